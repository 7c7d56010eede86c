"""Vertical offset between the images of a pair: zero where they are rectified.

Measured on the road, whose disparity is known once the plane is; the rows of both images are moved against
each other until the grey values agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .corridor import FAR_M, HALF_WIDTH_M, Corridor, Floats, lay_out, plane_of
from .extraction import Image
from .extrinsics import Array, Extrinsics
from .medians import upper_median
from .rig import StereoRig
from .sampling import half_disparity, sample, usable_samples

_BLUR_PX = 1.0
_KERNEL = (9, 9)
_MOST_PX = 4  # searched, in whole rows, to either side: more is seen by the eye
_PASSES = 3
_THINNING = 2
_LEAST_CELLS = 12  # six for each of the two numbers: their scatter is the uncertainty
_LEAST_INFORMATION = 0.2  # of a cell's vertical gradients, what the horizontal ones do not explain
_CELL_SIGMAS = 3.0
_CORRELATED_SAMPLES = (
    4.0  # of noise blurred by 1 px in both directions, 4 pi sigma^2 pixels, of every second pixel
)
_QUANTISATION = 1.0 / 12.0 / 6.0  # variance of a whole grey value, less by the blur
_TUKEY_SIGMAS = 4.685
_REWEIGHTINGS = 8
_SIGMA_OVER_MAD = 1.4826
_RIDGE = 1e-9  # keeps the equations regular where all cells lie below each other


@dataclass(frozen=True, slots=True)
class VerticalOffset:
    """How the rows of both images fit each other.

    Attributes:
        offset_px: Row in the right image minus row in the left one of the same point, at the principal point.
        std_px: Its standard deviation, by the scatter of the cells of the road.
        roll_rad: Turn of the right image against the left one about the optical axis, > 0: to the right the
            rows of the right image fall.
        roll_std_rad: Its standard deviation.
        n_cells: Cells of the road that were used.
    """

    offset_px: float
    std_px: float
    roll_rad: float
    roll_std_rad: float
    n_cells: int


def vertical_offset(
    images: tuple[Image, Image],
    rig: StereoRig,
    extrinsics: Extrinsics,
    lane_yaw_rad: float = 0.0,
    *,
    limits_m: tuple[float, float] = (-HALF_WIDTH_M, HALF_WIDTH_M),
    far_m: float = FAR_M,
) -> VerticalOffset | None:
    """Measure the vertical offset between both images on the road.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        extrinsics: Where the road is, good to about a pixel of disparity.
        lane_yaw_rad: Heading of the camera against the lane.
        limits_m: Right and left limit of the corridor beside the camera [m], left positive.
        far_m: End of the corridor [m].

    Returns:
        The offset, or None where the road has too little texture to measure it.
    """
    plane = plane_of(extrinsics, rig)
    corridor = lay_out(rig, extrinsics, lane_yaw_rad, limits_m, far_m, _THINNING)
    if corridor is None:
        return None
    half = half_disparity(corridor, plane, rig)
    usable = usable_samples(images, corridor, half, rig, None)
    first = max(0, int(corridor.v.min()) - 2 * _MOST_PX)
    left, right = (with_slopes(image[first:]) for image in images)
    v = corridor.v - np.float32(first)
    offset = _search(left, right, corridor, half, v, usable)
    return refine_offset(
        (left, right), corridor, (half, v), usable, rig, (offset, 0.0), _PASSES, _MOST_PX, cv2.INTER_CUBIC
    )


def refine_offset(
    images: tuple[Floats, Floats],
    samples: Corridor,
    place: tuple[Floats, Floats],
    usable: Floats,
    rig: StereoRig,
    start: tuple[float, float],
    passes: int,
    most_px: int,
    how: int,
) -> VerticalOffset | None:
    """Refine an offset and a turn, good to a row or so, by what the cells show.

    Args:
        images: Left and right image with their derivatives (:func:`with_slopes`).
        samples: Where they are compared.
        place: (N,) half the disparity, and row in the images given [px].
        usable: (N,) 1 for samples that count, 0 for others.
        rig: Intrinsics.
        start: Offset [px] and turn [rad].
        passes: How often.
        most_px: An offset twice as great has run away.
        how: Interpolation of OpenCV.

    Returns:
        Offset and turn, or None where too little is seen, or it has run away.
    """
    (left, right), (half, v) = images, place
    offset, turn = start
    columns = samples.cell_rays[:, 1] * -rig.fx
    solution = None
    for _ in range(passes):
        tilt = np.float32(0.5) * (np.float32(offset) + np.float32(turn) * (samples.u - np.float32(rig.cx)))
        of_left = sample(left, samples.u + half, v - tilt, how)
        of_right = sample(right, samples.u - half, v + tilt, how)
        solution = combine_cells(*measure_cells(of_left, of_right, usable, samples), columns)
        if solution is None:
            return None
        offset, turn = offset + solution.offset_px, turn + solution.roll_rad
        if not abs(offset) <= 2.0 * most_px:
            return None
    assert solution is not None
    return VerticalOffset(offset, solution.std_px, turn, solution.roll_std_rad, solution.n_cells)


def with_slopes(image: Image) -> Floats:
    """Return grey value, derivative along the row and along the column of the blurred image, (H, W, 3)."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), _KERNEL, _BLUR_PX)
    along = [cv2.Sobel(smooth, cv2.CV_32F, dx, dy, ksize=1, scale=0.5) for dx, dy in ((1, 0), (0, 1))]
    return np.asarray(cv2.merge([smooth, *along]))


def _search(
    left: Floats, right: Floats, corridor: Corridor, half: Floats, v: Floats, usable: Floats
) -> float:
    """Return the offset in whole rows at which both images correlate best, summed over the cells."""
    best = []
    fixed, moving = (np.ascontiguousarray(image[..., 0]) for image in (left, right))
    reference = sample(fixed, corridor.u + half, v, cv2.INTER_LINEAR)
    for rows in range(-_MOST_PX, _MOST_PX + 1):
        moved = sample(moving, corridor.u - half, v + np.float32(rows), cv2.INTER_LINEAR)
        squares = [_products(a, b, usable, corridor) for a, b in ((reference, moved), (moved, moved))]
        best.append(float((squares[0] / np.sqrt(np.maximum(squares[1], 1.0))).sum()))
    return float(np.argmax(best) - _MOST_PX)


def _products(a: Floats, b: Floats, weights: Floats, corridor: Corridor) -> Array:
    """Sum products of samples over the cells, means of the segments removed, (C,)."""
    return corridor.cell_sums(_segment_products(a, b, weights, corridor))


def _segment_products(a: Floats, b: Floats, weights: Floats, corridor: Corridor) -> Array:
    sums = corridor.segment_sums
    weighted = weights * a
    products: Array = sums(weighted * b) - sums(weighted) * sums(weights * b) / np.maximum(
        sums(weights), 1e-6
    )
    return products


def measure_cells(left: Floats, right: Floats, usable: Floats, corridor: Corridor) -> tuple[Array, Array]:
    """Return the vertical displacement of the cells [px] and its variance; infinite without texture.

    Args:
        left: (3, N) grey value and both derivatives of the left image at the samples (:func:`with_slopes`).
        right: The same of the right image.
        usable: (N,) 1 for samples that count, 0 for others.
        corridor: The samples, in segments and cells; the means of the segments are removed.
    """
    contrasts = [_squares(image[0], usable, corridor).sum() for image in (left, right)]
    scale = np.sqrt(contrasts[0] / max(contrasts[1], 1e-6))
    right = right * np.float32(np.clip(scale, 0.25, 4.0))
    difference = left[0] - right[0]
    slopes = (left[1:] + right[1:]) / 2  # of both images, by column and by row
    gradient = np.array([_products(slope, difference, usable, corridor) for slope in slopes])
    # Gradients of one image by those of the other: noise alone leaves nothing.
    common = np.array([[_products(a, b, usable, corridor) for b in right[1:]] for a in left[1:]])
    common = (common + common.swapaxes(0, 1)) / 2
    count = np.maximum(corridor.cell_sums(corridor.segment_sums(usable)), 1.0)
    by_noise = [
        _CELL_SIGMAS
        * np.sqrt(np.prod([_squares(image[k], usable, corridor) for image in (left, right)], axis=0))
        for k in (1, 2)
    ] * np.sqrt(_CORRELATED_SAMPLES / count)
    seen = common[1, 1] > by_noise[1]
    # An edge along the row has nothing across it, which a wrong disparity could move.
    slanted = common[0, 0] > by_noise[0]
    along = np.where(slanted, common[0, 1] / np.where(slanted, common[0, 0], 1.0), 0.0)
    by_row = np.where(seen, common[1, 1] - along * common[0, 1], 0.0)
    seen &= by_row > _LEAST_INFORMATION * common[1, 1]
    rest = gradient[1] - along * gradient[0]
    safe = np.where(seen, by_row, 1.0)
    noise = np.maximum(_products(difference, difference, usable, corridor) / count, _QUANTISATION)
    # The right image lies lower by the displacement: its grey values there, less those on the left, fall.
    return np.where(seen, rest / safe, 0.0), np.where(seen, noise / safe, np.inf)


def _squares(samples: Floats, usable: Floats, corridor: Corridor) -> Array:
    """Return the sums of squares of samples over the cells, means of the segments removed, (C,)."""
    return np.clip(_products(samples, samples, usable, corridor), 0.0, None)


def combine_cells(cells: Array, variance: Array, columns: Array) -> VerticalOffset | None:
    """Fit an offset and a turn to the displacements of the cells; their scatter is the uncertainty.

    Args:
        cells: (C,) vertical displacements [px].
        variance: (C,) of them; infinite where a cell shows nothing.
        columns: (C,) place of the cells beside the principal point [px].
    """
    seen = np.isfinite(variance)
    if np.count_nonzero(seen) < _LEAST_CELLS:
        return None
    design = np.column_stack([np.ones(np.count_nonzero(seen)), columns[seen]])
    sigma = np.sqrt(variance[seen])
    # No cell counts for more than a typical one: what scatters is the road, not the noise.
    sigma = np.maximum(sigma, upper_median(sigma))
    rows, target = design / sigma[:, None], cells[seen] / sigma
    weights, scale = np.ones(len(target)), 1.0
    products = np.stack([rows[:, 0] ** 2, rows[:, 0] * rows[:, 1], rows[:, 1] ** 2, *(rows.T * target)])
    for i in range(2 * _REWEIGHTINGS):
        a, b, c, first, second = products @ weights
        a, c = a * (1.0 + _RIDGE), c * (1.0 + _RIDGE)
        solution = np.array([c * first - b * second, a * second - b * first]) / (a * c - b * b)
        residual = np.abs(target - rows @ solution)
        scale = max(_SIGMA_OVER_MAD * upper_median(residual), 1e-9)
        if i < _REWEIGHTINGS:
            weights = 1.0 / np.maximum(residual, 0.1 * scale)
        else:
            weights = np.clip(1.0 - (residual / (_TUKEY_SIGMAS * scale)) ** 2, 0.0, None) ** 2
    normal = np.array([[a, b], [b, c]])
    covariance = np.linalg.inv(normal) * scale**2 * len(target) / (len(target) - 2)
    std = np.sqrt(np.diag(covariance))
    used = int(np.count_nonzero(weights))
    return VerticalOffset(float(solution[0]), float(std[0]), float(solution[1]), float(std[1]), used)
