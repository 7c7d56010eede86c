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

"""Height of a road that is no plane, and what pose a calibration over it should find.

Heights are functions of road coordinates: ``s`` along the reference line, ``d`` to its left [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereo_selfcal.core.errors import ConfigError

from ..core.geometry.pose import Extrinsics
from .renderer import rotation

Array = npt.NDArray[np.float64]

# The part of the own lane whose plane counts as "the road": where a camera behind a windscreen begins
# to see it, to where a pixel of height error still matters. Judges of other makes take the same part.
NEAR_M = (3.0, 15.0)
NEAR_SAMPLES = (61, 15)

# A crown is rounded off over this width, as rollers leave it.
CROWN_ROUND_M = 0.15

# Beyond this from the reference line the cross slope ends: no road falls without end.
CROSS_SLOPE_REACH_M = 9.0


@dataclass(frozen=True, slots=True)
class RoadShape:
    """Course and height of a road.

    Attributes:
        curvature_per_m: Curvature of the reference line [1/m], > 0 bends left.
        crown_at_m: Lateral position of the crown line [m].
        fall_right: Cross slope right of the crown line, > 0: falls to the right [m/m].
        fall_left: Cross slope left of the crown line, > 0: falls to the left [m/m].
        grade_change: Change of the slope along the road ahead, > 0: a dip, < 0: a crest [m/m].
        grade_begins_m: Where it begins [m ahead of the rig].
        grade_length_m: Over which length it happens, as a parabola [m].

    Raises:
        ConfigError: A slope is steeper than any road, or the parabola has no length.
    """

    curvature_per_m: float = 0.0
    crown_at_m: float = 0.0
    fall_right: float = 0.0
    fall_left: float = 0.0
    grade_change: float = 0.0
    grade_begins_m: float = 30.0
    grade_length_m: float = 20.0

    def __post_init__(self) -> None:
        for name in ("fall_right", "fall_left", "grade_change"):
            if not abs(getattr(self, name)) <= 0.2:
                raise ConfigError(f"shape.{name} is {getattr(self, name)}, it must be within 0.2")
        if not self.grade_length_m > 0:
            raise ConfigError(f"shape.grade_length_m is {self.grade_length_m}, it must be greater than zero")

    @property
    def plane(self) -> bool:
        """Whether the road has no height at all."""
        return self.fall_right == self.fall_left == self.grade_change == 0

    def height(self, s: npt.ArrayLike, d: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return height [m] and its derivatives along and across the road [m/m], broadcast."""
        s, d = np.asarray(s, np.float64), np.asarray(d, np.float64)
        # Both slopes as one even and one odd part: -mean |x| + half the difference x, rounded at 0.
        even, odd = (self.fall_left + self.fall_right) / 2, (self.fall_right - self.fall_left) / 2
        across = np.clip(d, -CROSS_SLOPE_REACH_M, CROSS_SLOPE_REACH_M)
        x = across - self.crown_at_m
        length = np.sqrt(x * x + CROWN_ROUND_M**2)
        crowned = odd * x - even * (length - CROWN_ROUND_M)
        per_d: Array = np.where(across == d, odd - even * x / length, 0.0)
        ahead = np.maximum(s - self.grade_begins_m, 0.0)
        bend = np.minimum(ahead, self.grade_length_m)
        per_s = self.grade_change * bend / self.grade_length_m
        height: Array = crowned + self.grade_change * (bend * bend / (2 * self.grade_length_m) + ahead - bend)
        return height, per_s + 0 * per_d, per_d + 0 * per_s

    def place(self, s: npt.ArrayLike, d: npt.ArrayLike) -> tuple[Array, Array]:
        """Return (x, y) in the lane frame of road coordinates [m]."""
        s, d = np.asarray(s, np.float64), np.asarray(d, np.float64)
        bend = self.curvature_per_m
        if bend == 0:
            return s + 0 * d, d + 0 * s
        angle = bend * s
        return np.sin(angle) * (1 / bend - d), (1 - np.cos(angle)) / bend + d * np.cos(angle)

    def locate(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return road coordinates (s, d) of places in the lane frame, the inverse of :meth:`place`."""
        bend = self.curvature_per_m
        if bend == 0:
            return x, y
        reach = np.sqrt((bend * x) ** 2 + (1 - bend * y) ** 2)
        d = (2 * y - bend * (x * x + y * y)) / (1 + reach)
        return np.arctan2(bend * x, 1 - bend * y) / bend, d


def near_plane(shape: RoadShape, lane_m: tuple[float, float], ahead_m: tuple[float, float] = NEAR_M) -> Array:
    """Return (z, dz/dx, dz/dy) of the least-squares plane of the own lane near the rig.

    Args:
        shape: The road.
        lane_m: Lateral positions of the right and the left border of the own lane [m].
        ahead_m: Where along the road the surface counts [m].
    """
    s = np.linspace(*ahead_m, NEAR_SAMPLES[0])[:, None]
    d = np.linspace(*lane_m, NEAR_SAMPLES[1])
    x, y = shape.place(s, d)
    z, _, _ = shape.height(s, d)
    columns = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    plane, *_ = np.linalg.lstsq(columns, z.ravel(), rcond=None)
    return np.asarray(plane, np.float64)


def pose_over_plane(
    pose: Extrinsics, lane_yaw_rad: float, lateral_offset_m: float, plane: Array
) -> Extrinsics:
    """Return the pose of a rig over a plane of the lane frame.

    Args:
        pose: The rig over the plane z = 0 of the lane frame.
        lane_yaw_rad: Its heading in the lane frame [rad].
        lateral_offset_m: Its lateral position in the lane frame [m].
        plane: (z, dz/dx, dz/dy) of the plane.
    """
    normal = np.array([-plane[1], -plane[2], 1.0])
    normal /= math.hypot(*normal)
    centre = np.array([0.0, lateral_offset_m, pose.height_m])
    height_m = float(normal @ (centre - np.array([0.0, 0.0, plane[0]])))
    lane_from_camera = (
        rotation(0.0, 0.0, lane_yaw_rad)
        @ rotation(0.0, pose.pitch_rad, 0.0)
        @ rotation(pose.roll_rad, 0.0, 0.0)
    )
    # Seen from the camera, the plane's normal is (-sin pitch, cos pitch sin roll, cos pitch cos roll).
    x, y, z = lane_from_camera.T @ normal
    return Extrinsics(height_m, -math.asin(x), math.atan2(y, z))
