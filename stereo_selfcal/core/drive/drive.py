"""The estimate of a drive: fused frames, the motion of the car, and the pose after each move of the mount."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, total_covariance
from ..results import CalibrationResult, announce
from ..types import Array
from .changes import find_changes
from .fusion import AcceptedFrame, fuse_frames, own_covariance
from .rig_doubt import with_doubt_of_rig

# Stamps from 2001 on come from a clock. Smaller stamps count from the start of a simulation.
FIRST_CLOCK_S = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class DriveSegment:
    """A part of a drive in which the mount did not move.

    Attributes:
        start_s: Stamp of its first accepted frame [s].
        end_s: Stamp of its last accepted frame [s].
        estimate: Fused estimate of its accepted frames.
        spread: Standard deviation of its frames over time, caused by the car's motion on its suspension and
            by the noise of the frames.
        standard_error: Standard error of the mean that this spread causes; None where the segment is shorter
            than half a minute, which is too short to measure how long the motion lasts.
    """

    start_s: float
    end_s: float
    estimate: CalibrationResult
    spread: Extrinsics
    standard_error: Extrinsics | None


@dataclass(frozen=True, slots=True, eq=False)
class DriveChange:
    """A move of the mount.

    Attributes:
        at_s: Time of the move [s].
        within_s: Distance from ``at_s`` within which the move lies with a probability of 95 % [s].
        before: Pose of the segment before the move.
        after: Pose of the segment after the move.
        sigmas: (3,) changes of height, pitch and roll over their standard errors.
    """

    at_s: float
    within_s: float
    before: Extrinsics
    after: Extrinsics
    sigmas: Array

    @property
    def shift(self) -> Extrinsics:
        """Change of height, pitch and roll."""
        return Extrinsics.from_array(self.after.as_array() - self.before.as_array())


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The poses of the mount during a drive.

    Attributes:
        estimate: Pose at the end of the drive, that of the last segment; the refusal of the last frame where
            no frame was accepted.
        segments: Parts in which the mount did not move, in order; none where no frame was accepted.
        changes: Moves between the segments.
        judged: Whether the drive is long enough to distinguish a move from motion.
    """

    estimate: CalibrationResult
    segments: tuple[DriveSegment, ...] = ()
    changes: tuple[DriveChange, ...] = ()
    judged: bool = False


def estimate_drive(frames: Sequence[AcceptedFrame], rig: StereoRig, fused: CalibrationResult) -> Drive:
    """Find the moves of the mount in a drive, and its pose between them.

    Args:
        frames: Accepted frames of the drive, in any order.
        rig: The rig that the frames come from.
        fused: :attr:`.Calibrator.estimate` of all frames of the drive.

    Returns:
        The given estimate where the drive is too short to distinguish a move from motion. Otherwise every
        segment is fused with weights that include the motion, and the covariance includes the error of the
        mean that the motion causes.
    """
    if not frames or not fused.accepted:
        return Drive(fused)
    frames = sorted(frames, key=lambda frame: frame.stamp_s)
    poses = np.array([frame.extrinsics.as_array() for frame in frames if frame.extrinsics is not None])
    covariances = np.array([own_covariance(frame) for frame in frames])
    stamps_s = np.array([frame.stamp_s for frame in frames])
    history = find_changes(stamps_s, poses, covariances)
    segments = []
    for part in history.segments:
        error = (
            None
            if part.standard_error is None
            else Extrinsics.from_array(np.sqrt(np.diag(part.standard_error)))
        )
        estimate = fused
        if history.judged and part.standard_error is not None:
            noise = np.median(np.diagonal(covariances[part.first : part.end], axis1=1, axis2=2), axis=0)
            motion = np.diag(np.maximum(part.spread**2 - noise, 0.0))
            estimate = fuse_frames(frames[part.first : part.end], rig, motion)
            if estimate.covariance is not None:
                terms = (*estimate.uncertainty, UncertaintyTerm("motion", part.standard_error))
                uncertainty = merge_terms(terms)
                estimate = replace(
                    estimate, covariance=total_covariance(uncertainty), uncertainty=uncertainty
                )
            n_outliers = part.end - part.first - estimate.n_frames
            # The alignment and the delay are those of the rig, whatever the mount does.
            estimate = replace(estimate, alignment=fused.alignment, delay=fused.delay)
            if not history.changes:
                estimate = replace(estimate, travel=fused.travel)
            estimate = replace(estimate, message=announce(estimate, n_outliers))
            estimate = with_doubt_of_rig(estimate, rig, n_outliers)
        spread = Extrinsics.from_array(part.spread)
        segments.append(DriveSegment(part.start_s, part.end_s, estimate, spread, error))
    changes = []
    for change, before, after in zip(history.changes, segments, segments[1:], strict=False):
        old, new = before.estimate.extrinsics, after.estimate.extrinsics
        if old is not None and new is not None:  # always true, because accepted frames were fused
            changes.append(DriveChange(change.at_s, change.within_s, old, new, change.sigmas))
    last = segments[-1].estimate
    if changes:
        last = replace(
            last, message=f"{last.message}; since the camera was moved at {clock(changes[-1].at_s)}"
        )
    return Drive(last, tuple(segments), tuple(changes), history.judged)


def clock(stamp_s: float) -> str:
    """Return a stamp as people read it: UTC where it comes from a clock, seconds where it does not."""
    if stamp_s < FIRST_CLOCK_S:
        return f"{stamp_s:.1f} s"
    return datetime.fromtimestamp(stamp_s, timezone.utc).strftime("%H:%M:%S UTC")
