"""What the node does: listens to a stereo camera, calibrates on request, publishes and saves the result."""

from __future__ import annotations

import threading
import time
import traceback
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import qos_profile_parameters
from std_srvs.srv import Trigger

from ..core.errors import OutputError
from ..core.extrinsics import Array
from ..core.pattern import LanePattern
from ..core.results import CalibrationResult
from ..core.rig import StereoRig
from ..exports import write_exports
from ..node_settings import NODE_SETTINGS
from ..result_file import NODE_NAME, write_result
from .calibration import Outcome
from .config import NodeConfig
from .diagnostics import CalibrationReport
from .inputs import StereoInput
from .live import LiveFrames
from .markers import lanes_on_road
from .outputs import Outputs, Publication
from .parameters import NodeParameters
from .record import FrameRecord, FrameReport, InForce, ReportingCall
from .reporter import DiagnosticsReporter
from .views import Views

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
        with ExitStack() as failed:
            failed.callback(self.node.destroy_node)  # half a node would answer to its name
            self._parameters = NodeParameters(self.node, self._on_parameters)
            self._input = StereoInput(self.node, self._parameters.config)
            self._live = LiveFrames(self._input, lambda: self._parameters.config)
            self._outputs = Outputs(self.node, self._parameters)
            self._calibrating = threading.Lock()
            self._record = FrameRecord()
            self._last_lines: tuple[LanePattern, StereoRig] | None = None
            self._in_force: InForce | None = None
            self._last_answer = "not called yet"
            self._last_success: bool | None = None
            self._views = Views(
                self.node, self._live.one, lambda: self._in_force, lambda: self._parameters.config
            )
            self._reporter = DiagnosticsReporter(
                self.node, self._input, lambda: self._parameters.config, self._calibration_report
            )
            self.node.create_service(
                Trigger,
                "~/calibrate",
                self._on_calibrate,
                # As the parameter services have it, a queue of 1000: with the 10 of other services, ten of
                # twenty calls at once got no answer.
                qos_profile=qos_profile_parameters,
                callback_group=ReentrantCallbackGroup(),
            )
            topics = self._input.topics
            self.node.get_logger().info(f"listening to {topics.left} and {topics.right}; call ~/calibrate")
            failed.pop_all()
        self._views.start()

    def stop(self) -> None:
        """End a running call and the pictures: the node shuts down."""
        self._input.stop()
        self._views.stop()

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
        self._last_lines = None
        with self._live.all() as frames:
            outcome = ReportingCall(frames, config, self._on_frame).run()
        result, rig = outcome.result, outcome.rig
        if result is None or rig is None:
            return False, outcome.message
        self._outputs.publish(Publication(result, config, outcome.stamp_ns, self._lanes(result)))
        # In effect from here on, saved or not.
        since_s = time.monotonic()
        self._in_force = InForce(result, rig, since_s, saved="not yet")
        saved, save_failed = self._try_to_save(outcome, config)
        self._in_force = InForce(result, rig, since_s, saved, save_failed)
        return True, f"{outcome.message}; {saved}"

    def _on_frame(self, report: FrameReport) -> None:
        """Remember a frame that was calibrated; called by the thread of the call."""
        self._record.add(report)
        self._views.show(report)
        if report.result.accepted and report.result.pattern is not None:
            self._last_lines = report.result.pattern, report.rig

    def _lanes(self, result: CalibrationResult) -> tuple[Array, ...]:
        """Return the lane lines of the last accepted frame on the road of the result."""
        if self._last_lines is None or result.extrinsics is None:
            return ()
        return lanes_on_road(*self._last_lines, result.extrinsics)

    def _calibration_report(self) -> CalibrationReport:
        in_force = self._in_force
        state = "uncalibrated" if in_force is None else "calibrated"
        return CalibrationReport(
            state="calibrating" if self._calibrating.locked() else state,
            in_force=in_force,
            age_s=0.0 if in_force is None else time.monotonic() - in_force.since_s,
            last_answer=self._last_answer,
            last_success=self._last_success,
            frames=self._record.statistics,
        )

    def _try_to_save(self, outcome: Outcome, config: NodeConfig) -> tuple[str, bool]:
        """Save the result; return what came of it, and whether it failed."""
        if config.output_path is None:
            return "not saved, as output_path is empty", False
        try:
            self._save(outcome, config, config.output_path)
        except OutputError as error:
            return f"in effect, but not saved: {error}", True
        return f"saved to {config.output_path}{self._export(outcome, config, config.output_path)}", False

    @staticmethod
    def _export(outcome: Outcome, config: NodeConfig, path: Path) -> str:
        """Write the exports; return what is to be said of them."""
        if not config.exports:
            return ""
        assert (
            outcome.result is not None and outcome.result.extrinsics is not None and outcome.rig is not None
        )
        extrinsics, frames = outcome.result.extrinsics, (config.road_frame, config.camera_frame)
        try:
            write_exports(path, config.exports, extrinsics, outcome.rig, *frames)
        except OutputError as error:
            return f", but not every export: {error}"
        return f" with {', '.join(config.exports)}"

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


def _default_output_path() -> Path:
    default = next(setting.default for setting in NODE_SETTINGS if setting.name == "output_path")
    return Path(str(default)).expanduser()
