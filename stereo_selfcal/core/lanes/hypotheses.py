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

"""Pairs of lane boundaries that both cameras see: calibration patterns (paper section 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..geometry.plane import jacobian_pose_wrt_plane, plane_from_pose
from ..numerics.linear import invert
from ..rejection import NotFitted, Rejection
from ..road.priors import LANE_WIDTH_M, MAX_CROSS_FALL
from ..types import Image
from . import frame_checks
from .closed_form import solve_plane
from .detector import LineDetector, detect_by_hough
from .lane_pair import ImageLine, LanePattern
from .line_fit import refit_lines
from .line_geometry import BelowPlane, height_std_m, heights_and_offsets_m
from .matching import (
    Candidates,
    MatchedLines,
    Matches,
    first_sampled_row,
    is_sampled,
    match_lines,
    pair_lines,
    sample_pattern,
)
from .stripe_points import StripePoints

Points = tuple[StripePoints, StripePoints]

# Lines surely cross where they change sides by more than this: the ends of worn stripes in noise are known to
# half a pixel each.
_SURELY_APART_PX = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class NoPattern:
    """Why a frame has no pattern; the lines that were found are kept for a picture."""

    rejection: Rejection
    pattern: LanePattern | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LaneHypotheses:
    """Lines of a frame, and the pairs that can bound a lane.

    Attributes:
        candidates: Lines of the left and of the right camera.
        matches: Lines that both cameras see.
        patterns: Pairs of lane boundaries, sampled, most promising first; or why there are none.
    """

    candidates: tuple[Candidates, Candidates]
    matches: Matches
    patterns: list[LanePattern] | NoPattern


def find_hypotheses(
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
    detector: LineDetector = detect_by_hough,
) -> LaneHypotheses:
    """Find the pairs of lane boundaries that both cameras see.

    Args:
        points: Stripe points of the left and of the right image.
        images: Both images, (H, W) uint8.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
        detector: Detector of the lines of an image.
    """
    left, right = (detector(each, image) for each, image in zip(points, images, strict=True))
    return pair_candidates((left, right), points, images, rig, config)


def pair_candidates(
    candidates: tuple[Candidates, Candidates],
    points: Points,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> LaneHypotheses:
    """Find the pairs of lane boundaries that both cameras see, among lines of both images.

    Args:
        candidates: Lines of the left and of the right image.
        points: Stripe points of both images.
        images: Both images, (H, W) uint8.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    left, right = candidates
    matches = match_lines(left, right, images, rig, config)
    refusal = frame_checks.check_lines_found([left, right], config)
    if refusal:
        return LaneHypotheses((left, right), matches, NoPattern(refusal))
    patterns = _patterns(matches, points, rig, config)
    if not patterns:
        exchanged = match_lines(right, left, images[::-1], rig, config)
        patterns = NoPattern(_unpaired(matches, exchanged, rig, config))
    return LaneHypotheses((left, right), matches, patterns)


def _unpaired(matches: Matches, exchanged: Matches, rig: StereoRig, config: CalibratorConfig) -> Rejection:
    """Return the refusal of lines of which no two bound a lane.

    Args:
        matches: Lines that both cameras see.
        exchanged: The same with the left and the right image exchanged.
        rig: Intrinsics and baseline.
        config: Settings.
    """
    pairs = pair_lines(exchanged, rig, config)
    if pairs:
        return frame_checks.cameras_swapped(pairs)
    if all(matches):
        return frame_checks.lines_not_matched(config.search.roll_max_rad)
    n_matched, n_exchanged = ((len(each[0]), len(each[1])) for each in (matches, exchanged))
    return frame_checks.line_not_in_both(n_matched, n_exchanged)


def _patterns(
    matches: Matches, points: Points, rig: StereoRig, config: CalibratorConfig
) -> list[LanePattern] | NoPattern:
    pairs = pair_lines(matches, rig, config)
    if not pairs:
        return []
    refusals = [frame_checks.check_converging(pair) for pair in pairs]
    converging = [pair for pair, refusal in zip(pairs, refusals, strict=True) if refusal is None]
    if refusals[0] is not None and not converging:
        return NoPattern(refusals[0], sample_pattern(pairs[0], rig, config))
    refined = [pair for pair in _refit(converging, points, rig, config) if is_sampled(pair, rig, config)]
    if not refined:
        return NoPattern(frame_checks.lines_too_short(config))
    refined.sort(key=lambda pair: -pair.score)
    return [sample_pattern(pair, rig, config) for pair in refined]


def _refit(
    pairs: Sequence[MatchedLines], points: Points, rig: StereoRig, config: CalibratorConfig
) -> list[MatchedLines]:
    """Fit lines again in the rows where they are sampled, below their vanishing point; too short ones go."""
    first_rows = [first_sampled_row(pair.vanishing_point, rig, config) for pair in pairs for _ in range(2)]
    left, right = (
        refit_lines(view.gradient, [line for both in lines for line in both], view.noise_grey, first_rows)
        for view, lines in zip(
            points, ([pair.left for pair in pairs], [pair.right for pair in pairs]), strict=True
        )
    )
    refitted = []
    for index, pair in enumerate(pairs):
        own = slice(2 * index, 2 * index + 2)
        lines = [line for line in (*left[own], *right[own]) if line is not None]
        if len(lines) == 4 and min(line.length_px for line in lines) >= config.extraction.min_line_rows:
            refitted.append(MatchedLines.of(lines, pair.votes))
    return refitted


def unused_lines(
    found: LaneHypotheses, pattern: LanePattern | None, lane_line: ImageLine | None = None
) -> tuple[ImageLine, ...]:
    """Return the lines of the left camera that were found, without those that are drawn as lane lines."""
    used = [] if pattern is None else list(pattern.lines[0])
    used += [] if lane_line is None else [lane_line]
    lines = [candidate.line for side in found.candidates[0] for candidate in side]
    return tuple(line for line in lines if not any(line.is_same_stripe(other) for other in used))


def lines_below_plane(patterns: list[LanePattern], rig: StereoRig) -> list[BelowPlane]:
    """Return for each pattern how deep a line of the other patterns lies below its plane.

    Nothing that is seen lies below the road. Where a line lies below the plane, the plane is that of a kerb
    or a rail. A line beyond those of the pattern may be lower by as much as roads fall to their sides. Of
    several lines, the one that is most surely below the plane counts.

    Args:
        patterns: Pairs of lines of one frame.
        rig: Intrinsics and baseline.
    """
    lines = [pair for pattern in patterns for pair in pattern.pairs]
    depths = []
    for pattern in patterns:
        closed = solve_plane(pattern, rig)
        depths.append(BelowPlane())
        if isinstance(closed, NotFitted):
            continue
        plane = plane_from_pose(closed.extrinsics, rig)
        jac_plane_pose = invert(jacobian_pose_wrt_plane(plane, rig), "numbers of the plane by the pose")
        if isinstance(jac_plane_pose, NotFitted):
            continue
        covariance = jac_plane_pose @ closed.covariance @ jac_plane_pose.T
        _, own_offsets_m = heights_and_offsets_m(pattern.pairs, plane, rig)
        heights_m, offsets_m = heights_and_offsets_m(lines, plane, rig)
        for (left, right), height_m, offset_m in zip(lines, heights_m, offsets_m, strict=True):
            beyond_m = float(max(offset_m - own_offsets_m.max(), own_offsets_m.min() - offset_m, 0.0))
            if beyond_m <= LANE_WIDTH_M:
                std_m = height_std_m(left, right, plane, rig, covariance)
                depth = BelowPlane(-float(height_m) - MAX_CROSS_FALL * beyond_m, std_m)
                depths[-1] = max(depths[-1], depth, key=lambda each: each.depth_m - each.limit_m)
    return depths


def cross(a: LanePattern, b: LanePattern) -> bool:
    """Whether a line of one pattern crosses a line of the other in the rows that show both.

    Lines of one road meet at their vanishing point only. Where two lines cross elsewhere, one of them leads
    from one stripe to another.
    """
    return any(
        _cross(*pair)
        for camera in ("left", "right")
        for pair in product(getattr(a, camera), getattr(b, camera))
    )


def _cross(a: ImageLine, b: ImageLine) -> bool:
    ends = np.array([max(a.rows.min(), b.rows.min()), min(a.rows.max(), b.rows.max())])
    if ends[0] >= ends[1]:
        return False
    apart = a.column_at(ends) - b.column_at(ends)
    return bool(apart.min() < -_SURELY_APART_PX and apart.max() > _SURELY_APART_PX)
