"""What the node does: listens to a stereo camera, calibrates on request, publishes and saves the result."""

from __future__ import annotations

import threading
import time
import traceback
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from ..core.errors import OutputError
from ..node_settings import NODE_SETTINGS
from ..result_file import NODE_NAME, write_result
from .calibration import CalibrationCall, Outcome
from .config import NodeConfig
from .diagnostics import Snapshot, diagnostics_message
from .inputs import StereoInput
from .outputs import Outputs, Publication
from .parameters import NodeParameters

_DIAGNOSTICS_PERIOD_S = 1.0
_BUSY = "busy: a calibration is running; call again when it has answered"


class SelfcalNode:
    """Calibrates a stereo camera on request; README.md describes its topics and parameters.

    It has a node instead of being one, as rclpy's Node claims names such as ``_parameters`` and ``_clock``.

    Images are paired in their own callback group. A call of ``~/calibrate`` waits and computes in
    its own thread of the executor, so images, parameter services and diagnostics go on meanwhile.

    Args:
        **kwargs: Passed to rclpy's Node.

    Raises:
        ConfigError: A parameter given at the start is wrong.
    """

    def __init__(self, **kwargs: Any) -> None:
        self.node = Node(NODE_NAME, **kwargs)
        self._parameters = NodeParameters(self.node, self._on_parameters)
        self._input = StereoInput(self.node, self._parameters.config)
        self._outputs = Outputs(self.node, self._parameters)
        self._calibrating = threading.Lock()
        self._diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.node.create_service(
            Trigger, "~/calibrate", self._on_calibrate, callback_group=ReentrantCallbackGroup()
        )
        self._last_answer = "not called yet"
        self._last_success: bool | None = None
        self._reported = (self._input.state.counts, time.monotonic())
        # On the steady clock: a simulation that stands still must not silence the diagnostics.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(_DIAGNOSTICS_PERIOD_S, self._on_diagnostics_timer, clock=clock)
        topics = self._input.topics
        self.node.get_logger().info(f"listening to {topics.left} and {topics.right}; call ~/calibrate")

    def stop(self) -> None:
        """End a running call: the node shuts down."""
        self._input.stop()

    def _on_parameters(self, config: NodeConfig) -> None:
        self._input.configure(config)

    def _on_calibrate(self, _request: Any, response: Any) -> Any:
        if not self._calibrating.acquire(blocking=False):
            response.success, response.message = False, _BUSY
            return response
        try:
            response.success, response.message = self._calibrate(self._parameters.config)
        except Exception as error:  # noqa: BLE001 - whatever it is, the caller gets an answer and the node lives
            if self.node.context.ok():  # after a shutdown everything fails, which is no news
                self.node.get_logger().error(traceback.format_exc())
            response.success = False
            response.message = f"internal error, see the node's log: {type(error).__name__}: {error}"
        finally:
            self._last_success, self._last_answer = response.success, response.message
            self._calibrating.release()
        # Two lines on purpose: rclpy refuses to log with another severity from the same line.
        if response.success:
            self.node.get_logger().info(response.message)
        else:
            self.node.get_logger().warning(response.message)
        return response

    def _calibrate(self, config: NodeConfig) -> tuple[bool, str]:
        """Return success and message of one call."""
        self._input.begin()
        try:
            outcome = CalibrationCall(self._input, config).run()
        finally:
            self._input.end()
        if outcome.result is None or outcome.rig is None:
            return False, outcome.message
        self._outputs.publish(Publication(outcome.result, config.road_frame, outcome.stamp_ns))
        if config.output_path is None:
            return True, f"{outcome.message}; not saved, as output_path is empty"
        try:
            self._save(outcome, config, config.output_path)
        except OutputError as error:
            return True, f"{outcome.message}; in effect, but not saved: {error}"
        return True, f"{outcome.message}; saved to {config.output_path}"

    def _save(self, outcome: Outcome, config: NodeConfig, path: Path) -> None:
        assert outcome.result is not None and outcome.rig is not None
        if path == _default_output_path():
            # ROS makes its folder when it first logs, which may be later. Others are the user's.
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(
                    f"{path.parent} cannot be made: {error.strerror}; set output_path"
                ) from error
        topics = self._input.topics
        source = f"{topics.left} {topics.right}"
        write_result(path, outcome.result, outcome.rig, source=source, seed=config.calibrator.seed)

    def _on_diagnostics_timer(self) -> None:
        now_s, counts = time.monotonic(), self._input.state.counts
        before, before_s = self._reported
        self._reported = (counts, now_s)
        snapshot = Snapshot(
            node=self.node.get_fully_qualified_name(),
            camera_frame=self._parameters.config.camera_frame,
            calibrating=self._calibrating.locked(),
            counts=counts,
            before=before,
            elapsed_s=now_s - before_s,
            last_answer=self._last_answer,
            last_success=self._last_success,
        )
        try:
            self._diagnostics.publish(diagnostics_message(self.node.get_clock().now().to_msg(), snapshot))
        except RuntimeError:  # rcl's errors
            if self.node.context.ok():  # Ctrl-C may come at any moment; then there is nobody to tell
                raise


def _default_output_path() -> Path:
    default = next(setting.default for setting in NODE_SETTINGS if setting.name == "output_path")
    return Path(str(default)).expanduser()
