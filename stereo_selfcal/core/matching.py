"""Which lines of the two images are the same two lane boundaries, and the pattern they make.

All lines of one direction on the road meet in one image point, and as that point is infinitely
far away, it has no disparity: the left and right lane boundary in both rectified images are four
lines through ONE point. Kerbs, poles, shadows and the wrong partner in the other image miss it.
The disparity of a road point grows in proportion to the rows below that point, by the
baseline over the height: this bounds what can be a line on the road at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from .config import CalibratorConfig
from .extrinsics import Array
from .pattern import ImageLine, LanePattern
from .rig import StereoRig

# Four lines that miss their common point by this (RMS along the row) count half. Lines are fitted
# to about a tenth of a pixel, and to a few tenths when extrapolated beyond their last dash.
_HALF_CREDIT_PX = 0.3

# Both cameras see one stripe: in the same rows, as wide, and as bright up to their gains, which
# an automatic exposure keeps within 0.8 ... 1.25 of each other.
_MIN_ROW_OVERLAP = 0.5
_MAX_WIDTH_RATIO = 1.5
_MAX_CONTRAST_RATIO = 2.0

# Roll tilts the road under a line at slope du/dv, which adds up to tan(15 deg) * slope to the growth
# of its disparity; the bounds on the height are widened by this factor for it.
_GROWTH_SLACK = 1.6

# Widths of painted stripes on the road: 10 cm (narrow lane lines) to 50 cm (stop of a bus lane),
# with a margin for the blur of distant ones.
_STRIPE_WIDTH_M = (0.05, 0.6)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A fitted line and the votes that found it."""

    line: ImageLine
    votes: float


@dataclass(frozen=True, slots=True)
class _Match:
    """One lane boundary as seen by both cameras."""

    left: Candidate
    right: Candidate


@dataclass(frozen=True, slots=True)
class MatchedLines:
    """The two lane boundaries of both cameras, and the point they share.

    Attributes:
        left: Left and right lane boundary in the left camera.
        right: The same two in the right camera.
        vanishing_point: (2,) column, row [px].
        concurrency_px: Root mean square distance along the row of the four lines from it [px].
    """

    left: tuple[ImageLine, ImageLine]
    right: tuple[ImageLine, ImageLine]
    vanishing_point: Array
    concurrency_px: float


def match_lines(
    left: tuple[list[Candidate], list[Candidate]],
    right: tuple[list[Candidate], list[Candidate]],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[MatchedLines | None, tuple[int, int]]:
    """Choose the two lane boundaries with the most votes among all that both cameras see alike.

    Args:
        left: Candidates of the left camera: left boundaries, right boundaries.
        right: Candidates of the right camera.
        rig: Intrinsics and baseline.
        config: Its search box bounds the growth of the disparity.

    Returns:
        The best four lines, or None; and how many left and right boundaries could be matched at all.
    """
    boundaries = [
        [_Match(a, b) for a, b in product(left[i], right[i]) if _may_lie_on_road(a.line, b.line, rig, config)]
        for i in range(2)
    ]
    best: MatchedLines | None = None
    best_score = 0.0
    for first, second in product(*boundaries):
        if not _roll_possible(first, second, rig, config):
            continue
        candidates = (first.left, first.right, second.left, second.right)
        point, distance = common_point([candidate.line for candidate in candidates])
        score = sum(candidate.votes for candidate in candidates) / (1 + (distance / _HALF_CREDIT_PX) ** 2)
        if score > best_score:
            best_score = score
            best = MatchedLines(
                (first.left.line, second.left.line), (first.right.line, second.right.line), point, distance
            )
    return best, (len(boundaries[0]), len(boundaries[1]))


def _roll_possible(first: _Match, second: _Match, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether the plane through two boundaries is tilted to the side by no more than the greatest roll."""
    # d = a + A u + B v on a plane, so along a line of slope m the disparity grows by A m + B a row.
    slopes = np.array([first.left.line.slope, second.left.line.slope])
    growths = slopes - np.array([first.right.line.slope, second.right.line.slope])
    across, down = np.linalg.solve(np.column_stack([slopes, np.ones(2)]), growths)
    roll = np.arctan2(across * rig.fx, down * rig.fy)
    return bool(abs(roll) <= config.search.roll_max_rad)


def _may_lie_on_road(left: ImageLine, right: ImageLine, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether the disparity between two lines is that of a stripe on a road under the rig."""
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
    if max(left.width_px, right.width_px) > _MAX_WIDTH_RATIO * min(left.width_px, right.width_px):
        return False
    if max(left.contrast, right.contrast) > _MAX_CONTRAST_RATIO * min(left.contrast, right.contrast):
        return False
    width_m = left.width_px * rig.baseline_m / disparity
    return _STRIPE_WIDTH_M[0] <= width_m <= _STRIPE_WIDTH_M[1]


def _overlap(a: Array, b: Array) -> float:
    """Return the rows common to two measured lines over the rows of both (intersection over union)."""
    common = min(a.max(), b.max()) - max(a.min(), b.min())
    return float(common / (max(a.max(), b.max()) - min(a.min(), b.min())))


def common_point(lines: list[ImageLine]) -> tuple[Array, float]:
    """Return the point nearest to all lines (column, row), and their RMS distance along the row [px]."""
    # u - slope v = u_mid - slope v_mid for every line, least squares.
    slopes = np.array([line.slope for line in lines])
    offsets = np.array([line.u_mid - line.slope * line.v_mid for line in lines])
    design = np.column_stack([np.ones_like(slopes), -slopes])
    point, *_ = np.linalg.lstsq(design, offsets, rcond=None)
    distance = float(np.sqrt(np.mean((design @ point - offsets) ** 2)))
    return point, distance


def sample_pattern(matched: MatchedLines, rig: StereoRig, config: CalibratorConfig) -> LanePattern:
    """Sample the lines row by row (paper section 2.2, figure 3b).

    The first row is where ``horizon_fraction`` of the height between the bottom of the image and the
    vanishing point is reached, then every ``sample_step_px`` down to the bottom.
    """
    bottom = rig.height - 1.0
    first = bottom - config.extraction.horizon_fraction * (bottom - float(matched.vanishing_point[1]))
    rows: npt.NDArray[np.float64] = np.arange(max(first, 0.0), rig.height, config.extraction.sample_step_px)
    columns = np.array([[line.column_at(rows) for line in lines] for lines in (matched.left, matched.right)])
    return LanePattern(matched.left, matched.right, matched.vanishing_point, rows, columns)
