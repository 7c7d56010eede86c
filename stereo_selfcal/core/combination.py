"""Lines and asphalt together: what a road that is no plane does to an estimate from lines, and their mean.

The pixels of two stripes give the plane of the stripes to a millimetre, yet the road between them is not in
it: heights under the stripes walk as those under the asphalt do (:mod:`.unevenness`). With the roughness
that the asphalt shows, the estimate from lines gets the uncertainty it has as an estimate of the road, and
both can be weighted by their information.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from .corridor import plane_of, plane_to_extrinsics
from .extrinsics import Array, Extrinsics, road_from_camera_rotation
from .geometry import apply_homography, road_from_image
from .pattern import LanePattern
from .places import MAX_LINE_HEIGHT_M
from .refinement import RefinedFit
from .rig import StereoRig
from .road import lane_in_road
from .texture import AGREEMENT, TextureFit
from .unevenness import RoadShape, kernels

# Calibrations of stereo cameras end with reprojection errors of a tenth of a pixel.
RECTIFICATION_STD_PX = 0.1
# Nothing is measured where the disparity is a pixel.
_LEAST_DISPARITY_PX = 1.0
_LEAST_WEIGHT = 1e-3  # of an outlier
_N_ROWS = 8  # of a line, which has two parameters
# Of the chi-squared distribution with three degrees of freedom: exceeded in one of twenty cases.
_UNLIKELY_CHI2_3 = 7.815
# Painted lines are parallel only so far: on the plane of the asphalt, those of 12 recorded roads meet at an
# angle of 5 mrad (RMS), as a lane does that is 5 cm wider after 10 m.
_PAINT_STD_RAD = 0.005
_HALF_LANE_M = 1.75  # of a usual one
_ANGLE_STEPS = np.array([1e-4, 1e-5, 1e-5])  # m, rad, rad: of a derivative
# Height [m], pitch, roll [rad] by which both may differ all the same, as far as the lever of the nearest line
# stretches that: an estimate off by this is called wrong, and the asphalt alone is better by half.
MAX_DIFFERENCE = np.array([0.060, np.radians(0.5), np.radians(1.2)])
# The same, of an estimate that has nothing but its own standard deviation to show that it is not wrong.
WRONG = MAX_DIFFERENCE.copy()

_SURE_SIGMAS = 3.0  # one in 370
# Asphalt that says how high a line or a plane lies excludes what is this many of its standard deviations off:
# a second question, after all of the asphalt has agreed.
KERB_SIGMAS = 2.0


def same_road(a: Extrinsics, b: Extrinsics) -> bool:
    """Whether two estimates are nearer than what the asphalt could tell apart."""
    return bool(np.all(np.abs(a.as_array() - b.as_array()) < AGREEMENT))


def heights_over(pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics) -> Array:
    """Return how high each line of the pattern lies over a road [m], where it was seen, (L,).

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        lines: Estimate from them: their disparities.
        road: Another estimate.
    """
    return np.array([np.average(h, weights=w) for h, w, _ in _heights_along(pattern, rig, lines, road)])


def heights_over_asphalt(
    pattern: LanePattern, rig: StereoRig, lines: Extrinsics, texture: TextureFit
) -> tuple[Array, Array]:
    """Return how high each line lies over the asphalt beside it, on the side of the camera.

    Where the asphalt is no plane, a line in it need not lie in its plane; what tells a kerb is its height
    over the asphalt it runs along: over the heights of the lane's own cells, carried on to it (universal
    kriging: Cressie, Statistics for Spatial Data, 1993, section 3.4).

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        lines: Estimate from them: their disparities.
        texture: The asphalt.

    Returns:
        (L,) heights, (L,) their standard deviations by the asphalt's [m].
    """
    yaw, left_m, right_m = lane_in_road(pattern.boundaries, rig, lines)
    aside = texture.cells_xy_m[:, 1] + np.tan(yaw) * texture.cells_xy_m[:, 0]
    inner = (right_m < aside) & (aside < left_m)
    along = _heights_along(pattern, rig, lines, texture.extrinsics)
    over = [_over_cells(*of_line, texture, inner) for of_line in along]
    return np.array([height for height, _ in over]), np.array([std for _, std in over])


def _over_cells(
    heights: Array, weights: Array, places: Array, texture: TextureFit, which: npt.NDArray[np.bool_]
) -> tuple[float, float]:
    """Return how high something lies over cells of the asphalt, carried on to it, and its deviation [m].

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
    variances = texture.cells_variance[known] / np.maximum(texture.cells_weight[known], _LEAST_WEIGHT)
    at = np.concatenate([places, xy])
    kernel, profile = kernels(at)
    of_road = texture.shape.roughness * kernel + texture.shape.profile**2 * profile
    planes = np.column_stack([np.ones(len(at)), at])
    n, mean = len(places), weights / weights.sum()
    to_cells, measured = mean @ of_road[:n, n:], of_road[n:, n:] + np.diag(variances)
    carried = np.linalg.solve(measured, np.column_stack([to_cells, planes[n:]]))
    by_cells, information = carried[:, 0], planes[n:].T @ carried[:, 1:]
    left = mean @ planes[:n] - by_cells @ planes[n:]
    variance = mean @ of_road[:n, :n] @ mean - by_cells @ to_cells
    variance += left @ np.linalg.pinv(information) @ left
    return float(mean @ heights - by_cells @ residuals), float(np.sqrt(max(variance, 0.0)))


def _heights_along(
    pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield heights over a road [m], weights and places on it [m] of the rows each line was seen in."""
    rotation = road_from_camera_rotation(road.pitch_rad, road.roll_rad)
    for ray in _rays(pattern, rig):
        seen, expected = ray @ plane_of(lines, rig), ray @ plane_of(road, rig)
        seen = np.maximum(seen, _LEAST_DISPARITY_PX)
        metres = road.height_m / seen
        xy = (ray * (rig.fx * rig.baseline_m / seen)[:, None]) @ rotation[:2].T
        # Rows weigh as their pixels do; far ones say little of a height.
        yield (seen - expected) * metres, metres**-2.0, xy


def surely_right(covariance: Array) -> bool:
    """Whether three standard deviations of an estimate are less than what is called wrong."""
    return bool(np.all(_SURE_SIGMAS * np.sqrt(np.diag(covariance)) <= WRONG))


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
    rows = np.linspace(1.0 / ahead_m.max(), 1.0 / ahead_m.min(), _N_ROWS)
    to_camera = road_from_camera_rotation(other.extrinsics.pitch_rad, other.extrinsics.roll_rad)
    over = []
    for side_m in (_HALF_LANE_M, -_HALF_LANE_M):
        places = np.column_stack([1.0 / rows, np.full(_N_ROWS, side_m)])
        ray = np.column_stack([places, np.full(_N_ROWS, -other.extrinsics.height_m)]) @ to_camera
        ray /= ray[:, :1]
        seen, expected = ray @ plane_of(road, rig), ray @ plane_of(other.extrinsics, rig)
        heights = (seen - expected) * other.extrinsics.height_m / seen
        over.append(_over_cells(heights, seen**2.0, places, other, known))
    heights_m, stds_m = np.transpose(over)
    return surely_no_kerb(heights_m, stds_m) >= 1.0


def surely_no_kerb(heights_m: Array, stds_m: Array) -> float:
    """Return how surely nothing is the lowest kerb, twice as high as a line may be: 1 is enough.

    Args:
        heights_m: (N,) heights over the asphalt [m].
        stds_m: (N,) their standard deviations [m].
    """
    return float(np.min((2.0 * MAX_LINE_HEIGHT_M - np.abs(heights_m)) / (KERB_SIGMAS * stds_m)))


def lies_on(pattern: LanePattern, rig: StereoRig, lines: Extrinsics, road: Extrinsics) -> bool:
    """Whether both lines lie in a road."""
    return bool(np.all(np.abs(heights_over(pattern, rig, lines, road)) <= MAX_LINE_HEIGHT_M))


def _rays(pattern: LanePattern, rig: StereoRig) -> list[Array]:
    """Return the rays (1, y, z) of the rows each line was seen in, from the middle of the baseline."""
    rays = []
    for index, line in enumerate(pattern.left):
        seen = (pattern.rows >= line.rows.min()) & (pattern.rows <= line.rows.max())
        v = pattern.rows[seen]
        u = pattern.columns[:, index, seen].mean(axis=0)
        rays.append(np.column_stack([np.ones(len(v)), -(u - rig.cx) / rig.fx, -(v - rig.cy) / rig.fy]))
    return rays


def covariance_by_road(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, shape: RoadShape
) -> Array:
    """Return the covariance (3, 3) that the shape of the road gives an estimate from lines.

    The disparities of the lines, row by row and of equal weight, are fitted by a plane; the heights of
    the road are no plane, with the covariance the asphalt shows.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        shape: Roughness, profile and mismatch of the road between them.

    Returns:
        Zeros where the road is a plane, as far as the asphalt shows.
    """
    if not shape.uneven:
        return np.zeros((3, 3))
    plane = plane_of(extrinsics, rig)
    ray = np.concatenate(_rays(pattern, rig))
    disparity = ray @ plane
    ray, disparity = ray[disparity > _LEAST_DISPARITY_PX], disparity[disparity > _LEAST_DISPARITY_PX]
    depth = rig.fx * rig.baseline_m / disparity
    rotation = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)
    xy = (ray * depth[:, None]) @ rotation[:2].T
    # A road higher by e has a disparity greater by e / metres.
    metres = extrinsics.height_m / disparity
    kernel, profile = kernels(xy)
    heights = (
        shape.roughness * kernel + shape.profile**2 * profile + np.diag((shape.mismatch_px * metres) ** 2)
    )
    by_plane = plane_to_extrinsics(plane, rig)
    by_heights = by_plane @ (np.linalg.pinv(ray) / metres)
    covariance = by_heights @ heights @ by_heights.T
    symmetric: Array = (covariance + covariance.T) / 2.0
    return symmetric


def covariance_by_kerbs(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, doubtful: Sequence[int]
) -> Array:
    """Return the covariance (3, 3) of an estimate from boundaries that may be the lowest kerbs, at even odds.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        doubtful: Which of the boundaries.
    """
    covariance = np.zeros((3, 3))
    plane = plane_of(extrinsics, rig)
    by_plane = plane_to_extrinsics(plane, rig)
    rays = _rays(pattern.boundaries, rig)
    solve = np.linalg.pinv(np.concatenate(rays))
    for line in doubtful:
        # A kerb higher by e has a disparity greater by e / metres. At even odds, e scatters by half of it.
        by_height = [ray @ plane / extrinsics.height_m * (i == line) for i, ray in enumerate(rays)]
        change = by_plane @ solve @ np.concatenate(by_height) * MAX_LINE_HEIGHT_M
        covariance += np.outer(change, change)
    return covariance


def covariance_by_stages(lines: Extrinsics, covariance: Array, refined: RefinedFit | None) -> Array:
    """Return the covariance (3, 3) of a refined estimate that is not that of the lines it began with.

    Both are of the same stripes. Where they differ by more than their covariances explain, one of them has
    taken something else for a part of a stripe, and it is not known which.

    Args:
        lines: Estimate from the lines.
        covariance: (3, 3) of it.
        refined: Fit of the grey values.
    """
    if refined is None:
        return np.zeros((3, 3))
    difference = refined.extrinsics.as_array() - lines.as_array()
    chi2 = float(difference @ np.linalg.solve(covariance + refined.covariance, difference))
    return np.outer(difference, difference) * (chi2 > _UNLIKELY_CHI2_3)


def covariance_by_paint(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, shape: RoadShape
) -> Array:
    """Return the covariance (3, 3) that lines painted not quite parallel give an estimate from them.

    The disparities of two lines leave the pose nearly free along a valley; the angle between them on the
    road, taken to be zero, says where in it.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        shape: Of the road between them.

    Returns:
        Zeros where the road is a plane, as far as the asphalt shows: rendered lines are parallel.
    """
    if not shape.uneven:
        return np.zeros((3, 3))
    ray = np.concatenate(_rays(pattern.boundaries, rig))
    by_plane = plane_to_extrinsics(plane_of(extrinsics, rig), rig)
    by_disparity = by_plane @ np.linalg.pinv(ray)
    free = by_disparity @ by_disparity.T
    angle = _angle_by_pose(pattern.boundaries, rig, extrinsics)
    moved = free @ angle / (angle @ free @ angle) * _PAINT_STD_RAD
    covariance: Array = np.outer(moved, moved)
    return covariance


def _angle_by_pose(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the derivative (3,) of the angle between two lines on the road by the pose."""
    ends = np.array([[line.rows.min(), line.rows.max()] for line in pattern.left])
    columns = [line.column_at(rows) for line, rows in zip(pattern.left, ends, strict=True)]
    points = np.stack([np.array(columns), ends], axis=-1)

    def angle(pose: Array) -> float:
        to_road = road_from_image(rig, Extrinsics.from_array(pose), "left")
        far, near = np.moveaxis(apply_homography(to_road, points), 1, 0)
        tangents = (far[:, 1] - near[:, 1]) / (far[:, 0] - near[:, 0])
        return float(np.arctan(tangents[0]) - np.arctan(tangents[1]))

    pose = extrinsics.as_array()
    steps = np.diag(_ANGLE_STEPS)
    return np.array([angle(pose + step) - angle(pose - step) for step in steps]) / (2.0 * _ANGLE_STEPS)


def covariance_by_rectification(rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the covariance (3, 3) that imperfect intrinsics of a rig give any estimate with it.

    The disparities of a rectified pair are off by as much as the calibration of the cameras has left: a
    constant, and what grows to the sides and to the top and bottom of the image.
    """
    reach = np.array([1.0, rig.width / (2.0 * rig.fx), rig.height / (2.0 * rig.fy)])
    by_plane = plane_to_extrinsics(plane_of(extrinsics, rig), rig) * (RECTIFICATION_STD_PX / reach)
    covariance: Array = by_plane @ by_plane.T
    return covariance


def combine(lines: Extrinsics, covariance: Array, texture: TextureFit) -> tuple[Extrinsics, Array]:
    """Return the mean of both estimates, weighted by their information, and its covariance.

    They share no pixel, as the asphalt is aligned without the paint; that both may lie in the same hollow of
    the road is neglected. Where they differ by more than their covariances explain, it is enlarged
    by as much (R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev. 40, 1932).

    Args:
        lines: Estimate from lines.
        covariance: (3, 3) of it, with the shape of the road.
        texture: The asphalt.
    """
    information = [np.linalg.inv(covariance), np.linalg.inv(texture.covariance)]
    total = np.linalg.inv(information[0] + information[1])
    mean = total @ (information[0] @ lines.as_array() + information[1] @ texture.extrinsics.as_array())
    difference = lines.as_array() - texture.extrinsics.as_array()
    chi2 = float(difference @ np.linalg.solve(covariance + texture.covariance, difference))
    if chi2 > _UNLIKELY_CHI2_3:
        total = total * (chi2 / len(difference))
    return Extrinsics.from_array(mean), (total + total.T) / 2.0
