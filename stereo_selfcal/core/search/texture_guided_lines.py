"""Lines found with the plane of the road surface's texture, where no pair of lines was found without it.

Matching the lines of both cameras needs two lines that are clear in both images. With one clear line, the
pose over a road without roll is accurate enough to align the texture of the road surface. The plane of the
texture then gives the position of a line in the right image from its position in the left one. Lines that are
found this way are fitted to the images without that plane, and the gates are the same as for all others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, product

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.texture_alignment import TextureFit, align_texture
from ..geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose, pose_from_plane
from ..geometry.pose import Extrinsics
from ..geometry.rays import pixel_rays
from ..lanes.hypotheses import Points
from ..lanes.lane_pair import ImageLine, LanePattern
from ..lanes.line_fit import refit_line
from ..lanes.line_geometry import height_and_offset_m
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
from ..numerics.linear import solve_linear
from ..rejection import NotFitted
from ..tolerances import MAX_LINE_HEIGHT_M
from ..types import Image

# Most lines from which the alignment of the texture is started: those with most votes.
_MOST_STARTS = 3
# Parallel lines meet on the horizon of their road, unless its slope changes: here by up to 1 %.
MAX_GAP_RAD = 0.01
# The heading of a car in its lane is within a few degrees of the lane; edges across the road are not.
MAX_YAW_RAD = float(np.radians(10.0))
# Most pairs of lines that are returned.
_MOST_PATTERNS = 3


def roads_of_single_lines(
    matches: list[Match], rig: StereoRig, config: CalibratorConfig
) -> Iterator[Extrinsics]:
    """Yield the pose over the road of each line, without roll; the line with most votes first.

    Args:
        matches: Lines that both cameras see.
        rig: Intrinsics and baseline.
        config: Settings; poses outside of the search box are left out.
    """
    box = config.search
    for match in sorted(matches, key=lambda m: -m.votes):
        left, right = match.left.line, match.right.line
        v = np.array([max(left.rows.min(), right.rows.min()), min(left.rows.max(), right.rows.max())])
        if v[1] <= v[0]:
            continue
        disparity = left.column_at(v) - right.column_at(v)
        ray = np.column_stack([np.ones(2), -(v - rig.cy) / rig.fy])
        plane = solve_linear(ray, disparity, "numbers of the plane that a line determines")
        if isinstance(plane, NotFitted) or plane[1] >= 0.0:
            continue
        p0, p2 = plane
        road_pose = pose_from_plane(DisparityPlane(np.array([p0, 0.0, p2]), PlaneCamera.MIDDLE), rig)
        inside = box.height_min_m <= road_pose.height_m <= box.height_max_m
        if inside and abs(road_pose.pitch_rad) <= box.pitch_max_rad:
            yield road_pose


def find_road(
    images: tuple[Image, Image],
    known_pose: Extrinsics | None,
    matches: list[Match],
    rig: StereoRig,
    config: CalibratorConfig,
) -> TextureFit | None:
    """Align the texture of the road surface, without knowing its lines; None where it is too weak.

    Args:
        images: Left and right image.
        known_pose: Pose over the road, if it is known.
        matches: Lines that both cameras see; without a known pose, those with most votes give the starts.
        rig: Intrinsics and baseline.
        config: Settings; starts outside of the search box are left out.
    """
    starts = [known_pose] if known_pose else islice(roads_of_single_lines(matches, rig, config), _MOST_STARTS)
    for start in starts:
        fit = align_texture(images, rig, start)
        if not isinstance(fit, NotFitted) and fit.enough_texture and fit.comparable:
            return fit
    return None


def lines_on_road(
    road_pose: Extrinsics,
    candidates: list[Candidates],
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> list[LanePattern]:
    """Return pairs of lines, one on either side, that lie in a road and meet at its horizon.

    Args:
        road_pose: Pose over the road surface.
        candidates: Lines of the left camera, from each search.
        points: Stripe points of both images.
        images: Left and right image.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    plane = plane_from_pose(road_pose, rig)
    sides: Matches = ([], [])
    for found in candidates:
        for side, lines in zip(sides, found, strict=True):
            for candidate in lines:
                match = _seen_by_both(candidate, plane, points, images, rig, config)
                if match is not None and not any(
                    match.left.line.is_same_stripe(other.left.line) for other in side
                ):
                    side.append(match)
    pairs = [MatchedLines.of_matches(first, second) for first, second in product(*sides)]
    reach_px = MAX_GAP_RAD * rig.fy
    pairs = [
        pair
        for pair in pairs
        if abs(_horizon_gap_px(pair, plane, rig)) <= reach_px and is_sampled(pair, rig, config)
    ]
    pairs.sort(key=lambda pair: -pair.score)
    return [sample_pattern(pair, rig, config) for pair in pairs[:_MOST_PATTERNS]]


def _horizon_gap_px(pair: MatchedLines, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the rows from the horizon of a road down to the point where two lines meet."""
    u, v = pair.vanishing_point
    ahead, aside, down = plane.coefficients
    horizon = rig.cy + rig.fy * (ahead - aside * (u - rig.cx) / rig.fx) / down
    return float(v - horizon)


def _seen_by_both(
    candidate: Candidate,
    plane: DisparityPlane,
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> Match | None:
    """Measure a line of the left image below the horizon, and in the right image where the plane predicts it.

    Returns:
        The line in both images; None where it is too short, not in the plane, or differs between the images.
    """
    line = candidate.line
    horizon = _horizon(line, plane, rig)
    bottom = rig.height - 1.0
    first_row = bottom - config.extraction.horizon_fraction * (bottom - horizon)
    left = refit_line(points[0].gradient, line, points[0].noise_grey, first_row)
    if left is None or left.n_rows < config.extraction.min_line_rows:
        return None
    expected = _in_right_camera(left, plane, rig)
    right = refit_line(points[1].gradient, expected, points[1].noise_grey, first_row)
    if right is None or right.n_rows < config.extraction.min_line_rows:
        return None
    if abs(height_and_offset_m(left, right, plane, rig)[0]) > MAX_LINE_HEIGHT_M:
        return None
    if not may_lie_on_road(left, right, rig, config):
        return None
    correlation = similarity(images, left, right)
    if not looks_alike(correlation):
        return None
    return Match(Candidate(left, candidate.votes), Candidate(right, candidate.votes), correlation)


def _horizon(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the row where a line of the left image meets the horizon: where its disparity is zero."""
    intercept, slope = _disparity_along(line, plane, rig)
    return float(np.clip(-intercept / slope, 0.0, rig.height - 2.0)) if slope > 0.0 else 0.0


def _disparity_along(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> tuple[float, float]:
    """Return a and b of the disparity a + b v [px] of a road along a line of the left image."""
    v = np.array([0.0, rig.height - 1.0])
    d = plane.of_camera(PlaneCamera.LEFT, rig).disparities(pixel_rays(rig, line.column_at(v), v))
    slope = float(d[1] - d[0]) / float(v[1])
    return float(d[0]), slope


def _in_right_camera(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> ImageLine:
    """Return the position that a plane predicts in the right image for a line of the left one."""
    intercept, slope = _disparity_along(line, plane, rig)
    return replace(line, u_mid=line.u_mid - intercept - slope * line.v_mid, slope=line.slope - slope)


def line_on_road(
    road_pose: Extrinsics,
    matches: list[Match],
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[Match, float] | None:
    """Return a line that both cameras see and that lies in a road, and the camera's yaw against it [rad].

    Of several lines, it is the one with most votes.

    Args:
        road_pose: Pose over the road surface.
        matches: Lines that both cameras see.
        points: Stripe points of both images.
        images: Left and right image.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    plane = plane_from_pose(road_pose, rig)
    for match in sorted(matches, key=lambda m: -m.votes):
        on_road = _seen_by_both(match.left, plane, points, images, rig, config)
        if on_road is None:
            continue
        right = match.right.line
        v = np.array([right.rows.mean(), right.rows.max()])
        # The line must be the one that was found in the right image without the plane, and not one nearby.
        if np.any(np.abs(right.column_at(v) - on_road.right.line.column_at(v)) > right.width_px):
            continue
        yaw = _yaw(on_road.left.line, plane, rig)
        if abs(yaw) <= MAX_YAW_RAD:
            return on_road, yaw
    return None


def _yaw(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the yaw of the camera against a line [rad], > 0: it points left of the line."""
    leaves = float(line.column_at(np.array(_horizon(line, plane, rig))))
    return float(np.arctan((leaves - rig.cx) / rig.fx))
