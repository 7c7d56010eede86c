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

"""The estimate of a drive: fused frames, the motion of the car, and the pose after each move of the mount."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..rejection import fitted
from ..reservations import Reservation, ReservationKind
from ..results import CalibrationResult, announce
from ..types import Array
from .changes import find_changes
from .fusion import AcceptedFrame, frame_series, fuse_frames
from .rig_doubt import with_doubt_of_rig
from .travel import ANY_ROLL, TravelStep
from .travel_vergence import pitch_difference
from .yaw_change import travel_at_end

# Stamps from 2001 on come from a clock. Smaller stamps count from the start of a simulation.
FIRST_CLOCK_S = 1e9
# One of 370 drives without a fault differs by more.
_CONTRADICTS_SIGMAS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class DriveSegment:
    """A part of a drive in which the mount did not move.

    Attributes:
        start_s: Stamp of its first accepted frame [s].
        end_s: Stamp of its last accepted frame [s].
        estimate: Fused estimate of its accepted frames.
        spread: Standard deviation of its frames over time, caused by the car's motion on its suspension and
            by the noise of the frames.
        standard_error: What the motion leaves of the mean; None where the car stood.
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


def estimate_drive(
    frames: Sequence[AcceptedFrame],
    rig: StereoRig,
    fused: CalibrationResult,
    steps: Sequence[TravelStep] = (),
) -> Drive:
    """Find the moves of the mount in a drive, and its pose between them.

    Args:
        frames: Accepted frames of the drive, in any order.
        rig: The rig that the frames come from.
        fused: Estimate of all frames of the drive.
        steps: The steps between its frames, accepted or not, in the order of time.

    Returns:
        The given estimate where the mount was not moved; else that of the frames since it was moved last.
    """
    if not frames or not fused.accepted:
        return Drive(with_travel(fused, frames, steps, rig))
    frames = sorted(frames, key=lambda frame: frame.stamp_s)
    history = find_changes(frame_series(frames))
    last_part = len(history.segments) - 1
    segments = []
    for i, part in enumerate(history.segments):
        estimate = fused
        if history.changes:
            estimate = fuse_frames(frames[part.first : part.end], rig)
            # The alignment and the delay are those of the rig, whatever the mount does.
            estimate = replace(estimate, alignment=fused.alignment, delay=fused.delay)
            estimate = with_doubt_of_rig(estimate, rig)
        start_s = part.start_s if i else -math.inf
        end_s = part.end_s if i < last_part else math.inf
        of_part = [step for step in steps if start_s <= step.middle_s <= end_s]
        estimate = with_travel(estimate, frames[part.first : part.end], of_part, rig)
        error = [each.covariance for each in estimate.uncertainty if each.name == "motion"]
        segments.append(
            DriveSegment(
                part.start_s,
                part.end_s,
                estimate,
                Extrinsics.from_array(part.spread),
                Extrinsics.from_array(np.sqrt(np.diag(error[0]))) if error else None,
            )
        )
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


def with_travel(
    estimate: CalibrationResult, frames: Sequence[AcceptedFrame], steps: Sequence[TravelStep], rig: StereoRig
) -> CalibrationResult:
    """Return an estimate with the camera against the direction of travel, as far as the steps tell it.

    In the mean a car drives along its road: where the pitch over it contradicts that, it is told.

    Args:
        estimate: An estimate of the mount, or a refusal.
        frames: Its accepted frames.
        steps: Steps of the same drive, in the order of time.
        rig: The rig that all come from.
    """
    pose, std = estimate.extrinsics, estimate.std
    roll = ANY_ROLL if pose is None or std is None else (pose.roll_rad, std.roll_rad)
    found = travel_at_end(steps, roll, estimate.n_frames)
    if found.travel is None:
        return estimate
    told = replace(estimate, travel=found.travel)
    if not told.accepted:
        return told
    told = replace(told, reservations=(*told.reservations, *found.reservations))
    apart = fitted(pitch_difference(steps, frames, rig))
    if apart is not None and abs(apart.value_rad) > _CONTRADICTS_SIGMAS * apart.std_rad:
        detail = f"{math.degrees(apart.value_rad):+.2f} deg more (std {math.degrees(apart.std_rad):.2f})"
        kind = ReservationKind.PITCH_NOT_OF_TRAVEL
        reservation = Reservation(kind, detail, max(1, estimate.n_frames))
        told = replace(told, reservations=(*told.reservations, reservation))
    return replace(told, message=announce(told))


def clock(stamp_s: float) -> str:
    """Return a stamp as people read it: UTC where it comes from a clock, seconds where it does not."""
    if stamp_s < FIRST_CLOCK_S:
        return f"{stamp_s:.1f} s"
    return datetime.fromtimestamp(stamp_s, timezone.utc).strftime("%H:%M:%S UTC")
