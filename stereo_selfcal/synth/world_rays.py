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

"""Intersections of the rays of a camera with an uneven road."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .ingredients import Shake, WorldScene
from .renderer import rotation
from .world import Side

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# Samples of a pixel along its column. Along its row the area under an edge is exact.
SUB_ROWS = 4

# Farther than this the road is not drawn [m]: a lane is narrower than 3 px there.
FARTHEST_M = 500.0

# Newton's method on a piecewise parabolic road: from far for a dip, from near for a crest; it has
# converged to well below a millimetre where the ray is not all but parallel to the road.
NEWTON_STEPS = 8
CONVERGED_M = 2e-3
SETTLED_M = 1e-4  # a step along the ray shorter than this is the last
ROWS_AT_ONCE = 16

TINY_M = 1e-6

# Which row sees a point while the rows shake: each step gains two digits and more.
SHAKE_STEPS = 6


class WorldRays:
    """Rays of one camera: which way they go, and where they meet surfaces.

    Args:
        scene: The world.
        side: Which camera.
    """

    def __init__(self, scene: WorldScene, side: Side) -> None:
        rig, pose, camera = scene.rig, scene.pose, scene.camera(side)
        lane_from_rig = (
            rotation(0.0, 0.0, scene.lane_yaw_rad)
            @ rotation(0.0, pose.pitch_rad, 0.0)
            @ rotation(pose.roll_rad, 0.0, 0.0)
        )
        half_m = rig.baseline_m / 2 if side == "left" else -rig.baseline_m / 2
        self.centre_m: Array = np.array([0.0, scene.lateral_offset_m, pose.height_m])
        self.centre_m += half_m * lane_from_rig[:, 1]
        rig_from_camera = rotation(0.0, 0.0, camera.yaw_rad) @ rotation(camera.turned_rad, 0.0, 0.0)
        self.lane_from_camera: Array = lane_from_rig @ rig_from_camera
        self.rig, self.shape, self.lower_px, self._shake = rig, scene.shape, camera.lower_px, scene.shake
        forward, left, up = self.lane_from_camera.T
        self._per_u, self._per_v = -left / rig.fx, -up / rig.fy
        self._at_origin = forward - rig.cx * self._per_u - (rig.cy + camera.lower_px) * self._per_v

    def mirrored(self) -> WorldRays:
        """Return the rays of the camera's image in the mirror z = 0: what a wet road reflects."""
        other = copy(self)
        flip = np.array([1.0, 1.0, -1.0])
        other.centre_m, other.lane_from_camera = flip * self.centre_m, flip[:, None] * self.lane_from_camera
        other._per_u, other._per_v = flip * self._per_u, flip * self._per_v
        other._at_origin = flip * self._at_origin
        return other

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return (x, y, z) of rays scaled to unit depth, broadcast."""
        u, v = np.asarray(u, np.float64), np.asarray(v, np.float64)
        if self._shake is not None:
            right_px, down_px = self._shaken(v, self._shake)
            u, v = u + right_px, v + down_px
        x, y, z = (self._at_origin[i] + u * self._per_u[i] + v * self._per_v[i] for i in range(3))
        return x, y, z

    @property
    def per_pixel(self) -> tuple[Array, Array]:
        """Change of a ray's direction from column to column, and from row to row, (x, y, z) each."""
        return self._per_u, self._per_v

    def project(self, points_m: npt.ArrayLike) -> Array:
        """Return the pixels (n, 2) of points (n, 3) of the lane frame; NaN behind the camera."""
        body = (np.asarray(points_m, np.float64) - self.centre_m) @ self.lane_from_camera
        depth = np.where(body[:, 0] > 0.1, body[:, 0], np.nan)
        u = self.rig.cx - self.rig.fx * body[:, 1] / depth
        v = self.rig.cy - self.rig.fy * body[:, 2] / depth + self.lower_px
        if self._shake is not None:
            at = v
            for _ in range(SHAKE_STEPS):
                right_px, down_px = self._shaken(at, self._shake)
                at = v - down_px
            u, v = u - right_px, at
        return np.stack([u, v], axis=1)

    def _shaken(self, v: Array, shake: Shake) -> tuple[Array, Array]:
        """Return how far right and down of its average view a row looks when it is read [px]."""
        rig = self.rig

        def angles(rows: Array) -> tuple[Array, Array]:
            phase = 2 * np.pi * shake.hz * shake.readout_s * rows / rig.height + shake.phase_rad
            return shake.pitch_rad * np.sin(phase), shake.yaw_rad * np.cos(phase)

        mean = [float(np.mean(angle)) for angle in angles(np.arange(max(rig.cy, 0.0), rig.height))]
        pitch, yaw = angles(v)
        return -rig.fx * (yaw - mean[1]), rig.fy * (pitch - mean[0])

    def meet(self, u: npt.ArrayLike, v: npt.ArrayLike, above_m: float = 0.0) -> tuple[Array, Array, Mask]:
        """Intersect rays with the road, or with a surface ``above_m`` higher.

        Returns:
            Road coordinates s and d [m] of the broadcast shape, and whether the ray meets the surface;
            where it does not, they are those of a far point.
        """
        dx, dy, dz = self.directions(u, v)
        depth = (self.centre_m[2] - above_m) / np.maximum(-dz, 1e-9)
        depth = np.minimum(depth, FARTHEST_M)
        if self.shape.plane:
            meets = depth < FARTHEST_M
        else:
            over_m = np.empty_like(depth)
            # A few rows at a time: they stay in the cache, and those near the rig need few steps.
            for i in range(0, len(depth), ROWS_AT_ONCE):
                rows = slice(i, i + ROWS_AT_ONCE)
                depth[rows], over_m[rows] = self._solve(depth[rows], dx[rows], dy[rows], dz[rows], above_m)
            meets = (depth < FARTHEST_M) & (np.abs(over_m) < CONVERGED_M)
        s, d = self.shape.locate(self.centre_m[0] + depth * dx, self.centre_m[1] + depth * dy)
        return s, d, meets

    def _solve(self, depth: Array, dx: Array, dy: Array, dz: Array, above_m: float) -> tuple[Array, Array]:
        """Return the depths at which rays meet the road, and their remaining heights over it [m]."""
        if self.shape.grade_change > 0:
            depth = np.full_like(depth, FARTHEST_M)
        over_m, per_depth = self._clearance(depth, dx, dy, dz, above_m)
        for _ in range(NEWTON_STEPS):
            moved = np.clip(depth - over_m / np.minimum(per_depth, -1e-6), 0.0, FARTHEST_M)
            settled = float(np.max(np.abs(moved - depth), initial=0.0)) < SETTLED_M
            depth = moved
            over_m, per_depth = self._clearance(depth, dx, dy, dz, above_m)
            if settled:
                break
        return depth, over_m

    def _clearance(
        self, depth: Array, dx: Array, dy: Array, dz: Array, above_m: float
    ) -> tuple[Array, Array]:
        """Return the height of the rays over a surface [m] and its derivative by depth."""
        s, d = self.shape.locate(self.centre_m[0] + depth * dx, self.centre_m[1] + depth * dy)
        height, per_s, per_d = self.shape.height(s, d)
        bend = self.shape.curvature_per_m
        if bend:
            sine, cosine = np.sin(bend * s), np.cos(bend * s)
            dx, dy = (dx * cosine + dy * sine) / (1 - bend * d), dy * cosine - dx * sine
        over_m = self.centre_m[2] - above_m + depth * dz - height
        return over_m, dz - per_s * dx - per_d * dy


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A surface as a camera sees it, in sub-rows of pixels.

    Attributes:
        s: Positions along the road, (rows * SUB_ROWS, width) [m].
        low: Lateral position of the right end of every sample, the same shape [m].
        span: How far every sample extends laterally [m].
        length: How far it extends along the road [m].
        meets: Whether there is surface.
    """

    s: Single
    low: Single
    span: Single
    length: Single
    meets: Mask

    @classmethod
    def seen(cls, rays: WorldRays, first_row: int, above_m: float = 0.0) -> Layer:
        """Intersect all rays from ``first_row`` down with the road, or a surface above it."""
        rig = rays.rig
        n_rows = (rig.height - first_row) * SUB_ROWS
        v = first_row - 0.5 + (np.arange(n_rows)[:, None] + 0.5) / SUB_ROWS
        s, d, meets = rays.meet(np.arange(rig.width + 1) - 0.5, v, above_m)
        s32, d32 = s.astype(np.float32), d.astype(np.float32)
        middle = 0.5 * (s32[:, 1:] + s32[:, :-1])
        span = np.abs(d32[:, 1:] - d32[:, :-1]) + np.float32(TINY_M)
        length = np.abs(np.gradient(middle, axis=0)) + np.float32(TINY_M)
        low = np.minimum(d32[:, 1:], d32[:, :-1])
        return cls(middle, low, span, length, meets[:, 1:] & meets[:, :-1])

    def left_of(self, d_m: float, soft_m: float = 0.0) -> Single:
        """Return how much of every sample lies to the left of a lateral position."""
        if soft_m == 0:
            share = (self.low + self.span - np.float32(d_m)) / self.span
        else:
            share = (self.low + self.span / 2 - np.float32(d_m)) / (self.span + np.float32(soft_m)) + 0.5
        clipped: Single = np.clip(share, 0.0, 1.0).astype(np.float32)
        return clipped

    def between(self, right_m: float, left_m: float, soft_m: float = 0.0) -> Single:
        """Return how much of every sample a band along the road covers."""
        return self.left_of(right_m, soft_m) - self.left_of(left_m, soft_m)

    def beyond(self, s_m: float | Single, soft_m: float = 0.0) -> Single:
        """Return how much of every sample lies farther along the road than ``s_m``."""
        share = (self.s - s_m) / (self.length + np.float32(soft_m)) + np.float32(0.5)
        clipped: Single = np.clip(share, 0.0, 1.0).astype(np.float32)
        return clipped

    @property
    def d(self) -> Single:
        """Lateral positions of the middles of the samples [m]."""
        middle: Single = self.low + self.span * np.float32(0.5)
        return middle

    def pixels(self) -> tuple[Single, Single, Single]:
        """Return s, d and the longer side of the footprint of whole pixels [m]."""
        footprint = np.maximum(pixel_mean(self.span), SUB_ROWS * pixel_mean(self.length))
        return pixel_mean(self.s), pixel_mean(self.d), footprint


def pixel_mean(samples: Single) -> Single:
    """Return the means of the sub-rows of pixels."""
    n_rows, width = samples.shape
    mean: Single = samples.reshape(n_rows // SUB_ROWS, SUB_ROWS, width).mean(axis=1, dtype=np.float32)
    return mean
