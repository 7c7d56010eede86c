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

"""Displacements of the cells of a road against the plane under which both images were sampled.

The differences of grey values, over their slope along the row, give the displacement of each cell (Lucas and
Kanade, IJCAI 1981). Noise that is independent in the two cameras is not mistaken for texture. The information
of a cell is the product of the gradients in the left and in the right image, and noise alone gives it a mean
of zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..road.cell_grid import SampleGrid
from ..types import Array, Floats

# OpenCV interpolates at multiples of 1 / 32 px. This is an error of 0.009 px for one sample, and of so much
# for a cell of hundreds of samples.
_FINEST_PX = 1e-3
_STEP_LIMIT_PX = 2.0  # most displacement of a cell in one pass; beyond, the gradient is not valid

_ABS_OF_SIGMA = 0.798  # mean absolute value of a Gaussian, sqrt(2 / pi)
_CELL_SIGMAS = 3.0  # least significance of a cell's texture: one cell in 700 without texture reaches it
_LEAST_SEGMENTS = 3
_ROUNDING = 1.0 / 12.0  # variance of rounding to whole grey levels: it turns a smooth shade into steps
# Sum of the squared autocorrelation, at whole pixels, of the derivative of noise, per pixel of its blur. So
# many samples count as one. For samples farther apart, the number is an upper bound.
_CORRELATED_SAMPLES = 1.88


@dataclass(frozen=True, slots=True, eq=False)
class CellDisplacements:
    """Displacements of the cells against the plane under which both images were sampled.

    Attributes:
        displacement: (C,) disparity minus that of the plane [px].
        variance: (C,) variance of the displacement caused by the noise [px^2].
        significant: (C,) whether the cell has significant texture.
        sigmas: Texture over its standard error, for all cells together.
        weights: (N,) robust weights of the samples.
    """

    displacement: Array
    variance: Array
    significant: npt.NDArray[np.bool_]
    sigmas: float
    weights: Floats


def measure_displacements(
    grey: tuple[Floats, Floats],
    slopes: tuple[Floats, Floats],
    usable: Floats,
    grid: SampleGrid,
    blur_px: float,
) -> CellDisplacements:
    """Fit the displacement of every cell; the samples are weighted robustly.

    Args:
        grey: Grey values of the samples in the left and in the right image, (N,) each.
        slopes: Their derivatives along the row [1/px], (N,) each.
        usable: (N,) 1 for samples that can be used, 0 for the others.
        grid: The samples.
        blur_px: Standard deviation of the blur along the row [px].
    """
    sums, cells = grid.segment_sums, grid.cell_sums
    count = np.maximum(sums(usable), 1e-6)
    gain = np.float32(_gain(*grey, usable, count, grid))
    difference = grey[0] * gain - grey[1] / gain
    slope_left, slope_right = slopes[0] * gain, slopes[1] / gain
    residuals = (difference - grid.to_samples(sums(usable * difference) / count)) * usable
    per_cell = np.maximum(cells(count), 1.0)
    scale = np.maximum(cells(sums(np.abs(residuals))) / per_cell / _ABS_OF_SIGMA, 0.1)
    relative = residuals * grid.to_samples(grid.to_segments(1.0 / (TUKEY_SIGMAS * scale)))
    weights = tukey_weights(relative * relative)
    weights *= usable
    # Sums over a segment, with the means removed. The slope is the mean of the slopes in both images.
    total = np.maximum(sums(weights), 1e-6)
    w_left, w_right = weights * slope_left, weights * slope_right
    s_left, s_right, s_difference = sums(w_left), sums(w_right), sums(weights * difference)
    gradient = (s_left + s_right) * s_difference / total - sums((w_left + w_right) * difference)
    gradient /= 2.0
    common = sums(w_left * slope_right) - s_left * s_right / total
    of_left = sums(w_left * slope_left) - s_left**2 / total
    of_right = sums(w_right * slope_right) - s_right**2 / total
    information = (of_left + 2.0 * common + of_right) / 4.0
    # For noise alone, the sum of the products of gradients has a mean of zero and this variance.
    alone = np.clip(of_left * of_right, 0.0, None) * (_CORRELATED_SAMPLES * blur_px) / total
    in_cell, spread = cells(common), np.sqrt(cells(alone))
    significant = (in_cell > _CELL_SIGMAS * spread) & (grid.cell_lengths >= _LEAST_SEGMENTS)
    rounding = _ROUNDING / (4.0 * np.sqrt(np.pi) * blur_px**3)  # variance of its derivative, blurred
    significant &= in_cell > rounding * cells(total)
    safe = np.where(significant, in_cell, 1.0)
    displacement = np.clip(cells(gradient) / safe, -_STEP_LIMIT_PX, _STEP_LIMIT_PX)
    misfit = cells((gradient - common * grid.to_segments(displacement)) ** 2)
    promised = np.maximum(scale**2 * cells(information), 1e-9)
    # Neighbouring samples are correlated by blur and road; one factor for all cells accounts for that.
    ratio = misfit[significant] / promised[significant]
    inflation = float(np.mean(ratio)) if ratio.size else 1.0
    sigmas = float((in_cell / scale**2).sum() / max(np.sqrt((spread**2 / scale**4).sum()), 1e-12))
    variance = inflation * promised / safe**2 + _FINEST_PX**2
    return CellDisplacements(displacement, variance, significant, sigmas, weights)


def _gain(left: Floats, right: Floats, usable: Floats, count: Array, grid: SampleGrid) -> float:
    """Return the root of the ratio of contrasts, right over left: the factor that equalises both images."""
    spreads = []
    for grey in (left, right):
        weighted = usable * grey
        squares = grid.segment_sums(weighted * grey) - grid.segment_sums(weighted) ** 2 / count
        spreads.append(max(float(squares.sum()), 1e-6))
    return float(np.clip((spreads[1] / spreads[0]) ** 0.25, 0.5, 2.0))


def correlation(left: Floats, right: Floats, weights: Floats, grid: SampleGrid) -> float:
    """Return the correlation of both images over all cells; the means of the segments are removed.

    Args:
        left: (N,) grey values of the samples in the left image.
        right: (N,) those in the right image.
        weights: (N,) of the samples.
        grid: The samples.
    """
    sums = grid.segment_sums
    total = np.maximum(sums(weights), 1e-6)
    w_left, w_right = weights * left, weights * right
    s_left, s_right = sums(w_left), sums(w_right)
    both = (sums(w_left * right) - s_left * s_right / total).sum()
    squares = (sums(w_left * left) - s_left**2 / total).sum() * (
        sums(w_right * right) - s_right**2 / total
    ).sum()
    return float(both / np.sqrt(squares + 1e-6))
