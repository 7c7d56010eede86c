"""Lines looked for on a road that the asphalt has shown: a second look, where two free lines were not found.

Matching lines of both cameras freely takes two that are clear in both. One clear line, though, and a road
that is level across, are near enough for the asphalt to be aligned; with its plane a line of the left camera
says where the right one has it. Lines found this way are measured freely, and judged like all others.
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
    looks_alike,
    may_lie_on_road,
    sample_pattern,
    similarity,
)
from ..rejection import NotFitted
from ..tolerances import MAX_LINE_HEIGHT_M
from ..types import Image

# Starts that get an alignment each: the clearest lines.
_MOST_STARTS = 3
# Parallel lines meet on the horizon of their road, unless it bends up or down: by a grade of 1 % here.
MAX_GAP_RAD = 0.01
# A car in its lane heads along it to a few degrees; edges that cross the road do not.
MAX_YAW_RAD = float(np.radians(10.0))
# Pairs of lines that are handed on.
_MOST_PATTERNS = 3


def roads_of_single_lines(
    matches: list[Match], rig: StereoRig, config: CalibratorConfig
) -> Iterator[Extrinsics]:
    """Yield the road each line would lie on if there were no roll, most voted line first.

    Args:
        matches: Lines that both cameras see.
        rig: Intrinsics and baseline.
        config: Its search box bounds the pose.
    """
    box = config.search
    for match in sorted(matches, key=lambda m: -m.votes):
        left, right = match.left.line, match.right.line
        v = np.array([max(left.rows.min(), right.rows.min()), min(left.rows.max(), right.rows.max())])
        if v[1] <= v[0]:
            continue
        disparity = left.column_at(v) - right.column_at(v)
        ray = np.column_stack([np.ones(2), -(v - rig.cy) / rig.fy])
        p0, p2 = np.linalg.solve(ray, disparity)
        road = pose_from_plane(DisparityPlane(np.array([p0, 0.0, p2]), PlaneCamera.MIDDLE), rig)
        inside = box.height_min_m <= road.height_m <= box.height_max_m
        if p2 < 0.0 and inside and abs(road.pitch_rad) <= box.pitch_max_rad:
            yield road


def find_road(
    images: tuple[Image, Image],
    known: Extrinsics | None,
    matches: list[Match],
    rig: StereoRig,
    config: CalibratorConfig,
) -> TextureFit | None:
    """Return the road that the asphalt shows, wherever its lines may be; None without enough texture.

    Args:
        images: Left and right image.
        known: Where it is, if that is known.
        matches: Lines that both cameras see; without a known road the clearest of them say where to start.
        rig: Intrinsics and baseline.
        config: Its search box bounds the pose.
    """
    starts = [known] if known else islice(roads_of_single_lines(matches, rig, config), _MOST_STARTS)
    for start in starts:
        fit = align_texture(images, rig, start)
        if not isinstance(fit, NotFitted) and fit.enough_texture and fit.even_enough:
            return fit
    return None


def lines_on_road(
    road: Extrinsics,
    candidates: list[Candidates],
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> list[LanePattern]:
    """Return pairs of lines, one on either side, that lie in a road and meet in one point of its horizon.

    Args:
        road: Height, pitch and roll of the asphalt.
        candidates: Of the left camera, as often as lines were looked for.
        points: Stripe points of both images.
        images: Left and right image.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    plane = plane_from_pose(road, rig)
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
    pairs = [pair for pair in pairs if abs(_gap(pair, plane, rig)) <= reach_px]
    pairs.sort(key=lambda pair: -pair.score)
    return [sample_pattern(pair, rig, config) for pair in pairs[:_MOST_PATTERNS]]


def _gap(pair: MatchedLines, plane: DisparityPlane, rig: StereoRig) -> float:
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
    """Measure a line of the left camera below the horizon, and where the right camera should have it."""
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
    alike = similarity(images, left, right)
    if not looks_alike(alike):
        return None
    return Match(Candidate(left, candidate.votes), Candidate(right, candidate.votes), alike)


def _horizon(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the row where a line of the left image leaves a road: where its disparity is none."""
    intercept, slope = _disparity_along(line, plane, rig)
    return float(np.clip(-intercept / slope, 0.0, rig.height - 2.0)) if slope > 0.0 else 0.0


def _disparity_along(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> tuple[float, float]:
    """Return a and b of the disparity a + b v of a road along a line of the left image."""
    v = np.array([0.0, rig.height - 1.0])
    d = plane.of_camera(PlaneCamera.LEFT, rig).disparities(pixel_rays(rig, line.column_at(v), v))
    slope = float(d[1] - d[0]) / float(v[1])
    return float(d[0]), slope


def _in_right_camera(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> ImageLine:
    intercept, slope = _disparity_along(line, plane, rig)
    return replace(line, u_mid=line.u_mid - intercept - slope * line.v_mid, slope=line.slope - slope)


def line_on_road(
    road: Extrinsics,
    matches: list[Match],
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[Match, float] | None:
    """Return the clearest line both cameras have found that lies in a road, and the yaw of the camera to it.

    Args:
        road: Height, pitch and roll of the asphalt.
        matches: Lines both cameras see.
        points: Stripe points of both images.
        images: Left and right image.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    plane = plane_from_pose(road, rig)
    for match in sorted(matches, key=lambda m: -m.votes):
        on_road = _seen_by_both(match.left, plane, points, images, rig, config)
        if on_road is None:
            continue
        right = match.right.line
        v = np.array([right.rows.mean(), right.rows.max()])
        # The right camera has found this line by itself, too, and not another one nearby.
        if np.any(np.abs(right.column_at(v) - on_road.right.line.column_at(v)) > right.width_px):
            continue
        yaw = _yaw(on_road.left.line, plane, rig)
        if abs(yaw) <= MAX_YAW_RAD:
            return on_road, yaw
    return None


def _yaw(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the heading of the camera against a line [rad], > 0: left of it."""
    leaves = float(line.column_at(np.array(_horizon(line, plane, rig))))
    return float(np.arctan((leaves - rig.cx) / rig.fx))
