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

"""Roads as long as a drive: where they bend, rise and fall to a side."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..second_worlds.cameras import Array, Array32

STEP_M = 0.5  # of everything that is known along a road
_BEFORE_M, _AFTER_M = 15.0, 170.0  # of road before its start and after its end, which is seen
_CELL_M = 1.0  # of the map from places in the world to places along the road
_REACH_M = 45.0  # beside the road to which the map goes
_CHORD_M = 5.0  # of what follows the road, as it is drawn
# Gradients of country roads change over vertical curves of 1000 to 5000 m radius (RAL 2012, table of
# crests and sags), and are below 4 % on most roads.
_CREST_M = (1200.0, 5000.0)
_GRADIENT = 0.03


@dataclass(frozen=True, eq=False)
class Way:
    """A road, sampled along its middle: the middle of the own lane.

    Attributes:
        start_m: Place along the road of the first sample.
        curvature_per_m: One over the radius at each sample, > 0: bends left.
        gradient: Slope at each sample, > 0: rises.
        fall: How far the carriageway falls to the right for each metre to the right, at each sample.
    """

    start_m: float
    curvature_per_m: Array
    gradient: Array
    fall: Array

    @cached_property
    def places_m(self) -> Array:
        """Places of the samples along the road, shape (n,)."""
        places: Array = self.start_m + STEP_M * np.arange(len(self.curvature_per_m))
        return places

    @cached_property
    def heading_rad(self) -> Array:
        """Heading of the road at the samples, shape (n,); 0 at place 0."""
        heading = _integral(self.curvature_per_m)
        return heading - np.interp(0.0, self.places_m, heading)

    @cached_property
    def middle_m(self) -> Array:
        """The samples in the world, shape (n, 3); the one of place 0 is its origin."""
        parts = [
            _integral(part) for part in (np.cos(self.heading_rad), np.sin(self.heading_rad), self.gradient)
        ]
        origin = [np.interp(0.0, self.places_m, part) for part in parts]
        return np.stack([part - zero for part, zero in zip(parts, origin, strict=True)], axis=1)

    def at(self, values: Array, s: Array | float) -> Array:
        """Return what is known at the samples, at other places."""
        result: Array = np.interp(s, self.places_m, values)
        return result

    def world(self, s: Array, t: Array | float, z: Array | float) -> Array:
        """Return points of the world, shape (..., 3), at places along and across, so far over the road.

        The height follows the carriageway's fall for a lane to either side, and is level beyond.
        """
        s, t, z = np.broadcast_arrays(
            np.asarray(s, np.float64), np.asarray(t, np.float64), np.asarray(z, np.float64)
        )
        heading = self.at(self.heading_rad, s)
        x, y, up = (self.at(self.middle_m[:, axis], s) for axis in range(3))
        up = up + z + self.at(self.fall, s) * np.clip(t, -2.5, 6.0)
        return np.stack([x - t * np.sin(heading), y + t * np.cos(heading), up], axis=-1)

    def cuts(self, start_m: float, end_m: float) -> Array:
        """Return places along the road between which it may be drawn flat."""
        return np.linspace(start_m, end_m, max(2, math.ceil((end_m - start_m) / _CHORD_M) + 1))

    def lane(self, x: Array32, y: Array32) -> tuple[Array32, Array32, Array32, Array32]:
        """Return where points lie along and across, and the direction (cos, sin) of the lane there."""
        origin, maps = self._map
        col = ((x - np.float32(origin[0])) / np.float32(_CELL_M)).astype(np.float32)
        row = ((y - np.float32(origin[1])) / np.float32(_CELL_M)).astype(np.float32)
        s, t, cos, sin = (_looked_up(each, col, row) for each in maps)
        return s, t, cos, sin

    @cached_property
    def _map(self) -> tuple[Array, tuple[Array32, ...]]:
        """The places along and across of a grid in the world, and the direction of the nearest lane."""
        low = self.middle_m[:, :2].min(axis=0) - _REACH_M
        size = np.ceil((self.middle_m[:, :2].max(axis=0) + _REACH_M - low) / _CELL_M).astype(int) + 1
        x, y = np.meshgrid(low[0] + _CELL_M * np.arange(size[0]), low[1] + _CELL_M * np.arange(size[1]))
        grid = np.stack([x.ravel(), y.ravel()], axis=1)
        coarse = self.middle_m[::4, :2]
        nearest = np.zeros(len(grid), int)
        for part in np.array_split(np.arange(len(grid)), max(1, len(grid) // 20_000)):
            squared = (
                (grid[part] ** 2).sum(axis=1)[:, None] + (coarse**2).sum(axis=1) - 2 * grid[part] @ coarse.T
            )
            nearest[part] = squared.argmin(axis=1)
        s = self.places_m[::4][nearest]
        for _ in range(3):
            away, ahead, left = self._from_middle(grid, s)
            bend = 1.0 - self.at(self.curvature_per_m, s) * (away * left).sum(axis=1)
            s = s + np.clip((away * ahead).sum(axis=1) / np.maximum(bend, 0.2), -2.0, 2.0)
            s = np.clip(s, self.places_m[0], self.places_m[-1])
        away, ahead, left = self._from_middle(grid, s)
        t = (away * left).sum(axis=1)
        # Before and after the road its line goes on.
        s = s + (away * ahead).sum(axis=1)
        shape = (size[1], size[0])
        maps = tuple(each.reshape(shape).astype(np.float32) for each in (s, t, ahead[:, 0], ahead[:, 1]))
        return low, maps

    def _from_middle(self, points: Array, s: Array) -> tuple[Array, Array, Array]:
        heading = self.at(self.heading_rad, s)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        middle = np.stack([self.at(self.middle_m[:, axis], s) for axis in range(2)], axis=1)
        return points - middle, ahead, np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)


@dataclass(frozen=True, slots=True)
class Bend:
    """A part of a road.

    Attributes:
        length_m: Its length.
        curvature_per_m: One over its radius, > 0: bends left; 0: it is straight.
    """

    length_m: float
    curvature_per_m: float


def way(bends: list[Bend], fall: float, banked: float, hilly: bool, rng: np.random.Generator) -> Way:
    """Return a road of bends; before the first one and after the last one, these go on.

    Args:
        bends: Its parts, in order, without the transitions, which are added between them.
        fall: How it falls to the right where it is straight.
        banked: Fall towards the inside of a bend of 100 m; as much at tighter ones, and less at wider ones.
        hilly: Whether its gradient changes.
        rng: Source of the gradient.
    """
    parts = [np.full(round(_BEFORE_M / STEP_M), bends[0].curvature_per_m)]
    for bend in bends:
        change = bend.curvature_per_m - parts[-1][-1]
        # A clothoid of parameter A (RAL: radius/3 to radius) is A^2 times the change of curvature long.
        length = min(60.0, 0.35 / max(abs(bend.curvature_per_m), abs(parts[-1][-1]), 1e-9)) if change else 0.0
        steps = round(length / STEP_M)
        parts.append(parts[-1][-1] + change * (np.arange(steps) + 1.0) / max(steps, 1))
        parts.append(np.full(max(1, round(bend.length_m / STEP_M)), bend.curvature_per_m))
    parts.append(np.full(round(_AFTER_M / STEP_M), 0.0))
    curvature = np.concatenate(parts)
    tight = np.clip(curvature * 100.0, -1.0, 1.0)
    gradient = _gradients(len(curvature), rng) if hilly else np.zeros(len(curvature))
    return Way(-_BEFORE_M, curvature, gradient, fall * (1.0 - np.abs(tight)) - banked * tight)


def _gradients(count: int, rng: np.random.Generator) -> Array:
    """Return slopes that change over crests and sags."""
    slopes, slope = [np.zeros(0)], float(rng.uniform(-_GRADIENT, _GRADIENT))
    while sum(map(len, slopes)) < count:
        aim = float(rng.uniform(-_GRADIENT, _GRADIENT))
        steps = max(1, round(abs(aim - slope) * rng.uniform(*_CREST_M) / STEP_M))
        slopes.append(np.linspace(slope, aim, steps))
        slopes.append(np.full(round(rng.uniform(20, 120) / STEP_M), aim))
        slope = aim
    gradient: Array = np.concatenate(slopes)[:count]
    return gradient


def _integral(values: Array) -> Array:
    steps = (values[1:] + values[:-1]) / 2 * STEP_M
    result: Array = np.concatenate([[0.0], np.cumsum(steps)])
    return result


def _looked_up(image: Array32, col: Array32, row: Array32) -> Array32:
    """Return an image at scattered places; floats have more places than OpenCV's remap tells apart."""
    left = np.clip(np.floor(col).astype(np.int32), 0, image.shape[1] - 2)
    top = np.clip(np.floor(row).astype(np.int32), 0, image.shape[0] - 2)
    x, y = col - left, row - top
    upper = image[top, left] * (1 - x) + image[top, left + 1] * x
    lower = image[top + 1, left] * (1 - x) + image[top + 1, left + 1] * x
    result: Array32 = (upper * (1 - y) + lower * y).astype(np.float32)
    return result
