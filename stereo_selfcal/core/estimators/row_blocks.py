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

"""Displacements of a stripe's edges from the grey values of a block of rows that the stripe crosses.

In a block, grey values follow

    I(u) = b0 + (p - b0) S(u - u_left) - (p - b1) S(u - u_right)

with the road surface b0 and b1, the paint p, and the step response S of pixel and lens. The model is
multiplied by a ramp along the row, because a lens gets darker towards the corners. Levels and ramp are
nuisances of the block. They are eliminated by variable projection (Golub and Pereyra, "The differentiation of
pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM J. Numer. Anal. 10,
1973). The reduced normal equations give the displacements of both edges and the change of the blur, with
their information. The information is small where the contrast is small, so that dash gaps and worn paint get
little weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.linear import invert_each, solve_each
from ..numerics.statistics import upper_median
from ..types import Array, Image
from .edge_response import StepResponse, runs_of

# Rows that share their grey levels. Smaller blocks measure the levels of a noisy image worse; larger ones
# reach over the ends of dashes. Between 4 and 24 rows, the error on rendered roads changes by less than a
# tenth.
BLOCK_ROWS = 8
MIN_CONTRAST_SIGMAS = 4.0

_ROUNDING_VARIANCE = 1.0 / 12.0  # variance of rounding to whole grey levels
_RIDGE = 1e-6
RAMP_PX = 10.0  # unit of the ramp: about one window, so that all terms have similar sizes
# Standard deviation of the ramp about the expected one [per RAMP_PX]. A lens that loses 30 % of its light in
# the corners, 400 px from the middle, gets darker by up to 0.15 % per pixel there. The prior keeps noise from
# being fitted as a ramp.
_RAMP_STD = 0.015
_N_LEVELS, _N_TERMS = 3, 11


@dataclass(frozen=True, slots=True, eq=False)
class RowBlocks:
    """Measurements of the blocks of rows, shape (2 cameras, L stripes, N blocks, ...).

    The three displacements of a block are those of the left edge [px], of the right edge [px] and of the
    blur's standard deviation [px].

    Attributes:
        information: (..., 3, 3) of the displacements, for noise of variance 1.
        gradient: (..., 3) information times displacement.
        displacement: (..., 3) displacements.
        variance: Median over the blocks of the variance of the grey values about the model.
        usable: (...) whether both edges are significant against the noise.
        ramp_sigmas: (...) steepness of the ramp beyond the expected one, over the sum of its own standard
            deviation and that of lenses. More than three: the ramp replaces an edge that does not exist.
        normal: (..., 8, 8) normal equations of levels, ramp, displacements, blur and grey value.
    """

    information: Array
    gradient: Array
    displacement: Array
    variance: float
    usable: npt.NDArray[np.bool_]
    ramp_sigmas: Array
    normal: Array

    def measure_ramp(self) -> Array:
        """Return the normal equations of the ramp alone, with levels and displacements eliminated.

        Returns:
            (..., 2) information about the steepness, and this information times the difference from the
            expected steepness, for noise of variance 1.
        """
        others = np.array([0, 1, 2, 4, 5, 6])
        cross = self.normal[..., others, 3, None]
        within = self.normal[..., others[:, None], others]
        ridge = _RIDGE * (np.trace(within, axis1=-1, axis2=-2)[..., None, None] + 1.0)
        solved = solve_each(
            within + np.eye(len(others)) * ridge,
            np.concatenate([cross, self.normal[..., others, 7, None]], axis=-1),
        )
        ramp: Array = self.normal[..., 3, [3, 7]] - (np.swapaxes(cross, -1, -2) @ solved)[..., 0, :]
        return ramp


def measure_blocks(
    images: tuple[Image, Image],
    columns: Array,
    slopes: Array,
    rows: npt.NDArray[np.intp],
    blur: Array,
    window: tuple[int, float],
    noise: float,
    steepness: Array,
) -> RowBlocks:
    """Fit levels, displacements and blur of every block of rows.

    Args:
        images: Left and right image, (H, W) uint8.
        columns: (2 cameras, L stripes, 2 edges, N, R) predicted columns of the edges [px].
        slopes: (2, L, 2) columns that the edges move a row.
        rows: (N, R) rows of the blocks [px].
        blur: (2,) standard deviation of the blur of either lens [px].
        window: Half width of the window around each edge [px], and blur added to the model [px].
        noise: Variance of the grey values; 0 where it is not known yet.
        steepness: (2, L, N) expected steepness of the ramp in each block [per RAMP_PX].
    """
    half_width, added_blur = window
    slant = 1.0 + slopes**2
    variance = slant * (blur**2)[:, None, None] + added_blur**2
    jac_variance_blur = 2.0 * slant * blur[:, None, None]  # d(variance) / d(blur) = 2 blur (1 + slope^2)
    response = StepResponse(slopes.ravel(), variance.ravel(), 2 * half_width + 1)
    edges = np.arange(slopes.size).reshape(slopes.shape)
    # The cameras are processed one after the other, because the data of one fit the processor's cache.
    each = [
        _products(image, columns[i], rows, half_width, (response, edges[i], jac_variance_blur[i]))
        for i, image in enumerate(images)
    ]
    gram, count, complete = (np.stack(part) for part in zip(*each, strict=True))
    return _eliminate(gram, count, complete, noise, steepness)


def _products(
    image: Image,
    columns: Array,
    rows: npt.NDArray[np.intp],
    half_width: int,
    edges: tuple[StepResponse, npt.NDArray[np.intp], Array],
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Return the products of the terms and grey values of each block, for one camera.

    Args:
        image: (H, W) uint8.
        columns: (L stripes, 2 edges, N, R) predicted columns of the edges [px].
        rows: (N, R) rows of the blocks [px].
        half_width: Half width of the window around each edge [px].
        edges: The step response, the index (L, 2) of each edge in it, and the derivative (L, 2) of the
            response's variance by the lens's blur [px].

    Returns:
        The products (L, N, 11, 11) that :func:`_eliminate` takes, the number of pixels (L, N), and whether
        the block lies inside the image (L, N).
    """
    n_stripes, _, n_blocks, n_rows = columns.shape
    response, tables, jac_variance_blur = edges
    width = image.shape[1]
    n_run = 2 * half_width + 1
    n_pixels = n_rows * 2 * n_run
    # The two windows of a row are side by side: (stripe, block, row, 2 windows[, pixel]).
    edge_columns = np.moveaxis(columns, 1, -1)
    middles = np.rint(edge_columns)
    first = middles - half_width
    reach = np.arange(n_run)
    inside = (middles[..., 0] >= half_width) & (middles[..., 1] < width - half_width)
    index = np.clip(first, 0, width - n_run).astype(np.intp)
    index += (rows * width)[..., None]
    # The response of either edge in both windows: (edge, stripe, block, row, 2 windows).
    found = response.at(first - np.moveaxis(edge_columns, -1, 0)[..., None], tables.T[..., None, None, None])
    share, density, jac_share_variance = (part.reshape(2, n_stripes, n_blocks, n_pixels) for part in found)
    ramp = (first - edge_columns.mean(axis=-1, keepdims=True)) * (1.0 / RAMP_PX)
    ramp = (ramp[..., None] + reach / RAMP_PX).reshape(n_stripes, n_blocks, 1, n_pixels)
    grey = runs_of(image.ravel(), n_run)[index].reshape(n_stripes, n_blocks, n_pixels)
    # The windows of a narrow stripe overlap; each pixel is counted once.
    valid = np.ones((*edge_columns.shape, n_run), dtype=bool)
    valid[..., 1, :] = reach > middles[..., :1] + half_width - first[..., 1:]
    valid_pixels = valid.reshape(n_stripes, n_blocks, 1, n_pixels)
    gram = np.empty((n_stripes, n_blocks, _N_TERMS, _N_TERMS))
    # One stripe after the other, whose terms fit the processor's cache.
    terms, masked = np.empty((2, n_blocks, _N_TERMS, n_pixels))
    for stripe in range(n_stripes):
        # Shares of the road surface on the left, of the paint, and of the road surface on the right.
        of_left, of_right = share[:, stripe]
        np.subtract(1.0, of_left, out=terms[:, 0])
        np.subtract(of_left, of_right, out=terms[:, 1])
        terms[:, 2] = of_right
        np.multiply(terms[:, :3], ramp[stripe], out=terms[:, 3:6])
        for edge in range(2):
            terms[:, 6 + edge] = density[edge, stripe]
            np.multiply(
                jac_share_variance[edge, stripe], jac_variance_blur[stripe, edge], out=terms[:, 8 + edge]
            )
        terms[:, 10] = grey[stripe]
        # The factors are two arrays. Of one array with itself, numpy computes a symmetric product, which is
        # slower for small matrices.
        np.multiply(terms, valid_pixels[stripe], out=masked)
        np.matmul(masked, np.swapaxes(terms, -1, -2), out=gram[stripe])
    return gram, valid_pixels.sum(axis=(-1, -2)), inside.all(axis=-1)


def _eliminate(
    gram: Array, count: Array, complete: npt.NDArray[np.bool_], noise: float, steepness: Array
) -> RowBlocks:
    """Eliminate the grey levels of every block from its normal equations.

    Args:
        gram: (..., 11, 11) products of the terms: three levels, their ramps, derivatives of both edges by
            their columns, derivatives of both by the blur, grey value.
        count: (...) number of pixels.
        complete: (...) whether the block lies inside the image.
        noise: Variance of the grey values; 0 where it is not known yet.
        steepness: (...) expected steepness of the ramp.
    """
    n = _N_LEVELS
    levels = solve_each(gram[..., :n, :n] + np.eye(n) * _RIDGE, gram[..., :n, 10:])[..., 0]
    left, right = levels[..., 1] - levels[..., 0], levels[..., 1] - levels[..., 2]
    # The unknowns as mixtures of the terms: three levels and the steepness of the ramp; the displacements of
    # the left and the right edge and the change of the blur; the grey value.
    mix = np.zeros((*gram.shape[:-2], _N_TERMS, 8))
    mix[..., [0, 1, 2, 10], [0, 1, 2, 7]] = 1.0
    mix[..., 3:6, 3] = levels
    mix[..., 3:6, 7] = -steepness[..., None] * levels
    mix[..., 6, 4], mix[..., 7, 5] = -left, right
    mix[..., 8, 6], mix[..., 9, 6] = left, -right
    normal = np.swapaxes(mix, -1, -2) @ gram @ mix
    nuisances = normal[..., :4, :4] + np.diag([_RIDGE, _RIDGE, _RIDGE, _RIDGE + noise / _RAMP_STD**2])
    inverse = invert_each(nuisances)
    reduced = normal[..., 4:, 4:] - np.swapaxes(normal[..., :4, 4:], -1, -2) @ inverse @ normal[..., :4, 4:]
    information, gradient, squares = reduced[..., :3, :3], reduced[..., :3, 3], reduced[..., 3, 3]
    trace = np.trace(information, axis1=-1, axis2=-2)[..., None, None]
    displacement = solve_each(information + np.eye(3) * (_RIDGE * trace + 1e-9), gradient[..., None])[..., 0]
    freedom = count - 7
    usable = complete & (freedom > 0)
    unexplained = squares - np.einsum("...i,...i", gradient, displacement)
    variance = upper_median(unexplained[usable] / freedom[usable]) if usable.any() else 0.0
    variance = max(variance, _ROUNDING_VARIANCE)
    level_variance = np.diagonal(inverse, axis1=-1, axis2=-2) * variance
    for contrast, side in ((left, 0), (right, 2)):
        usable &= contrast > MIN_CONTRAST_SIGMAS * np.sqrt(level_variance[..., 1] + level_variance[..., side])
    ramp = (inverse[..., 3, None, :] @ normal[..., :4, 7, None])[..., 0, 0]
    ramp_sigmas = np.abs(ramp) / (_RAMP_STD + np.sqrt(level_variance[..., 3]))
    return RowBlocks(information, gradient, displacement, variance, usable, ramp_sigmas, normal)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeResiduals:
    """Residual displacements of the edges after the fit, (2 cameras, L stripes, ...).

    Attributes:
        displacement: (2, L, N, 2 edges) measured minus predicted column [px].
        blocks: Measurements of the blocks, with their information and whether they show both edges.
        columns: (2, L, 2, N) predicted columns in the middle of the blocks [px].
        slopes: (2, L, 2) columns that the edges move a row.
        rows: (N,) rows of the middles of the blocks [px].
    """

    displacement: Array
    blocks: RowBlocks
    columns: Array
    slopes: Array
    rows: Array
