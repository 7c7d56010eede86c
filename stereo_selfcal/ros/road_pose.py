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

"""``~/road_pose``: the camera over the road at this moment, for subscribers only.

While somebody listens and a calibration is active, current frames are taken one by one, at most ten a second,
and the road is followed by the known camera (:class:`~stereo_selfcal.core.road_now.RoadTracker`). A frame
that is refused is not published; ``/diagnostics`` says why nothing comes. A call of ``~/calibrate`` has all
images, and nothing comes meanwhile.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from ..core.camera.pairing import stamp_to_s
from ..core.config import CalibratorConfig
from ..core.results import CalibrationResult
from ..core.road_now import RoadTracker
from ..files.frames import FrameNames, InfoFrames, place_camera
from .activation import other_cameras
from .calibration_keeper import ActiveCalibration
from .config import NodeConfig
from .live import LiveFrame, NoFrame
from .messages import pose_message
from .overrides import overridable_publisher
from .shutdown import silent_after_shutdown

TOPIC = "~/road_pose"
PERIOD_S = 0.1
# Frames of a faster camera are left out, by their stamps, which may be off by a tenth of the period.
_LEAST_APART_NS = round(0.9 * PERIOD_S * 1e9)
# How long one wait for a frame may take; its reason is reported then.
_PATIENCE_S = 1.0
# While nobody listens, somebody is looked for as often as this.
_LISTENERS_EVERY_S = 0.2
# A silence as long as this is reported with its reason: several frames have been refused.
SILENT_S = 1.0
_QUEUE = 10
_RATE_OVER = 20  # messages over which the rate is measured
NOT_CALIBRATED = "there is no active calibration: call ~/calibrate"
CALL_RUNNING = "a call of ~/calibrate has all images, or the node shuts down"


class RoadPosePublisher:
    """Follows the road and publishes the pose over it, in a thread of its own.

    Args:
        node: The node.
        take: Returns a current frame, why there is none, or None while a call has them all; its
            argument is how long it may wait [s].
        active: Returns the active calibration.
        config: Returns the parameters.
        clock: Steady time [s], for tests.
        infos: Returns what CameraInfo calls the cameras.
        leave: Called when no more frames are taken for a while.
    """

    def __init__(
        self,
        node: Node,
        take: Callable[[float], LiveFrame | NoFrame | None],
        active: Callable[[], ActiveCalibration | None],
        config: Callable[[], NodeConfig],
        clock: Callable[[], float] = time.monotonic,
        infos: Callable[[], InfoFrames] = InfoFrames,
        leave: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._leave = leave
        self._take = take
        self._active = active
        self._config = config
        self._infos = infos
        self._clock = clock
        self._publisher = overridable_publisher(node, PoseWithCovarianceStamped, TOPIC, _QUEUE)
        self._known: tuple[CalibrationResult, CalibratorConfig, RoadTracker] | None = None
        self._looked_at: deque[CalibrationResult] = deque(maxlen=4)
        self._sent_s: deque[float] = deque(maxlen=_RATE_OVER)
        self._since_s = self._clock()
        self._last_stamp_ns: int | None = None
        self._why = NOT_CALIBRATED
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="road_pose", daemon=True)

    def start(self) -> None:
        """Follow the road until :meth:`stop`."""
        self._thread.start()

    def stop(self) -> None:
        """End it and wait for it."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def wanted(self) -> bool:
        """Whether somebody listens."""
        with silent_after_shutdown(self._node.context):
            return bool(self._publisher.get_subscription_count())
        return False

    @property
    def described(self) -> str:
        """What is published, or why nothing is, one sentence."""
        if not self.wanted:
            return "nobody listens"
        sent = tuple(self._sent_s)
        silent_s = self._clock() - (sent[-1] if sent else self._since_s)
        if silent_s >= SILENT_S or not sent:
            return f"nothing is published: {self._why}"
        if len(sent) == 1:
            return "published"
        return f"published {(len(sent) - 1) / max(sent[-1] - sent[0], PERIOD_S):.1f} times a second"

    def compare(self, cold: CalibrationResult) -> None:
        """Take what the watch has found in a frame; returns at once.

        Args:
            cold: Result of a frame that was looked at as if nothing were known.
        """
        if cold.accepted:
            self._looked_at.append(cold.slim())

    def step(self) -> None:
        """Take a frame, follow the road in it, and publish its pose; or note why nothing is published."""
        active = self._active()
        if active is None:
            self._known, self._why = None, NOT_CALIBRATED
            self._leave()
            self._stopped.wait(_LISTENERS_EVERY_S)
            return
        frame = self._take(_PATIENCE_S)
        refused = self._refused(frame, active)
        if refused or not isinstance(frame, LiveFrame):
            self._why = refused
            self._stopped.wait(PERIOD_S)
            return
        if self._last_stamp_ns is not None and 0 <= frame.stamp_ns - self._last_stamp_ns < _LEAST_APART_NS:
            return
        self._last_stamp_ns = frame.stamp_ns
        tracker = self._tracker(active)
        while self._looked_at:
            tracker.compare(self._looked_at.popleft())
        result = tracker.follow(frame.left, frame.right, stamp_to_s(frame.stamp_ns), frame.stamp_difference_s)
        if not result.accepted:
            self._why = result.message
        elif self._active() is active:  # else a reset came meanwhile, or another calibration
            names, infos = self._config().frame_names, self._infos()
            self._publisher.publish(_message(result, active, names, infos, frame.stamp_ns))
            self._sent_s.append(self._clock())

    def _refused(self, frame: LiveFrame | NoFrame | None, active: ActiveCalibration) -> str:
        """Return why a frame cannot be looked at; "" where it can."""
        if frame is None:
            return CALL_RUNNING
        if isinstance(frame, NoFrame):
            return frame.reason
        if frame.refusal is not None:
            return frame.refusal.message
        return frame.problem or other_cameras(active.rig, frame.rig)

    def _tracker(self, active: ActiveCalibration) -> RoadTracker:
        """Return the tracker of the active calibration; a new one where that or the settings are new."""
        config = self._config().calibrator
        if self._known is None or self._known[:2] != (active.result, config):
            self._looked_at.clear()
            self._known = active.result, config, RoadTracker(active.rig, config, active.result)
        return self._known[2]

    def _run(self) -> None:
        delay_s, listened = 0.0, False
        while not self._stopped.wait(delay_s):
            begun_s, wanted = self._clock(), self.wanted
            delay_s = _LISTENERS_EVERY_S
            if wanted != listened:
                listened = wanted
                self._known, self._since_s = None, begun_s
                self._sent_s.clear()
                self._leave()
            if not wanted:
                continue
            try:
                delay_s = 0.0  # the next step waits for a frame
                self.step()
            except Exception as error:  # noqa: BLE001 - a frame that fails must not end the following
                delay_s = PERIOD_S
                self._known, self._why = None, f"internal error: {type(error).__name__}: {error}"
                if self._node.context.ok() and not self._stopped.is_set():
                    self._node.get_logger().error(
                        f"{TOPIC} failed on a frame:\n{traceback.format_exc()}", throttle_duration_sec=60.0
                    )


def _message(
    moment: CalibrationResult, active: ActiveCalibration, names: FrameNames, infos: InfoFrames, stamp_ns: int
) -> PoseWithCovarianceStamped:
    """Return the pose of a moment, with frame and layout of ``~/pose``: the yaw is that of the mount.

    Args:
        moment: An accepted result of one frame.
        active: The calibration of the mount.
        names: The frames as they are asked for.
        infos: What CameraInfo calls the cameras.
        stamp_ns: Stamp of the frame [ns].
    """
    placed = place_camera(replace(moment, travel=active.result.travel), active.rig, names, infos)
    return pose_message(placed, stamp_ns)
