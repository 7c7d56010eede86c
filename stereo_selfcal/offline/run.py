"""One recording from the first frame to the estimate: the path of replay, report and fleet alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..bags import StereoFrame
from ..core.calibrator import Calibrator
from ..core.config import CalibratorConfig
from ..core.results import CalibrationResult
from ..core.rig import StereoRig
from .recording import FrameSource
from .rows import FrameRow


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Outcome of a recording.

    Attributes:
        rows: One row per frame, in order, at least one.
        estimate: The accepted frames, fused.
        rig: The rig of the recording.
        config: Settings it was calibrated with.
    """

    rows: tuple[FrameRow, ...]
    estimate: CalibrationResult
    rig: StereoRig
    config: CalibratorConfig

    @property
    def shown(self) -> FrameRow:
        """The frame for a single picture: the last accepted one, or the last one when none was."""
        return next((row for row in reversed(self.rows) if row.accepted), self.rows[-1])


def calibrate_recording(
    source: FrameSource,
    config: CalibratorConfig | None = None,
    on_row: Callable[[FrameRow], None] = lambda row: None,
) -> Replay:
    """Calibrate every selected frame of a recording and fuse the accepted ones.

    At most two frames are in memory at a time; rows stay.

    Args:
        source: The recording, open.
        config: Settings, None for the defaults.
        on_row: Called after every frame, in order.

    Raises:
        SelfcalError: The recording cannot be read, or has no frame that is selected.
    """
    config = config or CalibratorConfig()
    calibrator = Calibrator(source.rig, config)
    rows: list[FrameRow] = []
    for frame in source.frames():
        result = calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
        calibrator.remember(result)
        rows.append(FrameRow.from_result(result, frame.stamp_s, frame.recorded_ns, frame.name))
        on_row(rows[-1])
    if not rows:
        raise ValueError("a recording of no frames cannot be calibrated")
    return Replay(tuple(rows), calibrator.estimate, source.rig, config)


def look_again(
    source: FrameSource, row: FrameRow, config: CalibratorConfig | None = None
) -> tuple[StereoFrame, CalibrationResult]:
    """Read a frame again and calibrate it again, for pictures: the images and all that was found in them.

    Args:
        source: The recording the row is of, open.
        row: The row.
        config: The settings it was calibrated with; same settings, same result.
    """
    frame = source.frame_at(row.recorded_ns)
    calibrator = Calibrator(source.rig, config)
    return frame, calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
