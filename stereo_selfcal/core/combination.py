"""Lines and asphalt together: what a road that is no plane does to an estimate from lines, and their mean.

The pixels of two stripes give the plane of the stripes to a millimetre, yet the road between them is not in
it: heights under the stripes walk as those under the asphalt do (:mod:`.unevenness`). With the roughness
that the asphalt shows, the estimate from lines gets the uncertainty it has as an estimate of the road, and
both can be weighted by their information.
"""

from __future__ import annotations

import numpy as np

from .corridor import plane_of, plane_to_extrinsics
from .extrinsics import Array, Extrinsics, road_from_camera_rotation
from .pattern import ImageLine, LanePattern
from .refinement import RefinedFit
from .rig import StereoRig
from .texture import AGREEMENT, TextureFit
from .unevenness import RoadShape, kernels

# Calibrations of stereo cameras end with reprojection errors of a tenth of a pixel.
RECTIFICATION_STD_PX = 0.1
# Nothing is measured where the disparity is a pixel.
_LEAST_DISPARITY_PX = 1.0
_N_ROWS = 8  # of a line, which has two parameters
# Near and far differ: one false alarm in 15 000 frames for normal errors.
_DIFFER_SIGMAS = 4.0
# Painted lines lie in the asphalt; the lowest kerbs are 6 cm high, and half of that tells them apart.
MAX_LINE_HEIGHT_M = 0.030
# Height [m], pitch, roll [rad] by which both may differ all the same, as far as the lever of the nearest line
# stretches that: an estimate off by this is called wrong, and the asphalt alone is better by half.
MAX_DIFFERENCE = np.array([0.060, np.radians(0.5), np.radians(1.2)])


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
    heights = []
    for ray in _rays(pattern, rig):
        seen, expected = ray @ plane_of(lines, rig), ray @ plane_of(road, rig)
        metres = road.height_m / np.maximum(seen, _LEAST_DISPARITY_PX)
        # Rows weigh as their pixels do; far ones say little of a height.
        heights.append(float(np.sum((seen - expected) / metres) / np.sum(1.0 / metres**2)))
    return np.array(heights)


def place_of_line(left: ImageLine, right: ImageLine, plane: Array, rig: StereoRig) -> tuple[float, float]:
    """Return the height of a line over a plane and its place to the left of the camera [m].

    Args:
        left: The line in the left image.
        right: The same in the right image.
        plane: (3,) of the road (:mod:`.corridor`).
        rig: Intrinsics and baseline.
    """
    v = np.linspace(max(left.rows.min(), right.rows.min()), min(left.rows.max(), right.rows.max()), _N_ROWS)
    columns = left.column_at(v), right.column_at(v)
    disparity = columns[0] - columns[1]
    u = (columns[0] + columns[1]) / 2.0
    ray = np.column_stack([np.ones(len(v)), -(u - rig.cx) / rig.fx, -(v - rig.cy) / rig.fy])
    expected = ray @ plane
    metres = rig.fx * rig.baseline_m / np.linalg.norm(plane) / np.maximum(disparity, 1.0)
    weights = metres**-2.0  # as pixels do
    height = float(np.average((disparity - expected) * metres, weights=weights))
    aside = float(
        np.average(ray[:, 1] * rig.fx * rig.baseline_m / np.maximum(disparity, 1.0), weights=weights)
    )
    return height, aside


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
    solve = np.linalg.pinv(ray) / metres
    by_plane = plane_to_extrinsics(plane, rig) @ solve
    covariance = by_plane @ heights @ by_plane.T
    symmetric: Array = (covariance + covariance.T) / 2.0
    return symmetric


def covariance_by_profile(refined: RefinedFit | None) -> Array:
    """Return the covariance (3, 3) of an estimate from lines whose near and far parts differ.

    They are of one plane within noise, or the road is none and the estimate is as uncertain as they differ.
    """
    covariance = np.zeros((3, 3))
    if refined is not None and refined.profile is not None:
        profile = refined.profile
        surely = np.any(np.abs(profile.change) > _DIFFER_SIGMAS * profile.std)
        covariance[:2, :2] = np.outer(profile.change, profile.change) * surely
    return covariance


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
    the road is neglected.

    Args:
        lines: Estimate from lines.
        covariance: (3, 3) of it, with the shape of the road.
        texture: The asphalt.
    """
    information = [np.linalg.inv(covariance), np.linalg.inv(texture.covariance)]
    total = np.linalg.inv(information[0] + information[1])
    mean = total @ (information[0] @ lines.as_array() + information[1] @ texture.extrinsics.as_array())
    return Extrinsics.from_array(mean), (total + total.T) / 2.0
