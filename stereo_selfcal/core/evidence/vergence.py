"""Whether the right camera has turned about the vertical against its calibration.

Such a turn changes all disparities by the same number. The surface of the road fits as well as before, with
another pitch. Two things know of it: what is infinitely far away has a disparity, and lane lines, which are
parallel, do not meet at the horizon of the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.rays import pixel_rays
from ..lanes.lane_pair import ImageLine
from ..lanes.line_geometry import height_and_offset_m
from ..lanes.matching import Match, Matches
from ..road.priors import MAX_LANE_WIDTH_M, MIN_LANE_WIDTH_M, PAINT_ANGLE_STD_RAD, VERGENCE_STD_RAD
from ..tolerances import EXCLUDED_SIGMAS, WRONG
from .far_disparity import MOST_TURN_RAD, FarDisparity
from .rig_unknowns import response_of_surface

# So many directions with the same least disparity are no accident: the odds grow from none to sure between
# these. In 50 recorded frames without infinitely far things, two or three directions were equal by chance.
_FEW_EQUAL, _MANY_EQUAL = 2.5, 3.5
# Least likeness of the two lines of a lane in both images for them to contradict the surface.
_LEAST_LIKENESS = 0.9


@dataclass(frozen=True, slots=True)
class Vergence:
    """A turn of the right camera about the vertical, by what contradicts its calibration most.

    Attributes:
        yaw_rad: The angle by which it looks farther left [rad]: disparities are smaller by ``fx * yaw_rad``.
        std_rad: Its standard deviation.
        wrong_rad: The turn from which on a pose over the road surface is wrong.
        by_lines: Whether lane lines tell it, else what is far away.
    """

    yaw_rad: float
    std_rad: float
    wrong_rad: float
    by_lines: bool


def vergence_std_rad(far: FarDisparity | None, rig: StereoRig) -> float:
    """Return the standard deviation of the right camera's turn about the vertical [rad].

    It is that of calibrations, unless what is far away shows more: a negative disparity surely, a positive
    one as far as it is the same in many directions.

    Args:
        far: The disparity of what is farthest away; None where nothing is seen.
        rig: Intrinsics and baseline.
    """
    if far is None:
        return VERGENCE_STD_RAD
    seen_rad = far.disparity_px / rig.fx * (1.0 if far.disparity_px < 0.0 else _infinitely_far(far))
    expected = VERGENCE_STD_RAD**2 + (far.std_px / rig.fx) ** 2
    return math.sqrt(VERGENCE_STD_RAD**2 + max(seen_rad**2 - expected, 0.0))


def measure_vergence(
    far: FarDisparity | None, lines: Matches, rig: StereoRig, extrinsics: Extrinsics
) -> Vergence | None:
    """Measure how the right camera has turned, by what is far away and by lane lines on the road surface.

    Args:
        far: The disparity of what is farthest away; None where nothing is seen.
        lines: Lines that both cameras see on the road surface.
        rig: Intrinsics and baseline.
        extrinsics: Pose over the road surface.

    Returns:
        What contradicts the calibration most, in its own standard deviations; None where neither tells.
    """
    wrong_rad = _wrong_rad(rig, extrinsics)
    found = []
    if far is not None:
        # Nothing is farther than infinity; what is nearer than it shows no turn.
        disparity = min(far.disparity_px, 0.0) / rig.fx
        found.append(Vergence(-disparity, far.std_px / rig.fx, wrong_rad, by_lines=False))
    by_lines = _by_lines(lines, rig, extrinsics, wrong_rad)
    if by_lines is not None and not _denied(by_lines, far, rig):
        found.append(by_lines)
    return max(found, key=lambda each: abs(each.yaw_rad) / each.std_rad, default=None)


def _infinitely_far(far: FarDisparity) -> float:
    """Return how likely what is farthest away is infinitely far, 0 ... 1."""
    return min(max((far.n_equal - _FEW_EQUAL) / (_MANY_EQUAL - _FEW_EQUAL), 0.0), 1.0)


def _wrong_rad(rig: StereoRig, extrinsics: Extrinsics) -> float:
    """Return the turn from which on a pose over the road surface is wrong."""
    response = np.abs(response_of_surface(rig, extrinsics)[:, 0]) / VERGENCE_STD_RAD
    return float(np.min(WRONG / np.maximum(response, np.finfo(np.float64).eps)))


def _by_lines(lines: Matches, rig: StereoRig, extrinsics: Extrinsics, wrong_rad: float) -> Vergence | None:
    """Return the turn by the clearest two lines of a lane; None where two lines confirm the road surface."""
    plane = plane_from_pose(extrinsics, rig)
    clearest: tuple[float, Vergence] | None = None
    for first, second in product(*lines):
        width_m = abs(_offset_m(first, plane, rig) - _offset_m(second, plane, rig))
        turn = _where_they_meet(first.left.line, second.left.line, width_m, rig, extrinsics, wrong_rad)
        if turn is None:
            continue
        if abs(turn.yaw_rad) <= max(wrong_rad, EXCLUDED_SIGMAS * turn.std_rad):
            return None
        alike = min(first.similarity, second.similarity) > _LEAST_LIKENESS
        if alike and MIN_LANE_WIDTH_M <= width_m <= MAX_LANE_WIDTH_M and abs(turn.yaw_rad) < MOST_TURN_RAD:
            votes = first.votes + second.votes
            clearest = clearest if clearest is not None and clearest[0] >= votes else (votes, turn)
    return None if clearest is None else clearest[1]


def _offset_m(match: Match, plane: DisparityPlane, rig: StereoRig) -> float:
    return height_and_offset_m(match.left.line, match.right.line, plane, rig)[1]


def _where_they_meet(
    first: ImageLine,
    second: ImageLine,
    width_m: float,
    rig: StereoRig,
    extrinsics: Extrinsics,
    wrong_rad: float,
) -> Vergence | None:
    """Return the turn under which two lines of the left image, ``width_m`` apart on the road, are parallel.

    Where parallel lines meet is infinitely far away, so the disparity of the road surface there is an error.
    None where they do not meet.
    """
    apart = first.slope - second.slope
    if not abs(apart) > np.finfo(np.float32).eps or not width_m > 0.0:
        return None
    u0, v0 = first.u_mid, first.v_mid
    row = v0 + (float(second.column_at(np.array(v0))) - u0) / apart
    column = float(first.column_at(np.array(row)))
    plane = plane_from_pose(extrinsics, rig, PlaneCamera.LEFT)
    disparity = float(plane.disparities(pixel_rays(rig, np.array(column), np.array(row))))
    by_row = abs(float(plane.coefficients[2])) / rig.fy
    # Lines at an angle on the road meet that much above or below the horizon, by their distance over the
    # height; and the row where they meet is as uncertain as their columns there.
    by_paint = PAINT_ANGLE_STD_RAD * extrinsics.height_m / width_m * rig.fy
    columns = [np.array([1.0, row - line.v_mid]) for line in (first, second)]
    variances = [at @ line.covariance @ at for at, line in zip(columns, (first, second), strict=True)]
    std_px = by_row * math.sqrt(by_paint**2 + float(sum(variances)) / apart**2)
    return Vergence(-disparity / rig.fx, std_px / rig.fx, wrong_rad, by_lines=True)


def _denied(by_lines: Vergence, far: FarDisparity | None, rig: StereoRig) -> bool:
    """Whether what is far away shows that it is the lines that are not parallel."""
    if far is None:
        return False
    # The disparity at infinity that lines tell, over the one that is seen: nothing is farther than infinity.
    excess_px = -by_lines.yaw_rad * rig.fx - far.disparity_px
    limit_px = EXCLUDED_SIGMAS * math.hypot(by_lines.std_rad * rig.fx, far.std_px)
    return excess_px > limit_px or (_infinitely_far(far) >= 1.0 and -excess_px > limit_px)
