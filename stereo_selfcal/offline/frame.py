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

"""One frame of a recording: its data without the images, and its calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..bags import StereoFrame
from ..core.calibrator import Calibrator
from ..core.camera.frozen import refuse_frozen
from ..core.camera.rectifier import StereoRectifier
from ..core.drive.travel import MotionSince, SeenLandmarks
from ..core.drive.turn_topics import TurnMessage
from ..core.rejection import Bound, Rejection, RejectReason
from ..core.results import CalibrationResult, caught, refused_for, rejected


@dataclass(frozen=True, slots=True)
class FrameHead:
    """A frame without its images.

    Attributes:
        stamp_s: Header stamp of the left image [s].
        recorded_ns: When the left image was recorded [ns].
        name: Name of the left image where it has one.
        cameras: The cameras of the frame, None where there is one rig for all or they are not usable.
        frozen: Side of the image that is only the last one again, "" where both are new.
        turns: Messages of odometry and gyroscopes that were recorded since the frame before.
        moved: The motion since the frame before with landmarks, where it was estimated with the frame.
    """

    stamp_s: float
    recorded_ns: int
    name: str
    cameras: StereoRectifier | None = None
    frozen: str = ""
    turns: tuple[TurnMessage, ...] = ()
    moved: MotionSince | None = None

    @classmethod
    def of(cls, frame: StereoFrame) -> FrameHead:
        """Return the data of a frame without its images."""
        frozen = "" if frame.frozen is None else frame.frozen.side
        return cls(frame.stamp_s, frame.recorded_ns, frame.name, frame.cameras, frozen, frame.turns)


class FrameCalibrator:
    """Calibrates the frames of a recording, one after the other, each with the rig of its own cameras.

    A frame may start from the one before (:meth:`.Calibrator.calibrate_next`), unless its cameras differ.

    Args:
        calibrator: Has the settings, and the rig of frames that come without cameras of their own.
    """

    def __init__(self, calibrator: Calibrator) -> None:
        self._of_recording = self._current = calibrator
        self._seen: SeenLandmarks | None = None

    def calibrate(self, frame: StereoFrame) -> CalibrationResult:
        """Calibrate the next frame; refuse one without images or without cameras.

        One in which something comes up that was not foreseen is refused as well, and its result has the
        traceback.
        """
        return caught(lambda: _calibrate_frame(self._of(frame), frame), frame.stamp_s)

    def calibrate_slim(self, frame: StereoFrame) -> CalibrationResult:
        """Calibrate the next frame; keep everything but points and lines, which weigh as much as an image.

        The landmarks stay, which tell the motion to the next frame.
        """
        result = self.calibrate(frame)
        attempts = tuple(attempt.slim() for attempt in result.attempts)
        return replace(result.slim(), attempts=attempts, landmarks=result.landmarks)

    def motion_to(self, result: CalibrationResult) -> MotionSince | None:
        """Return the motion to a frame from the one before with landmarks; None where either has none.

        Args:
            result: Result of the frame, each of which is asked for in turn.
        """
        if result.landmarks is None:
            return None
        before, self._seen = self._seen, SeenLandmarks(result.stamp_s, result.landmarks)
        return None if before is None else MotionSince.between(before, result.landmarks, self._current.rig)

    def _of(self, frame: StereoFrame) -> Calibrator:
        """Return the calibrator of the rig of a frame; a new one where it is not that of the frame before."""
        rig = self._of_recording.rig if frame.cameras is None else frame.cameras.rig
        if rig != self._current.rig:
            self._current, self._seen = Calibrator(rig, self._of_recording.config), None
        return self._current


def _calibrate_frame(calibrator: Calibrator, frame: StereoFrame) -> CalibrationResult:
    if frame.fault is not None:
        return refused_for(frame.fault, frame.stamp_s)
    if frame.rig_problem and not frame.problem:
        unusable = Rejection(
            RejectReason.CAMERA_INFO_UNUSABLE,
            f"{{value}} of {{limit}} pairs of CameraInfo can be used ({frame.rig_problem})",
            0,
            Bound.LEAST,
            1,
            "",
            "publish the CameraInfo of a stereo calibration with these images",
        )
        return rejected(unusable, frame.stamp_s)
    if not frame.problem:
        frozen = refuse_frozen(frame.frozen, frame.left, frame.right)
        if frozen is not None:
            return rejected(frozen, frame.stamp_s)
        return calibrator.calibrate_next(frame.left, frame.right, frame.stamp_s, frame.stamp_difference_s)
    rejection = Rejection(
        RejectReason.IMAGE_UNREADABLE,
        f"{{value}} of {{limit}} pairs of images could be read ({frame.problem})",
        0,
        Bound.LEAST,
        1,
        "",
        "check the camera driver and the disk the recording was made on",
    )
    return rejected(rejection, frame.stamp_s)
