"""How high lane lines lie over the road's surface, and how surely that is no kerb."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..estimators.texture_alignment import TextureFit
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.rays import LEAST_DISPARITY_PX
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import N_ROWS, HeightOverLane, lane_in_road, rays_of_lines
from ..road.priors import HALF_LANE_M
from ..road.surface import LEAST_WEIGHT, kernels
from ..tolerances import KERB_SIGMAS, MAX_LINE_HEIGHT_M
from ..types import Array


def heights_over(pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics) -> Array:
    """Return how high each line of the pattern lies over a road [m], where it was seen, (L,).

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        lines: Estimate from them: their disparities.
        road: Another estimate.
    """
    return np.array([np.average(h, weights=w) for h, w, _ in _heights_along(pattern, rig, lines, road)])


def heights_over_surface(
    pattern: LanePattern, rig: StereoRig, lines: Extrinsics, texture: TextureFit
) -> tuple[HeightOverLane, ...]:
    """Return how high each line lies over the road surface beside it, on the side of the camera.

    Where the asphalt is no plane, a line in it need not lie in its plane; what tells a kerb is its height
    over the asphalt it runs along: over the heights of the lane's own cells, carried on to it (universal
    kriging: Cressie, Statistics for Spatial Data, 1993, section 3.4).

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        lines: Estimate from them: their disparities.
        texture: The asphalt.

    Returns:
        One for each of the L lines; the standard deviations are those of the surface alone.
    """
    yaw, left_m, right_m = lane_in_road(pattern.boundaries, rig, lines)
    aside = texture.cells_xy_m[:, 1] + np.tan(yaw) * texture.cells_xy_m[:, 0]
    inner = (right_m < aside) & (aside < left_m)
    along = _heights_along(pattern, rig, lines, texture.extrinsics)
    return tuple(_over_cells(*of_line, texture, inner) for of_line in along)


def _over_cells(
    heights: Array, weights: Array, places: Array, texture: TextureFit, which: npt.NDArray[np.bool_]
) -> HeightOverLane:
    """Return how high something lies over cells of the road surface, carried on to it.

    Args:
        heights: (N,) heights over the plane of the asphalt [m].
        weights: (N,) of them in the mean that is returned.
        places: (N, 2) where, on the road [m].
        texture: The asphalt.
        which: (C,) cells that count.
    """
    known = np.isfinite(texture.cells_height_m) & which
    xy, residuals = texture.cells_xy_m[known], texture.cells_height_m[known]
    # Outliers are cells of little weight.
    variances = texture.cells_variance[known] / np.maximum(texture.cells_weight[known], LEAST_WEIGHT)
    at = np.concatenate([places, xy])
    kernel, profile = kernels(at)
    of_road = texture.shape.roughness * kernel + texture.shape.profile**2 * profile
    planes = np.column_stack([np.ones(len(at)), at])
    n, mean = len(places), weights / weights.sum()
    to_cells, measured = mean @ of_road[:n, n:], of_road[n:, n:] + np.diag(variances)
    carried = np.linalg.solve(measured, np.column_stack([to_cells, planes[n:]]))
    by_cells, information = carried[:, 0], planes[n:].T @ carried[:, 1:]
    # What the cells leave open of their own plane.
    open_plane = mean @ planes[:n] - by_cells @ planes[n:]
    variance = mean @ of_road[:n, :n] @ mean - by_cells @ to_cells
    variance += open_plane @ np.linalg.pinv(information) @ open_plane
    return HeightOverLane(float(mean @ heights - by_cells @ residuals), float(np.sqrt(max(variance, 0.0))))


def _heights_along(
    pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield heights over a road [m], weights and places on it [m] of the rows each line was seen in."""
    rotation = road_from_camera_rotation(road.pitch_rad, road.roll_rad)
    for ray in rays_of_lines(pattern, rig):
        seen, expected = (plane_from_pose(each, rig).disparities(ray) for each in (lines, road))
        seen = np.maximum(seen, LEAST_DISPARITY_PX)
        metres = road.height_m / seen
        xy = (ray * (rig.fx * rig.baseline_m / seen)[:, None]) @ rotation[:2].T
        # Rows weigh as their pixels do; far ones say little of a height.
        yield (seen - expected) * metres, metres**-2.0, xy


def surely_same(road: Extrinsics, other: TextureFit, rig: StereoRig) -> bool:
    """Whether a part of the asphalt excludes that a road is that of a kerb beside the lane.

    Args:
        road: A road from more of the asphalt.
        other: The part of it that is surely of the lane.
        rig: Intrinsics and baseline.

    Returns:
        Whether the lowest kerb is excluded at both sides of the lane, along all of the part.
    """
    if not other.seen:
        return False
    known = np.isfinite(other.cells_height_m)
    ahead_m = other.cells_xy_m[known, 0]
    # Rows of the image weigh alike, as those of a line do.
    rows = np.linspace(1.0 / ahead_m.max(), 1.0 / ahead_m.min(), N_ROWS)
    to_camera = road_from_camera_rotation(other.extrinsics.pitch_rad, other.extrinsics.roll_rad)
    over = []
    for side_m in (HALF_LANE_M, -HALF_LANE_M):
        places = np.column_stack([1.0 / rows, np.full(N_ROWS, side_m)])
        ray = np.column_stack([places, np.full(N_ROWS, -other.extrinsics.height_m)]) @ to_camera
        ray /= ray[:, :1]
        seen, expected = (plane_from_pose(each, rig).disparities(ray) for each in (road, other.extrinsics))
        heights = (seen - expected) * other.extrinsics.height_m / seen
        over.append(_over_cells(heights, seen**2.0, places, other, known))
    return surely_no_kerb(over) >= 1.0


def surely_no_kerb(heights: Sequence[HeightOverLane]) -> float:
    """Return how surely nothing is the lowest kerb, twice as high as a line may be: 1 is enough.

    Args:
        heights: Over the road surface of the lane; at least one.
    """
    return min(
        (2.0 * MAX_LINE_HEIGHT_M - abs(height.value_m)) / (KERB_SIGMAS * height.std_m) for height in heights
    )


def lies_on(pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics) -> bool:
    """Whether both lines lie in a road."""
    return bool(np.all(np.abs(heights_over(pattern, rig, lines, road)) <= MAX_LINE_HEIGHT_M))
