"""Straight lines through stripe points: Hough transform, then a sub-pixel fit (paper section 2.2).

The accumulator is the paper's: rho = u cos(theta) + v sin(theta) about the image centre, rho of
either sign, so that left and right lane boundaries differ in the sign of theta. Its cells (1 degree, 4
px) only say where to look. The accuracy comes from the fit that follows: the edge is measured in
blocks of rows along the line, and a straight line is fitted robustly to the measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .extraction import Response, StripePoints
from .extrinsics import Array
from .pattern import ImageLine

_THETA_STEP_DEG = 1.0
# A row-wise gradient sees no line flatter than this; it also bounds du/dv to +-5.7.
_THETA_MAX_DEG = 80.0
_N_THETA = int(2 * _THETA_MAX_DEG / _THETA_STEP_DEG) + 1
_RHO_STEP_PX = 4.0

# A point votes only for slopes near that of its own edge: within three standard deviations of
# the measured direction, but at least within this, for a direction from 3 x 3 pixels of a
# stripe a few pixels wide is that much off by its other edge (measured on rendered lines).
_MIN_VOTE_HALF_WIDTH_DEG = 8.0
_MAX_VOTE_HALF_WIDTH_DEG = 40.0  # half the accumulator: beyond, a point says nothing
_VOTE_SIGMAS = 3.0

# Contrast beyond this makes no better line: a quarter of the grey levels (the paper's stripes
# have 123), so that fresh paint in the sun does not outvote a worn line of twice the length.
_FULL_VOTE_GREY = 64.0

# The strongest points of an image that vote; a lane line has at most one in each row and filter,
# so this leaves room for several lines besides clutter, and bounds the time on foliage.
_MAX_VOTING_POINTS = 6000

# Peaks kept for each sign of theta: own lane, neighbours' lanes, kerbs, shadows.
PEAKS_PER_SIGN = 10
# Lines with fewer votes are not looked at: a worn line (10 grey levels) of half the length of the
# strongest has a tenth of its votes, and 40 rows of it have 5.
_MIN_VOTE_SHARE = 0.04
_MIN_VOTES = 2.0
# Points this close to a peak are taken to be its line, and their votes are withdrawn before the
# next peak is looked for: the half diagonal of a cell over the length of a line.
_SUPPORT_PX = 6.0

# Half width of the search for the edge [px] in the passes of a fit: first the Hough cell (4 px and
# 1 degree over the length of the line), then around the fitted line.
_COARSE_HALF_WIDTHS_PX = (7, 4)
_FINE_HALF_WIDTHS_PX = (3,)
# A block of rows has as many as bring its edge to this many standard deviations over the noise.
_BLOCK_SIGMAS = 6.0
_BLOCK_ROWS_MIN, _BLOCK_ROWS_MAX = 4, 24
_MIN_PEAK_SIGMAS = 3.5  # one false peak in 2000 blocks
_TUKEY = 4.685  # 95 % efficiency for normal residuals (Huber, Robust Statistics)
_MIN_BLOCKS = 5  # two parameters, and enough left to estimate the residuals' spread
_MAX_ITERATIONS, _SETTLED = 40, 1e-3  # of the reweighting, change of the residuals' spread
_SINGULAR = 1e-12  # all points in one row
_SIGMA_OVER_MAD = 1.4826
_MIN_RESIDUAL_PX = 0.005  # rounding to 8 bits moves an edge of contrast 100 by this


@dataclass(frozen=True, slots=True)
class HoughPeak:
    """A cell of the accumulator: ``u(v) = u_mid + slope * (v - v_mid)``, and its votes."""

    u_mid: float
    slope: float
    v_mid: float
    votes: float
    contrast: float
    width_px: float


def hough_peaks(points: StripePoints, shape: tuple[int, int]) -> tuple[list[HoughPeak], list[HoughPeak]]:
    """Return the strongest lines of either sign of theta, strongest first.

    Args:
        points: Marked points of one image.
        shape: (H, W) of the image.

    Returns:
        Lines that run to the left going down (theta > 0: left lane boundaries), and to the right.
    """
    centre_u, centre_v = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    vote = np.minimum(points.contrast / _FULL_VOTE_GREY, 1.0) * points.continuity * points.counts
    strongest = np.argsort(-vote, kind="stable")[:_MAX_VOTING_POINTS]
    u, v = points.columns[strongest] - centre_u, points.rows[strongest] - centre_v
    theta = np.degrees(np.arctan(-points.slopes[strongest]))
    spread = np.degrees(points.slope_std[strongest] / (1.0 + points.slopes[strongest] ** 2))
    half_width = np.clip(_VOTE_SIGMAS * spread, _MIN_VOTE_HALF_WIDTH_DEG, _MAX_VOTE_HALF_WIDTH_DEG)
    n_rho = 2 * math.ceil(math.hypot(*shape) / 2 / _RHO_STEP_PX) + 3
    cells, owner = _cells(u, v, theta, half_width, n_rho)
    weights = vote[strongest]
    table = np.bincount(cells, weights[owner], minlength=_N_THETA * n_rho)

    sides: tuple[list[HoughPeak], list[HoughPeak]] = ([], [])
    middle = _N_THETA // 2
    regions = (slice((middle + 1) * n_rho, _N_THETA * n_rho), slice(0, middle * n_rho))
    strongest_votes = float(table.max(initial=0.0))
    for peaks, region in zip(sides, regions, strict=True):
        for _ in range(PEAKS_PER_SIGN):
            best = region.start + int(np.argmax(table[region]))
            if table[best] <= max(_MIN_VOTES, _MIN_VOTE_SHARE * strongest_votes):
                break
            angle = math.radians(best // n_rho * _THETA_STEP_DEG - _THETA_MAX_DEG)
            rho = (best % n_rho - n_rho // 2) * _RHO_STEP_PX
            support = np.abs(u * math.cos(angle) + v * math.sin(angle) - rho) < _SUPPORT_PX
            support &= weights > 0.0
            support &= np.abs(theta - math.degrees(angle)) <= half_width
            if not support.any():
                table[best] = 0.0
                continue
            chosen = strongest[support]
            v_mid = float(np.median(v[support]))
            u_mid, slope = _line_through(
                u[support],
                v[support] - v_mid,
                weights[support],
                ((rho - v_mid * math.sin(angle)) / math.cos(angle), -math.tan(angle)),
            )
            peaks.append(
                HoughPeak(
                    u_mid=u_mid + centre_u,
                    slope=slope,
                    v_mid=v_mid + centre_v,
                    votes=float(table[best]),
                    contrast=float(np.median(points.contrast[chosen])),
                    width_px=float(np.median(points.widths[chosen])),
                )
            )
            withdrawn = support[owner]
            table -= np.bincount(cells[withdrawn], weights[owner[withdrawn]], minlength=table.size)
            weights[support] = 0.0
            table[best] = 0.0  # what rounding left, or points on the rim of the support
    return sides


def _line_through(u: Array, v: Array, weights: Array, cell: tuple[float, float]) -> tuple[float, float]:
    """Return u and du/dv at v = 0 of the line through the points of a cell, (u, du/dv) of the cell itself.

    A cell is a degree wide: too much in noise, where the blocks of rows the edge is measured in must be
    long, and the points know better. No point is further from the cell than it may be, which bounds the
    slope.
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


def _cells(
    u: Array, v: Array, theta: Array, half_width: Array, n_rho: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the cells that get votes, (M,), and which point each vote is of, (M,)."""
    nearest = np.rint((theta + _THETA_MAX_DEG) / _THETA_STEP_DEG).astype(np.intp)
    reach = (half_width / _THETA_STEP_DEG).astype(np.intp)
    n_votes = 2 * reach + 1
    owner = np.repeat(np.arange(len(u)), n_votes)
    first = np.cumsum(n_votes) - n_votes
    column = nearest[owner] - reach[owner] + np.arange(len(owner)) - first[owner]
    inside = (column >= 0) & (column < _N_THETA)
    column, owner = column[inside], owner[inside]
    angles = np.radians(np.arange(_N_THETA) * _THETA_STEP_DEG - _THETA_MAX_DEG)
    rho = u[owner] * np.cos(angles)[column] + v[owner] * np.sin(angles)[column]
    return column * n_rho + np.rint(rho / _RHO_STEP_PX).astype(np.intp) + n_rho // 2, owner


def fit_line(response: Response, peak: HoughPeak, noise: float) -> ImageLine | None:
    """Fit a straight line to the left edge of a stripe.

    Args:
        response: (H, W) gradient of the image by the paper's kernel [-1 0 1].
        peak: Where to look.
        noise: Standard deviation of the image noise [grey levels].

    Returns:
        The line, or None when too little of it can be measured.
    """
    start = (peak.u_mid, peak.slope, peak.v_mid)
    return _fit(response, start, noise, 0, _COARSE_HALF_WIDTHS_PX, peak.width_px, peak.contrast)


def refit_line(response: Response, line: ImageLine, noise: float, first_row: float) -> ImageLine | None:
    """Fit a line again, close by and below ``first_row`` only: nothing above is road."""
    start = (line.u_mid, line.slope, line.v_mid)
    row = max(0, math.ceil(first_row))
    return _fit(response, start, noise, row, _FINE_HALF_WIDTHS_PX, line.width_px, line.contrast)


def _fit(
    response: Response,
    start: tuple[float, float, float],
    noise: float,
    first_row: int,
    half_widths: tuple[int, ...],
    width_px: float,
    contrast: float,
) -> ImageLine | None:
    """Measure the edge along a line and fit a line to it; in longer blocks where that fails in noise."""
    sigmas = _BLOCK_SIGMAS * noise * math.sqrt(2.0) / contrast
    n_rows = round(np.clip(sigmas**2, _BLOCK_ROWS_MIN, _BLOCK_ROWS_MAX))
    for rows in (n_rows, _BLOCK_ROWS_MAX):
        line = _fit_blocks(response, start, noise, first_row, half_widths, width_px, contrast, rows)
        if line is not None or n_rows == _BLOCK_ROWS_MIN:
            return line
    return None


def _fit_blocks(
    response: Response,
    start: tuple[float, float, float],
    noise: float,
    first_row: int,
    half_widths: tuple[int, ...],
    width_px: float,
    contrast: float,
    n_rows: int,
) -> ImageLine | None:
    """Measure the edge in blocks of ``n_rows`` and fit a line to it, in one pass per half width."""
    u_mid, slope, v_mid = start
    for half_width in half_widths:
        rows, offsets, strength = _measure(
            response, (u_mid, slope, v_mid), n_rows, half_width, noise, first_row
        )
        if len(rows) < _MIN_BLOCKS:
            return None
        columns = u_mid + slope * (rows - v_mid) + offsets
        v_mid = float(np.average(rows, weights=strength))
        fitted = _robust_line(rows - v_mid, columns, strength)
        if fitted is None:
            return None
        (u_mid, slope), covariance, robust = fitted
    keep = robust > 0.0
    used = strength[keep] * robust[keep]
    return ImageLine(
        u_mid=u_mid,
        slope=slope,
        v_mid=v_mid,
        covariance=covariance,
        rows=rows[keep],
        columns=columns[keep],
        weights=used / used.mean(),
        n_rows=n_rows * int(np.count_nonzero(keep)),
        width_px=width_px,
        contrast=contrast,
    )


def _median(values: Array) -> float:
    """Return the upper median; np.median spends more time on its checks than on 60 values."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def _measure(
    response: Response,
    line: tuple[float, float, float],
    n_rows: int,
    half_width: int,
    noise: float,
    first_row: int,
) -> tuple[Array, Array, Array]:
    """Measure the edge in blocks of rows, each averaged along the line.

    Returns:
        rows (M,) middle of each block that shows an edge, offsets (M,) of the edge from the line [px],
        weights (M,) inverse variances up to a common factor.
    """
    u_mid, slope, v_mid = line
    height, width = response.shape
    rows = np.arange(first_row, height)
    columns = u_mid + slope * (rows - v_mid)
    inside = (columns > half_width + 1) & (columns < width - half_width - 3)
    rows, columns = rows[inside], columns[inside]
    n_blocks = len(rows) // n_rows
    if n_blocks < _MIN_BLOCKS:
        empty = np.empty(0)
        return empty, empty, empty
    # The nearest rows fill whole blocks; what is left over is at the far end.
    rows, columns = rows[-n_blocks * n_rows :], columns[-n_blocks * n_rows :]
    floor = np.floor(columns).astype(np.intp)
    part = (columns - floor).astype(np.float32)[:, None]
    window = np.arange(-half_width, half_width + 2)
    values = response[rows[:, None], floor[:, None] + window]
    strip = values[:, :-1] * (1 - part) + values[:, 1:] * part
    profile = strip.reshape(n_blocks, n_rows, -1).mean(axis=1)

    best = np.argmax(profile[:, 1:-1], axis=1) + 1
    block = np.arange(n_blocks)
    before, here, after = (profile[block, best + shift] for shift in (-1, 0, 1))
    curvature = np.minimum(before - 2 * here + after, -1e-6)
    offsets = best - half_width + 0.5 * (before - after) / curvature
    seen = here > _MIN_PEAK_SIGMAS * noise * math.sqrt(2.0 / n_rows)
    middles = rows.reshape(n_blocks, n_rows).mean(axis=1)
    # The noise of a parabola's vertex goes with the inverse of its curvature.
    weights = (-curvature / 255.0) ** 2
    return middles[seen], offsets[seen].astype(np.float64), weights[seen].astype(np.float64)


def _robust_line(v: Array, u: Array, weights: Array) -> tuple[tuple[float, float], Array, Array] | None:
    """Fit u = a + b v by iteratively reweighted least squares with Tukey's biweight.

    Returns:
        (a, b), their covariance (2, 2), and the robust weights 0 ... 1; None when too few agree.
    """
    relative = weights / weights.mean()
    root = np.sqrt(relative)
    robust = np.ones_like(v)
    scale = 0.0
    for _ in range(_MAX_ITERATIONS):
        used = relative * robust
        # Normal equations of two parameters, written out: this runs for every line of every frame.
        s0, s1, s2 = float(used.sum()), float(used @ v), float(used @ (v * v))
        t0, t1 = float(used @ u), float(used @ (v * u))
        determinant = s0 * s2 - s1 * s1
        if determinant <= _SINGULAR * s0 * s2:
            return None
        a, b = (s2 * t0 - s1 * t1) / determinant, (s0 * t1 - s1 * t0) / determinant
        # Residuals in units of a point of mean weight.
        residual = (u - a - b * v) * root
        previous, scale = scale, max(_MIN_RESIDUAL_PX, _SIGMA_OVER_MAD * _median(np.abs(residual)))
        robust = np.clip(1.0 - (residual / (_TUKEY * scale)) ** 2, 0.0, None) ** 2
        if abs(scale - previous) <= _SETTLED * scale:
            break
    if np.count_nonzero(robust) < _MIN_BLOCKS:
        return None
    covariance = scale**2 / determinant * np.array([[s2, -s1], [-s1, s0]])
    return (a, b), covariance, robust
