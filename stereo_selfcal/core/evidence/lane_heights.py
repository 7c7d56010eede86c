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

"""Heights of lane lines over the road surface, and whether they exclude a kerb."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..estimators.texture_fit import TextureFit
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.rays import LEAST_DISPARITY_PX
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import N_ROWS, HeightOverLane, lane_in_road, rays_of_lines
from ..numerics.linear import solve_linear
from ..rejection import NotFitted
from ..road.extent import LEAST_WEIGHT
from ..road.priors import MIN_LANE_WIDTH_M
from ..road.unevenness import unit_covariances
from ..tolerances import KERB_SIGMAS, MAX_LINE_HEIGHT_M
from ..types import Array


def heights_over_surface(
    pattern: LanePattern, rig: StereoRig, line_pose: Extrinsics, texture: TextureFit
) -> tuple[HeightOverLane, ...]:
    """Return the height of each line over the road surface beside it, on the side of the camera.

    Where the road surface is uneven, a painted line need not lie in its plane. A kerb is known by its height
    over the surface it runs along. So the heights of the lane's own cells are extrapolated to the line
    (universal kriging: Cressie, Statistics for Spatial Data, 1993, section 3.4).

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        line_pose: Pose estimated from them: it gives their disparities.
        texture: The alignment of the road surface.

    Returns:
        One for each of the L lines; the standard deviations are those of the surface alone.
    """
    yaw, left_m, right_m = lane_in_road(pattern.boundaries, rig, line_pose)
    aside = texture.cells_xy_m[:, 1] + np.tan(yaw) * texture.cells_xy_m[:, 0]
    inner = (right_m < aside) & (aside < left_m)
    lines = _heights_along(pattern, rig, line_pose, texture.extrinsics)
    return tuple(_height_over_cells(*along, texture, inner) for along in lines)


def heights_over_strip(
    road_pose: Extrinsics, strip: TextureFit, rig: StereoRig
) -> tuple[HeightOverLane, HeightOverLane]:
    """Return the height of a plane over the road under the car, at both sides of a lane.

    The plane may be that of a pavement beside the lane. It is compared with the surface of the strip under
    the car, extrapolated to the sides of the narrowest lane.

    Args:
        road_pose: Pose over the plane of a wider part of the road surface.
        strip: Alignment of the strip under the car alone.
        rig: Intrinsics and baseline.
    """
    known = np.isfinite(strip.cells_height_m)
    ahead_m = strip.cells_xy_m[known, 0]
    # Points at equal steps of image rows, as those of a line.
    rows = np.linspace(1.0 / ahead_m.max(), 1.0 / ahead_m.min(), N_ROWS)
    to_camera = road_from_camera_rotation(strip.extrinsics.pitch_rad, strip.extrinsics.roll_rad)
    sides = (
        np.column_stack([1.0 / rows, np.full(N_ROWS, side_m)])
        for side_m in (MIN_LANE_WIDTH_M / 2.0, -MIN_LANE_WIDTH_M / 2.0)
    )
    left, right = (_plane_over_strip(side, to_camera, road_pose, strip, rig) for side in sides)
    return left, right


def _plane_over_strip(
    positions_m: Array, to_camera: Array, road_pose: Extrinsics, strip: TextureFit, rig: StereoRig
) -> HeightOverLane:
    """Return the mean height of a plane over the strip's surface at positions (N, 2) on the road [m]."""
    height_m = strip.extrinsics.height_m
    ray = np.column_stack([positions_m, np.full(len(positions_m), -height_m)]) @ to_camera
    ray /= ray[:, :1]
    seen, expected = (plane_from_pose(each, rig).disparities(ray) for each in (road_pose, strip.extrinsics))
    heights_m = (seen - expected) * height_m / seen
    return _height_over_cells(heights_m, seen**2.0, positions_m, strip, np.isfinite(strip.cells_height_m))


def _height_over_cells(
    heights: Array, weights: Array, positions_m: Array, texture: TextureFit, usable: npt.NDArray[np.bool_]
) -> HeightOverLane:
    """Return the mean height of points over the road surface, extrapolated from its cells.

    Args:
        heights: (N,) heights of the points over the plane of the road surface [m].
        weights: (N,) their weights in the mean.
        positions_m: (N, 2) their positions on the road [m].
        texture: The alignment of the road surface.
        usable: (C,) cells to extrapolate from.
    """
    known = np.isfinite(texture.cells_height_m) & usable
    xy, residuals = texture.cells_xy_m[known], texture.cells_height_m[known]
    # Outliers are cells of small weight.
    variances = texture.cells_variance[known] / np.maximum(texture.cells_weight[known], LEAST_WEIGHT)
    at = np.concatenate([positions_m, xy])
    kernel, profile = unit_covariances(at)
    road = texture.unevenness.roughness * kernel + texture.unevenness.camber**2 * profile
    planes = np.column_stack([np.ones(len(at)), at])
    n, mean = len(positions_m), weights / weights.sum()
    to_cells, measured = mean @ road[:n, n:], road[n:, n:] + np.diag(variances)
    kriging = solve_linear(measured, np.column_stack([to_cells, planes[n:]]), "cells that are independent")
    if isinstance(kriging, NotFitted):
        return HeightOverLane(float(mean @ heights), np.inf)  # nothing is known of the surface there
    cell_weights, information = kriging[:, 0], planes[n:].T @ kriging[:, 1:]
    # The error of the plane that the cells determine.
    plane_error = mean @ planes[:n] - cell_weights @ planes[n:]
    variance = mean @ road[:n, :n] @ mean - cell_weights @ to_cells
    variance += plane_error @ np.linalg.pinv(information) @ plane_error
    return HeightOverLane(
        float(mean @ heights - cell_weights @ residuals), float(np.sqrt(max(variance, 0.0)))
    )


def _heights_along(
    pattern: LanePattern, rig: StereoRig, line_pose: Extrinsics, road_pose: Extrinsics
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield for each line its N heights over a road [m], their weights and positions on it (N, 2) [m]."""
    rotation = road_from_camera_rotation(road_pose.pitch_rad, road_pose.roll_rad)
    for ray in rays_of_lines(pattern, rig):
        seen, expected = (plane_from_pose(each, rig).disparities(ray) for each in (line_pose, road_pose))
        seen = np.maximum(seen, LEAST_DISPARITY_PX)
        metres = road_pose.height_m / seen
        xy = (ray * (rig.fx * rig.baseline_m / seen)[:, None]) @ rotation[:2].T
        # A row has the weight of its pixels, as one pixel is a larger height farther away.
        yield (seen - expected) * metres, metres**-2.0, xy


def surely_no_kerb(heights: Sequence[HeightOverLane]) -> float:
    """Return how surely all heights exclude the lowest kerb, over what is needed: 1 is enough.

    The lowest kerb is 6 cm high, twice ``MAX_LINE_HEIGHT_M``. Each height must be ``KERB_SIGMAS`` of its
    standard deviations below that.

    Args:
        heights: Heights over the road surface of the lane; at least one.
    """
    return min(
        (2.0 * MAX_LINE_HEIGHT_M - abs(height.value_m)) / (KERB_SIGMAS * height.std_m) for height in heights
    )
