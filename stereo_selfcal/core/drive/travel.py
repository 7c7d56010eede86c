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

"""The camera against the direction of travel, from the motion between the frames of a drive.

In the mean a car drives along its road. So the direction in which its camera moves says where the horizon
is, without any disparity. Single steps differ from the mean: the car pitches on its suspension, with a memory
of a second or two; in a bend the camera moves sideways, as it sits ahead of the rear axle, and the rear tyres
slip. The first is a scatter that is measured. The others grow with the curvature and with the acceleration,
by a length and a compliance that are estimated with the mean. What a bend does besides is not known to
average out, so that a step counts less the less straight the car drives around it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..geometry.pose import road_from_camera_rotation
from ..geometry.travel import MOUNT_YAW_STD_RAD, Travel
from ..rejection import Bound, NotFitted
from ..road.priors import RIDE_MEMORY_S
from ..types import Array
from .mean_over_time import MeanOverTime, mean_over_time
from .motion_between_frames import FrameMotion, estimate_motion

MOST_STEP_S = 1.5  # between two frames of a step: beyond, few landmarks are left even at walking pace
MOST_STEP_M = 20.0
LEAST_STEP_M = 0.05  # a step of less has no direction: landmarks tell a motion to about 5 mm
_LEAST_STEPS = 3
# Prior of the scatter of single steps: a car pitches by tenths of a degree; its body sways sideways while it
# rolls, by a degree each second at a metre of height and 10 m/s.
_PITCH_SCATTER_RAD, _YAW_SCATTER_RAD = math.radians(0.2), math.radians(0.1)
_LASTING_PART = 0.5
# How far the camera is ahead of the rear axle, the point of a car that moves along its heading: behind the
# windscreen of a small car or of a long one, or on the roof.
_LEVER_M, _LEVER_STD_M = 1.3, 1.0
# Slip of the rear tyres in a bend, over the acceleration: a third of a degree for each m/s^2 (Milliken and
# Milliken, Race Car Vehicle Dynamics, 1995, chapter 5: 5 deg at 0.8 g and more); less with stiff tyres.
_SLIP_RAD_PER_MPS2, _SLIP_STD_RAD_PER_MPS2 = 0.006, 0.003
# The same on the cross fall of the road. Roads fall by 2.5 % to the side on which one drives, within 0.7 %,
# and one in seven to the other side: they differ by 2 % (RMS) from the usual one, on which the direction of
# travel is defined.
_GRAVITY_MPS2 = 9.81
_CROSS_FALL_STD_RAD = 0.02 * _GRAVITY_MPS2 * _SLIP_RAD_PER_MPS2
# Drivers weave in their lane by less than a degree to either side. Where the heading changes by 3.5 deg
# within 6 s, which is a radius of 1.4 km at 50 km/h, the car drives in a bend, or changes the lane. A bend
# that is not told from a straight road leaves 0.3 deg of yaw; that grows with the square of the turn.
_STRAIGHT_S = 6.0
_TINY_S = 1e-6  # stamps are rounded to less
_BEND_TURN_RAD, _BEND_STD_RAD = math.radians(3.5), math.radians(0.3)
# Roll of a mount of which nothing is known: that of its yaw.
ANY_ROLL = 0.0, MOUNT_YAW_STD_RAD


class FrameWithLandmarks(Protocol):
    """What a step needs of a frame."""

    @property
    def stamp_s(self) -> float:
        """Time stamp [s]."""

    @property
    def landmarks(self) -> Landmarks | None:
        """Landmarks; None where the frame was not looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenLandmarks:
    """The landmarks of a frame, without its result.

    Attributes:
        stamp_s: Time stamp [s].
        landmarks: The landmarks.
    """

    stamp_s: float
    landmarks: Landmarks | None


@dataclass(frozen=True, slots=True, eq=False)
class MotionSince:
    """The motion between the landmarks of two frames, in whichever process it was estimated.

    Attributes:
        stamp_s: Time stamp of the first frame [s].
        motion: The motion; or why there is none.
    """

    stamp_s: float
    motion: FrameMotion | NotFitted

    @classmethod
    def between(cls, before: SeenLandmarks, after: Landmarks, rig: StereoRig) -> MotionSince | None:
        """Return the motion from one frame to another one; None where the first has no landmarks.

        Args:
            before: The first frame.
            after: Landmarks of the second one.
            rig: The rig that both come from.
        """
        if before.landmarks is None:
            return None
        return cls(before.stamp_s, estimate_motion(before.landmarks, after, rig))


@dataclass(frozen=True, slots=True, eq=False)
class TravelStep:
    """The motion between two frames, and the camera against its direction.

    Attributes:
        stamp_s: Time stamp of the first frame [s].
        duration_s: Time to the second frame [s].
        motion: The motion.
    """

    stamp_s: float
    duration_s: float
    motion: FrameMotion

    @property
    def middle_s(self) -> float:
        """Time of the middle of the step [s]."""
        return self.stamp_s + self.duration_s / 2.0

    @property
    def way_m(self) -> float:
        """How far the camera has moved ahead [m]; negative: backwards."""
        return math.copysign(float(np.linalg.norm(self.motion.moved_m)), float(self.motion.moved_m[0]))

    @property
    def speed_mps(self) -> float:
        """Mean speed [m/s]."""
        return self.way_m / self.duration_s

    @property
    def curvature_per_m(self) -> float:
        """Turn to the left over the way [1/m]."""
        return float(self.motion.turned_rad[2]) / self.way_m

    @property
    def direction(self) -> Array:
        """(3,) way in the body of the camera in the middle of the step [m].

        There, a car that drives along an arc moves along its chord.
        """
        halfway = np.asarray(cv2.Rodrigues(-0.5 * self.motion.turned_rad)[0], np.float64)
        way: Array = halfway @ self.motion.moved_m
        return way

    def against_travel(self, roll_rad: float = 0.0) -> tuple[float, float]:
        """Return yaw and pitch of the camera against the direction of the step [rad].

        Args:
            roll_rad: Roll of the camera over the road [rad].
        """
        yaw, pitch = angles_against(self.direction, roll_rad)
        return float(yaw), float(pitch)

    def noise(self) -> Array:
        """Return the variances (2,) of that yaw and pitch, as the landmarks tell them [rad^2]."""
        half = self.way_m / 2.0
        # A turn by an angle changes the direction in the middle of the step by half of it.
        by_yaw, by_pitch = np.zeros(7), np.zeros(7)
        by_yaw[[2, 4]] = half, -1.0
        by_pitch[[1, 5]] = half, 1.0
        covariance = self.motion.covariance
        return np.array([by @ covariance @ by for by in (by_yaw, by_pitch)]) / self.way_m**2


def angles_against(directions: Array, roll_rad: float) -> tuple[Array, Array]:
    """Return yaw and pitch (...) of ``R_z(yaw) R_y(pitch) R_x(roll)``, which turns directions to x [rad].

    Args:
        directions: (..., 3) directions in the body of the camera, of any length.
        roll_rad: Roll of the camera over the road [rad].
    """
    ahead, left, up = np.moveaxis(directions @ road_from_camera_rotation(0.0, roll_rad).T, -1, 0)
    return -np.arctan2(left, np.hypot(ahead, up)), np.arctan2(up, ahead)


def step_between(
    before: FrameWithLandmarks,
    after: FrameWithLandmarks,
    rig: StereoRig,
    moved: FrameMotion | NotFitted | None = None,
) -> TravelStep | NotFitted:
    """Return the step from one frame to the next one.

    Args:
        before: The first frame.
        after: The second frame.
        rig: The rig that both come from.
        moved: The motion between them where it is known already; None to estimate it.

    Returns:
        The step, or why there is none: the frames are too far apart, or the motion could not be estimated.
    """
    duration_s = after.stamp_s - before.stamp_s
    if not duration_s <= MOST_STEP_S:
        return NotFitted("time between two frames", duration_s, Bound.MOST, MOST_STEP_S, "s")
    if duration_s <= 0.0:
        return NotFitted("time between two frames", duration_s, Bound.LEAST, 0.0, "s")
    if before.landmarks is None or after.landmarks is None:
        return NotFitted("frames with landmarks", 1, Bound.LEAST, 2)
    motion = moved or estimate_motion(before.landmarks, after.landmarks, rig)
    if isinstance(motion, NotFitted):
        return motion
    way_m = float(np.linalg.norm(motion.moved_m))
    if way_m > MOST_STEP_M:
        return NotFitted("way between two frames", way_m, Bound.MOST, MOST_STEP_M, "m")
    return TravelStep(before.stamp_s, duration_s, motion)


def steps_of(frames: Iterable[FrameWithLandmarks], rig: StereoRig) -> list[TravelStep]:
    """Return the steps of a drive.

    Args:
        frames: Frames with landmarks, in the order of time, refused ones among them.
        rig: The rig that all come from.
    """
    steps = (step_between(before, after, rig) for before, after in pairwise(frames))
    return [step for step in steps if not isinstance(step, NotFitted)]


def ahead_only(steps: Iterable[TravelStep]) -> list[TravelStep]:
    """Return the steps in which the car drives ahead."""
    return [step for step in steps if step.way_m >= LEAST_STEP_M]


@dataclass(frozen=True, slots=True, eq=False)
class DrivenSteps:
    """The steps in which the car drives ahead, as columns.

    Attributes:
        middle_s: (N,) times of their middles [s].
        angles_rad: (N, 2) yaw and pitch of the camera against their directions [rad].
        noise: (N, 2) variances of the noise of these [rad^2].
        curvature: (N,) turn to the left over the way [1/m].
        acceleration: (N,) acceleration to the left [m/s^2].
        bend_std_rad: (N,) what the bends around a step leave of its yaw, which is not known to average out.
        driven_s: Duration of all steps [s].
    """

    middle_s: Array
    angles_rad: Array
    noise: Array
    curvature: Array
    acceleration: Array
    bend_std_rad: Array
    driven_s: float

    @classmethod
    def of(cls, steps: Sequence[TravelStep], roll_rad: float) -> DrivenSteps | NotFitted:
        """Return those of a drive; why there are none where they are too few.

        Args:
            steps: All steps, in the order of time.
            roll_rad: Roll of the mount over the road [rad].
        """
        ahead = np.array([step.way_m >= LEAST_STEP_M for step in steps], dtype=bool)
        driven = [step for step, drives in zip(steps, ahead, strict=True) if drives]
        if len(driven) < _LEAST_STEPS:
            return NotFitted("steps of a drive", len(driven), Bound.LEAST, _LEAST_STEPS)
        curvature = np.array([step.curvature_per_m for step in driven])
        return cls(
            np.array([step.middle_s for step in driven]),
            np.column_stack(angles_against(np.array([step.direction for step in driven]), roll_rad)),
            np.array([step.noise() for step in driven]),
            curvature,
            np.array([step.speed_mps for step in driven]) ** 2 * curvature,
            _BEND_STD_RAD * (_turns_nearby(steps)[ahead] / _BEND_TURN_RAD) ** 2,
            float(sum(step.duration_s for step in driven)),
        )

    @property
    def yaw_rad(self) -> Array:
        """(N,) yaw, less what usual cars do in bends [rad]."""
        in_bends = _LEVER_M * self.curvature - _SLIP_RAD_PER_MPS2 * self.acceleration
        yaw: Array = self.angles_rad[:, 0] + in_bends
        return yaw

    @property
    def yaw_scatter_rad(self) -> float:
        """Prior of the slow scatter of the yaw [rad]."""
        return math.hypot(_YAW_SCATTER_RAD, _lasting_noise(self.noise[:, 0]))


def estimate_travel(steps: Sequence[TravelStep], roll: tuple[float, float] = ANY_ROLL) -> Travel | NotFitted:
    """Average the direction of travel over a drive.

    Args:
        steps: The steps, in the order of time.
        roll: Roll of the mount over the road, and its standard deviation [rad].

    Returns:
        The camera against the direction of travel, or why it is not known: the car has hardly moved.
    """
    driven = DrivenSteps.of(steps, roll[0])
    return driven if isinstance(driven, NotFitted) else average_travel(driven, roll[1])


def average_travel(driven: DrivenSteps, roll_std_rad: float) -> Travel | NotFitted:
    """Average the direction of travel over steps.

    Args:
        driven: The steps.
        roll_std_rad: Standard deviation of the roll that they were taken with [rad].

    Returns:
        The camera against the direction of travel, or why it is not known.
    """
    over = MeanOverTime(driven.driven_s, RIDE_MEMORY_S)
    yaw = mean_over_time(
        driven.yaw_rad,
        driven.noise[:, 0],
        over.with_scatter(driven.yaw_scatter_rad),
        slopes=((-driven.curvature, _LEVER_STD_M), (driven.acceleration, _SLIP_STD_RAD_PER_MPS2)),
        lasting=driven.bend_std_rad,
    )
    of_pitch = driven.noise[:, 1]
    pitch_scatter_rad = math.hypot(_PITCH_SCATTER_RAD, _lasting_noise(of_pitch))
    pitch = mean_over_time(driven.angles_rad[:, 1], of_pitch, over.with_scatter(pitch_scatter_rad))
    if isinstance(yaw, NotFitted):
        return yaw
    if isinstance(pitch, NotFitted):
        return pitch
    # A camera that is turned by a roll that is not known sees one angle as part of the other one.
    by_roll = roll_std_rad * np.array([math.sin(pitch.value), math.sin(yaw.value)])
    variances = np.array([yaw.variance + _CROSS_FALL_STD_RAD**2, pitch.variance]) + by_roll**2
    return Travel(
        yaw.value,
        pitch.value,
        np.diag(variances),
        int(np.count_nonzero((yaw.weights > 0.0) & (pitch.weights > 0.0))),
        _LEVER_M + float(yaw.slopes[0]),
        driven.driven_s,
    )


def _lasting_noise(noise: Array) -> float:
    """Return the prior of what landmarks do wrong for as long as they are seen [rad].

    Steps one after the other rest on the same landmarks: how some are seen from the left and from the right,
    or that they move, is in all of these. It is taken for half of the variance of a step, as for what frames
    tell of the alignment.

    Args:
        noise: (N,) variances of the noise of the steps [rad^2].
    """
    return math.sqrt(_LASTING_PART * float(np.median(noise)))


def _turns_nearby(steps: Sequence[TravelStep]) -> Array:
    """Return by how much the heading changes around each step (N,): greatest less least within a time [rad].

    At the ends of a drive, the time is one that lies within it. In gaps, the car is taken to turn as before.
    """
    starts = np.array([step.stamp_s for step in steps])
    ends = starts + [step.duration_s for step in steps]
    turns = np.array([float(step.motion.turned_rad[2]) for step in steps])
    gaps = np.maximum(starts - np.concatenate([starts[:1], ends[:-1]]), 0.0)
    rates = np.concatenate([[0.0], turns[:-1] / (ends - starts)[:-1]])
    after = np.cumsum(turns + gaps * rates)
    before = after - turns
    last = max(float(starts[0]), float(ends[-1]) - _STRAIGHT_S)
    begin = np.clip((starts + ends - _STRAIGHT_S) / 2.0, starts[0], last)
    first = np.searchsorted(starts, begin - _TINY_S)
    end = np.searchsorted(ends, begin + _STRAIGHT_S + _TINY_S, side="right")
    nearby = [
        max(before[i:j].max(), after[i:j].max()) - min(before[i:j].min(), after[i:j].min())
        for i, j in zip(first, np.maximum(end, first + 1), strict=True)
    ]
    return np.array(nearby)
