"""What the grey values of a block of rows say about the edges of a stripe that crosses them.

In a block, grey values follow

    I(u) = b0 + (p - b0) S(u - u_left) - (p - b1) S(u - u_right)

with asphalt b0 and b1, paint p, and the step response S of pixel and lens; the whole is multiplied by
a ramp along the row, for a lens gets darker towards the corners. Levels and ramp are nuisances of the
block, eliminated by variable projection (Golub and Pereyra, "The differentiation of pseudo-inverses and
nonlinear least squares problems whose variables separate", SIAM J. Numer. Anal. 10, 1973). What is left
says by least squares how far both edges are off, and the blur, and with what information: little where
the contrast is little, so that dash gaps and worn paint drop out by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.statistics import upper_median
from ..types import Array, Image
from .edge_response import StepResponse, runs_of

# Rows that share their grey levels. Fewer know the levels of a noisy image worse, more reach over the
# ends of dashes; between 4 and 24 the error on rendered roads changes by less than a tenth.
BLOCK_ROWS = 8
MIN_CONTRAST_SIGMAS = 4.0

_ROUNDING_VARIANCE = 1.0 / 12.0  # of whole grey levels
_RIDGE = 1e-6
RAMP_PX = 10.0  # unit of the ramp: about a window, so that all terms are of one size
# How far the ramp may be from the expected one: a lens that loses 30 % of its light in the corners, 400 px
# from the middle, gets darker by up to 0.15 % a pixel there. It keeps noise from being taken for a ramp.
_RAMP_STD = 0.015
_N_LEVELS, _N_TERMS = 3, 11


@dataclass(frozen=True, slots=True, eq=False)
class RowBlocks:
    """What the blocks of rows say, shape (2 cameras, L stripes, N blocks, ...).

    Attributes:
        information: (..., 3, 3) of the displacements of left edge, right edge [px] and of the blur's
            standard deviation [px], for noise of variance 1.
        gradient: (..., 3) information times displacement.
        displacement: (..., 3).
        variance: Of the grey values about the model, the median over the blocks.
        usable: (...) whether both edges stand out of the noise.
        ramp_sigmas: (...) by how many standard deviations, its own and those of lenses, the ramp is steeper
            than expected: by more than three where it stands for an edge that is not there.
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
        """Return what the blocks say of the ramp alone, levels and displacements eliminated.

        Returns:
            (..., 2) information on its steepness, and that times its difference from the one expected, for
            noise of variance 1.
        """
        others = np.array([0, 1, 2, 4, 5, 6])
        cross = self.normal[..., others, 3, None]
        within = self.normal[..., others[:, None], others]
        ridge = _RIDGE * (np.trace(within, axis1=-1, axis2=-2)[..., None, None] + 1.0)
        solved = np.linalg.solve(
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
        slopes: (2, L, 2) columns the edges move a row.
        rows: (N, R) rows of the blocks [px].
        blur: (2,) standard deviation of the blur of either lens [px].
        window: Half width of the window around each edge [px], and blur added to the model [px].
        noise: Variance of the grey values, as far as it is known.
        steepness: (2, L, N) expected steepness of the ramp in each block [per RAMP_PX].
    """
    half_width, added_blur = window
    slant = 1.0 + slopes**2
    variance = slant * (blur**2)[:, None, None] + added_blur**2
    by_blur = 2.0 * slant * blur[:, None, None]  # d(variance) / d(blur) = 2 blur (1 + slope^2)
    response = StepResponse(slopes.ravel(), variance.ravel(), 2 * half_width + 1)
    edges = np.arange(slopes.size).reshape(slopes.shape)
    # One camera after the other: what one needs fits the processor's cache.
    each = [
        _products(image, columns[i], rows, half_width, (response, edges[i], by_blur[i]))
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
    """Return the products of a block's terms and grey values, for one camera.

    Args:
        image: (H, W) uint8.
        columns: (L stripes, 2 edges, N, R) predicted columns of the edges [px].
        rows: (N, R) rows of the blocks [px].
        half_width: Of the window around each edge [px].
        edges: What is known of them: their response, which of its tables each has, (L, 2), and the derivative
            of its variance by the lens's blur, (L, 2).

    Returns:
        gram (L, N, 11, 11) as :func:`_eliminate` has it, pixels (L, N), and whether the block lies inside of
        the image (L, N).
    """
    n_stripes, _, n_blocks, n_rows = columns.shape
    response, tables, by_blur = edges
    width = image.shape[1]
    n_run = 2 * half_width + 1
    n_pixels = n_rows * 2 * n_run
    # Both windows of a row side by side: (stripe, block, row, 2 windows[, pixel]).
    of_edges = np.moveaxis(columns, 1, -1)
    middles = np.rint(of_edges)
    first = middles - half_width
    reach = np.arange(n_run)
    inside = (middles[..., 0] >= half_width) & (middles[..., 1] < width - half_width)
    index = np.clip(first, 0, width - n_run).astype(np.intp)
    index += (rows * width)[..., None]
    # (edge, stripe, block, row, 2 windows): of either edge both windows.
    found = response.at(first - np.moveaxis(of_edges, -1, 0)[..., None], tables.T[..., None, None, None])
    share, density, bend = (part.reshape(2, n_stripes, n_blocks, n_pixels) for part in found)
    terms = np.empty((n_stripes, n_blocks, _N_TERMS, n_pixels))
    np.subtract(1.0, share[0], out=terms[..., 0, :])  # of asphalt, paint, asphalt
    np.subtract(share[0], share[1], out=terms[..., 1, :])
    terms[..., 2, :] = share[1]
    ramp = ((first - of_edges.mean(axis=-1, keepdims=True)) * (1.0 / RAMP_PX))[..., None] + reach / RAMP_PX
    np.multiply(terms[..., :3, :], ramp.reshape(n_stripes, n_blocks, 1, n_pixels), out=terms[..., 3:6, :])
    terms[..., 6:8, :] = np.moveaxis(density, 0, -2)
    np.multiply(np.moveaxis(bend, 0, -2), by_blur[:, None, :, None], out=terms[..., 8:10, :])
    terms[..., 10, :] = runs_of(image.ravel(), n_run)[index].reshape(n_stripes, n_blocks, n_pixels)
    # A narrow stripe's windows overlap; each pixel counts once.
    valid = np.ones((*of_edges.shape, n_run), dtype=bool)
    valid[..., 1, :] = reach > middles[..., :1] + half_width - first[..., 1:]
    valid_pixels = valid.reshape(n_stripes, n_blocks, 1, n_pixels)
    # Two arrays: the product of one with itself numpy computes as a symmetric one, slower for small ones.
    gram = (terms * valid_pixels) @ np.swapaxes(terms, -1, -2)
    return gram, valid_pixels.sum(axis=(-1, -2)), inside.all(axis=-1)


def _eliminate(
    gram: Array, count: Array, complete: npt.NDArray[np.bool_], noise: float, steepness: Array
) -> RowBlocks:
    """Eliminate the grey levels of every block from its normal equations.

    Args:
        gram: (..., 11, 11) products of the terms: three levels, their ramps, slopes of both edges, change of
            both by blur, grey value.
        count: (...) pixels.
        complete: (...) whether the block lies inside the image.
        noise: Variance of the grey values, as far as it is known.
        steepness: (...) expected steepness of the ramp.
    """
    n = _N_LEVELS
    levels = np.linalg.solve(gram[..., :n, :n] + np.eye(n) * _RIDGE, gram[..., :n, 10:])[..., 0]
    left, right = levels[..., 1] - levels[..., 0], levels[..., 1] - levels[..., 2]
    # Three levels, steepness of the ramp; displacement of the left edge, of the right edge, change of
    # blur; grey value: as mixtures of the terms.
    mix = np.zeros((*gram.shape[:-2], _N_TERMS, 8))
    mix[..., [0, 1, 2, 10], [0, 1, 2, 7]] = 1.0
    mix[..., 3:6, 3] = levels
    mix[..., 3:6, 7] = -steepness[..., None] * levels
    mix[..., 6, 4], mix[..., 7, 5] = -left, right
    mix[..., 8, 6], mix[..., 9, 6] = left, -right
    normal = np.swapaxes(mix, -1, -2) @ gram @ mix
    by_levels = normal[..., :4, :4] + np.diag([_RIDGE, _RIDGE, _RIDGE, _RIDGE + noise / _RAMP_STD**2])
    inverse = np.linalg.inv(by_levels)
    rest = normal[..., 4:, 4:] - np.swapaxes(normal[..., :4, 4:], -1, -2) @ inverse @ normal[..., :4, 4:]
    information, gradient, squares = rest[..., :3, :3], rest[..., :3, 3], rest[..., 3, 3]
    trace = np.trace(information, axis1=-1, axis2=-2)[..., None, None]
    displacement = np.linalg.solve(information + np.eye(3) * (_RIDGE * trace + 1e-9), gradient[..., None])[
        ..., 0
    ]
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
    """What the edges are off after the fit, (2 cameras, L stripes, ...).

    Attributes:
        displacement: (2, L, N, 2 edges) measured minus predicted column [px].
        blocks: Information and whether the block shows both edges.
        columns: (2, L, 2, N) predicted columns [px].
        slopes: (2, L, 2) columns the edges move a row.
        rows: (N,) rows [px].
    """

    displacement: Array
    blocks: RowBlocks
    columns: Array
    slopes: Array
    rows: Array
