"""The estimate of a drive: frames fused, the car's motion beside it, and where the camera is since a move."""

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
from .fusion import AcceptedFrame, fuse_frames

# Stamps from 2001 on are of a clock; what is less counts from the start of a simulation.
FIRST_CLOCK_S = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class DriveSegment:
    """A part of a drive in which the mount stayed where it was.

    Attributes:
        start_s: Stamp of its first accepted frame [s].
        end_s: Stamp of its last [s].
        estimate: Its accepted frames, fused.
        spread: Standard deviation of its frames over time: the car moves on its suspension, and a frame
            has its noise.
        standard_error: Of the mean, as far as that spread decides it; None where the segment is shorter than
            half a minute, which does not show how long the motion lasts.
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
        at_s: When [s].
        within_s: It is within this of ``at_s`` with a probability of 95 % [s].
        before: Pose of the segment before.
        after: Pose of the segment after.
        sigmas: (3,) by how many standard errors height, pitch and roll have changed.
    """

    at_s: float
    within_s: float
    before: Extrinsics
    after: Extrinsics
    sigmas: Array

    @property
    def shift(self) -> Extrinsics:
        """By how much height, pitch and roll changed."""
        return Extrinsics.from_array(self.after.as_array() - self.before.as_array())


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What a drive says of the mount.

    Attributes:
        estimate: Where the camera is at the end: of the last segment; the refusal of the last frame when none
            was accepted.
        segments: Parts with the mount at rest, in order; none when no frame was accepted.
        changes: Moves between them.
        judged: Whether the drive is long enough for a move to be told from motion.
    """

    estimate: CalibrationResult
    segments: tuple[DriveSegment, ...] = ()
    changes: tuple[DriveChange, ...] = ()
    judged: bool = False


def estimate_drive(frames: Sequence[AcceptedFrame], rig: StereoRig, fused: CalibrationResult) -> Drive:
    """Find the mounts of a drive.

    Args:
        frames: Its accepted frames, in any order.
        rig: The rig they come from.
        fused: :attr:`.Calibrator.estimate` of all frames of the drive.

    Returns:
        The fused estimate as it is where the drive is too short to tell a move from motion. Else every
        segment is fused with the motion in the weights, and what it does to the mean in the covariance.
    """
    if not frames:
        return Drive(fused)
    frames = sorted(frames, key=lambda frame: frame.stamp_s)
    poses = np.array([frame.extrinsics.as_array() for frame in frames if frame.extrinsics is not None])
    covariances = np.array([frame.covariance for frame in frames])
    stamps_s = np.array([frame.stamp_s for frame in frames])
    course = find_changes(stamps_s, poses, covariances)
    segments = []
    for part in course.segments:
        error = (
            None
            if part.standard_error is None
            else Extrinsics.from_array(np.sqrt(np.diag(part.standard_error)))
        )
        estimate = fused
        if course.judged and part.standard_error is not None:
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
            estimate = replace(estimate, message=announce(estimate, n_outliers))
        spread = Extrinsics.from_array(part.spread)
        segments.append(DriveSegment(part.start_s, part.end_s, estimate, spread, error))
    changes = []
    for change, before, after in zip(course.changes, segments, segments[1:], strict=False):
        old, new = before.estimate.extrinsics, after.estimate.extrinsics
        if old is not None and new is not None:  # they are: accepted frames were fused
            changes.append(DriveChange(change.at_s, change.within_s, old, new, change.sigmas))
    last = segments[-1].estimate
    if changes:
        last = replace(
            last, message=f"{last.message}; since the camera was moved at {clock(changes[-1].at_s)}"
        )
    return Drive(last, tuple(segments), tuple(changes), course.judged)


def clock(stamp_s: float) -> str:
    """Return a stamp as people read it: UTC where it is of a clock, seconds where it is not."""
    if stamp_s < FIRST_CLOCK_S:
        return f"{stamp_s:.1f} s"
    return datetime.fromtimestamp(stamp_s, timezone.utc).strftime("%H:%M:%S UTC")
