# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the node does: it calibrates a stereo camera on request, and watches the active calibration."""

from __future__ import annotations

import threading
import time
import traceback
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import qos_profile_parameters
from rclpy.qos_overriding_options import InvalidQosOverridesError
from std_srvs.srv import Trigger

from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.drive.kept_yaw import with_kept_yaw
from ..core.drive.states import Event, State
from ..core.errors import ConfigError, RigError
from ..core.faults import FaultLog
from ..core.lanes.lane_pair import LanePattern
from ..core.results import CalibrationResult
from ..core.types import Array
from ..files.frames import InfoFrames
from ..files.node_settings import NODE_NAME
from ..published.markers import lanes_on_road
from .activation import Activation, FoundCalibration, other_cameras
from .calibration import INTERRUPTED, RESET, CalibrationCall
from .calibration_keeper import CalibrationKeeper
from .call_progress import CallProgress
from .config import NodeConfig
from .diagnostics import CalibrationReport
from .frames import camera_frame, info_frames
from .inputs import StereoInput
from .live import LiveFrames, known_rig
from .memory import trim_heap
from .monitor import Monitor
from .odometry import TurnInput
from .outputs import Outputs
from .overrides import unused_start_values
from .pair_source import known_rectifier
from .parameters import NodeParameters
from .record import FrameRecord, FrameReport
from .reporter import DiagnosticsReporter
from .road_pose import RoadPosePublisher
from .shutdown import silent_after_shutdown
from .transform_report import TransformReport
from .turns_of_call import TurnsOfCall
from .views import Views

_RECALIBRATE = "recalibrate"
_FRAMES_EVERY_S = 1.0
_BUSY = "busy: a calibration is running; call again when it has answered"


class SelfcalNode:
    """Calibrates a stereo camera on request; docs/node.md describes its topics.

    It has a node instead of being one: rclpy's Node uses names such as ``_parameters`` and ``_clock``.

    Images are taken and paired in a thread of their own. A call of ``~/calibrate`` waits and computes in its
    own thread of the executor. Images, parameter services and diagnostics go on meanwhile. The watch computes
    in a thread of its own, too.

    Args:
        **kwargs: Passed to rclpy's Node.

    Raises:
        ConfigError: A parameter given at the start is wrong.
    """

    def __init__(self, **kwargs: Any) -> None:
        self.node = _node(**kwargs)
        with ExitStack() as failed:
            failed.callback(self.node.destroy_node)  # else half a node would answer under its name
            self._parameters = NodeParameters(self.node, self._on_parameters)
            self._input = StereoInput(self.node, self._parameters.config)
            self._turns = TurnInput(self.node, self._parameters.config)
            self._live = LiveFrames(self._input, lambda: self._parameters.config)
            self._outputs = Outputs(self.node, self._parameters)
            self._calibrating = threading.Lock()
            self._record = FrameRecord()
            self._faults = FaultLog(self.node.get_logger().error)
            self._last_lines: tuple[LanePattern, StereoRig] | None = None
            self._keeper = CalibrationKeeper()
            self._activation = Activation(
                self.node,
                self._parameters,
                self._outputs,
                self._keeper,
                self._input.topics,
                lambda: info_frames(self._input, self._parameters.config),
            )
            self._call: CalibrationCall | None = None
            self._last_answer = "not called yet"
            self._last_success: bool | None = None
            self._views = Views(
                self.node,
                self._live.one,
                lambda: self._keeper.active,
                lambda: self._parameters.config,
                lambda: camera_frame(self._input, self._parameters.config),
            )
            self._road_pose = RoadPosePublisher(
                self.node,
                self._live.next,
                lambda: self._keeper.active,
                lambda: self._parameters.config,
                infos=lambda: info_frames(self._input, self._parameters.config) or InfoFrames(),
                leave=self._live.close,
            )
            self._reporter = DiagnosticsReporter(
                self.node, self._input, lambda: self._parameters.config, self._calibration_report
            )
            self.node.create_service(
                Trigger,
                "~/calibrate",
                self._on_calibrate,
                # The queue of the parameter services, 1000. With that of other services, 10, ten of twenty
                # simultaneous calls got no answer.
                qos_profile=qos_profile_parameters,
                callback_group=ReentrantCallbackGroup(),
            )
            # A group of its own: resets come one after the other, and none of them takes a thread to wait.
            self.node.create_service(
                Trigger, "~/reset", self._on_reset, callback_group=MutuallyExclusiveCallbackGroup()
            )
            self._monitor = Monitor(
                self._live.one,
                lambda: self._parameters.config,
                self._check_cameras,
                self._on_watched,
                self.node.context.ok,
                self.node.get_logger(),
            )
            # In the default callback group, in which results are published.
            self.node.create_timer(
                _FRAMES_EVERY_S, self._follow_frames, clock=Clock(clock_type=ClockType.STEADY_TIME)
            )
            for text in unused_start_values(self.node):
                self.node.get_logger().warning(text)
            self._activation.restore()
            topics = self._input.topics
            self.node.get_logger().info(f"listening to {topics.left} and {topics.right}; call ~/calibrate")
            failed.pop_all()
        self._input.start()
        self._views.start()
        self._road_pose.start()
        self._monitor.start()

    def stop(self) -> None:
        """End a running call, the watch, the road and the pictures: the node shuts down."""
        self._input.stop()
        self._monitor.cancel()
        self._outputs.stop()  # the watch may be waiting for them
        self._monitor.stop()
        self._road_pose.stop()
        self._views.stop()

    def _on_parameters(self, config: NodeConfig) -> None:
        self._input.configure(config)

    def _on_calibrate(self, _request: Any, response: Any) -> Any:
        if not self._calibrating.acquire(blocking=False):
            response.success, response.message = False, _BUSY
            return response
        try:
            config = self._parameters.config
            turns = TurnsOfCall(self._turns.topics)
            call = CalibrationCall(self._input, config, self._on_frame, self._on_progress, turns)
            self._call = call  # a reset ends it from here on
            self._keeper.begin()
            with self._turns.heard_by(turns.hear):
                response.success, response.message = self._calibrate(call, config)
        except Exception as error:  # noqa: BLE001 - the caller gets an answer and the node goes on
            response.success, response.message = False, self._explain_failure(error)
        finally:
            self._call = None
            self._keeper.fail()  # does nothing after a success
            self._last_success, self._last_answer = response.success, response.message
            self._calibrating.release()
        # Two calls, because rclpy refuses to log with another severity from the same line.
        if response.success:
            self.node.get_logger().info(response.message)
        else:
            self.node.get_logger().warning(response.message)
        return response

    def _calibrate(self, call: CalibrationCall, config: NodeConfig) -> tuple[bool, str]:
        """Return success and message of one call."""
        self._last_lines = None
        with self._live.all():
            outcome = call.run()
        trim_heap()
        result, rig, message = outcome.result, outcome.rig, outcome.message
        if result is None or rig is None:
            return False, message
        active = self._keeper.active
        same = active is not None and not other_cameras(active.rig, rig)
        if not outcome.reached:
            better, why = self._keeper.compare(result, config.targets, same_cameras=same)
            if not better:
                return False, f"not activated, as {why}: {message}"
            message += f"; activated all the same, as {why}"
        if active is not None and same:
            kept = with_kept_yaw(result, active.result)
            message += kept.message.removeprefix(result.message)
            result = kept
        found = FoundCalibration(result, rig, outcome.stamp_ns, outcome.cameras, self._lanes(result))
        saved = self._activation.activate(found, config, lambda: not call.cancelled)
        return (False, RESET) if saved is None else (True, f"{message}; {saved}")

    def _on_progress(self, progress: CallProgress) -> None:
        """Log the progress of a call; called by its thread, once a second while frames come."""
        if self.node.context.ok():  # after a shutdown everything fails
            self.node.get_logger().info(progress.text)

    def _on_reset(self, _request: Any, response: Any) -> Any:
        try:
            call = self._call
            if call is not None:
                call.cancel()
            told, response.success = self._activation.reset()
            self._last_success = None
            response.message = told if call is None else f"the running call is ended; {told}"
            self.node.get_logger().info(f"~/reset: {response.message}")
        except Exception as error:  # noqa: BLE001 - the caller gets an answer and the node goes on
            response.success, response.message = False, self._explain_failure(error)
        return response

    def _explain_failure(self, error: Exception) -> str:
        """Return the answer of a service that failed, and log the traceback; in an ``except`` clause."""
        if not self.node.context.ok():  # after a shutdown everything fails
            return INTERRUPTED
        self.node.get_logger().error(traceback.format_exc())
        return f"internal error, see the node's log: {type(error).__name__}: {error}"

    def _check_cameras(self) -> bool:
        """Withdraw the active calibration if it is of other cameras. Return whether to watch."""
        config, active = self._parameters.config, self._keeper.active
        if self._keeper.state is State.CALIBRATING:
            return False
        if active is None:
            return config.on_drift == _RECALIBRATE
        problem = other_cameras(active.rig, self._known_rig(config))
        if problem:
            self.node.get_logger().warning(f"the calibration is taken back: {problem}")
            self._activation.withdraw(problem)
        return not problem

    def _follow_frames(self) -> None:
        """Have the transform follow the names of frames; that of other cameras the watch takes back."""
        config, active = self._parameters.config, self._keeper.active
        infos = info_frames(self._input, config)
        with silent_after_shutdown(self.node.context):
            if active and infos is not None and not other_cameras(active.rig, self._known_rig(config)):
                self._activation.follow_frames(infos)

    def _known_rig(self, config: NodeConfig) -> StereoRig | None:
        try:
            return known_rig(self._input, config)
        except RigError:  # /diagnostics reports it
            return None

    def _cameras_of(self, rig: StereoRig, config: NodeConfig) -> StereoRectifier | None:
        """Return the cameras that are known now, None where they are not those of this rig."""
        try:
            cameras = known_rectifier(self._input, config)
        except RigError:
            return None
        found = (cameras, None if cameras is None else cameras.whole)
        return next((each for each in found if each is not None and each.rig == rig), None)

    def _on_frame(self, report: FrameReport) -> None:
        """Count and show a frame that was calibrated; called by the thread of the call."""
        self._count(report)
        self._views.show(report)
        self._remember_lines(report)

    def _count(self, report: FrameReport) -> None:
        self._record.add(report)
        if self.node.context.ok():  # after a shutdown everything fails
            self._faults.note(report.result.fault, report.result.stamp_s)

    def _on_watched(self, report: FrameReport) -> None:
        """Give a frame to the watch; called by its thread."""
        self._count(report)
        if report.rig is None:
            return
        self._road_pose.compare(report.result)
        turned = self._keeper.alignment.message
        resets = self._keeper.resets
        event = self._keeper.watched(report.result, report.rig)
        if not turned and self._keeper.alignment.message:
            self.node.get_logger().warning(self._keeper.alignment.message)
        if event is Event.CONFIRMED:
            self.node.get_logger().info(f"{self._keeper.state}: {self._keeper.reason}")
        elif event is Event.REFUTED:
            self.node.get_logger().error(f"{self._keeper.state}: {self._keeper.reason}")
        elif event is not None:
            self.node.get_logger().warning(f"{self._keeper.state}: {self._keeper.reason}")
        config = self._parameters.config
        if config.on_drift != _RECALIBRATE or not self._keeper.wants_another:
            return
        better = self._keeper.proposal(report.rig)
        if better is None:
            return
        active = self._keeper.active
        if active is not None and not other_cameras(active.rig, report.rig):
            better = with_kept_yaw(better, active.result)
        self._remember_lines(report)
        cameras = self._cameras_of(report.rig, config)
        found = FoundCalibration(
            better, report.rig, report.stamp_ns, cameras, self._lanes(better), by_watch=True
        )
        saved = self._activation.activate(found, config, lambda: self._keeper.resets == resets)
        if saved is not None:
            self.node.get_logger().info(f"recalibrated by the watch: {better.message}; {saved}")

    def _remember_lines(self, report: FrameReport) -> None:
        if report.rig is not None and report.result.pattern is not None and report.result.accepted:
            self._last_lines = report.result.pattern, report.rig

    def _lanes(self, result: CalibrationResult) -> tuple[Array, ...]:
        """Return the lane lines of the last accepted frame, projected to the road by the result."""
        if self._last_lines is None or result.extrinsics is None:
            return ()
        return lanes_on_road(*self._last_lines, result.extrinsics)

    def _calibration_report(self) -> CalibrationReport:
        active, config, call = self._keeper.active, self._parameters.config, self._call
        return CalibrationReport(
            state=str(self._keeper.state),
            reason=self._keeper.reason,
            watch=self._keeper.explain() if config.monitor_period_s else "off: monitor_period_s is 0",
            active=active,
            age_s=0.0 if active is None else time.monotonic() - active.since_s,
            last_answer=self._last_answer,
            last_success=self._last_success,
            frames=self._record.statistics,
            alignment=self._keeper.alignment,
            road_pose=self._road_pose.described,
            transform=TransformReport(self._activation.placed, self._activation.told),
            progress=None if call is None else call.progress,
        )


def _node(**kwargs: Any) -> Node:
    """Make the node; what ROS itself does not take (``use_sim_time:=5``) is a ConfigError as our own."""
    try:
        return Node(NODE_NAME, **kwargs)
    except (ParameterException, InvalidQosOverridesError, RuntimeError, ValueError, TypeError) as error:
        raise ConfigError(f"the node cannot be made: {' '.join(str(error).split())}") from error
