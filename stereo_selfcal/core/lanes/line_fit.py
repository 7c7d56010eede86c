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

"""Straight lines fitted to a fraction of a pixel, from the peaks of the Hough transform.

The edge is measured in blocks of rows along the line, and a straight line is fitted robustly to the
measurements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..numerics.ragged import consecutive
from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..numerics.statistics import SIGMA_OVER_MAD
from ..types import Array, Indices, Mask
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
_ROUNDS, _SETTLED = 40, 1e-3  # of reweighting; the scale has settled where it changes by at most this part
_SINGULAR = 1e-12  # ratio to the product of its factors: all points lie in one row
_MIN_RESIDUAL_PX = 0.005  # rounding to 8 bits moves an edge of contrast 100 by this


@dataclass(frozen=True, slots=True)
class _Start:
    """Where the fit of a line starts, and in which rows: the line and its stripe, as of :class:`ImageLine`.

    Attributes:
        between: First row, and the one after the last.
    """

    u_mid: float
    slope: float
    v_mid: float
    between: tuple[int, int]
    width_px: float
    contrast: float


def fit_line(response: Response, peak: HoughPeak, noise: float) -> ImageLine | None:
    """Fit a straight line to the left edge of a stripe; arguments are those of :func:`fit_lines`."""
    return fit_lines(response, [peak], noise)[0]


def fit_lines(response: Response, peaks: Sequence[HoughPeak], noise: float) -> list[ImageLine | None]:
    """Fit straight lines to the left edges of stripes, all at once.

    Args:
        response: (H, W) gradient of the image by the paper's kernel [-1 0 1].
        peaks: Peaks of the Hough transform: the starts of the fits.
        noise: Standard deviation of the image noise [grey levels].

    Returns:
        Each line, or None where too little of it can be measured.
    """
    starts = []
    for peak in peaks:
        rows = (peak.first_row, peak.last_row + 1)
        if _block_rows(noise, peak.contrast) > _BLOCK_ROWS_CLEAN:
            rows = (0, response.shape[0])  # in noise, a line may have no stripe points in some rows
        starts.append(_Start(peak.u_mid, peak.slope, peak.v_mid, rows, peak.width_px, peak.contrast))
    return _fit(response, starts, noise, _COARSE_HALF_WIDTHS_PX)


def refit_line(response: Response, line: ImageLine, noise: float, first_row: float) -> ImageLine | None:
    """Fit a line again; arguments are those of :func:`refit_lines`."""
    return refit_lines(response, [line], noise, [first_row])[0]


def refit_lines(
    response: Response, lines: Sequence[ImageLine], noise: float, first_rows: Sequence[float]
) -> list[ImageLine | None]:
    """Fit lines again, close to them and only below a row of each, as nothing above it is road.

    Args:
        response: (H, W) gradient of the image by the paper's kernel.
        lines: The lines.
        noise: Standard deviation of the image noise [grey levels].
        first_rows: The row of each line [px].

    Returns:
        Each line, or None where too little of it can be measured.
    """
    last = response.shape[0]
    starts = [
        _Start(
            line.u_mid,
            line.slope,
            line.v_mid,
            (max(0, math.ceil(first)), last),
            line.width_px,
            line.contrast,
        )
        for line, first in zip(lines, first_rows, strict=True)
    ]
    return _fit(response, starts, noise, _FINE_HALF_WIDTHS_PX)


def _fit(
    response: Response, starts: Sequence[_Start], noise: float, half_widths: tuple[int, ...]
) -> list[ImageLine | None]:
    """Measure edges along lines and fit lines to them; where that fails in noise, with longer blocks."""
    n_rows = [_block_rows(noise, start.contrast) for start in starts]
    lines = _fit_blocks(response, starts, n_rows, noise, half_widths)
    again = [
        index
        for index, (line, rows) in enumerate(zip(lines, n_rows, strict=True))
        if line is None and _BLOCK_ROWS_MIN < rows < _BLOCK_ROWS_MAX
    ]
    longer = _fit_blocks(
        response, [starts[index] for index in again], [_BLOCK_ROWS_MAX] * len(again), noise, half_widths
    )
    for index, line in zip(again, longer, strict=True):
        lines[index] = line
    return lines


def _block_rows(noise: float, contrast: float) -> int:
    """Return the rows of a block for a contrast of ``_BLOCK_SIGMAS`` standard deviations of its noise."""
    rows = (_BLOCK_SIGMAS * noise * math.sqrt(2.0) / contrast) ** 2
    return round(min(max(rows, _BLOCK_ROWS_MIN), _BLOCK_ROWS_MAX))


def _fit_blocks(
    response: Response,
    starts: Sequence[_Start],
    n_rows: Sequence[int],
    noise: float,
    half_widths: tuple[int, ...],
) -> list[ImageLine | None]:
    """Measure the edges in blocks of ``n_rows`` and fit lines to them, in one pass per half width."""
    found: list[ImageLine | None] = [None] * len(starts)
    lines = np.array([[start.u_mid, start.slope, start.v_mid] for start in starts]).reshape(-1, 3)
    between = np.array([start.between for start in starts], np.intp).reshape(-1, 2)
    rows_of_block = np.array(n_rows, np.intp)
    which = np.arange(len(starts))  # lines that can be measured so far
    for half_width in half_widths:
        blocks = _measure(response, lines[which], rows_of_block[which], half_width, noise, between[which])
        enough = blocks.counts >= _MIN_BLOCKS
        which, blocks = which[enough], blocks.of_lines(enough)
        if not len(which):
            return found
        columns = blocks.offsets + lines[which, :1] + lines[which, 1:2] * (blocks.rows - lines[which, 2:])
        v_mid = (blocks.rows * blocks.valid).sum(axis=1) / blocks.counts
        fits = _robust_lines(blocks.rows - v_mid[:, None], columns, blocks.weights, blocks.valid)
        lines[which] = np.column_stack([fits.at_mid, fits.slope, v_mid])
        which, blocks, columns, fits = (
            which[fits.good],
            blocks.of_lines(fits.good),
            columns[fits.good],
            fits.of_lines(fits.good),
        )
    for index, one in enumerate(which.tolist()):
        keep = fits.robust[index] > 0.0
        used = blocks.weights[index, keep] * fits.robust[index, keep]
        u_mid, slope, v = lines[one].tolist()
        found[one] = ImageLine(
            u_mid=u_mid,
            slope=slope,
            v_mid=v,
            covariance=fits.covariance[index],
            rows=blocks.rows[index, keep],
            columns=columns[index, keep],
            weights=used / used.mean(),
            n_rows=n_rows[one] * int(np.count_nonzero(keep)),
            width_px=starts[one].width_px,
            contrast=starts[one].contrast,
        )
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Blocks of rows that show an edge: of each of L lines, up to M.

    Attributes:
        rows: (L, M) rows of their middles [px].
        offsets: (L, M) offsets of the edge from the line [px].
        weights: (L, M) inverse variances of these up to a common factor; 0 beyond the blocks of a line.
        valid: (L, M) whether these are blocks of the line.
        counts: (L,) number of blocks.
    """

    rows: Array
    offsets: Array
    weights: Array
    valid: Mask
    counts: Indices

    def of_lines(self, which: Mask) -> _Blocks:
        """Return the blocks of some lines (L,)."""
        if which.all():
            return self
        return _Blocks(
            self.rows[which], self.offsets[which], self.weights[which], self.valid[which], self.counts[which]
        )


def _measure(
    response: Response, lines: Array, n_rows: Indices, half_width: int, noise: float, between: Indices
) -> _Blocks:
    """Measure the edges in blocks of rows, each averaged along its line.

    Args:
        response: (H, W) gradient of the image.
        lines: (L, 3) column at the middle row, slope, and middle row.
        n_rows: (L,) rows of a block.
        half_width: Half width of the search around the line [px].
        noise: Standard deviation of the image noise [grey levels].
        between: (L, 2) first row, and the one after the last.
    """
    width, n_lines = response.shape[1], len(lines)
    n_all = np.maximum(between[:, 1] - between[:, 0], 0)
    line = np.repeat(np.arange(n_lines), n_all)
    rows = consecutive(between[:, 0], n_all)
    columns = lines[line, 0] + lines[line, 1] * (rows - lines[line, 2])
    inside = (columns > half_width + 1) & (columns < width - half_width - 3)
    count = np.bincount(line[inside], minlength=n_lines)
    n_blocks = count // n_rows
    n_blocks[n_blocks < _MIN_BLOCKS] = 0
    # The blocks begin at the nearest row; remaining rows are dropped at the far end.
    used = n_blocks * n_rows
    chosen = np.flatnonzero(inside)[consecutive(np.cumsum(count) - used, used)]
    rows, columns = rows[chosen], columns[chosen]
    line, length = np.repeat(np.arange(n_lines), n_blocks), np.repeat(n_rows, n_blocks)
    if not len(line):
        return _padded(line, n_lines, np.empty((3, 0)))
    floor = columns.astype(np.intp)
    part = (columns - floor).astype(np.float32)[:, None]
    window = np.arange(-half_width, half_width + 2)
    values = response.ravel().take((rows * width + floor)[:, None] + window)
    strip = values[:, :-1] * (1 - part) + values[:, 1:] * part
    first = np.cumsum(length) - length
    profile = np.add.reduceat(strip, first, axis=0)
    profile /= length.astype(np.float32)[:, None]

    best = np.argmax(profile[:, 1:-1], axis=1) + 1
    at = best + np.arange(len(profile)) * profile.shape[1]
    before, here, after = (profile.ravel().take(at + shift) for shift in (-1, 0, 1))
    curvature = np.minimum(before - 2 * here + after, -1e-6)
    offsets = best - half_width + 0.5 * (before - after) / curvature
    has_peak = here > _MIN_PEAK_SIGMAS * noise * np.sqrt(2.0 / length)
    middles = rows[first] + (length - 1) / 2.0
    # The noise of a parabola's vertex is proportional to the inverse of its curvature.
    weights = (-curvature / 255.0) ** 2
    measured = np.array([middles[has_peak], offsets[has_peak], weights[has_peak]])
    return _padded(line[has_peak], n_lines, measured)


def _padded(line: Indices, n_lines: int, measured: Array) -> _Blocks:
    """Return the measurements (3, B) of blocks, given the line (B,) of each, in order."""
    counts = np.bincount(line, minlength=n_lines)
    most = int(counts.max(initial=0))
    valid = np.arange(most) < counts[:, None]
    padded = np.zeros((3, n_lines, most))
    padded[:, valid] = measured
    return _Blocks(padded[0], padded[1], padded[2], valid, counts)


@dataclass(frozen=True, slots=True, eq=False)
class _RobustLines:
    """Fits of straight lines u = at_mid + slope v.

    Attributes:
        at_mid: (L,) u at v = 0.
        slope: (L,) du/dv.
        covariance: (L, 2, 2) of both.
        robust: (L, M) weights 0 ... 1.
        good: (L,) whether enough points agree.
    """

    at_mid: Array
    slope: Array
    covariance: Array
    robust: Array
    good: Mask

    def of_lines(self, which: Mask) -> _RobustLines:
        """Return the fits of some lines (L,)."""
        if which.all():
            return self
        return _RobustLines(
            self.at_mid[which],
            self.slope[which],
            self.covariance[which],
            self.robust[which],
            self.good[which],
        )


def _robust_lines(v: Array, u: Array, weights: Array, valid: Mask) -> _RobustLines:
    """Fit lines by iteratively reweighted least squares with Tukey's biweight, each until it has settled.

    Args:
        v: (L, M) rows.
        u: (L, M) columns.
        weights: (L, M) inverse variances up to a common factor.
        valid: (L, M) which of these are points of the line.
    """
    n, counts = len(v), np.count_nonzero(valid, axis=1)
    relative = weights * (counts / weights.sum(axis=1))[:, None]
    root = np.sqrt(relative)
    # Normal equations of two parameters, written out: this runs for every line of every frame.
    by_row, by_column = relative * v, relative * u
    products = np.stack([relative, by_row, by_row * v, by_column, by_column * v], axis=1)
    # Residuals in units of a point of mean weight, which are zero where there is no point.
    model = np.stack([root * u, -root, -root * v], axis=1)
    beyond = np.where(valid, 0.0, np.inf)
    robust, of_lines = np.zeros(v.shape), np.zeros((n, 7))  # of the lines that have settled
    active, middle = np.arange(n), np.arange(n) * v.shape[1] + counts // 2
    own, scale = np.ones(v.shape), np.full(n, np.inf)
    coefficients = np.ones((n, 1, 3))
    for i in range(_ROUNDS):
        sums = (products @ own[:, :, None])[:, :, 0]
        s0, s1, s2, t0, t1 = sums.T
        determinant = s0 * s2 - s1 * s1
        solved = determinant > _SINGULAR * s0 * s2
        safe = np.where(solved, determinant, 1.0)
        a, b = (s2 * t0 - s1 * t1) / safe, (s0 * t1 - s1 * t0) / safe
        coefficients[:, 0, 1], coefficients[:, 0, 2] = a, b
        residuals = (coefficients @ model)[:, 0]
        absolute = np.abs(residuals)
        absolute += beyond
        absolute.sort(axis=1)
        before, scale = scale, SIGMA_OVER_MAD * absolute.ravel().take(middle)
        np.maximum(scale, _MIN_RESIDUAL_PX, out=scale)
        residuals /= (TUKEY_SIGMAS * scale)[:, None]
        residuals *= residuals
        own = tukey_weights(residuals)
        # A scale of infinity before the first round is never near to the first one.
        ended = ~solved | (np.abs(scale - before) <= _SETTLED * scale)
        if i == _ROUNDS - 1:
            ended[:] = True
        if ended.any():
            done = active[ended]
            robust[done] = own[ended]
            of_lines[done] = np.column_stack([a, b, scale, sums[:, :3], solved])[ended]
            more = ~ended
            active = active[more]
            if not len(active):
                break
            own, scale, products, model, beyond, coefficients = (
                each[more] for each in (own, scale, products, model, beyond, coefficients)
            )
            middle = np.arange(len(active)) * v.shape[1] + counts[active] // 2
    robust *= valid
    a, b, scales, s0, s1, s2, solved = of_lines.T
    good = (solved > 0.0) & (np.count_nonzero(robust, axis=1) >= _MIN_BLOCKS)
    inverse = np.array([[s2, -s1], [-s1, s0]]) * (scales**2 / np.where(good, s0 * s2 - s1 * s1, 1.0))
    return _RobustLines(a, b, np.moveaxis(inverse, 2, 0), robust, good)
