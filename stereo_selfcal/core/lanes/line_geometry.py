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

"""Height over a plane and lateral offset of a line that both cameras see, and the height's uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import apply_homography, road_from_image
from ..geometry.plane import DisparityPlane
from ..geometry.pose import Extrinsics
from ..geometry.rays import LEAST_DISPARITY_PX, pixel_rays
from ..tolerances import MAX_LINE_HEIGHT_M
from ..types import Array
from .lane_pair import ImageLine, LanePattern

_DEPTH_SIGMAS = 3.0  # a line is surely below a plane by this many standard deviations
N_ROWS = 8  # rows in which a line is evaluated: enough, as it has two parameters


@dataclass(frozen=True, slots=True)
class HeightOverLane:
    """Height over the plane of a lane, or over its surface.

    Attributes:
        value_m: The height [m], > 0: above.
        std_m: Its standard deviation [m].
    """

    value_m: float
    std_m: float


@dataclass(frozen=True, slots=True)
class BelowPlane:
    """How deep a line lies below a plane [m], and the standard deviation [m]."""

    depth_m: float = 0.0
    std_m: float = 0.0

    @property
    def limit_m(self) -> float:
        """The depth up to which the line may lie in the plane [m]."""
        return max(MAX_LINE_HEIGHT_M, _DEPTH_SIGMAS * self.std_m)

    @property
    def surely_below(self) -> bool:
        """Whether the line surely does not lie in the plane."""
        return self.depth_m > self.limit_m


def height_and_offset_m(
    left: ImageLine, right: ImageLine, plane: DisparityPlane, rig: StereoRig
) -> tuple[float, float]:
    """Return the height of a line over a plane [m], and its lateral offset from the camera [m], > 0: left.

    Args:
        left: The line in the left image.
        right: The same in the right image.
        plane: The road, of the camera in the middle.
        rig: Intrinsics and baseline.
    """
    heights, offsets = heights_and_offsets_m([(left, right)], plane, rig)
    return float(heights[0]), float(offsets[0])


def heights_and_offsets_m(
    pairs: Sequence[tuple[ImageLine, ImageLine]], plane: DisparityPlane, rig: StereoRig
) -> tuple[Array, Array]:
    """Return heights (K,) and offsets (K,) of lines as :func:`height_and_offset_m` does, all at once.

    Args:
        pairs: Each line in the left and in the right image.
        plane: The road, of the camera in the middle.
        rig: Intrinsics and baseline.
    """
    numbers = np.array(
        [
            [(line.u_mid, line.slope, line.v_mid, line.rows.min(), line.rows.max()) for line in (left, right)]
            for left, right in pairs
        ]
    ).reshape(-1, 2, 5)
    first, last = numbers[:, :, 3].max(axis=1), numbers[:, :, 4].min(axis=1)
    v = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, N_ROWS)
    u_mid, slope, v_mid = (numbers[:, :, index, None] for index in range(3))
    columns = u_mid + slope * (v[:, None] - v_mid)
    ray, disparity = pixel_rays(rig, columns.mean(axis=1), v), columns[:, 0] - columns[:, 1]
    metres, weights = _metres(disparity, plane, rig)
    weights /= weights.sum(axis=1, keepdims=True)
    heights = ((disparity - plane.disparities(ray)) * metres * weights).sum(axis=1)
    far = np.maximum(disparity, LEAST_DISPARITY_PX)
    return heights, (ray[..., 1] * rig.fx * rig.baseline_m / far * weights).sum(axis=1)


def height_std_m(
    left: ImageLine,
    right: ImageLine,
    plane: DisparityPlane,
    rig: StereoRig,
    plane_covariance: Array | None = None,
) -> float:
    """Return the standard deviation of the height of a line over a plane [m].

    Args:
        left: The line in the left image.
        right: The same in the right image.
        plane: The road, of the camera in the middle.
        rig: Intrinsics and baseline.
        plane_covariance: (3, 3) of the plane; None for the standard deviation by the line alone.
    """
    v, ray, disparity = _rows_of(left, right, rig)
    metres, weights = _metres(disparity, plane, rig)
    jac_height_row = weights / weights.sum() * metres
    variance = 0.0
    for line in (left, right):
        jac_height_line = np.array([jac_height_row.sum(), jac_height_row @ (v - line.v_mid)])
        variance += float(jac_height_line @ line.covariance @ jac_height_line)
    if plane_covariance is not None:
        jac_height_plane = jac_height_row @ ray
        variance += float(jac_height_plane @ plane_covariance @ jac_height_plane)
    return float(np.sqrt(variance))


def _rows_of(left: ImageLine, right: ImageLine, rig: StereoRig) -> tuple[Array, Array, Array]:
    """Return rows (N,), rays (1, y, z) from the middle of the baseline (N, 3), disparities (N,) [px]."""
    v = np.linspace(max(left.rows.min(), right.rows.min()), min(left.rows.max(), right.rows.max()), N_ROWS)
    columns = left.column_at(v), right.column_at(v)
    u = (columns[0] + columns[1]) / 2.0
    return v, pixel_rays(rig, u, v), columns[0] - columns[1]


def rays_of_lines(pattern: LanePattern, rig: StereoRig) -> list[Array]:
    """Return the rays (N, 3) from the middle of the baseline to each line, in the rows where it was seen.

    Of a line that lies between two sampled rows, it is the row next to it.
    """
    rays = []
    for index, line in enumerate(pattern.left):
        seen = (pattern.rows >= line.rows.min()) & (pattern.rows <= line.rows.max())
        if not seen.any():
            seen[np.argmin(np.abs(pattern.rows - line.rows.mean()))] = True
        rays.append(pixel_rays(rig, pattern.columns[:, index, seen].mean(axis=0), pattern.rows[seen]))
    return rays


def _metres(disparity: Array, plane: DisparityPlane, rig: StereoRig) -> tuple[Array, Array]:
    """Return the height of a pixel of disparity (N,) [m], and the weights of rows (N,): inverse squares."""
    metres: Array = plane.height_m(rig) / np.maximum(disparity, LEAST_DISPARITY_PX)
    return metres, metres**-2.0


def lane_in_road(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return lane yaw [rad] and the positions of all L lines at x = 0 [m], from the left image."""
    to_road = road_from_image(rig, extrinsics, "left")
    columns = pattern.columns[0][:, [0, -1]]
    ends = np.stack([columns, np.broadcast_to(pattern.rows[[0, -1]], columns.shape)], axis=-1)
    far, near = np.moveaxis(apply_homography(to_road, ends), 1, 0)
    tangent = float(np.mean(((far[:, 1] - near[:, 1]) / (far[:, 0] - near[:, 0]))[:2]))
    # The heading of the lane is minus the yaw of the camera.
    return np.concatenate([[-np.arctan(tangent)], near[:, 1] - tangent * near[:, 0]])
