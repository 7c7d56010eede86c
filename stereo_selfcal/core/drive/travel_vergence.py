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

"""Yaw of the right camera, the vergence, from a drive: by the direction of travel, and by the parallax.

A right camera that has turned about the vertical makes all disparities wrong by the same number. The surface
of the road then seems to have another pitch. The direction of travel needs no disparity: in the mean a car
drives along its road, and the difference of the pitch over the surface from that against the direction of
travel tells the turn. The parallax of each step tells it again: far and near points show it differently.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import jacobian_pose_wrt_plane, plane_from_pose
from ..geometry.pose import Extrinsics
from ..rejection import Bound, NotFitted
from ..road.priors import RECTIFICATION_STD_PX, RIDE_MEMORY_S
from ..types import Array
from .mean_over_time import MeanOverTime, mean_over_time
from .travel import TravelStep, ahead_only, angles_against

# Slope of the road in view against that under the car: crests and dips change it by a third of a degree (RMS)
# over some car's lengths (single frames of recorded drives), and average out along the road.
_SLOPE_STD_RAD, _SLOPE_MEMORY_M = math.radians(0.3), 20.0
# Both pitches follow the motion of the car on its suspension. What remains is how it heaves in between.
_SAME_TIME_S = 0.5
_LEAST_POSES, _LEAST_STEPS = 3, 3
# Points of the same objects tell the parallax for about so long, with the same errors.
_PARALLAX_RIDE_MEMORY_S = 1.0
_PARALLAX_SCATTER_RAD = math.radians(0.02)  # of single steps, beyond their noise: recorded drives
_SLOWEST_MPS = 1.0


class PoseAtTime(Protocol):
    """What is used of an accepted frame."""

    @property
    def stamp_s(self) -> float:
        """Time stamp [s]."""

    @property
    def extrinsics(self) -> Extrinsics | None:
        """The pose over the road."""


@dataclass(frozen=True, slots=True)
class RightYaw:
    """Yaw of the right camera.

    Attributes:
        yaw_rad: The yaw [rad], > 0: farther left than the rig has it.
        std_rad: Its standard deviation [rad].
        n: Number of measurements that agree.
    """

    yaw_rad: float
    std_rad: float
    n: int


def pitch_by_right_yaw(rig: StereoRig, pose: Extrinsics) -> float:
    """Return the change of the pitch over the surface by the yaw of the right camera [rad/rad].

    Args:
        rig: Intrinsics and baseline.
        pose: Pose over the road.
    """
    # A right camera that looks farther left sees its content farther right: disparities are smaller.
    return -rig.fx * float(jacobian_pose_wrt_plane(plane_from_pose(pose, rig), rig)[1, 0])


@dataclass(frozen=True, slots=True)
class PitchDifference:
    """Pitch over the road less pitch against the direction of travel, in the mean.

    Attributes:
        value_rad: The difference [rad].
        std_rad: Its standard deviation, of a rig that is what its CameraInfo says [rad].
        n: Number of poses that agree.
    """

    value_rad: float
    std_rad: float
    n: int


def pitch_difference(
    steps: Sequence[TravelStep],
    poses: Sequence[PoseAtTime],
    rig: StereoRig,
    pitch_std_rad: Sequence[float] | None = None,
) -> PitchDifference | NotFitted:
    """Return by how much the pitch over the road differs from that against the direction of travel.

    Both follow the motion of the car on its suspension, so they are compared at the same time.

    Args:
        steps: Steps of the drive, in the order of time.
        poses: Accepted frames of the same drive.
        rig: Intrinsics and baseline.
        pitch_std_rad: Standard deviations of their pitch by noise, without the unknowns of the rig; None
            where they do not matter beside the slopes of the road.
    """
    driven = ahead_only(steps)
    located = [(pose.stamp_s, pose.extrinsics) for pose in poses if pose.extrinsics is not None]
    if len(located) != len(poses):
        return NotFitted("frames with a pose", len(located), Bound.LEAST, len(poses))
    if len(driven) < _LEAST_STEPS:
        return NotFitted("steps of a drive", len(driven), Bound.LEAST, _LEAST_STEPS)
    differences, variances, slower = [], [], []
    stds = np.zeros(len(located)) if pitch_std_rad is None else np.asarray(pitch_std_rad, np.float64)
    times = np.array([step.middle_s for step in driven])
    directions = np.array([step.direction for step in driven])
    noise = np.array([step.noise()[1] for step in driven])
    speeds = np.array([step.speed_mps for step in driven])
    for (stamp_s, pose), std in zip(located, stds, strict=True):
        near = np.abs(times - stamp_s) <= _SAME_TIME_S
        if not np.any(near):
            continue
        information = 1.0 / noise[near]
        total = float(information.sum())
        _, pitches = angles_against(directions[near], pose.roll_rad)
        differences.append(pose.pitch_rad - float(pitches @ information) / total)
        variances.append(std**2 + 1.0 / total)
        slower.append(float(speeds[near].mean()))
    if len(differences) < _LEAST_POSES:
        return NotFitted("poses while the car drives", len(differences), Bound.LEAST, _LEAST_POSES)
    memory_s = max(RIDE_MEMORY_S, _SLOPE_MEMORY_M / max(_SLOWEST_MPS, float(np.median(slower))))
    over = MeanOverTime(_covered_s(driven), memory_s, _SLOPE_STD_RAD)
    mean = mean_over_time(np.array(differences), np.array(variances), over)
    if isinstance(mean, NotFitted):
        return mean
    rectified = RECTIFICATION_STD_PX / rig.fy  # a direction in the image is not known better
    std = math.hypot(math.sqrt(mean.variance), rectified)
    return PitchDifference(mean.value, std, int(np.count_nonzero(mean.weights)))


def vergence_of_travel(
    steps: Sequence[TravelStep],
    poses: Sequence[PoseAtTime],
    rig: StereoRig,
    pitch_std_rad: Sequence[float] | None = None,
) -> RightYaw | NotFitted:
    """Return the yaw of the right camera for which the road lies along the direction of travel, in the mean.

    Arguments are those of :func:`pitch_difference`; the poses rest on the surface of the road.
    """
    found = pitch_difference(steps, poses, rig, pitch_std_rad)
    if isinstance(found, NotFitted):
        return found
    located = [pose.extrinsics.as_array() for pose in poses if pose.extrinsics is not None]
    derivative = pitch_by_right_yaw(rig, Extrinsics.from_array(np.median(located, axis=0)))
    return RightYaw(found.value_rad / derivative, found.std_rad / abs(derivative), found.n)


def vergence_of_parallax(steps: Sequence[TravelStep], rig: StereoRig) -> RightYaw | NotFitted:
    """Return the yaw of the right camera that the parallax of the steps tells, in the mean.

    Args:
        steps: Steps of the drive, in the order of time.
        rig: Intrinsics and baseline.
    """
    driven = ahead_only(steps)
    if len(driven) < _LEAST_STEPS:
        return NotFitted("steps of a drive", len(driven), Bound.LEAST, _LEAST_STEPS)
    yaws: Array = np.array([step.motion.right_yaw_rad for step in driven])
    noise = np.array([step.motion.covariance[6, 6] for step in driven])
    over = MeanOverTime(_covered_s(driven), _PARALLAX_RIDE_MEMORY_S, _PARALLAX_SCATTER_RAD)
    mean = mean_over_time(yaws, noise, over)
    if isinstance(mean, NotFitted):
        return mean
    std = math.hypot(math.sqrt(mean.variance), RECTIFICATION_STD_PX / rig.fx)
    return RightYaw(mean.value, std, int(np.count_nonzero(mean.weights)))


def _covered_s(steps: Sequence[TravelStep]) -> float:
    """Return the duration of all steps [s]."""
    return float(sum(step.duration_s for step in steps))
