"""Refinement: a maximum-likelihood fit of the stripes' grey values in both images at once.

The genetic algorithm compares lines that were fitted to one edge of each stripe. Here one road
(pose, yaw, position and width of both stripes) predicts both edges of both stripes in both
images, and is fitted to the grey values around them by Gauss-Newton.

Grey levels are nuisances of each block of rows, eliminated by variable projection (Golub and
Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
separate", SIAM J. Numer. Anal. 10, 1973). In a block, grey values follow

    I(u) = b0 + (p - b0) S(u - u_left) - (p - b1) S(u - u_right)

with asphalt b0 and b1, paint p, and the step response S of pixel and lens; the whole is multiplied by
a ramp along the row, for a lens gets darker towards the corners. Linearised about the
predicted edges and blur, a block says by least squares how far its edges are off, and with what
information: little where the contrast is little, so that dash gaps and worn paint drop out by
themselves. These displacements are linear in the parameters of the road.

The step response of a box-shaped pixel on a slanted edge behind a Gaussian lens is taken as an
integrated Gaussian of the same variance: as symmetric as the true one, so edges are not shifted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .extraction import Image, edge_response
from .extrinsics import Array, Extrinsics
from .pattern import LanePattern, row_towards
from .rig import StereoRig
from .road import lane_in_road, predict_edges

# Parameters of the road: height, pitch, roll, yaw of the lane, middle of stripe 1 and 2, width of
# stripe 1 and 2 [m, rad]; after them the blur of the left and the right lens [px].
_STEPS = np.array([1e-5, 1e-6, 1e-6, 1e-6, 1e-5, 1e-5, 1e-5, 1e-5])
_N_ROAD = len(_STEPS)
_N_ALL = _N_ROAD + 2
# Passes: half width of the window around each edge [px], and blur added to the template [px]: the
# first bears edges 3 px off (a width that is 10 % wrong), the last ones are the fit itself.
_PASSES = ((6, 2.0), (5, 0.5), (5, 0.0), (5, 0.0))

# Rows that share their grey levels. Fewer know the levels of a noisy image worse, more reach over the
# ends of dashes; between 4 and 24 the error on rendered roads changes by less than a tenth.
_BLOCK_ROWS = 8
_MIN_BLOCKS = 12  # of four stripe images, 10 parameters: 36 displacements at least
_MIN_CONTRAST_SIGMAS = 4.0
# First row, as the height over the bottom of the image relative to the vanishing point: closer to it
# stripes are thinner than a pixel and every road is a hill or a bend.
_FIRST_ROW = 0.97

_PIXEL_VARIANCE = 1.0 / 12.0  # of a box one pixel wide [px^2]
_BLUR_START_PX, _BLUR_MIN_PX, _BLUR_MAX_PX = 0.5, 0.05, 3.0

# Tukey's biweight on the deviance of a block: zero beyond 4^2 times its scale.
_TUKEY_DEVIANCE = 16.0
_REWEIGHTINGS = 5
_MEDIAN_CHI2_3 = 2.366  # of the chi-squared distribution with three degrees of freedom
_RIDGE = 1e-6
_RAMP_PX = 10.0  # unit of the ramp: about a window, so that all terms are of one size
# Expected steepness: a lens that loses 30 % of its light in the corners, 400 px from the middle, gets
# darker by up to 0.15 % a pixel there. It keeps noise from being taken for a ramp.
_RAMP_STD = 0.015

# Stripe widths tried at the start [m].
_WIDTHS_M = np.linspace(0.04, 0.70, 67)

# Normal integral on a grid fine enough for linear interpolation to 1e-6.
_GRID = np.linspace(-6.0, 6.0, 4801)
_DENSITY = np.exp(-0.5 * _GRID**2) / np.sqrt(2.0 * np.pi)
_INTEGRAL = np.concatenate([[0.0], np.cumsum((_DENSITY[1:] + _DENSITY[:-1]) / 2.0) * (_GRID[1] - _GRID[0])])


@dataclass(frozen=True, slots=True, eq=False)
class RefinedFit:
    """Outcome of the refinement.

    Attributes:
        extrinsics: Height, pitch and roll.
        covariance: (3, 3) of them: inverse information, times the scale of the residuals.
        lane_yaw_rad: Yaw of the camera against the lane [rad].
        positions_m: (2,) middle of the stripes at x = 0, left positive [m].
        widths_m: (2,) width of the stripes [m].
        blur_px: (2,) standard deviation of the blur of the left and right lens [px].
        noise_grey: Standard deviation of the grey values about the model.
        scale: Deviance of a block over what the noise explains; 1 where the model is the road.
        n_blocks: Blocks of rows that count.
    """

    extrinsics: Extrinsics
    covariance: Array
    lane_yaw_rad: float
    positions_m: Array
    widths_m: Array
    blur_px: Array
    noise_grey: float
    scale: float
    n_blocks: int


def refine(
    images: tuple[Image, Image], pattern: LanePattern, rig: StereoRig, start: Extrinsics
) -> RefinedFit | None:
    """Fit the road to the grey values around the edges of the stripes.

    Args:
        images: Left and right image, (H, W) uint8.
        pattern: The matched lines, for yaw and position of the stripes.
        rig: Intrinsics and baseline.
        start: Extrinsics to start from, good to a few pixels in the image.

    Returns:
        The fit, or None when too few blocks of rows show both edges of a stripe, or the fit runs away.
    """
    yaw, *left_edges = lane_in_road(pattern, rig, start)
    widths = _start_widths(images, pattern, rig, start)
    road = np.array([*start.as_array(), yaw, *(np.array(left_edges) - widths / 2.0), *widths])
    blur = np.full(2, _BLUR_START_PX)
    noise = 0.0  # not known before the first pass
    first = row_towards(pattern.vanishing_point, _FIRST_ROW, rig)
    n_blocks = (rig.height - int(np.ceil(first))) // _BLOCK_ROWS
    if n_blocks < _MIN_BLOCKS // 4:
        return None
    rows = np.arange(rig.height - n_blocks * _BLOCK_ROWS, rig.height)
    for half_width, added_blur in _PASSES:
        variations = np.concatenate([road[None], road + np.diag(_STEPS), road - np.diag(_STEPS)])
        edges = predict_edges(variations, rig)
        by_road = (edges[1 : _N_ROAD + 1] - edges[_N_ROAD + 1 :]) / (2.0 * _STEPS).reshape(-1, 1, 1, 1, 1)
        blocks = _measure_blocks(images, edges[0], blur, rows, half_width, added_blur, noise)
        noise = blocks.variance
        solution = _solve(blocks, by_road, rows)
        if solution is None:
            return None
        step, covariance, scale, used = solution
        road = road + step[:_N_ROAD]
        # Far from the road its blur cannot be known, but must be free: else a camera that is sharper
        # or softer than supposed is taken for an outlier.
        if added_blur == 0.0:
            blur = np.clip(blur + step[_N_ROAD:], _BLUR_MIN_PX, _BLUR_MAX_PX)
        if not np.all(np.isfinite(road)) or road[0] <= 0.0 or np.any(road[6:8] <= 0.0):
            return None
    return RefinedFit(
        extrinsics=Extrinsics.from_array(road[:3]),
        covariance=(covariance[:3, :3] + covariance[:3, :3].T) / 2.0,
        lane_yaw_rad=float(road[3]),
        positions_m=road[4:6],
        widths_m=road[6:8],
        blur_px=blur,
        noise_grey=float(np.sqrt(blocks.variance)),
        scale=scale,
        n_blocks=used,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """What the blocks of rows say, shape (2 cameras, 2 stripes, N blocks, ...).

    Attributes:
        information: (..., 3, 3) of the displacements of left edge, right edge [px] and blur [px], for
            noise of variance 1.
        gradient: (..., 3) information times displacement.
        displacement: (..., 3).
        variance: Of the grey values about the model, the median over the blocks.
        usable: (...) whether both edges stand out of the noise.
    """

    information: Array
    gradient: Array
    displacement: Array
    variance: float
    usable: npt.NDArray[np.bool_]


def _measure_blocks(
    images: tuple[Image, Image],
    edges: Array,
    blur: Array,
    rows: npt.NDArray[np.intp],
    half_width: int,
    added_blur: float,
    noise: float,
) -> _Blocks:
    """Fit levels, displacements and blur of every block of rows."""
    n_blocks = len(rows) // _BLOCK_ROWS
    columns = edges[..., :1] + edges[..., 1:] * rows  # (camera, stripe, edge, row)
    slant = 1.0 + edges[..., 1] ** 2
    sigma = np.sqrt(slant * (_PIXEL_VARIANCE + blur[:, None, None] ** 2) + added_blur**2)
    nearest = np.rint(columns).astype(np.intp)
    window = np.arange(-half_width, half_width + 1)
    pixels = nearest[..., None] + window
    width = images[0].shape[1]
    inside = (nearest[:, :, 0] >= half_width) & (nearest[:, :, 1] < width - half_width)
    # A narrow stripe's windows overlap; each pixel counts once.
    valid = np.broadcast_to(inside[:, :, None, :, None], pixels.shape).copy()
    valid[:, :, 1] &= pixels[:, :, 1] > nearest[:, :, 0, :, None] + half_width
    grey = np.stack(
        [
            image[rows[:, None], np.clip(of_camera, 0, width - 1)]
            for image, of_camera in zip(images, pixels, strict=True)
        ]
    )
    # Both windows of a row side by side: (camera, stripe, row, pixel).
    pixels, valid, grey = (np.moveaxis(a, 2, 3).reshape(2, 2, len(rows), -1) for a in (pixels, valid, grey))
    steps, densities, by_blur = [], [], []
    for edge in range(2):
        scale = sigma[:, :, edge, None, None]
        t = (pixels - columns[:, :, edge, :, None]) / scale
        density = np.exp(-0.5 * t * t) / (np.sqrt(2.0 * np.pi) * scale)
        steps.append(np.interp(t, _GRID, _INTEGRAL))
        densities.append(density)
        by_blur.append(-t * density * (slant[:, :, edge] * blur[:, None])[..., None, None] / scale)
    shares = [1.0 - steps[0], steps[0] - steps[1], steps[1]]  # of asphalt, paint, asphalt
    middle = columns.mean(axis=2)[..., None]
    ramp = (pixels - middle) / _RAMP_PX
    ramps = [share * ramp for share in shares]
    terms = np.stack([*shares, *ramps, *densities, *by_blur, grey.astype(np.float64)], axis=-1)
    terms *= valid[..., None]
    terms = terms.reshape(2, 2, n_blocks, -1, terms.shape[-1])
    gram = np.swapaxes(terms, -1, -2) @ terms
    count = valid.reshape(2, 2, n_blocks, -1).sum(axis=-1)
    complete = inside.reshape(2, 2, n_blocks, _BLOCK_ROWS).all(axis=-1)
    return _eliminate(gram, count, complete, noise)


def _eliminate(gram: Array, count: Array, complete: npt.NDArray[np.bool_], noise: float) -> _Blocks:
    """Eliminate the grey levels of every block from its normal equations.

    Args:
        gram: (..., 11, 11) products of the terms: three levels, their ramps, slopes of both edges, change of
            both by blur, grey value.
        count: (...) pixels.
        complete: (...) whether the block lies inside the image.
        noise: Variance of the grey values, as far as it is known.
    """
    levels = np.linalg.solve(gram[..., :3, :3] + np.eye(3) * _RIDGE, gram[..., :3, 10:])[..., 0]
    left, right = levels[..., 1] - levels[..., 0], levels[..., 1] - levels[..., 2]
    # Three levels, steepness of the ramp; displacement of the left edge, of the right edge, change of
    # blur; grey value: as mixtures of the terms.
    mix = np.zeros((*gram.shape[:-2], 11, 8))
    mix[..., [0, 1, 2, 10], [0, 1, 2, 7]] = 1.0
    mix[..., 3:6, 3] = levels
    mix[..., 6, 4], mix[..., 7, 5] = -left, right
    mix[..., 8, 6], mix[..., 9, 6] = left, -right
    normal = np.swapaxes(mix, -1, -2) @ gram @ mix
    by_levels = normal[..., :4, :4] + np.diag([_RIDGE, _RIDGE, _RIDGE, _RIDGE + noise / _RAMP_STD**2])
    eliminated = np.linalg.solve(by_levels, normal[..., :4, 4:])
    rest = normal[..., 4:, 4:] - np.swapaxes(normal[..., :4, 4:], -1, -2) @ eliminated
    information, gradient, squares = rest[..., :3, :3], rest[..., :3, 3], rest[..., 3, 3]
    trace = np.trace(information, axis1=-1, axis2=-2)[..., None, None]
    displacement = np.linalg.solve(information + np.eye(3) * (_RIDGE * trace + 1e-9), gradient[..., None])[
        ..., 0
    ]
    freedom = count - 7
    usable = complete & (freedom > 0)
    unexplained = squares - np.einsum("...i,...i", gradient, displacement)
    variance = float(np.median(unexplained[usable] / freedom[usable])) if usable.any() else 0.0
    variance = max(variance, _PIXEL_VARIANCE)  # rounding to whole grey levels
    level_variance = np.diagonal(np.linalg.inv(by_levels), axis1=-1, axis2=-2) * variance
    for contrast, side in ((left, 0), (right, 2)):
        usable &= contrast > _MIN_CONTRAST_SIGMAS * np.sqrt(
            level_variance[..., 1] + level_variance[..., side]
        )
    return _Blocks(information, gradient, displacement, variance, usable)


def _solve(
    blocks: _Blocks, by_road: Array, rows: npt.NDArray[np.intp]
) -> tuple[Array, Array, float, int] | None:
    """Solve for the change of all parameters, block by block weighted robustly.

    Returns:
        step (10,), covariance (10, 10), scale of the deviances, blocks used; None when undetermined.
    """
    if np.count_nonzero(blocks.usable) < _MIN_BLOCKS:
        return None
    middles = rows.reshape(-1, _BLOCK_ROWS).mean(axis=1)
    # Displacements (left edge, right edge, blur) by all parameters: (camera, stripe, block, 3, 10).
    design = np.zeros((*blocks.gradient.shape, _N_ALL))
    at_block = by_road[..., :1] + by_road[..., 1:] * middles
    design[..., :2, :_N_ROAD] = np.moveaxis(at_block, (0, 3), (-1, -2))
    for camera in range(2):
        design[camera, ..., 2, _N_ROAD + camera] = 1.0
    weighted = np.swapaxes(design, -1, -2) @ blocks.information
    normals = (weighted @ design)[blocks.usable]
    sides = np.einsum("...ij,...i->...j", design, blocks.gradient)[blocks.usable]
    information, displacement = blocks.information[blocks.usable], blocks.displacement[blocks.usable]
    design = design[blocks.usable]
    weights = np.ones(len(sides))
    # A camera that the template fits worse (its lens is sharper or softer) has larger deviances in all
    # of its blocks: they weigh less, but are no outliers.
    of_camera = np.nonzero(blocks.usable)[0]
    scales = np.ones(2)
    step: Array = np.zeros(_N_ALL)
    for _ in range(_REWEIGHTINGS):
        normal = np.tensordot(weights, normals, axes=1)
        if not np.all(np.isfinite(normal)) or np.linalg.matrix_rank(normal, hermitian=True) < len(normal):
            return None
        step = np.asarray(np.linalg.solve(normal, weights @ sides), dtype=np.float64)
        residual = displacement - design @ step
        deviance = np.einsum("bi,bij,bj->b", residual, information, residual) / blocks.variance
        for i in np.unique(of_camera):
            scales[i] = max(1.0, float(np.median(deviance[of_camera == i])) / _MEDIAN_CHI2_3)
        relative = deviance / scales[of_camera]
        weights = np.clip(1.0 - relative / _TUKEY_DEVIANCE, 0.0, None) ** 2 / scales[of_camera]
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64) * blocks.variance
    scale = float(scales.mean())
    return step, covariance, scale, int(np.count_nonzero(weights))


def _start_widths(
    images: tuple[Image, Image], pattern: LanePattern, rig: StereoRig, start: Extrinsics
) -> Array:
    """Return the widths of both stripes [m] that put their right edges on falling grey values."""
    horizon = float(pattern.vanishing_point[1])
    rows = np.arange(int(horizon) + 2 * _BLOCK_ROWS, rig.height, 2)
    px_per_m = (rows - horizon) / start.height_m * rig.fx / rig.fy
    score = np.zeros((2, len(_WIDTHS_M)))
    for image, lines in zip(images, (pattern.left, pattern.right), strict=True):
        gradient = edge_response(image, 1)
        for stripe, line in enumerate(lines):
            left = line.column_at(rows.astype(np.float64))[:, None]
            columns = np.rint(left + px_per_m[:, None] * _WIDTHS_M).astype(np.intp)
            seen = (columns > 0) & (columns < rig.width - 1) & (left > 0)
            falling = -gradient[rows[:, None], np.clip(columns, 0, rig.width - 1)]
            score[stripe] += np.where(seen, falling, 0.0).sum(axis=0)
    widths: Array = _WIDTHS_M[np.argmax(score, axis=1)]
    return widths
