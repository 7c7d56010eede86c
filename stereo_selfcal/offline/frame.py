"""One frame of a recording: its data without the images, and its calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..bags import StereoFrame
from ..core.calibrator import Calibrator
from ..core.rejection import Bound, Rejection, RejectReason
from ..core.results import CalibrationResult, rejected


@dataclass(frozen=True, slots=True)
class FrameHead:
    """A frame without its images.

    Attributes:
        stamp_s: Header stamp of the left image [s].
        recorded_ns: When the left image was recorded [ns].
        name: Name of the left image where it has one.
    """

    stamp_s: float
    recorded_ns: int
    name: str

    @classmethod
    def of(cls, frame: StereoFrame) -> FrameHead:
        """Return the data of a frame without its images."""
        return cls(frame.stamp_s, frame.recorded_ns, frame.name)


def calibrate_frame(calibrator: Calibrator, frame: StereoFrame) -> CalibrationResult:
    """Calibrate a frame; one whose images could not be converted is refused for that."""
    if not frame.problem:
        return calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
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


def calibrate_frame_slim(calibrator: Calibrator, frame: StereoFrame) -> CalibrationResult:
    """Calibrate a frame; keep everything but points and lines, which weigh as much as an image."""
    result = calibrate_frame(calibrator, frame)
    return replace(result.slim(), attempts=tuple(attempt.slim() for attempt in result.attempts))
