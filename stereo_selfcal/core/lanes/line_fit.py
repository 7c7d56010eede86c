"""Straight lines fitted to a fraction of a pixel, from the peaks of the Hough transform.

The edge is measured in blocks of rows along the line, and a straight line is fitted robustly to the
measurements.
"""

from __future__ import annotations

import math

import numpy as np

from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..rejection import Bound, NotFitted
from ..types import Array
from .hough import HoughPeak
from .lane_pair import ImageLine
from .stripe_points import Response

# Half width of the search for the edge [px] in the passes of a fit: first the Hough cell (4 px and
# 1 degree over the length of the line), then around the fitted line.
_COARSE_HALF_WIDTHS_PX = (7, 4)
_FINE_HALF_WIDTHS_PX = (3,)
# A block has as many rows as make the contrast of its edge this many standard deviations of the noise.
_BLOCK_SIGMAS = 6.0
_BLOCK_ROWS_MIN, _BLOCK_ROWS_MAX = 4, 24
_BLOCK_ROWS_CLEAN = 8  # up to this, a line has a stripe point in nearly every row it is seen in
_MIN_PEAK_SIGMAS = 3.5  # one false peak in 2000 blocks
_MIN_BLOCKS = 5  # two parameters, and three more to estimate the scatter of the residuals
_REWEIGHTING = Reweighting(rounds=40, settled=1e-3)
_SINGULAR = 1e-12  # ratio to the product of its factors: all points lie in one row
_MIN_RESIDUAL_PX = 0.005  # rounding to 8 bits moves an edge of contrast 100 by this
_SCALE = scale_by_median(_MIN_RESIDUAL_PX)


def fit_line(response: Response, peak: HoughPeak, noise: float) -> ImageLine | None:
    """Fit a straight line to the left edge of a stripe.

    Args:
        response: (H, W) gradient of the image by the paper's kernel [-1 0 1].
        peak: Peak of the Hough transform: the start of the fit.
        noise: Standard deviation of the image noise [grey levels].

    Returns:
        The line, or None when too little of it can be measured.
    """
    start = (peak.u_mid, peak.slope, peak.v_mid)
    rows = (peak.first_row, peak.last_row + 1)
    if _block_rows(noise, peak.contrast) > _BLOCK_ROWS_CLEAN:
        rows = (0, response.shape[0])  # in noise, a line may have no stripe points in some rows
    return _fit(response, start, noise, rows, _COARSE_HALF_WIDTHS_PX, peak.width_px, peak.contrast)


def refit_line(response: Response, line: ImageLine, noise: float, first_row: float) -> ImageLine | None:
    """Fit a line again, close to it and only below ``first_row``, as nothing above it is road."""
    start = (line.u_mid, line.slope, line.v_mid)
    rows = (max(0, math.ceil(first_row)), response.shape[0])
    return _fit(response, start, noise, rows, _FINE_HALF_WIDTHS_PX, line.width_px, line.contrast)


def _fit(
    response: Response,
    start: tuple[float, float, float],
    noise: float,
    between: tuple[int, int],
    half_widths: tuple[int, ...],
    width_px: float,
    contrast: float,
) -> ImageLine | None:
    """Measure the edge along a line and fit a line to it; where that fails in noise, with longer blocks."""
    n_rows = _block_rows(noise, contrast)
    for rows in (n_rows, _BLOCK_ROWS_MAX):
        line = _fit_blocks(response, start, noise, between, half_widths, width_px, contrast, rows)
        if line is not None or n_rows == _BLOCK_ROWS_MIN:
            return line
    return None


def _block_rows(noise: float, contrast: float) -> int:
    """Return the rows of a block for a contrast of ``_BLOCK_SIGMAS`` standard deviations of its noise."""
    rows = (_BLOCK_SIGMAS * noise * math.sqrt(2.0) / contrast) ** 2
    return round(min(max(rows, _BLOCK_ROWS_MIN), _BLOCK_ROWS_MAX))


def _fit_blocks(
    response: Response,
    start: tuple[float, float, float],
    noise: float,
    between: tuple[int, int],
    half_widths: tuple[int, ...],
    width_px: float,
    contrast: float,
    n_rows: int,
) -> ImageLine | None:
    """Measure the edge in blocks of ``n_rows`` and fit a line to it, in one pass per half width."""
    u_mid, slope, v_mid = start
    for half_width in half_widths:
        rows, offsets, strength = _measure(
            response, (u_mid, slope, v_mid), n_rows, half_width, noise, between
        )
        if len(rows) < _MIN_BLOCKS:
            return None
        columns = u_mid + slope * (rows - v_mid) + offsets
        v_mid = float(rows.mean())
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


def _measure(
    response: Response,
    line: tuple[float, float, float],
    n_rows: int,
    half_width: int,
    noise: float,
    between: tuple[int, int],
) -> tuple[Array, Array, Array]:
    """Measure the edge in blocks of rows, each averaged along the line.

    Returns:
        Of each of M blocks that show an edge: rows (M,) of its middle [px], offsets (M,) of the edge from the
        line [px], and weights (M,), which are inverse variances up to a common factor.
    """
    u_mid, slope, v_mid = line
    width = response.shape[1]
    rows = np.arange(*between)
    columns = u_mid + slope * (rows - v_mid)
    inside = (columns > half_width + 1) & (columns < width - half_width - 3)
    rows, columns = rows[inside], columns[inside]
    n_blocks = len(rows) // n_rows
    if n_blocks < _MIN_BLOCKS:
        empty = np.empty(0)
        return empty, empty, empty
    # The blocks begin at the nearest row; remaining rows are dropped at the far end.
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
    has_peak = here > _MIN_PEAK_SIGMAS * noise * math.sqrt(2.0 / n_rows)
    middles = rows.reshape(n_blocks, n_rows).mean(axis=1)
    # The noise of a parabola's vertex is proportional to the inverse of its curvature.
    weights = (-curvature / 255.0) ** 2
    return middles[has_peak], offsets[has_peak].astype(np.float64), weights[has_peak].astype(np.float64)


def _robust_line(v: Array, u: Array, weights: Array) -> tuple[tuple[float, float], Array, Array] | None:
    """Fit u = a + b v by iteratively reweighted least squares with Tukey's biweight.

    Returns:
        (a, b), their covariance (2, 2), and the robust weights 0 ... 1; None when too few agree.
    """
    relative = weights / weights.mean()
    root = np.sqrt(relative)
    # Normal equations of two parameters, written out: this runs for every line of every frame.
    products = relative * np.stack([np.ones(len(v)), v, v * v, u, v * u])
    rows, columns = root * np.stack([np.ones(len(v)), v]), root * u

    def fit(robust: Array, _: object) -> tuple[tuple[float, float, Array], Array] | NotFitted:
        sums = products @ robust
        s0, s1, s2, t0, t1 = sums.tolist()
        determinant = s0 * s2 - s1 * s1
        if determinant <= _SINGULAR * s0 * s2:
            spread = determinant / (s0 * s2) if s0 * s2 > 0.0 else 0.0
            return NotFitted("spread of the rows", spread, Bound.LEAST, _SINGULAR)
        a, b = (s2 * t0 - s1 * t1) / determinant, (s0 * t1 - s1 * t0) / determinant
        # Residuals in units of a point of mean weight.
        return (a, b, sums), columns - np.array([a, b]) @ rows

    found = fit_reweighted(fit, len(v), _REWEIGHTING, _SCALE)
    if isinstance(found, NotFitted) or np.count_nonzero(found.weights) < _MIN_BLOCKS:
        return None
    a, b, (s0, s1, s2, *_) = found.solution
    inverse = np.array([[s2, -s1], [-s1, s0]]) / (s0 * s2 - s1 * s1)
    return (a, b), found.scale**2 * inverse, found.weights
