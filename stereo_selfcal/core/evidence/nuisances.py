"""What is unknown besides the pose, and the covariance it leaves in the pose: one function each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.stripe_fit import StripeFit
from ..geometry.homography import apply_homography, road_from_image
from ..geometry.plane import jacobian_pose_wrt_plane, plane_from_pose
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.rays import LEAST_DISPARITY_PX
from ..geometry.uncertainty import UncertaintyTerm, propagate_terms
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import rays_of_lines
from ..numerics.derivatives import central_difference, point_by_point
from ..numerics.statistics import UNLIKELY_CHI2_3
from ..road.priors import FALL_STD, NARROWEST_LANE_M, PAINT_STD_RAD, RECTIFICATION_STD_PX, WIDEST_LANE_M
from ..road.surface import RoadUnevenness, kernels
from ..tolerances import MAX_LINE_HEIGHT_M
from ..types import Array
from .profile import Profile

_ANGLE_STEPS = np.array([1e-4, 1e-5, 1e-5])  # m, rad, rad: of a derivative


def road_shape_terms(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, shape: RoadUnevenness
) -> tuple[UncertaintyTerm, ...]:
    """Return what the shape of the road leaves unknown in an estimate from lines.

    The disparities of the lines, row by row and of equal weight, are fitted by a plane; the heights of
    the road are no plane, with the covariance the texture shows.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        shape: Roughness, profile and mismatch of the road between them.

    Returns:
        Roughness, camber and mismatch; nothing where the road is a plane, as far as the texture shows.
    """
    if not shape.uneven:
        return ()
    plane = plane_from_pose(extrinsics, rig)
    ray = np.concatenate(rays_of_lines(pattern, rig))
    disparity = plane.disparities(ray)
    ray, disparity = ray[disparity > LEAST_DISPARITY_PX], disparity[disparity > LEAST_DISPARITY_PX]
    depth = rig.fx * rig.baseline_m / disparity
    rotation = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)
    xy = (ray * depth[:, None]) @ rotation[:2].T
    # A road higher by e has a disparity greater by e / metres.
    metres = extrinsics.height_m / disparity
    kernel, profile = kernels(xy)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    jac_pose_heights = jac_pose_plane @ (np.linalg.pinv(ray) / metres)
    heights = (
        ("roughness", shape.roughness * kernel),
        ("camber", shape.profile**2 * profile),
        ("mismatch", np.diag((shape.mismatch_px * metres) ** 2)),
    )
    return propagate_terms(
        (UncertaintyTerm(name, covariance) for name, covariance in heights), jac_pose_heights
    )


def kerb_covariance(
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
    plane = plane_from_pose(extrinsics, rig)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    rays = rays_of_lines(pattern.boundaries, rig)
    solve = np.linalg.pinv(np.concatenate(rays))
    for line in doubtful:
        # A kerb higher by e has a disparity greater by e / metres. At even odds, e scatters by half of it.
        jac_disparities_height = [
            plane.disparities(ray) / extrinsics.height_m * (i == line) for i, ray in enumerate(rays)
        ]
        change = jac_pose_plane @ solve @ np.concatenate(jac_disparities_height) * MAX_LINE_HEIGHT_M
        covariance += np.outer(change, change)
    return covariance


def stage_disagreement_covariance(lines: Extrinsics, covariance: Array, refined: StripeFit | None) -> Array:
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
    return np.outer(difference, difference) * (chi2 > UNLIKELY_CHI2_3)


def paint_angle_covariance(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, shape: RoadUnevenness
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
    ray = np.concatenate(rays_of_lines(pattern.boundaries, rig))
    jac_pose_plane = jacobian_pose_wrt_plane(plane_from_pose(extrinsics, rig), rig)
    jac_pose_disparities = jac_pose_plane @ np.linalg.pinv(ray)
    free = jac_pose_disparities @ jac_pose_disparities.T
    jac_angle = _jac_angle_pose(pattern.boundaries, rig, extrinsics)
    moved = free @ jac_angle / (jac_angle @ free @ jac_angle) * PAINT_STD_RAD
    covariance: Array = np.outer(moved, moved)
    return covariance


def _jac_angle_pose(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the derivative (3,) of the angle between two lines on the road by the pose."""
    ends = np.array([[line.rows.min(), line.rows.max()] for line in pattern.left])
    columns = [line.column_at(rows) for line, rows in zip(pattern.left, ends, strict=True)]
    points = np.stack([np.array(columns), ends], axis=-1)

    def angle(pose: Array) -> float:
        to_road = road_from_image(rig, Extrinsics.from_array(pose), "left")
        far, near = np.moveaxis(apply_homography(to_road, points), 1, 0)
        tangents = (far[:, 1] - near[:, 1]) / (far[:, 0] - near[:, 0])
        return float(np.arctan(tangents[0]) - np.arctan(tangents[1]))

    return central_difference(point_by_point(angle), extrinsics.as_array(), _ANGLE_STEPS)


def rectification_covariance(rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the covariance (3, 3) that imperfect intrinsics of a rig give any estimate with it.

    The disparities of a rectified pair are off by as much as the calibration of the cameras has left: a
    constant, and what grows to the sides and to the top and bottom of the image.
    """
    reach = np.array([1.0, rig.width / (2.0 * rig.fx), rig.height / (2.0 * rig.fy)])
    jac_pose_plane = jacobian_pose_wrt_plane(plane_from_pose(extrinsics, rig), rig) * (
        RECTIFICATION_STD_PX / reach
    )
    covariance: Array = jac_pose_plane @ jac_pose_plane.T
    return covariance


def seen_slope_covariance(*profiles: Profile | None) -> Array:
    """Return the covariance (3, 3) of an estimate from a road whose near and far parts differ.

    They are of one plane within noise, or the road is none and the estimate is as uncertain as they differ,
    and as what is not seen of the road 5 to 20 m ahead may go on.

    Args:
        profiles: Of the road, by what the estimate is made from; the first that is surely bent counts.
    """
    for profile in profiles:
        if profile is not None and profile.bent:
            return _as_it_may_go_on(profile)
    return np.zeros((3, 3))


def unseen_slope_covariance(*profiles: Profile | None) -> Array:
    """Return the covariance (3, 3) of an estimate from what ends, to the eye, where a slope may begin.

    Zero where one of the profiles has seen the road there, or none was measured. Where one is surely bent,
    :func:`seen_slope_covariance` says so.

    Args:
        profiles: Of the road, by what the estimate is made from.
    """
    known = [profile for profile in profiles if profile is not None]
    if not slope_ahead_unknown(*known) or any(profile.bent for profile in known):
        return np.zeros((3, 3))
    return _as_it_may_go_on(min(known, key=lambda profile: float(profile.std[1])))


def slope_ahead_unknown(*profiles: Profile | None) -> bool:
    """Whether none of the profiles that were measured excludes another slope of the road ahead."""
    known = [profile for profile in profiles if profile is not None]
    return bool(known) and not any(profile.sees_ahead for profile in known)


def _as_it_may_go_on(profile: Profile) -> Array:
    covariance = np.zeros((3, 3))
    change = profile.change / profile.seen_share if profile.bent else profile.change
    covariance[:2, :2] = np.outer(change, change) + profile.covariance
    return covariance


def crown_covariance(refined: StripeFit | None) -> Array:
    """Return the covariance (3, 3) that crowns give an estimate from lines, as one of the own lane.

    A line that was measured between the boundaries shows how the own lane lies; where there is none and the
    boundaries are farther apart than the lines of one lane, the slope changes between them, as it does from
    lane to lane; of n lanes at most.
    Lines nearer to each other than any lane is wide (one of them is an arrow) show a part of the own one.

    Args:
        refined: Positions of the stripes, and heights of those beside the boundaries.

    Returns:
        Zeros where the stripes are those of one lane, in one plane.
    """
    covariance = np.zeros((3, 3))
    if refined is None:
        return covariance
    places, heights = refined.positions_m, refined.heights_m
    if np.any(places > 0.0) and np.any(places < 0.0):
        left = int(np.argmin(np.where(places > 0.0, places, np.inf)))
        right = int(np.argmax(np.where(places < 0.0, places, -np.inf)))
    else:  # one is an arrow before the camera
        left, right = int(np.argmax(places[:2])), int(np.argmin(places[:2]))
    width_m = places[left] - places[right]
    # Height of the own lane over the plane below the camera, and how it rises to the left: what lies higher
    # makes the camera lower; what rises to the left, its roll less.
    rise = (heights[left] - heights[right]) / width_m
    higher_m = heights[right] - rise * places[right]
    shown = np.array([higher_m, 0.0, rise])
    covariance += np.outer(shown, shown)
    lanes = max(2, int(width_m / NARROWEST_LANE_M)) if width_m > WIDEST_LANE_M else 1
    near, far = sorted((places[left], places[right]), key=abs)
    if lanes > 1:
        # The plane goes through both borders, the lane of the camera through the nearer one.
        hidden, border_m = (lanes - 1) / lanes, near
    else:
        # The border of the lane is the farther one: the arrow lies before the camera.
        hidden, border_m = max(0.0, 1.0 - float(np.ptp(places)) / NARROWEST_LANE_M), far
    by_slope = FALL_STD * hidden * np.array([-border_m, 0.0, 1.0])
    return covariance + np.outer(by_slope, by_slope)
