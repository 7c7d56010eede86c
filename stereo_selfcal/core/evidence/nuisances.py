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

"""Causes of uncertainty besides the noise of the pixels: for each, the covariance it leaves in the pose."""

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
from ..numerics.linear import solve_linear
from ..numerics.statistics import UNLIKELY_CHI2_3
from ..rejection import NotFitted
from ..road.priors import (
    CROSS_FALL_STD,
    MAX_LANE_WIDTH_M,
    MIN_LANE_WIDTH_M,
    PAINT_ANGLE_STD_RAD,
)
from ..road.unevenness import RoadUnevenness, unit_covariances
from ..types import Array
from .profile import Profile

# Number of lanes that fit between two lines, by their distance [m]. Where one more has just room, it is
# counted in part, so that the uncertainty is continuous.
_PARTLY_M = 0.5
_MOST_LANES = (
    (
        MAX_LANE_WIDTH_M,
        2.0 * MIN_LANE_WIDTH_M,
        3.0 * MIN_LANE_WIDTH_M - _PARTLY_M,
        3.0 * MIN_LANE_WIDTH_M,
        4.0 * MIN_LANE_WIDTH_M - _PARTLY_M,
        4.0 * MIN_LANE_WIDTH_M,
    ),
    (1.0, 2.0, 2.0, 3.0, 3.0, 4.0),
)
_ANGLE_STEPS = np.array([1e-4, 1e-5, 1e-5])  # m, rad, rad: steps of the central difference


def road_shape_terms(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, unevenness: RoadUnevenness
) -> tuple[UncertaintyTerm, ...]:
    """Return the terms that the shape of the road adds to the covariance of an estimate from lines.

    A plane is fitted to the disparities of the lines, row by row with equal weights. The heights of the road
    deviate from a plane, with a covariance that was measured from the texture of its surface.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        unevenness: Roughness, camber and mismatch of the road between the lines.

    Returns:
        Roughness, camber and mismatch, as far as the texture shows that the road is no plane.
    """
    plane = plane_from_pose(extrinsics, rig)
    ray = np.concatenate(rays_of_lines(pattern, rig))
    disparity = plane.disparities(ray)
    ray, disparity = ray[disparity > LEAST_DISPARITY_PX], disparity[disparity > LEAST_DISPARITY_PX]
    depth = rig.fx * rig.baseline_m / disparity
    rotation = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)
    xy = (ray * depth[:, None]) @ rotation[:2].T
    # A road higher by e has a disparity greater by e / metres.
    metres = extrinsics.height_m / disparity
    kernel, profile = unit_covariances(xy)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    jac_pose_heights = jac_pose_plane @ (np.linalg.pinv(ray) / metres)
    heights = (
        ("roughness", unevenness.roughness * kernel),
        ("camber", unevenness.camber**2 * profile),
        ("mismatch", np.diag((unevenness.mismatch_px * metres) ** 2)),
    )
    share = unevenness.significance
    return propagate_terms(
        (UncertaintyTerm(name, share * covariance) for name, covariance in heights), jac_pose_heights
    )


def kerb_covariance(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, doubtful: Sequence[int], std_m: float
) -> Array:
    """Return the covariance (3, 3) that possible kerbs add to an estimate from two boundaries.

    A doubtful boundary is a painted line or a kerb, at even odds. Kerbs on both sides of a lane have one
    height: two doubtful boundaries are one doubt.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
        doubtful: Indices of the boundaries that may be kerbs.
        std_m: Standard deviation of the height of such a boundary: half that of a kerb.
    """
    plane = plane_from_pose(extrinsics, rig)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    rays = rays_of_lines(pattern.boundaries, rig)
    solve = np.linalg.pinv(np.concatenate(rays))
    # A kerb higher by e has a disparity greater by e / metres.
    jac_disparities_height = [
        plane.disparities(ray) / extrinsics.height_m * (i in doubtful) for i, ray in enumerate(rays)
    ]
    change = jac_pose_plane @ solve @ np.concatenate(jac_disparities_height) * std_m
    covariance: Array = np.outer(change, change)
    return covariance


def stage_disagreement_covariance(
    line_pose: Extrinsics, covariance: Array, refined: StripeFit | None
) -> Array:
    """Return the covariance (3, 3) that a disagreement of two stages adds to a refined estimate.

    The estimate from the lines and that from the grey values are made from the same stripes. Where they
    differ by more than their covariances explain, one of them has taken something else for a part of a
    stripe. It is not known which one.

    Args:
        line_pose: Pose estimated from the lines.
        covariance: (3, 3) of it.
        refined: Fit of the stripes' grey values; None where there is none.

    Returns:
        The square of the difference, less the part that chance may explain; zeros where that is all of it.
    """
    if refined is None:
        return np.zeros((3, 3))
    difference = refined.extrinsics.as_array() - line_pose.as_array()
    weighted = solve_linear(covariance + refined.covariance, difference, "numbers of the pose that are known")
    explained = 0.0
    if not isinstance(weighted, NotFitted):
        chi2 = float(difference @ weighted)
        explained = UNLIKELY_CHI2_3 / max(chi2, UNLIKELY_CHI2_3)
    return np.outer(difference, difference) * (1.0 - explained)


def paint_angle_covariance(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the covariance (3, 3) of an estimate from lines that are not painted exactly parallel.

    The disparities of two lines determine the pose only weakly along one direction. The angle between the
    lines on the road, assumed to be zero, determines it along that direction.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        extrinsics: The estimate from them.
    """
    ray = np.concatenate(rays_of_lines(pattern.boundaries, rig))
    jac_pose_plane = jacobian_pose_wrt_plane(plane_from_pose(extrinsics, rig), rig)
    jac_pose_disparities = jac_pose_plane @ np.linalg.pinv(ray)
    pose_covariance = jac_pose_disparities @ jac_pose_disparities.T
    jac_angle = _jac_angle_pose(pattern.boundaries, rig, extrinsics)
    angle_variance = float(jac_angle @ pose_covariance @ jac_angle)
    if not angle_variance > 0.0:  # the lines do not show the angle
        return np.zeros((3, 3))
    pose_change = pose_covariance @ jac_angle / angle_variance * PAINT_ANGLE_STD_RAD
    covariance: Array = np.outer(pose_change, pose_change)
    return covariance


def _jac_angle_pose(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return the derivative (3,) of the angle [rad] between two lines on the road by the pose."""
    ends = np.array([[line.rows.min(), line.rows.max()] for line in pattern.left])
    columns = [line.column_at(rows) for line, rows in zip(pattern.left, ends, strict=True)]
    points = np.stack([np.array(columns), ends], axis=-1)

    def angle(pose: Array) -> float:
        to_road = road_from_image(rig, Extrinsics.from_array(pose), "left")
        far, near = np.moveaxis(apply_homography(to_road, points), 1, 0)
        tangents = (far[:, 1] - near[:, 1]) / (far[:, 0] - near[:, 0])
        return float(np.arctan(tangents[0]) - np.arctan(tangents[1]))

    return central_difference(point_by_point(angle), extrinsics.as_array(), _ANGLE_STEPS)


def seen_slope_covariance(profile: Profile | None) -> Array:
    """Return the covariance (3, 3) that a measured change of slope adds to an estimate.

    An estimate from lines is that of the plane of their near part. The pose is that over the road 5 to 20 m
    ahead, and the estimate is off by what the profile measures.

    Args:
        profile: Profile of the road, from the stripes; None where it was not measured.
    """
    return np.zeros((3, 3)) if profile is None else _of_height_and_pitch(profile.seen_change)


def unseen_slope_covariance(profile: Profile | None) -> Array:
    """Return the covariance (3, 3) that a possible change of slope ahead adds to an estimate.

    It is small where the profile shows the road 5 to 20 m ahead. Where it does not, it grows up to what roads
    are known to do.

    Args:
        profile: Profile of the road, from the stripes; None where it was not measured.
    """
    return np.zeros((3, 3)) if profile is None else _of_height_and_pitch(profile.unseen_change)


def _of_height_and_pitch(part: Array) -> Array:
    """Return the covariance (3, 3) of a pose from that of its height and pitch (2, 2)."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = part
    return covariance


def crown_covariance(refined: StripeFit | None) -> Array:
    """Return the covariance (3, 3) that the crown of the road adds to an estimate from lines.

    The pose is that over the own lane. A line that was measured between the boundaries shows how the own lane
    lies. Where there is none and the boundaries are farther apart than the lines of one lane, the slope may
    change from lane to lane between them. The number of lanes is the most that fit. Where the lines are
    nearer to each other than any lane is wide, one of them is an arrow. They show only a part of the own
    lane.

    Args:
        refined: Positions of the stripes, and heights of the extra ones; None where there is no fit.

    Returns:
        The covariance; zeros where the stripes are those of one lane, in one plane.
    """
    covariance = np.zeros((3, 3))
    if refined is None:
        return covariance
    positions_m, heights = refined.positions_m, refined.heights_m
    if np.any(positions_m > 0.0) and np.any(positions_m < 0.0):
        left = int(np.argmin(np.where(positions_m > 0.0, positions_m, np.inf)))
        right = int(np.argmax(np.where(positions_m < 0.0, positions_m, -np.inf)))
    else:  # one of the lines is an arrow in front of the camera
        left, right = int(np.argmax(positions_m[:2])), int(np.argmin(positions_m[:2]))
    width_m = positions_m[left] - positions_m[right]
    # Height of the own lane over the plane, below the camera, and its rise to the left. A lane that lies
    # higher lowers the height; one that rises to the left lowers the roll.
    rise = (heights[left] - heights[right]) / width_m
    higher_m = heights[right] - rise * positions_m[right]
    seen_tilt = np.array([higher_m, 0.0, rise])
    covariance += np.outer(seen_tilt, seen_tilt)
    lanes = float(np.interp(width_m, *_MOST_LANES))
    near, far = sorted((positions_m[left], positions_m[right]), key=abs)
    if lanes > 1:
        # The plane goes through both borders, the lane of the camera through the nearer one.
        unseen_share, border_m = (lanes - 1) / lanes, near
    else:
        # The border of the lane is the farther line: the arrow lies in front of the camera.
        unseen_share, border_m = max(0.0, 1.0 - float(np.ptp(positions_m)) / MIN_LANE_WIDTH_M), far
    change = CROSS_FALL_STD * unseen_share * np.array([-border_m, 0.0, 1.0])
    return covariance + np.outer(change, change)
