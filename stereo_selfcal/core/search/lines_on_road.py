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

"""Lines looked for on the road that its surface shows.

With the plane of the road surface, a line of the left image has one place in the right image, and what is not
on the road (houses, poles, cars) is left out before lines are looked for. Lines that are found this way are
fitted to the images without that plane, and the gates are the same as for all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.rays import LEAST_DISPARITY_PX, pixel_rays
from ..lanes import frame_checks
from ..lanes.detector import LineDetector, detect_by_hough
from ..lanes.hypotheses import LaneHypotheses, NoPattern, Points
from ..lanes.lane_pair import ImageLine
from ..lanes.line_fit import refit_lines
from ..lanes.line_geometry import heights_and_offsets_m
from ..lanes.matching import (
    Candidate,
    Candidates,
    Match,
    MatchedLines,
    Matches,
    is_sampled,
    looks_alike,
    may_lie_on_road,
    sample_pattern,
    similarity,
)
from ..lanes.stripe_points import StripePoints, row_thinning
from ..road.priors import LANE_WIDTH_M
from ..tolerances import MAX_LINE_HEIGHT_M
from ..types import Array, Image

# How far to either side lines are looked for: those of a lane, whose camera may be half a lane beside its
# middle, and those of the next lane.
_HALF_WIDTH_M = 1.5 * LANE_WIDTH_M
# Points so far from the road tell whether a stripe on it continues: four rows, at 80 deg.
_NEIGHBOURS_ROWS, _NEIGHBOURS_COLUMNS = 4, 25
# Parallel lines meet on the horizon of their road, unless its slope changes: here by up to 1 %.
MAX_GAP_RAD = 0.01
# The heading of a car in its lane is within a few degrees of the lane; edges across the road are not.
MAX_YAW_RAD = float(np.radians(10.0))
# Least votes in both images for each row of a line that tells the yaw without another one: those of a stripe
# with an eighth of the contrast of a full vote. Lines that chance makes in the texture of rendered roads have
# 0.15 at most.
_LEAST_VOTES_PER_ROW = 0.25
# Most pairs of lines that are returned.
_MOST_PATTERNS = 3


def candidates_on_road(
    road_pose: Extrinsics,
    points: StripePoints,
    image: Image,
    rig: StereoRig,
    detector: LineDetector | None = None,
) -> Candidates:
    """Return the lines of the left image through stripe points that lie on the road.

    Args:
        road_pose: Pose over the road surface.
        points: Stripe points of the left image.
        image: The left image.
        rig: Intrinsics and baseline.
        detector: Finds the lines among these points; None for the Hough transform.
    """
    plane = plane_from_pose(road_pose, rig, PlaneCamera.LEFT)
    limits = _limits(plane, rig)
    points = points if limits is None else points.within(limits)
    rays = pixel_rays(rig, points.columns, points.rows)
    disparity = plane.disparities(rays)
    # At a disparity d, a metre is d / baseline pixels wide.
    half_px = disparity * (_HALF_WIDTH_M / rig.baseline_m)
    on_road = (disparity > LEAST_DISPARITY_PX) & (np.abs(rays[:, 1]) * rig.fx < half_px)
    return (detector or detect_by_hough)(points.chosen(on_road), image)


def _limits(plane: DisparityPlane, rig: StereoRig) -> tuple[Array, Array] | None:
    """Return the columns (H,) of each row between which the road lies, and the neighbourhood of its points.

    They are None for a road so steep to a side that no column limits it.
    """
    ahead, aside, down = plane.coefficients.tolist()
    # A point is on the road where |cx - u| < disparity * reach; the disparity grows with cx - u and the row.
    reach = _HALF_WIDTH_M / rig.baseline_m
    growth = reach * aside / rig.fx
    if abs(growth) >= 1.0:
        return None
    thinning = row_thinning(rig.height)
    rows = np.arange(rig.height) + _NEIGHBOURS_ROWS * thinning
    width = np.maximum(reach * (ahead + down * (rig.cy - rows) / rig.fy), 0.0)
    return (
        rig.cx - width / (1.0 - growth) - _NEIGHBOURS_COLUMNS * thinning,
        rig.cx + width / (1.0 + growth) + _NEIGHBOURS_COLUMNS * thinning,
    )


def lines_on_road(
    road_pose: Extrinsics,
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
    detector: LineDetector | None = None,
) -> LaneHypotheses:
    """Return the lines that lie on a road, and the pairs of them that meet at its horizon.

    Args:
        road_pose: Pose over the road surface.
        points: Stripe points of both images.
        images: Left and right image.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
        detector: Detector of the lines of the left image; None for the Hough transform.
    """
    plane = plane_from_pose(road_pose, rig)
    candidates = candidates_on_road(road_pose, points[0], images[0], rig, detector)
    seen = _seen_by_both([*candidates[0], *candidates[1]], plane, points, images, rig, config)
    sides: Matches = ([], [])
    for index, match in seen:
        side = sides[index >= len(candidates[0])]
        if not any(match.left.line.is_same_stripe(other.left.line) for other in side):
            side.append(match)
    pairs = [MatchedLines.of_matches(first, second) for first, second in product(*sides)]
    reach_px = MAX_GAP_RAD * rig.fy
    pairs = [
        pair
        for pair in pairs
        if abs(_horizon_gap_px(pair, plane, rig)) <= reach_px and is_sampled(pair, rig, config)
    ]
    pairs.sort(key=lambda pair: -pair.score)
    patterns = [sample_pattern(pair, rig, config) for pair in pairs[:_MOST_PATTERNS]]
    in_right = [match.right for match in sides[0]], [match.right for match in sides[1]]
    return LaneHypotheses(
        (candidates, in_right),
        sides,
        patterns or NoPattern(frame_checks.no_pair_on_road(len(sides[0]), len(sides[1]))),
    )


def _horizon_gap_px(pair: MatchedLines, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the rows from the horizon of a road down to the point where two lines meet."""
    u, v = pair.vanishing_point
    ahead, aside, down = plane.coefficients
    horizon = rig.cy + rig.fy * (ahead - aside * (u - rig.cx) / rig.fx) / down
    return float(v - horizon)


def _seen_by_both(
    candidates: Sequence[Candidate],
    plane: DisparityPlane,
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> list[tuple[int, Match]]:
    """Measure lines of the left image below the horizon, and where the plane predicts them in the right one.

    Returns:
        Index and match of each line that is long enough, lies in the plane, and is alike in both images.
    """
    bottom, least_px = rig.height - 1.0, config.extraction.min_line_rows
    of_left = plane.of_camera(PlaneCamera.LEFT, rig)
    horizons = [_horizon(candidate.line, of_left, rig) for candidate in candidates]
    first_rows = [bottom - config.extraction.horizon_fraction * (bottom - each) for each in horizons]
    lines = [candidate.line for candidate in candidates]
    in_left = refit_lines(points[0].gradient, lines, points[0].noise_grey, first_rows)
    long = [(i, line) for i, line in enumerate(in_left) if line is not None and line.length_px >= least_px]
    expected = [_in_right_camera(line, of_left, rig) for _, line in long]
    in_right = refit_lines(
        points[1].gradient, expected, points[1].noise_grey, [first_rows[i] for i, _ in long]
    )
    pairs = [
        (i, left, right)
        for (i, left), right in zip(long, in_right, strict=True)
        if right is not None and right.length_px >= least_px
    ]
    heights_m, _ = heights_and_offsets_m([(left, right) for _, left, right in pairs], plane, rig)
    matches = []
    for (i, left, right), height_m in zip(pairs, heights_m.tolist(), strict=True):
        if abs(height_m) > MAX_LINE_HEIGHT_M or not may_lie_on_road(left, right, rig, config):
            continue
        correlation = similarity(images, left, right)
        if looks_alike(correlation):
            votes = candidates[i].votes
            matches.append((i, Match(Candidate(left, votes), Candidate(right, votes), correlation)))
    return matches


def _horizon(line: ImageLine, of_left: DisparityPlane, rig: StereoRig) -> float:
    """Return the row where a line of the left image meets the horizon: where its disparity is zero."""
    intercept, slope = _disparity_along(line, of_left, rig)
    return min(max(-intercept / slope, 0.0), rig.height - 2.0) if slope > 0.0 else 0.0


def _disparity_along(line: ImageLine, of_left: DisparityPlane, rig: StereoRig) -> tuple[float, float]:
    """Return a and b of the disparity a + b v [px] of a road along a line of the left image.

    Args:
        line: The line.
        of_left: The road, of the left camera.
        rig: Intrinsics.
    """
    ahead, aside, down = of_left.coefficients.tolist()
    at_top = line.u_mid - line.slope * line.v_mid
    intercept = ahead + aside * (rig.cx - at_top) / rig.fx + down * rig.cy / rig.fy
    return intercept, -aside * line.slope / rig.fx - down / rig.fy


def _in_right_camera(line: ImageLine, of_left: DisparityPlane, rig: StereoRig) -> ImageLine:
    """Return the position that a plane predicts in the right image for a line of the left one."""
    intercept, slope = _disparity_along(line, of_left, rig)
    return replace(line, u_mid=line.u_mid - intercept - slope * line.v_mid, slope=line.slope - slope)


def yaw_of_line(matches: Matches, road_pose: Extrinsics, rig: StereoRig) -> float | None:
    """Return the yaw of the camera against the clearest line on a road [rad]; None without a clear one.

    The line is that of :func:`lane_line`.

    Args:
        matches: Lines that both cameras see on the road.
        road_pose: Pose over the road surface.
        rig: Intrinsics and baseline.
    """
    line = lane_line(matches, road_pose, rig)
    return None if line is None else _yaw(line, plane_from_pose(road_pose, rig), rig)


def lane_line(matches: Matches, road_pose: Extrinsics, rig: StereoRig) -> ImageLine | None:
    """Return the clearest line of the left image that runs along a road; None without one.

    Args:
        matches: Lines that both cameras see on the road.
        road_pose: Pose over the road surface.
        rig: Intrinsics and baseline.
    """
    plane = plane_from_pose(road_pose, rig)
    for match in sorted((each for side in matches for each in side), key=lambda m: -m.votes):
        if is_clear(match) and abs(_yaw(match.left.line, plane, rig)) <= MAX_YAW_RAD:
            return match.left.line
    return None


def is_clear(match: Match) -> bool:
    """Whether a line has more votes than chance gives to lines in the texture of a road."""
    return match.votes >= _LEAST_VOTES_PER_ROW * match.left.line.n_rows


def _yaw(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the yaw of the camera against a line [rad], > 0: it points left of the line."""
    of_left = plane.of_camera(PlaneCamera.LEFT, rig)
    leaves = float(line.column_at(np.array(_horizon(line, of_left, rig))))
    return float(np.arctan((leaves - rig.cx) / rig.fx))
