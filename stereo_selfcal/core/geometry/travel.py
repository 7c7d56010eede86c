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

"""What the motion of a car tells of its cameras, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import Array
from .pose import DEGREES

# Standard deviation of the yaw of a mount of which nothing is known: cameras are mounted straight to a
# degree. A drive that tells it less well tells nothing of it.
MOUNT_YAW_STD_RAD = math.radians(1.0)
# Public names of the yaw and its standard deviation: of files, tables and ROS parameters.
YAW_NAME, YAW_STD_NAME = YAW_NAMES = ("yaw_rad", "yaw_std_rad")


@dataclass(frozen=True, slots=True, eq=False)
class Travel:
    """The camera against the direction of travel.

    Attributes:
        yaw_rad: Yaw [rad], > 0: the camera points left of the direction of travel.
        pitch_rad: Pitch [rad], > 0: nose down against it.
        covariance: (2, 2) of (yaw_rad, pitch_rad).
        n_steps: Number of steps that agree.
        lever_m: How far ahead of the rear axle the camera seems to be, by what it does in bends [m].
        driven_s: Duration of all steps [s].
    """

    yaw_rad: float
    pitch_rad: float
    covariance: Array
    n_steps: int
    lever_m: float
    driven_s: float

    @property
    def std(self) -> Array:
        """(2,) standard deviations of (yaw_rad, pitch_rad)."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std

    @property
    def tells_yaw(self) -> bool:
        """Whether the yaw is known better than that of any mount."""
        return bool(self.std[0] < MOUNT_YAW_STD_RAD)

    def yaw_dict(self) -> dict[str, float]:
        """Return yaw and standard deviation by the names of :data:`YAW_NAMES`; nothing while not known."""
        if not self.tells_yaw:
            return {}
        return {YAW_NAME: float(self.yaw_rad), YAW_STD_NAME: float(self.std[0])}

    def describe_yaw(self) -> str:
        """Return the yaw as people read it, in degrees."""
        yaw, std = DEGREES.text(self.yaw_rad, "+", fine=True), DEGREES.number(float(self.std[0]), fine=True)
        return f"yaw {yaw} (std {std}) against the direction of travel"


@dataclass(frozen=True, slots=True, eq=False)
class RightDelay:
    """When the right images are taken, against what their stamps say.

    Attributes:
        delay_s: How much later [s]: than the left ones, where the stamps are equal.
        offset_m: How much farther ahead the right camera sits than the rig has it [m].
        covariance: (2, 2) of (delay_s, offset_m), with the prior of the offset. At constant speed both are
            correlated: the sum ``offset_m + speed * delay_s`` is known better than either.
        n_frames: Number of frames that agree.
        speeds_mps: Least and greatest speed of these [m/s].
    """

    delay_s: float
    offset_m: float
    covariance: Array
    n_frames: int
    speeds_mps: tuple[float, float]

    @property
    def std(self) -> Array:
        """(2,) standard deviations of (delay_s, offset_m)."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std
