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

"""Extra lines beside the two boundaries of a lane: double lines, lines of bus lanes and of the next lanes.

Only the boundaries determine the plane, as the next lane may have another slope. A rail, the top of a kerb or
a shadow is not a painted line: it misses the point where all lines meet, or lies too high. Such lines are
left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..geometry.plane import DisparityPlane, plane_from_pose
from ..geometry.rays import LEAST_DISPARITY_PX, pixel_rays
from ..rejection import NotFitted
from ..road.priors import CROSS_FALL_STD, LANE_WIDTH_M, LINE_HEIGHT_STD_M, MAX_CROSS_FALL, MAX_CROWN_M
from ..tolerances import MAX_LINE_HEIGHT_M
from .closed_form import solve_plane
from .lane_pair import ExtraLine, ImageLine, LanePattern
from .line_fit import refit_lines
from .line_geometry import HeightOverLane, height_std_m, heights_and_offsets_m
from .matching import HALF_CREDIT_PX, Match, Matches, common_point, first_sampled_row
from .stripe_points import StripePoints

# Boundaries that miss their common point by this count half (`core.lanes.matching`). An extra line is not
# needed, so one that misses the point by more is left out.
_MAX_CONCURRENCY_PX = HALF_CREDIT_PX
# In the fit of the stripes, an extra line takes as much time as a boundary. A road rarely has more lines
# within a lane's width.
_MOST_LINES = 4
# Greatest slope of an extra line [columns a row]. Lines are measured along the row. A line with a greater
# slope moves by more than its width from row to row. It is measured with an error of up to half a pixel. That
# is too much for the angles between lines.
_MAX_SLOPE = 2.5
# A line between the boundaries is surely not in their plane where its height is this many of its standard
# deviations from zero.
_SIGMAS = 4.0


def find_extra_lines(
    pattern: LanePattern,
    matches: Matches,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[ExtraLine, ...]:
    """Return the other lines that both cameras see on the road of a lane, those with most votes first.

    Args:
        pattern: The boundaries of the lane.
        matches: Lines that both cameras see.
        points: Stripe points of both images.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    closed = solve_plane(pattern, rig)
    if isinstance(closed, NotFitted):
        return ()
    plane = plane_from_pose(closed.extrinsics, rig)
    _, (first_m, second_m) = heights_and_offsets_m(pattern.pairs, plane, rig)
    bounds_m = [float(first_m), float(second_m)]
    occupied = [
        (offset, _width_m(line, plane, rig)) for offset, line in zip(bounds_m, pattern.left, strict=True)
    ]
    found: list[ExtraLine] = []
    others = _others(
        bounds_m, sorted((m for side in matches for m in side), key=lambda m: -m.votes), plane, rig
    )
    refitted = _refit([match for match, _ in others], pattern, points, rig, config)
    heights_m, offsets_m = heights_and_offsets_m(refitted, plane, rig)
    for lines, height_m, offset_m in zip(refitted, heights_m.tolist(), offsets_m.tolist(), strict=True):
        if len(found) == _MOST_LINES:
            break
        width_m = _width_m(lines[0], plane, rig)
        if any(abs(offset_m - offset) < (width_m + width) / 2.0 for offset, width in occupied):
            continue
        beyond_m = max(offset_m - max(bounds_m), min(bounds_m) - offset_m, 0.0)
        allowed_m = MAX_LINE_HEIGHT_M + MAX_CROSS_FALL * beyond_m
        if beyond_m > LANE_WIDTH_M or abs(height_m) > allowed_m:
            continue
        _, missed_px = common_point([*pattern.left, *pattern.right, *lines])
        if missed_px > _MAX_CONCURRENCY_PX:
            continue
        occupied.append((offset_m, width_m))
        std_m = float(np.hypot(LINE_HEIGHT_STD_M, CROSS_FALL_STD * _lever_m(bounds_m, offset_m)))
        found.append(ExtraLine(*lines, std_m))
    return tuple(found)


def _lever_m(bounds_m: list[float], offset_m: float) -> float:
    """Return the height of a line over the plane, per unit of a change of slope beside it [m].

    For a line beyond the boundaries, the slope changes at the nearer boundary, where the next lane begins.
    For a line between them, it changes at the line itself.
    """
    first, second = abs(offset_m - min(bounds_m)), abs(offset_m - max(bounds_m))
    if min(bounds_m) < offset_m < max(bounds_m):
        return first * second / (first + second)
    return min(first, second)


def inner_line_height(
    pattern: LanePattern,
    plane: DisparityPlane,
    matches: Matches,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> HeightOverLane:
    """Return the height of a line between the boundaries over their plane.

    A lane has no other lines between its own two. A line above their plane means that the boundaries belong
    to different lanes, with a crown between them. A line below it means that one boundary is a kerb or a
    rail.

    Args:
        pattern: The boundaries.
        plane: The plane through them, of the camera in the middle.
        matches: Lines that both cameras see.
        points: Stripe points of both images.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.

    Returns:
        The height of the line that most surely lies beside the plane; zeros where there is no such line.
    """
    _, (first_m, second_m) = heights_and_offsets_m(pattern.pairs, plane, rig)
    bounds_m = [float(first_m), float(second_m)]
    widths = [_width_m(line, plane, rig) for line in pattern.left]
    worst = HeightOverLane(0.0, 0.0)
    # Before it is fitted again, a line may be off by its width.
    others = [
        match
        for match, offset_m in _others(bounds_m, [m for side in matches for m in side], plane, rig)
        if min(bounds_m) < offset_m < max(bounds_m)
    ]
    refitted = _refit(others, pattern, points, rig, config)
    heights_m, offsets_m = heights_and_offsets_m(refitted, plane, rig)
    for lines, height_m, offset_m in zip(refitted, heights_m.tolist(), offsets_m.tolist(), strict=True):
        if not min(bounds_m) + max(widths) < offset_m < max(bounds_m) - max(widths) or height_m > MAX_CROWN_M:
            continue
        _, missed_px = common_point([*pattern.left, *pattern.right, *lines])
        if missed_px > _MAX_CONCURRENCY_PX:
            continue
        std_m = height_std_m(*lines, plane, rig)
        if abs(height_m) - _SIGMAS * std_m > abs(worst.value_m) - _SIGMAS * worst.std_m:
            worst = HeightOverLane(height_m, std_m)
    return worst


def _others(
    bounds_m: list[float], matches: Sequence[Match], plane: DisparityPlane, rig: StereoRig
) -> list[tuple[Match, float]]:
    """Return the lines that are not within half of their width of a boundary, with their offsets [m]."""
    _, offsets_m = heights_and_offsets_m([match.lines for match in matches], plane, rig)
    return [
        (match, offset_m)
        for match, offset_m in zip(matches, offsets_m.tolist(), strict=True)
        if all(abs(offset_m - bound_m) >= _width_m(match.left.line, plane, rig) / 2.0 for bound_m in bounds_m)
    ]


def _refit(
    matches: Sequence[Match],
    pattern: LanePattern,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> list[tuple[ImageLine, ImageLine]]:
    """Fit lines in both images again, in the rows where the pattern is sampled, without those too short."""
    first_row = first_sampled_row(pattern.vanishing_point, rig, config)
    pairs = [match.lines for match in matches if max(abs(line.slope) for line in match.lines) <= _MAX_SLOPE]
    refitted = [
        refit_lines(
            view.gradient, [pair[camera] for pair in pairs], view.noise_grey, [first_row] * len(pairs)
        )
        for camera, view in enumerate(points)
    ]
    least_px = config.extraction.min_line_rows
    return [
        (left, right)
        for left, right in zip(*refitted, strict=True)
        if left is not None and right is not None and min(left.length_px, right.length_px) >= least_px
    ]


def _width_m(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the width of a stripe of the left image on the road [m]."""
    # A pixel is baseline / disparity wide. That the plane is of another camera does not matter here.
    disparity = float(plane.disparities(pixel_rays(rig, line.u_mid, line.v_mid)))
    return line.width_px * rig.baseline_m / max(disparity, LEAST_DISPARITY_PX)
