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

"""How the right camera is turned against where the rig has it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..types import Array, Mask
from .pose import BODY_FROM_OPTICAL, road_from_camera_rotation

# Public names of the angles and of their standard deviations, in the order of the covariance: those of
# attributes, files, tables and ROS parameters.
ALIGNMENT_NAMES = ("pitch_rad", "roll_rad", "yaw_rad")
ALIGNMENT_STD_NAMES = ("pitch_std_rad", "roll_std_rad", "yaw_std_rad")
# An angle or a standard deviation beyond it is no knowledge: the two images have nothing in common then.
MOST_KNOWN_RAD = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """How the right camera's body is turned in the left one's (REP-103), against where the rig has it.

    Attributes:
        pitch_rad: Pitch [rad], > 0: nose down; the content of the right image moves up.
        roll_rad: Roll [rad], > 0: right side down.
        yaw_rad: Yaw [rad], > 0: it looks farther left; its content moves right, and disparities are smaller
            by ``fx * yaw_rad``.
        covariance: (3, 3) of (pitch_rad, roll_rad, yaw_rad). What is not seen has a large variance.
        unexplained_rad: Standard deviation of the smooth error of the rows that no turn explains [rad]; 0
            where it is not known.
        yaw_corrected_rad: The part of the yaw that was corrected before the pose was estimated [rad].
    """

    pitch_rad: float
    roll_rad: float
    yaw_rad: float
    covariance: Array
    unexplained_rad: float = 0.0
    yaw_corrected_rad: float = 0.0

    @classmethod
    def from_values(cls, values: Mapping[str, float], covariance: Array | None = None) -> Alignment:
        """Build from angles and standard deviations by name; what is missing is not known.

        Args:
            values: By the names of :data:`ALIGNMENT_NAMES` and :data:`ALIGNMENT_STD_NAMES`.
            covariance: (3, 3); None: that of the standard deviations alone.
        """
        pitch_rad, roll_rad, yaw_rad = (float(values.get(name, 0.0)) for name in ALIGNMENT_NAMES)
        if covariance is None:
            stds = [float(values.get(name, math.inf)) for name in ALIGNMENT_STD_NAMES]
            covariance = np.diag(np.square(stds))
        return cls(pitch_rad, roll_rad, yaw_rad, covariance)

    def known(self) -> Mask:
        """Return which of pitch, roll and yaw has a number that can be told (3,)."""
        values, std = self.as_array(), self.std
        known: Mask = (np.abs(values) <= MOST_KNOWN_RAD) & (std > 0.0) & (std <= MOST_KNOWN_RAD)
        return known

    def as_dict(self) -> dict[str, float]:
        """Return the known angles by name, as numbers that JSON and YAML take."""
        named = zip(ALIGNMENT_NAMES, self.as_array(), self.known(), strict=True)
        return {name: float(value) for name, value, known in named if known}

    def std_dict(self) -> dict[str, float]:
        """Return the standard deviations of the known angles by name, as numbers that JSON and YAML take."""
        named = zip(ALIGNMENT_STD_NAMES, self.std, self.known(), strict=True)
        return {name: float(value) for name, value, known in named if known}

    def as_array(self) -> Array:
        """Return (pitch_rad, roll_rad, yaw_rad) as an array (3,)."""
        return np.array([self.pitch_rad, self.roll_rad, self.yaw_rad])

    @property
    def std(self) -> Array:
        """(3,) standard deviations of (pitch_rad, roll_rad, yaw_rad)."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std

    @property
    def left_from_right(self) -> Array:
        """Rotation matrix (3, 3) to the left optical frame (x right, y down, z forward)."""
        return optical_rotation(self.pitch_rad, self.roll_rad, self.yaw_rad)

    def describe(self) -> str:
        """Return the angles with their standard deviations, in degrees."""
        named = zip(("pitch", "roll", "yaw"), np.degrees(self.as_array()), np.degrees(self.std), strict=True)
        return ", ".join(f"{name} {value:+.3f} deg (std {std:.3f})" for name, value, std in named)


def optical_rotation(pitch_rad: float, roll_rad: float, yaw_rad: float) -> Array:
    """Return the rotation matrix (3, 3) of a turn, in the optical frame (x right, y down, z forward).

    Args:
        pitch_rad: Pitch [rad], > 0: nose down.
        roll_rad: Roll [rad], > 0: right side down.
        yaw_rad: Yaw [rad], > 0: to the left.
    """
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    yaw = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    body = yaw @ road_from_camera_rotation(pitch_rad, roll_rad)
    rotation: Array = BODY_FROM_OPTICAL.T @ body @ BODY_FROM_OPTICAL
    return rotation
