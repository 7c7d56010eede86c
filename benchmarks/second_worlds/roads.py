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

"""The shape of a road: how it bends, rises and falls, and the plane of its own lane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .cameras import Array, Array32
from .mesh import Look, MeshBuilder

# The strip of which the plane is the truth: of the own lane, so far ahead [m].
NEAREST_M, FARTHEST_M = 3.0, 15.0
_FAR_M = 400.0
_BEHIND_M = -4.0
_SAG_M = 0.006  # by which a bend may be drawn off its arc


@dataclass(frozen=True)
class Strip:
    """A strip of the cross-section, seen along the road.

    Attributes:
        from_m: Place across and height of its right border.
        to_m: The same of its left border. A face stands where both places are equal.
        look: How it looks.
        start_m: Where it begins along the road.
        end_m: Where it ends.
    """

    from_m: tuple[float, float]
    to_m: tuple[float, float]
    look: Look
    start_m: float = _BEHIND_M
    end_m: float = _FAR_M


@dataclass(frozen=True)
class Alignment:
    """How the road runs: an arc or straight, with slopes from place to place.

    Attributes:
        curvature_per_m: One over the radius, > 0: bends left.
        kinks: Places along the road and by how much the slope grows there.
        lane_width_m: Width of the own lane, which lies about zero.
        crown: Falls of the own carriageway: (place across, height) from right to left, ascending.
        base_m: Added to every height given to :meth:`world`, for what stands beside the carriageway.
    """

    curvature_per_m: float
    kinks: tuple[tuple[float, float], ...]
    lane_width_m: float
    crown: tuple[tuple[float, float], ...]
    base_m: float = 0.0

    def rise_m(self, s: Array) -> Array:
        """Return the height of the road along it."""
        rise = np.zeros_like(s)
        for place, change in self.kinks:
            rise += change * np.maximum(s - place, 0)
        return rise

    def section_m(self, t: Array) -> Array:
        """Return the height of the carriageway across it."""
        places, heights = np.array(self.crown).T
        result: Array = np.interp(t, places, heights)
        return result

    def world(self, s: Array, t: npt.ArrayLike, z: npt.ArrayLike) -> Array:
        """Return points of the world, shape (..., 3), at places along and across, so far over the rise."""
        s, t, z = np.broadcast_arrays(s, np.asarray(t, np.float64), np.asarray(z, np.float64))
        x, y = s, t
        if self.curvature_per_m:
            radius = 1 / self.curvature_per_m
            x, y = (radius - t) * np.sin(s / radius), radius - (radius - t) * np.cos(s / radius)
        return np.stack([x, y, z + self.rise_m(s) + self.base_m], axis=-1)

    def lane(self, x: Array32, y: Array32) -> tuple[Array32, Array32, Array32, Array32]:
        """Return where points lie along and across, and the direction (cos, sin) of the lane there."""
        if not self.curvature_per_m:
            one = np.ones(1, np.float32)
            return x, y, one, np.zeros(1, np.float32)
        radius = np.float32(1 / self.curvature_per_m)
        sign = np.sign(radius)
        across = (radius - y) * sign
        distance = np.hypot(x, across)
        cos, sin = across / distance, sign * x / distance
        angle = np.arctan2(x, across)
        return angle * np.abs(radius), (np.abs(radius) - distance) * sign, cos, sin

    def cuts(self, start_m: float, end_m: float) -> Array:
        """Return places along the road between which it may be drawn flat."""
        cuts = {start_m, end_m} | {place for place, _ in self.kinks if start_m < place < end_m}
        if self.curvature_per_m:
            radius = abs(1 / self.curvature_per_m)
            end_m = min(end_m, 1.3 * radius)
            step = math.sqrt(8 * _SAG_M * radius)
            near, far = np.arange(start_m, min(end_m, 40.0), step), np.arange(40.0, end_m, 2 * step)
            cuts = {cut for cut in cuts if cut <= end_m} | {end_m}
            cuts |= {float(cut) for cut in np.concatenate([near, far])}
        return np.array(sorted(cuts))

    def plane(self) -> tuple[tuple[float, float, float], float]:
        """Return the plane z = a + b x + c y of the own lane ahead, and how far the lane leaves it [m]."""
        half = self.lane_width_m / 2
        s, t = np.meshgrid(np.linspace(NEAREST_M, FARTHEST_M, 61), np.linspace(-half, half, 41))
        points = self.world(s, t, self.section_m(t)).reshape(-1, 3)
        matrix = np.column_stack([np.ones(len(points)), points[:, :2]])
        plane = np.linalg.lstsq(matrix, points[:, 2], rcond=None)[0]
        leave = float(np.abs(matrix @ plane - points[:, 2]).max())
        return (float(plane[0]), float(plane[1]), float(plane[2])), leave


def add_strips(builder: MeshBuilder, road: Alignment, strips: list[Strip]) -> None:
    """Add the strips of a cross-section to a mesh; each is one smooth surface."""
    for strip in strips:
        cuts = road.cuts(strip.start_m, strip.end_m)
        (t0, z0), (t1, z1) = strip.from_m, strip.to_m
        right = road.world(cuts, np.array(t0), np.array(z0))
        left = road.world(cuts, np.array(t1), np.array(z1))
        quads = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
        twisted = bool(road.curvature_per_m) and len(road.kinks) > 0
        if twisted or (road.curvature_per_m and z0 != z1):
            first, second = quads.copy(), quads.copy()
            first[:, 3] = first[:, 2]
            second[:, 1], second[:, 2], second[:, 3] = quads[:, 2], quads[:, 3], quads[:, 3]
            quads = np.concatenate([first, second])
        builder.add(quads, strip.look)


def add_section(
    builder: MeshBuilder, road: Alignment, points_m: list[tuple[float, float]], looks: list[Look]
) -> None:
    """Add a chain of strips from right to left, over the whole length."""
    strips = [Strip(a, b, look) for a, b, look in zip(points_m[:-1], points_m[1:], looks, strict=True)]
    add_strips(builder, road, strips)
