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

"""Upright surfaces along a straight road, as a camera sees them: pixel by pixel, with exact edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .world_rays import FARTHEST_M, Array, Mask, WorldRays

# Nearer than this nothing is drawn [m]: a rail beside the camera would fill the picture.
NEAREST_M = 0.3

# Keeps the two sides of a pixel apart where an edge is parallel to one of them.
LEAST_SIDE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """A quantity at the middles of pixels, and how much it changes from pixel to pixel.

    Attributes:
        value: Its values, (H, W).
        per_u: Change from column to column.
        per_v: Change from row to row.
    """

    value: Array
    per_u: Array
    per_v: Array

    def above(self, threshold: float) -> Array:
        """Return the share of every pixel where the quantity is greater than a threshold.

        The share is exact where the quantity is linear within the pixel: the integral of a box (along the
        rows) over a box (along the columns).
        """
        across, down = np.abs(self.per_u), np.abs(self.per_v)
        least = LEAST_SIDE * (across + down) + 1e-12
        across, down = np.maximum(across, least), np.maximum(down, least)
        off, sum_, difference = self.value - threshold, (across + down) / 2, (across - down) / 2
        area = _ramp(off + sum_) - _ramp(off + difference) - _ramp(off - difference) + _ramp(off - sum_)
        share: Array = np.clip(area / (across * down), 0.0, 1.0)
        return share

    def between(self, low: float, high: float) -> Array:
        """Return the share of every pixel where the quantity is between two values."""
        return self.above(low) - self.above(high)

    def periodic(self, first: float, width: float, every: float) -> Array:
        """Return the share of every pixel in strips of a width, one in each period from ``first`` on."""
        span = np.maximum(np.hypot(self.per_u, self.per_v), 1e-9)

        def painted(at: Array) -> Array:
            periods = np.floor((at - first) / every)
            length: Array = periods * width + np.minimum(at - first - periods * every, width)
            return length

        share: Array = (painted(self.value + span / 2) - painted(self.value - span / 2)) / span
        return share

    @property
    def span(self) -> Array:
        """Extent of a pixel."""
        extent: Array = np.abs(self.per_u) + np.abs(self.per_v)
        return extent


def _ramp(x: Array) -> Array:
    """Return the integral of the integral of a step."""
    ramp: Array = 0.5 * np.square(np.maximum(x, 0.0))
    return ramp


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """The plane d = const of a straight road, in the part of the picture that shows it.

    Attributes:
        rows: First row and the row after the last.
        columns: First column and the column after the last.
        along: Positions along the road [m].
        over: Heights over the road [m].
        meets: Whether the plane is met before the camera.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    along: Linear
    over: Linear
    meets: Mask

    @classmethod
    def seen(cls, rays: WorldRays, d_m: float, low_m: float, high_m: float) -> Upright | None:
        """Intersect the rays with a plane, where its height over the road is within a range.

        Args:
            rays: The camera's.
            d_m: Lateral position of the plane [m].
            low_m: Least height over the road [m].
            high_m: Greatest height [m].

        Returns:
            None where the picture does not show it.
        """
        rig = rays.rig
        u, v = np.arange(rig.width), np.arange(rig.height)[:, None]
        _, sideways, rise = rays.directions(u, v)
        ahead = d_m - rays.centre_m[1]
        depth = ahead / np.where(np.abs(sideways) < 1e-9, 1e-9, sideways)
        # Within a pixel of its end the plane is no longer linear.
        meets = (depth > NEAREST_M) & (depth < FARTHEST_M)
        height = rays.centre_m[2] + depth * rise
        margin = depth / min(rig.fx, rig.fy) * (1 + np.abs(rise / np.where(sideways == 0, 1.0, sideways)))
        # Where the road has height the range is not so sharp.
        steep_m = 0.0 if rays.shape.plane else 1.0 + 0.2 * depth
        inside = meets & (height > low_m - margin - steep_m) & (height < high_m + margin + steep_m)
        if not inside.any():
            return None
        row, column = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        rows, columns = (int(row[0]), int(row[-1]) + 1), (int(column[0]), int(column[-1]) + 1)
        part = (slice(*rows), slice(*columns))
        return cls._of(rays, d_m, rows, columns, np.where(meets, depth, FARTHEST_M)[part], meets[part])

    @classmethod
    def _of(
        cls,
        rays: WorldRays,
        d_m: float,
        rows: tuple[int, int],
        columns: tuple[int, int],
        depth: Array,
        meets: Mask,
    ) -> Upright:
        ahead, sideways, rise = rays.directions(np.arange(*columns), np.arange(*rows)[:, None])
        sideways = np.where(np.abs(sideways) < 1e-9, 1e-9, sideways)
        s, z = rays.centre_m[0] + depth * ahead, rays.centre_m[2] + depth * rise
        ground, slope, _ = rays.shape.height(s, d_m)
        along, over = [], []
        for per_pixel in rays.per_pixel:
            # The ray turns by per_pixel, and so it meets the plane at another depth.
            per_s = depth * (per_pixel[0] - ahead / sideways * per_pixel[1])
            along.append(per_s)
            over.append(depth * (per_pixel[2] - rise / sideways * per_pixel[1]) - slope * per_s)
        return cls(rows, columns, Linear(s, *along), Linear(z - ground, *over), meets)

    def section(self, begin_m: float, end_m: float) -> Upright | None:
        """Return the columns of it that show a part of the road; None where there are none."""
        at, half = self.along.value, self.along.span
        inside = self.meets & (at > begin_m - half) & (at < end_m + half)
        columns = np.flatnonzero(inside.any(axis=0))
        if not columns.size:
            return None
        first, last = int(columns[0]), int(columns[-1]) + 1
        part = slice(first, last)
        along, over = (
            Linear(each.value[:, part], each.per_u[:, part], each.per_v[:, part])
            for each in (self.along, self.over)
        )
        shown = (self.columns[0] + first, self.columns[0] + last)
        return Upright(self.rows, shown, along, over, self.meets[:, part])

    def over_curve(self, lift_m: Array, slope: Array) -> Linear:
        """Return the heights over a curve in the plane.

        Args:
            lift_m: Height of the curve over the road at every pixel [m].
            slope: Its change along the road [m/m].
        """
        return Linear(
            self.over.value - lift_m,
            self.over.per_u - slope * self.along.per_u,
            self.over.per_v - slope * self.along.per_v,
        )
