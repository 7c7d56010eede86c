"""The ROS 2 node: subscribes to a stereo camera, calibrates on request, publishes and saves the result."""

from __future__ import annotations

import argparse
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.utilities import remove_ros_args
from std_srvs.srv import Trigger

from ..core.errors import ConfigError, OutputError, SelfcalError
from ..node_settings import NODE_SETTINGS
from ..result_file import NODE_NAME, result_parameters, write_result
from .calibration import CalibrationCall, Outcome
from .config import NodeConfig
from .inputs import StereoInput
from .messages import diagnostics_message, extrinsics_message, pose_message
from .parameters import NodeParameters

# Parameter services and timer, images, one call of ~/calibrate that waits, and one that is told "busy".
_THREADS = 4
_DIAGNOSTICS_PERIOD_S = 1.0
# The default callback group runs only short work; longer than this means it hangs.
_PUBLISH_TIMEOUT_S = 10.0
# Fast DDS crashed in 2 of some 440 measured ends when a service was destroyed while the
# acknowledgement of its last answer may have been on its way; with the pause in none of 571.
_CALM_S = 0.2
_EXIT_BAD_USAGE = 2
_LATCHED = QoSProfile(
    depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
)
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
        self._calibrating = threading.Lock()
        self._extrinsics = self.node.create_publisher(ParameterEvent, "~/extrinsics", _LATCHED)
        self._pose = self.node.create_publisher(PoseWithCovarianceStamped, "~/pose", _LATCHED)
        self._diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.node.create_service(
            Trigger, "~/calibrate", self._on_calibrate, callback_group=ReentrantCallbackGroup()
        )
        # Published from the default callback group, in which the parameter services run.
        self._to_publish: _Publication | None = None
        self._publish_guard = self.node.create_guard_condition(self._on_publish)
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
        self._publish(outcome, config)
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

    def _publish(self, outcome: Outcome, config: NodeConfig) -> None:
        """Set the parameters and publish the messages, and wait until it is done."""
        publication = _Publication(outcome, config)
        self._to_publish = publication
        self._publish_guard.trigger()
        if not publication.done.wait(_PUBLISH_TIMEOUT_S):
            raise TimeoutError(f"the result was not published within {_PUBLISH_TIMEOUT_S} s")
        if publication.error is not None:
            raise publication.error

    def _on_publish(self) -> None:
        publication, self._to_publish = self._to_publish, None
        if publication is None:
            return
        outcome, config = publication.outcome, publication.config
        result = outcome.result
        try:
            assert result is not None and result.extrinsics is not None and result.covariance is not None
            parameters = result_parameters(result)
            pose = pose_message(result.extrinsics, result.covariance, config.road_frame, outcome.stamp_ns)
            event = extrinsics_message(self.node.get_fully_qualified_name(), outcome.stamp_ns, parameters)
            self._parameters.publish_result(parameters)
            self._extrinsics.publish(event)
            self._pose.publish(pose)
        except Exception as error:  # noqa: BLE001 - raised again in the thread of the call
            publication.error = error
        finally:
            publication.done.set()

    def _on_diagnostics_timer(self) -> None:
        now_s, counts = time.monotonic(), self._input.state.counts
        before, before_s = self._reported
        self._reported = (counts, now_s)
        added, elapsed_s = counts.since(before), max(now_s - before_s, 1e-3)
        values = {
            "state": "calibrating" if self._calibrating.locked() else "idle",
            "left_rate_hz": f"{added.left / elapsed_s:.1f}",
            "right_rate_hz": f"{added.right / elapsed_s:.1f}",
            "pair_rate_hz": f"{added.pairs / elapsed_s:.1f}",
            **{name: str(getattr(counts, name)) for name in counts.__slots__},
            "last_answer": self._last_answer,
            "camera_frame": self._parameters.config.camera_frame,
        }
        level, text = DiagnosticStatus.OK, f"{values['pair_rate_hz']} pairs per second; {self._last_answer}"
        if not added.pairs:
            level = DiagnosticStatus.WARN
            text = f"no pairs: left {values['left_rate_hz']} Hz, right {values['right_rate_hz']} Hz"
        elif self._last_success is False:
            level = DiagnosticStatus.WARN
        message = diagnostics_message(
            self.node.get_clock().now().to_msg(),
            f"{self.node.get_fully_qualified_name()}: calibration",
            self._parameters.config.camera_frame,
            level,
            text,
            values,
        )
        try:
            self._diagnostics.publish(message)
        except RuntimeError:  # rcl's errors
            if self.node.context.ok():  # Ctrl-C may come at any moment; then there is nobody to tell
                raise


class _Publication:
    """A result on its way from the thread of a call to the default callback group."""

    def __init__(self, outcome: Outcome, config: NodeConfig) -> None:
        self.outcome = outcome
        self.config = config
        self.done = threading.Event()
        self.error: Exception | None = None


def _default_output_path() -> Path:
    default = next(setting.default for setting in NODE_SETTINGS if setting.name == "output_path")
    return Path(str(default)).expanduser()


class _Executor(MultiThreadedExecutor):  # type: ignore[misc]
    """Executor that can be waited for."""

    def finish(self) -> None:
        """Wait for the callbacks in flight, before the node is taken from under them.

        ``shutdown()`` of rclpy 7 is meant to wait and does not.
        """
        pool = getattr(self, "_executor", None)
        if pool is not None:
            pool.shutdown(wait=True)


def _spin(executor: MultiThreadedExecutor) -> None:
    """Run callbacks until the context is shut down (Ctrl-C, SIGTERM)."""
    while executor.context.ok():
        try:
            executor.spin_once()
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception:  # noqa: BLE001 - one bad request (a parameter of unknown type) must not end the node
            if executor.context.ok():
                for node in executor.get_nodes():
                    node.get_logger().error(f"a callback failed:\n{traceback.format_exc()}")


def _run(arguments: list[str]) -> None:
    """Start ROS and run the node until it is told to end."""
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:
        raise ConfigError(f"ROS does not start: {_one_line(error)}") from error
    try:
        selfcal = SelfcalNode()
        executor = _Executor(_THREADS)
        executor.add_node(selfcal.node)
        try:
            _spin(executor)
        finally:
            selfcal.stop()
            executor.finish()
            time.sleep(_CALM_S)
            executor.shutdown()
            selfcal.node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _without_ros_arguments(arguments: list[str]) -> list[str]:
    try:
        return list(remove_ros_args(arguments))
    except RuntimeError as error:  # rcl has several, all of them this
        raise ConfigError(f"wrong ROS arguments: {_one_line(error)}") from error


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C or SIGTERM.

    Args:
        args: Arguments without the program name, None for those of the process.

    Returns:
        Exit status: 0 after Ctrl-C or SIGTERM, 2 after a wrong argument or parameter.
    """
    arguments = list(sys.argv[1:] if args is None else args)
    parser = argparse.ArgumentParser(
        prog="node",
        description="Calibrate a stereo camera on request: subscribes to left and right image_rect and "
        "their camera_info, answers ~/calibrate. Parameters, remappings: --ros-args -p NAME:=VALUE -r A:=B.",
    )
    try:
        parser.parse_args(_without_ros_arguments(arguments))
        _run(arguments)
    except KeyboardInterrupt:
        pass
    except SelfcalError as error:
        sys.stderr.write(f"{NODE_NAME}: {error}\n")
        return _EXIT_BAD_USAGE
    return 0


if __name__ == "__main__":
    sys.exit(main())
