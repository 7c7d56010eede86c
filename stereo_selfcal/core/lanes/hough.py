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

"""Hough transform of the stripe points (paper section 2.2): approximate positions of the lines.

The accumulator is the paper's: rho = u cos(theta) + v sin(theta) about the image centre. rho has either sign,
so left and right lane boundaries differ in the sign of theta. Its cells (1 degree, 4 px) only give the start
of the fit that follows (`core.lanes.line_fit`), which gives the accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numerics.ragged import consecutive
from ..numerics.statistics import median
from ..types import Array, Indices
from .stripe_points import MarkedPoints, StripePoints

_THETA_STEP_DEG = 1.0
# A row-wise gradient sees no line flatter than this; it also bounds du/dv to +-5.7.
_THETA_MAX_DEG = 80.0
_N_THETA = int(2 * _THETA_MAX_DEG / _THETA_STEP_DEG) + 1
_RHO_STEP_PX = 4.0

# A point votes only for slopes near that of its own edge: within three standard deviations of the measured
# direction, but at least within this. A direction from 3 x 3 pixels of a stripe a few pixels wide is off by
# as much, because of its other edge (measured on rendered lines).
_MIN_VOTE_HALF_WIDTH_DEG = 8.0
_MAX_VOTE_HALF_WIDTH_DEG = 40.0  # half the accumulator; a larger one gives no information
_VOTE_SIGMAS = 3.0

# Contrast beyond this adds no votes: a quarter of the grey levels (the paper's stripes have 123). So fresh
# paint in the sun does not outvote a worn line of twice the length.
_FULL_VOTE_GREY = 64.0

# Only the strongest points of an image vote. A lane line has at most one point in each row and filter, so
# this number is enough for several lines besides clutter. It bounds the time on images of foliage.
_MAX_VOTING_POINTS = 6000

# Peaks kept for each sign of theta: own lane, neighbours' lanes, kerbs, shadows.
PEAKS_PER_SIGN = 10
# Of these, so many may be as upright as this: houses and trunks have more such edges than a road has lines.
# Of the lines of a road, only one that is straight ahead of the camera is upright.
_UPRIGHT_DEG, _UPRIGHT_PEAKS = 6.0, 4
# Peaks with fewer votes are dropped: a worn line (10 grey levels) of half the length of the strongest one has
# a tenth of its votes, and 40 rows of it have 5.
_MIN_VOTE_SHARE = 0.04
_MIN_VOTES = 2.0
# Points this close to a peak are taken as points of its line. Their votes are withdrawn before the next peak
# is searched. It is the half diagonal of a cell over the length of a line.
_SUPPORT_PX = 6.0
# Points this close to a line of the frame before may be points of it: a car drifts and turns by as much in a
# tenth of a second (0.3 m/s and 0.5 deg, seen with a focal length of 700 px, are 4 px and 6 px).
_FOLLOWED_PX = 10.0
# Share of the votes of a line that may lie beyond the rows it is measured in, at either end: stray points of
# a tree behind it.
_TAIL_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class HoughPeak:
    """A cell of the accumulator: ``u(v) = u_mid + slope * (v - v_mid)``, its votes, and their rows."""

    u_mid: float
    slope: float
    v_mid: float
    votes: float
    contrast: float
    width_px: float
    first_row: int
    last_row: int


def hough_peaks(points: StripePoints, shape: tuple[int, int]) -> tuple[list[HoughPeak], list[HoughPeak]]:
    """Return the strongest lines of either sign of theta, strongest first.

    Args:
        points: Marked points of one image.
        shape: (H, W) of the image.

    Returns:
        Lines that run to the left going down (theta > 0: left lane boundaries), and to the right.
    """
    centre_u, centre_v = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    marked = points.marked
    vote = _weight(marked)
    strongest = _strongest(vote)
    u, v = marked.columns[strongest] - centre_u, marked.rows[strongest] - centre_v
    theta, half_width = _directions(marked.slopes[strongest], marked.slope_std[strongest])
    n_rho = 2 * math.ceil(math.hypot(*shape) / 2 / _RHO_STEP_PX) + 3
    cells = _cells(u, v, theta, half_width, n_rho)
    weights = vote[strongest]
    table = np.bincount(cells.cells, np.repeat(weights, cells.counts), minlength=_N_THETA * n_rho)

    sides: tuple[list[HoughPeak], list[HoughPeak]] = ([], [])
    middle = _N_THETA // 2
    regions = (slice((middle + 1) * n_rho, _N_THETA * n_rho), slice(0, middle * n_rho))
    strongest_votes = float(table.max(initial=0.0))
    least_votes = max(_MIN_VOTES, _MIN_VOTE_SHARE * strongest_votes)
    reach = round(_UPRIGHT_DEG / _THETA_STEP_DEG)
    upright = slice((middle - reach) * n_rho, (middle + reach + 1) * n_rho)
    for peaks, region in zip(sides, regions, strict=True):
        of_upright = 0
        for _ in range(PEAKS_PER_SIGN):
            if of_upright == _UPRIGHT_PEAKS:
                table[upright] = np.minimum(table[upright], 0.0)
            best = region.start + int(np.argmax(table[region]))
            if table[best] <= least_votes:
                break
            of_upright += upright.start <= best < upright.stop
            angle = math.radians(best // n_rho * _THETA_STEP_DEG - _THETA_MAX_DEG)
            rho = (best % n_rho - n_rho // 2) * _RHO_STEP_PX
            is_near = np.abs(u * math.cos(angle) + v * math.sin(angle) - rho) < _SUPPORT_PX
            is_near &= weights > 0.0
            is_near &= np.abs(theta - math.degrees(angle)) <= half_width
            support = np.flatnonzero(is_near)
            if not len(support):
                table[best] = 0.0
                continue
            chosen, votes = strongest[support], weights[support]
            v_mid = median(v[support])
            u_mid, slope = _line_through(
                u[support],
                v[support] - v_mid,
                votes,
                ((rho - v_mid * math.sin(angle)) / math.cos(angle), -math.tan(angle)),
            )
            # Houses and trees stand above a line; below its points it may go on, in noise.
            rows = _row_range(marked.rows[chosen], votes)[0], shape[0] - 1.0
            peaks.append(
                HoughPeak(
                    u_mid=u_mid + centre_u,
                    slope=slope,
                    v_mid=v_mid + centre_v,
                    votes=float(table[best]),
                    contrast=median(marked.contrast[chosen]),
                    width_px=median(marked.widths[chosen]),
                    first_row=int(rows[0]),
                    last_row=int(rows[1]),
                )
            )
            withdrawn = cells.of(support)
            first, last = int(withdrawn.min()), int(withdrawn.max())
            given = np.bincount(withdrawn - first, np.repeat(votes, cells.counts[support]))
            table[first : last + 1] -= given
            weights[support] = 0.0
            table[best] = 0.0  # rounding, or points at the border of the support, may have left votes
    return sides


def peak_near(points: StripePoints, u_mid: float, slope: float, v_mid: float) -> HoughPeak | None:
    """Return the line through the stripe points near a line, as a peak; None where they have too few votes.

    Its votes are those of points that are as close as those of one cell of the accumulator.

    Args:
        points: Marked points of one image.
        u_mid: Column of the line at row ``v_mid`` [px].
        slope: Its du/dv.
        v_mid: Row [px].
    """
    marked = points.marked
    vote, (theta, half_width) = _weight(marked), _directions(marked.slopes, marked.slope_std)
    for reach_px in (_FOLLOWED_PX, _SUPPORT_PX):
        distance = (marked.columns - u_mid - slope * (marked.rows - v_mid)) / math.hypot(1.0, slope)
        along = np.abs(theta - math.degrees(math.atan(-slope))) <= half_width
        support = np.flatnonzero((np.abs(distance) < reach_px) & along & (vote > 0.0))
        if not len(support):
            return None
        rows = marked.rows[support]
        v_mid_new = median(rows)
        found = _line_through(
            marked.columns[support],
            rows - v_mid_new,
            vote[support],
            (u_mid + slope * (v_mid_new - v_mid), slope),
        )
        (u_mid, slope), v_mid = found, v_mid_new
    distance = (marked.columns - u_mid - slope * (marked.rows - v_mid)) / math.hypot(1.0, slope)
    votes = float(vote[support] @ (np.abs(distance[support]) < _RHO_STEP_PX / 2.0))
    if votes <= _MIN_VOTES:
        return None
    return HoughPeak(
        u_mid=u_mid,
        slope=slope,
        v_mid=v_mid,
        votes=votes,
        contrast=median(marked.contrast[support]),
        width_px=median(marked.widths[support]),
        first_row=int(_row_range(rows, vote[support])[0]),
        last_row=points.gradient.shape[0] - 1,
    )


def _weight(marked: MarkedPoints) -> Array:
    """Return the weight (N,) of each point's votes."""
    weight: Array = np.minimum(marked.contrast / _FULL_VOTE_GREY, 1.0) * marked.continuity * marked.counts
    return weight


def _directions(slopes: Array, slope_std: Array) -> tuple[Array, Array]:
    """Return theta (N,) and the half width (N,) of the votes of points [deg].

    Args:
        slopes: (N,) du/dv of their edges.
        slope_std: (N,) standard deviations of these.
    """
    spread = np.degrees(slope_std / (1.0 + slopes**2))
    half_width = np.clip(_VOTE_SIGMAS * spread, _MIN_VOTE_HALF_WIDTH_DEG, _MAX_VOTE_HALF_WIDTH_DEG)
    return np.degrees(np.arctan(-slopes)), half_width


def _strongest(vote: Array) -> Indices:
    """Return the points with the most votes, as many as may vote; of equal ones, the first."""
    if len(vote) <= _MAX_VOTING_POINTS:
        return np.arange(len(vote))
    least = np.partition(vote, -_MAX_VOTING_POINTS)[-_MAX_VOTING_POINTS]
    more, equal = np.flatnonzero(vote > least), np.flatnonzero(vote == least)
    return np.sort(np.concatenate([more, equal[: _MAX_VOTING_POINTS - len(more)]]))


def _line_through(u: Array, v: Array, weights: Array, cell: tuple[float, float]) -> tuple[float, float]:
    """Return u and du/dv at v = 0 of the line through the points of a cell.

    A cell is a degree wide. That is too much in noise, where the edge is measured in long blocks of rows; the
    points give a more accurate direction. No point is farther from the cell than ``_SUPPORT_PX``, which
    bounds the slope.

    Args:
        u: (N,) columns of the points [px].
        v: (N,) their rows [px].
        weights: (N,) their votes.
        cell: u and du/dv at v = 0 of the cell itself.
    """
    share = weights / weights.sum()
    mean_u, mean_v = float(share @ u), float(share @ v)
    spread = float(share @ (v - mean_v) ** 2)
    slope = cell[1]
    if spread <= 0.0:
        return cell
    found = float(share @ ((v - mean_v) * (u - mean_u))) / spread
    reach = 2.0 * _SUPPORT_PX / float(np.ptp(v))
    slope = min(max(found, slope - reach), slope + reach)
    return mean_u - slope * mean_v, slope


def _row_range(rows: Array, weights: Array) -> tuple[float, float]:
    """Return the rows between which nearly all weight lies."""
    order = np.argsort(rows, kind="stable")
    share = np.cumsum(weights[order])
    ends = np.searchsorted(share, share[-1] * np.array([_TAIL_SHARE, 1.0 - _TAIL_SHARE]))
    return float(rows[order[ends[0]]]), float(rows[order[min(ends[1], len(rows) - 1)]])


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells of the accumulator that points vote for, point by point.

    Attributes:
        cells: (M,) cell of each vote.
        counts: (N,) number of votes of each point.
        starts: (N,) index of its first vote.
    """

    cells: Indices
    counts: Indices
    starts: Indices

    def of(self, points: Indices) -> Indices:
        """Return the cells of the votes of some points (K,)."""
        return self.cells[consecutive(self.starts[points], self.counts[points])]


def _cells(u: Array, v: Array, theta: Array, half_width: Array, n_rho: int) -> _Cells:
    """Return the cells that points vote for."""
    nearest = np.rint((theta + _THETA_MAX_DEG) / _THETA_STEP_DEG).astype(np.intp)
    reach = (half_width / _THETA_STEP_DEG).astype(np.intp)
    first = np.maximum(nearest - reach, 0)
    counts = np.maximum(np.minimum(nearest + reach, _N_THETA - 1) - first + 1, 0)
    column = consecutive(first, counts)
    angles = np.radians(np.arange(_N_THETA) * _THETA_STEP_DEG - _THETA_MAX_DEG)
    rho = np.repeat(u / _RHO_STEP_PX, counts)
    rho *= np.cos(angles)[column]
    down = np.repeat(v / _RHO_STEP_PX, counts)
    down *= np.sin(angles)[column]
    rho += down
    column *= n_rho
    column += np.rint(rho, out=rho).astype(np.intp)
    column += n_rho // 2
    return _Cells(column, counts, np.cumsum(counts) - counts)
