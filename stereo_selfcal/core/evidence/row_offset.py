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

"""Vertical offset between the images of a pair: zero where they are rectified.

The offset is measured on the road. The plane of the road gives the disparity of each sample, and the rows of
both images are moved against each other until the grey values agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..estimators.sampling import half_disparity, sample, usable_samples
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..numerics.linear import invert, is_covariance
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..numerics.statistics import upper_median
from ..rejection import Bound, NotFitted
from ..road.cell_grid import FAR_M, HALF_WIDTH_M, SampleGrid, lay_out_samples
from ..types import Array, Floats, Image

_BLUR_PX = 1.0
_KERNEL_PX = 9
_MARGIN_PX = 8  # around the samples: half the kernel, the derivative and the interpolation
_MAX_OFFSET_PX = 4  # searched in whole rows, up and down; a larger offset is visible to the eye
_PASSES = 3
_THINNING = 2
_LEAST_CELLS = 12  # six for each of the two unknowns: their scatter gives the uncertainty
# Share of a cell's vertical gradients that the horizontal ones must leave unexplained.
_LEAST_INFORMATION = 0.2
_CELL_SIGMAS = 3.0
# Samples per independent value of the noise: a blur of 1 px in both directions correlates 4 pi sigma^2
# pixels, and every second pixel is sampled.
_CORRELATED_SAMPLES = 4.0
_QUANTISATION = 1.0 / 12.0 / 6.0  # variance of rounding to whole grey values, reduced by the blur
_REWEIGHTING = Reweighting(rounds=8, absolute_rounds=8)
_SCALE = scale_by_median(1e-9)  # the least scale: two cells are fitted without residuals
_RIDGE = 1e-9  # keeps the equations regular where all cells lie in one column


# Columns [px] in the left and in the right image, and rows [px] without an offset, of N samples: (N,) each.
SamplePositions = tuple[Floats, Floats, Floats]
# Grey value, derivative along the row and along the column of a blurred image, (H, W) each.
Channels = tuple[Floats, Floats, Floats]


@dataclass(frozen=True, slots=True)
class VerticalOffset:
    """Offset and turn between the rows of both images.

    Attributes:
        offset_px: Row in the right image minus row in the left one of the same point, at the principal point.
        std_px: Its standard deviation, by the scatter of the cells of the road.
        roll_rad: Turn of the right image against the left one about the optical axis [rad]; > 0: the rows of
            the right image fall to the right.
        roll_std_rad: Its standard deviation.
        n_cells: Number of cells of the road that were used.
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
) -> VerticalOffset | NotFitted:
    """Measure the vertical offset between both images on the road.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        extrinsics: Pose over the road, good to about a pixel of disparity.
        lane_yaw_rad: Heading of the camera against the lane.
        limits_m: Right and left limit of the strip beside the camera [m], left positive.
        far_m: Distance of the strip's end [m].

    Returns:
        The offset, or why there is none: the road is not in view, or has too little texture.
    """
    plane = plane_from_pose(extrinsics, rig)
    grid = lay_out_samples(rig, extrinsics, lane_yaw_rad, limits_m, far_m, _THINNING)
    if grid is None:
        return NotFitted("cells of the road in view", 0, Bound.LEAST, _LEAST_CELLS)
    half = half_disparity(grid, plane, rig)
    usable = usable_samples(images, grid, half, rig, None)
    at_left, at_right = grid.u + half, grid.u - half
    # Filter only the part of the images that holds the samples, with a margin for filters and interpolation.
    top = max(0, int(grid.v.min()) - 2 * _MAX_OFFSET_PX)
    start = max(0, int(min(at_left.min(), at_right.min())) - _MARGIN_PX)
    end = int(max(at_left.max(), at_right.max())) + _MARGIN_PX + 1
    left, right = (with_gradients(image[top:, start:end]) for image in images)
    positions = (at_left - np.float32(start), at_right - np.float32(start), grid.v - np.float32(top))
    offset = _search(left[0], right[0], grid, positions, usable)
    return refine_offset(
        (left, right),
        grid,
        positions,
        usable,
        rig,
        (offset, 0.0),
        _PASSES,
        _MAX_OFFSET_PX,
        cv2.INTER_CUBIC,
    )


def refine_offset(
    images: tuple[Channels, Channels],
    samples: SampleGrid,
    positions: SamplePositions,
    usable: Floats,
    rig: StereoRig,
    start: tuple[float, float],
    passes: int,
    max_offset_px: int,
    interpolation: int,
    disparity_std_px: float = math.inf,
    least_cells: int = _LEAST_CELLS,
) -> VerticalOffset | NotFitted:
    """Refine an offset and a turn that are good to about a row.

    Args:
        images: Left and right image with their derivatives (:func:`with_gradients`).
        samples: Cells in which the images are compared.
        positions: Columns and rows of the samples in these images.
        usable: (N,) 1 for samples that count, 0 for others.
        rig: Intrinsics.
        start: Offset [px] and turn [rad] to begin with.
        passes: Number of Gauss-Newton steps.
        max_offset_px: The iteration has diverged when the offset is more than twice this.
        interpolation: Flag of OpenCV.
        disparity_std_px: Standard deviation of the disparity [px]; infinite where it is unknown, so that
            inclined edges give little information.
        least_cells: Least number of cells with a displacement.

    Returns:
        Offset and turn, or why there are none: too few cells, or the iteration has diverged.
    """
    (left, right), (at_left, at_right, v) = images, positions
    offset, roll = start
    columns = samples.cell_rays[:, 1] * -rig.fx
    solution: VerticalOffset | NotFitted | None = None
    for _ in range(passes):
        shift_px = np.float32(0.5) * (
            np.float32(offset) + np.float32(roll) * (samples.u - np.float32(rig.cx))
        )
        left_values = np.stack([sample(channel, at_left, v - shift_px, interpolation) for channel in left])
        right_values = np.stack([sample(channel, at_right, v + shift_px, interpolation) for channel in right])
        cells = measure_cells(left_values, right_values, usable, samples, disparity_std_px)
        solution = combine_cells(*cells, columns, least_cells)
        if isinstance(solution, NotFitted):
            return solution
        offset, roll = offset + solution.offset_px, roll + solution.roll_rad
        if not abs(offset) <= 2.0 * max_offset_px:
            return NotFitted(
                "offset between the rows of both images", abs(offset), Bound.MOST, 2.0 * max_offset_px, "px"
            )
    assert isinstance(solution, VerticalOffset)  # there is at least one pass
    return VerticalOffset(offset, solution.std_px, roll, solution.roll_std_rad, solution.n_cells)


def with_gradients(image: Image) -> Channels:
    """Return grey value, derivative along the row and along the column of the blurred image."""
    kernel = cv2.getGaussianKernel(_KERNEL_PX, _BLUR_PX, cv2.CV_32F)
    smooth = np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel), np.float32)
    across, down = (
        np.asarray(cv2.Sobel(smooth, cv2.CV_32F, dx, dy, ksize=1, scale=0.5), np.float32)
        for dx, dy in ((1, 0), (0, 1))
    )
    return smooth, across, down


def _search(
    fixed: Floats, moving: Floats, grid: SampleGrid, positions: SamplePositions, usable: Floats
) -> float:
    """Return the offset in whole rows at which both images correlate best, summed over the cells."""
    at_left, at_right, v = positions
    offsets = np.arange(-_MAX_OFFSET_PX, _MAX_OFFSET_PX + 1)
    rows = v + offsets[:, None].astype(np.float32)
    columns = np.broadcast_to(at_right, rows.shape)
    reference = sample(fixed, at_left, v, cv2.INTER_LINEAR)
    moved = sample(moving, columns, rows, cv2.INTER_LINEAR)
    reference, moved = (_centred(each, usable, grid) for each in (reference, moved))
    both, squares = (grid.sums_over_cells(moved * each) for each in (reference, moved))
    return float(offsets[np.argmax((both / np.sqrt(np.maximum(squares, 1.0))).sum(axis=1))])


def _centred(samples: Floats, usable: Floats, grid: SampleGrid) -> Floats:
    """Remove the means of the segments from samples (..., N); unusable samples become zero."""
    sums = grid.segment_sums
    means = sums(samples * usable) / np.maximum(sums(usable), 1e-6)
    centred: Floats = (samples - grid.to_samples(means)) * usable
    return centred


def measure_cells(
    left: Floats, right: Floats, usable: Floats, grid: SampleGrid, disparity_std_px: float = math.inf
) -> tuple[Array, Array]:
    """Return the vertical displacement of each cell [px] and its variance, which is infinite without texture.

    Args:
        left: (3, N) grey value and both derivatives of the left image at the samples
            (:func:`with_gradients`).
        right: The same of the right image.
        usable: (N,) 1 for samples that count, 0 for others.
        grid: The samples, in segments and cells; the means of the segments are removed.
        disparity_std_px: Standard deviation of the disparity [px]; infinite where it is unknown.
    """
    left, right = _centred(left, usable, grid), _centred(right, usable, grid)
    scale = np.sqrt(np.vdot(left[0], left[0]) / max(np.vdot(right[0], right[0]), 1e-6))
    right = right * np.float32(np.clip(scale, 0.25, 4.0))
    difference = left[0] - right[0]
    slopes_left, slopes_right = left[1:], right[1:]  # by column and by row
    sums = grid.sums_over_cells
    gradient = sums((slopes_left + slopes_right) / 2 * difference)
    # Gradients of one image times those of the other: the expectation of their noise is zero.
    products = sums(slopes_left[:, None] * slopes_right)
    products = (products + products.swapaxes(0, 1)) / 2
    count = np.maximum(sums(usable), 1.0)
    squares = sums(slopes_left * slopes_left) * sums(slopes_right * slopes_right)
    noise_limit = _CELL_SIGMAS * np.sqrt(squares * _CORRELATED_SAMPLES / count)
    seen = products[1, 1] > noise_limit[1]
    noise = np.maximum(sums(difference * difference) / count, _QUANTISATION)
    # A cell whose edges all run along the row has no horizontal gradient: a wrong disparity does not matter.
    inclined = products[0, 0] > noise_limit[0]
    disparity_noise = noise / disparity_std_px**2
    horizontal = np.where(inclined, products[0, 0] + disparity_noise, 1.0)
    coupling = np.where(inclined, products[0, 1] / horizontal, 0.0)
    information = np.where(seen, products[1, 1] - coupling * products[0, 1], 0.0)
    seen &= information > (_LEAST_INFORMATION * products[1, 1] if math.isinf(disparity_std_px) else 0.0)
    remainder = gradient[1] - coupling * gradient[0]
    safe = np.where(seen, information, 1.0)
    # Where the right image lies lower by d rows, R(v) = L(v - d), so L - R is d times the gradient.
    return np.where(seen, remainder / safe, 0.0), np.where(seen, noise / safe, np.inf)


def combine_cells(
    cells: Array, variance: Array, columns: Array, least_cells: int = _LEAST_CELLS
) -> VerticalOffset | NotFitted:
    """Fit an offset and a turn to the displacements of the cells; their scatter gives the uncertainty.

    Args:
        cells: (C,) vertical displacements [px].
        variance: (C,) their variances; infinite for cells without texture.
        columns: (C,) columns of the cells minus that of the principal point [px].
        least_cells: Least number of cells with a displacement.
    """
    seen = np.isfinite(variance)
    n_seen = int(np.count_nonzero(seen))
    if n_seen < least_cells:
        return NotFitted("cells whose rows can be compared", n_seen, Bound.LEAST, least_cells)
    design = np.column_stack([np.ones(n_seen), columns[seen]])
    sigma = np.sqrt(variance[seen])
    # No cell counts for more than a typical one: the scatter comes from the road, not from the noise.
    sigma = np.maximum(sigma, upper_median(sigma))
    rows, target = design / sigma[:, None], cells[seen] / sigma
    products = np.stack([rows[:, 0] ** 2, rows[:, 0] * rows[:, 1], rows[:, 1] ** 2, *(rows.T * target)])

    def fit(weights: Array, _: object) -> tuple[tuple[Array, Array], Array]:
        # Normal equations of two parameters, written out: this runs for every pass of every frame.
        a, b, c, first, second = products @ weights
        a, c = a * (1.0 + _RIDGE), c * (1.0 + _RIDGE)
        solution = np.array([c * first - b * second, a * second - b * first]) / (a * c - b * b)
        return (solution, np.array([[a, b], [b, c]])), target - rows @ solution

    found = fit_reweighted(fit, len(target), _REWEIGHTING, _SCALE)
    assert not isinstance(found, NotFitted)  # the ridge makes the equations regular
    solution, normal = found.solution
    inverse = invert(normal, "numbers of the offset that the cells determine")
    if isinstance(inverse, NotFitted):
        return inverse
    covariance = inverse * found.scale**2 * len(target) / (len(target) - 2)
    if not is_covariance(covariance):  # all cells in one column, but for rounding
        return NotFitted("numbers of the offset that the cells determine", 1, Bound.LEAST, 2)
    std = np.sqrt(np.diag(covariance))
    used = int(np.count_nonzero(found.weights))
    return VerticalOffset(float(solution[0]), float(std[0]), float(solution[1]), float(std[1]), used)
