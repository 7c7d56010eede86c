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

"""Matching of the lines of both images: which of them are the same two lane boundaries.

All lines of one direction on the road meet in one image point. That point is infinitely far away and has no
disparity. So the left and the right boundary in both rectified images are four lines through one point.
Poles, shadows across the road and lines of another direction miss it. A parallel object, such as a kerb,
meets it, too; its cross-section of grey values is another one. The disparity of a road point grows in
proportion to the rows below that point, by the baseline over the height. This limits which lines can lie on
the road.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..numerics.linear import solve_linear
from ..rejection import NotFitted
from ..types import Array, Image
from .lane_pair import ImageLine, LanePattern, row_towards

# Four lines that miss their common point by this (RMS along the row) count half. A fitted line is accurate to
# about a tenth of a pixel, and to a few tenths where it is extrapolated beyond its last dash.
HALF_CREDIT_PX = 0.3

# Pairs of boundaries that are fitted again. A lane line, the kerb beside it and the line of the next lane, on
# either side, make nine pairs; no more than five have had similar scores.
_MAX_PAIRS = 5

# Both cameras see the same stripe in the same rows, with the same width and contrast. The contrast differs by
# their gains, which an automatic exposure keeps within 0.8 ... 1.25 of each other.
_MIN_ROW_OVERLAP = 0.5  # of the shorter line, as one stray block in the sky makes a line twice as long
_MAX_WIDTH_RATIO = 2.0
_MAX_CONTRAST_RATIO = 2.5
# Least correlation r of the cross-sections of one line in both images, as Fisher's z = atanh(r), whose
# scatter does not depend on r. This is r = 0.7, half of the variance in common; over real frames the same
# line has 0.75 ... 1, a line and the kerb next to it -0.2 ... 0.6.
MIN_LIKENESS = 0.867
# Positions of the cross-section, in stripe widths from the left edge of the stripe.
_SECTION_WIDTHS = np.linspace(-3.0, 4.0, 29)
_SECTION_ROW_STEP = 3

# Spread of the slopes of parallel lines, over their squares: rounding.
_PARALLEL = 1e-14

# Roll tilts the road along a line of slope du/dv, which adds up to tan(15 deg) * slope to the growth of its
# disparity. The limits of the height are widened by this factor to allow for that.
_GROWTH_SLACK = 1.6

# Widths of painted stripes on the road [m]: from 10 cm (narrow lane lines) to 50 cm (stop of a bus lane),
# with a margin for the blur of distant ones.
_STRIPE_WIDTH_M = (0.05, 0.6)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A fitted line and the votes that found it."""

    line: ImageLine
    votes: float


@dataclass(frozen=True, slots=True)
class Match:
    """One lane boundary as seen by both cameras, and how alike they see it."""

    left: Candidate
    right: Candidate
    similarity: float

    @property
    def lines(self) -> tuple[ImageLine, ImageLine]:
        """The line in the left and in the right image."""
        return self.left.line, self.right.line

    @property
    def votes(self) -> float:
        """Votes of both lines, weighted by how alike the cameras see them."""
        return self.similarity * (self.left.votes + self.right.votes)


Candidates = tuple[list[Candidate], list[Candidate]]  # left boundaries, right boundaries
Matches = tuple[list[Match], list[Match]]


@dataclass(frozen=True, slots=True)
class MatchedLines:
    """Two lane boundaries as seen by both cameras, and the point they share.

    Attributes:
        left: Left and right lane boundary in the left camera.
        right: The same two in the right camera.
        votes: Votes of the four lines, weighted by how alike the cameras see each boundary.
        vanishing_point: (2,) column, row [px].
        concurrency_px: Root mean square distance along the row of the four lines from it [px].
    """

    left: tuple[ImageLine, ImageLine]
    right: tuple[ImageLine, ImageLine]
    votes: float
    vanishing_point: Array
    concurrency_px: float

    @classmethod
    def of(cls, lines: Sequence[ImageLine], votes: float) -> MatchedLines:
        """Build from left and right boundary in the left camera, then in the right camera."""
        point, distance = common_point(lines)
        return cls((lines[0], lines[1]), (lines[2], lines[3]), votes, point, distance)

    @classmethod
    def of_matches(cls, first: Match, second: Match) -> MatchedLines:
        """Build from a left and a right boundary."""
        lines = [first.left.line, second.left.line, first.right.line, second.right.line]
        return cls.of(lines, first.votes + second.votes)

    @property
    def score(self) -> float:
        """Rank among several pairs: high for many votes and a small distance from one point."""
        return self.votes / (1.0 + (self.concurrency_px / HALF_CREDIT_PX) ** 2)


def match_lines(
    left: Candidates,
    right: Candidates,
    images: tuple[Image, Image],
    rig: StereoRig,
    config: CalibratorConfig,
) -> Matches:
    """Return the lines that both cameras see, with similar cross-sections.

    Args:
        left: Candidates of the left camera: left boundaries, right boundaries.
        right: Candidates of the right camera.
        images: Both images, (H, W) uint8.
        rig: Intrinsics and baseline.
        config: Its search box bounds the growth of the disparity.

    Returns:
        Left and right boundaries.
    """
    sides = []
    for left_lines, right_lines in zip(left, right, strict=True):
        possible = [
            (a, b)
            for a, b in product(left_lines, right_lines)
            if may_lie_on_road(a.line, b.line, rig, config)
        ]
        matches = [Match(a, b, similarity(images, a.line, b.line)) for a, b in possible]
        sides.append([match for match in matches if looks_alike(match.similarity)])
    return sides[0], sides[1]


def pair_lines(matches: Matches, rig: StereoRig, config: CalibratorConfig) -> list[MatchedLines]:
    """Pair left and right boundaries to lanes.

    Returns:
        The most promising pairs, best first, for a closer fit.
    """
    found = [
        MatchedLines.of_matches(first, second)
        for first, second in product(*matches)
        if _roll_possible(first, second, rig, config)
    ]
    # This is a preliminary order: the fits still include rows above the road.
    found.sort(key=lambda lines: -lines.score)
    return found[:_MAX_PAIRS]


def _roll_possible(first: Match, second: Match, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether the roll of the plane through two boundaries is within the search range.

    Two lines of one slope leave the roll open: they meet nowhere, and so bound no lane.
    """
    # d = a + A u + B v on a plane, so along a line of slope m the disparity grows by A m + B a row.
    slopes = np.array([first.left.line.slope, second.left.line.slope])
    growths = slopes - np.array([first.right.line.slope, second.right.line.slope])
    tilt = solve_linear(np.column_stack([slopes, np.ones(2)]), growths, "slopes of the lines that differ")
    if isinstance(tilt, NotFitted):
        return False
    roll = np.arctan2(tilt[0] * rig.fx, tilt[1] * rig.fy)
    return bool(abs(roll) <= config.search.roll_max_rad)


def may_lie_on_road(left: ImageLine, right: ImageLine, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether the disparity of two lines can be that of a stripe on a road below the rig."""
    # d(v) = growth * (v - v_infinity); on a level road growth = baseline / height * fx / fy.
    growth = left.slope - right.slope
    scale = rig.baseline_m * rig.fx / rig.fy
    if not (
        scale / config.search.height_max_m / _GROWTH_SLACK
        <= growth
        <= scale / config.search.height_min_m * _GROWTH_SLACK
    ):
        return False
    row = np.array(left.v_mid)
    disparity = float(left.column_at(row) - right.column_at(row))
    if disparity <= 0.0:
        return False
    if _overlap(left.rows, right.rows) < _MIN_ROW_OVERLAP:
        return False
    # Widths grow with the rows below the horizon, and the two may be measured in different rows.
    horizon = float(left.v_mid) - disparity / growth
    widths = [line.width_px / max(line.v_mid - horizon, 1.0) for line in (left, right)]
    if max(widths) > _MAX_WIDTH_RATIO * min(widths):
        return False
    if max(left.contrast, right.contrast) > _MAX_CONTRAST_RATIO * min(left.contrast, right.contrast):
        return False
    width_m = left.width_px * rig.baseline_m / disparity
    return _STRIPE_WIDTH_M[0] <= width_m <= _STRIPE_WIDTH_M[1]


def similarity(images: tuple[Image, Image], left: ImageLine, right: ImageLine) -> float:
    """Compare the cross-sections of a line in both images: paint, road surface, gutter, kerb.

    The grey values at fixed distances on the road from the line, a few stripe widths to either side, are
    averaged over the rows that both cameras see. This cross-section is the same for the same line, and
    differs for the line next to it.

    Args:
        images: Left and right image, (H, W) uint8.
        left: The line in the left image.
        right: The line in the right image.

    Returns:
        Correlation coefficient of the two cross-sections, -1 ... 1.
    """
    first, last = max(left.rows.min(), right.rows.min()), min(left.rows.max(), right.rows.max())
    rows = np.arange(first, last, _SECTION_ROW_STEP)
    # The disparity is zero at the horizon; a distance on the road grows in the image with the rows below it.
    growth = left.slope - right.slope
    middle = np.array((rows[0] + rows[-1]) / 2.0 if len(rows) else left.v_mid)
    horizon = float(middle) - float(left.column_at(middle) - right.column_at(middle)) / growth
    rows = rows[rows > horizon + _SECTION_ROW_STEP]
    width_per_row = left.width_px / max(left.v_mid - horizon, 1.0)
    offsets = (rows[:, None] - horizon) * width_per_row * _SECTION_WIDTHS
    both = np.stack([line.column_at(rows) for line in (left, right)])
    columns = np.rint(both[:, :, None] + offsets).astype(np.intp)
    width = images[0].shape[1]
    inside = np.minimum(np.maximum(columns, 0), width - 1)
    valid = (inside == columns).all(axis=0)
    inside += (rows.astype(np.intp) * width)[:, None]
    count = valid.sum(axis=0)
    seen = count > 0
    if not seen.any():
        return 0.0
    a, b = (
        (image.ravel().take(at) * valid).sum(axis=0, dtype=np.float64)[seen] / count[seen]
        for image, at in zip(images, inside, strict=True)
    )
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0


def looks_alike(correlation: float) -> bool:
    """Whether the correlation of two cross-sections is high enough for one and the same line."""
    return correlation >= math.tanh(MIN_LIKENESS)


def _overlap(a: Array, b: Array) -> float:
    """Return the rows common to two measured lines over those of the shorter one."""
    (first_a, last_a), (first_b, last_b) = ((float(each.min()), float(each.max())) for each in (a, b))
    common = min(last_a, last_b) - max(first_a, first_b)
    return common / min(last_a - first_a, last_b - first_b)


def common_point(lines: Sequence[ImageLine]) -> tuple[Array, float]:
    """Return the point nearest to all lines (column, row), and their RMS distance along the row [px]."""
    # u - slope v = u_mid - slope v_mid for every line, least squares. In plain numbers: it is done for every
    # pair of lines of a frame.
    slopes = [line.slope for line in lines]
    offsets = [line.u_mid - line.slope * line.v_mid for line in lines]
    n = len(lines)
    mean_slope, mean_offset = sum(slopes) / n, sum(offsets) / n
    apart = [slope - mean_slope for slope in slopes]
    spread = sum(each * each for each in apart)
    if spread <= _PARALLEL * (n * mean_slope**2 + spread):  # they meet nowhere
        design = np.column_stack([np.ones(n), np.negative(slopes)])
        point = np.linalg.lstsq(design, np.array(offsets), rcond=None)[0]
        u, v = point.tolist()
    else:
        v = -sum(each * offset for each, offset in zip(apart, offsets, strict=True)) / spread
        u = mean_offset + v * mean_slope
        point = np.array([u, v])
    squares = sum((u - slope * v - offset) ** 2 for slope, offset in zip(slopes, offsets, strict=True))
    return point, math.sqrt(squares / n)


def sample_pattern(matched: MatchedLines, rig: StereoRig, config: CalibratorConfig) -> LanePattern:
    """Sample the lines row by row (paper section 2.2, figure 3b).

    The first row is at ``horizon_fraction`` of the height between the bottom of the image and the vanishing
    point. The others follow every ``sample_step_px`` down to the bottom.
    """
    first = first_sampled_row(matched.vanishing_point, rig, config)
    rows: npt.NDArray[np.float64] = np.arange(first, rig.height, config.extraction.sample_step_px)
    columns = np.array([[line.column_at(rows) for line in lines] for lines in (matched.left, matched.right)])
    return LanePattern(matched.left, matched.right, matched.vanishing_point, rows, columns)


def is_sampled(matched: MatchedLines, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether at least two rows of the image are sampled; else the lines meet too close to its bottom."""
    first = first_sampled_row(matched.vanishing_point, rig, config)
    return first + config.extraction.sample_step_px < rig.height


def first_sampled_row(vanishing_point: Array, rig: StereoRig, config: CalibratorConfig) -> float:
    """Return the first sampled row [px]; heights count from the bottom of the image (figure 3b)."""
    return row_towards(vanishing_point, config.extraction.horizon_fraction, rig)
