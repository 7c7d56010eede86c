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

"""Samples of both images at the positions that a road plane predicts, and which of them show road surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, PlaneCamera
from ..numerics.statistics import quantile
from ..road.cell_grid import SampleGrid
from ..types import Array, Floats, Image, Indices, Mask

_SATURATED = 250  # noise and interpolation make clipping visible a few grey levels below 255
_DARK = 3

# A sample is paint where it is brighter than the road on both sides, at one of these distances [m]. Stripes
# are 6 to 54 cm wide.
_FLANKS_M = (0.2, 0.45)
_PAINT_SIGMAS = 5.0  # least contrast of paint, in standard deviations of the road's own contrasts
# Reach of smeared paint, in standard deviations of the blur: of a contrast of 120 grey levels, a tenth of one
# grey level remains there.
_SMEAR_SIGMAS = 3.0
_PAINT_MARGIN_M = 0.06  # the edges of worn paint are ragged

# Columns and rows of samples in one image, (N,) each [px].
_Positions = tuple[Floats, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class BlurredImages:
    """Both images, blurred along the rows. Single-channel arrays are sampled faster.

    Attributes:
        grey: Grey values of the left and of the right image, (H, W) each.
        slope: Derivatives of the grey values along the row [1/px], (H, W) each.
        made: (H,) which rows are blurred; the others are zero.
    """

    grey: tuple[Floats, Floats]
    slope: tuple[Floats, Floats]
    made: Mask


class ImageBlurs:
    """Both images, blurred along the rows. Each row is blurred once, for all alignments of a frame."""

    def __init__(self, images: tuple[Image, Image]) -> None:
        """Create from the left and the right image, (H, W) uint8."""
        self._images = images
        self._made: dict[float, BlurredImages] = {}

    def of(self, blur_px: float, grid: SampleGrid, reach: int = 0) -> BlurredImages:
        """Return the images with the rows that hold the samples of a grid, blurred and differentiated.

        Near the car, the rows of a large image lie closer on the road than its samples.

        Args:
            blur_px: Standard deviation of the blur [px].
            grid: The samples.
            reach: Rows that are needed above and below each sample.
        """
        height, width = self._images[0].shape
        made = self._made.get(blur_px)
        if made is None:
            left, right, of_left, of_right = np.zeros((4, height, width), np.float32)
            made = BlurredImages((left, right), (of_left, of_right), np.zeros(height, bool))
            self._made[blur_px] = made
        sampled = np.bincount(grid.v.astype(np.intp), minlength=height) > 0
        if reach:
            sampled = np.convolve(sampled, np.ones(2 * reach + 1), "same") > 0
        rows = np.flatnonzero(sampled & ~made.made)
        if len(rows):
            _blur_rows(self._images, blur_px, rows, made)
        return made


def _blur_rows(images: tuple[Image, Image], blur_px: float, rows: Indices, made: BlurredImages) -> None:
    """Blur some rows of both images along the row, and differentiate them along it."""
    radius = int(np.ceil(4.0 * blur_px))
    kernel = cv2.getGaussianKernel(2 * radius + 1, blur_px, cv2.CV_32F).ravel()
    x = np.arange(-radius, radius + 1)
    # OpenCV correlates instead of convolving, so the kernel is positive to the right.
    derivative = (x * kernel / blur_px**2).astype(np.float32)
    one = np.ones(1, np.float32)
    for index, image in enumerate(images):
        some = image[rows]
        made.grey[index][rows] = cv2.sepFilter2D(some, cv2.CV_32F, kernel, one)
        made.slope[index][rows] = cv2.sepFilter2D(some, cv2.CV_32F, derivative, one)
    made.made[rows] = True


def sample(image: npt.NDArray[Any], u: Floats, v: Floats, how: int = cv2.INTER_CUBIC) -> npt.NDArray[Any]:
    """Sample an image (H, W) at points of any shape; their number is a multiple of 256."""
    shape = (-1, 256)
    sampled = cv2.remap(image, u.reshape(shape), v.reshape(shape), how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled.reshape(u.shape))


def half_disparity(grid: SampleGrid, plane: DisparityPlane, rig: StereoRig) -> Floats:
    """Return half the disparity of the plane at each sample [px], (N,)."""
    # The product of the plane and the rays of all pixels (`core.geometry.rays`), written out in single
    # precision.
    p = plane.of_camera(PlaneCamera.MIDDLE, rig).coefficients
    base = p[0] + p[1] * rig.cx / rig.fx + p[2] * rig.cy / rig.fy
    half: Floats = grid.v * np.float32(-p[2] / rig.fy / 2.0)
    half += grid.u * np.float32(-p[1] / rig.fx / 2.0)
    half += np.float32(base / 2.0)
    return half


def sample_positions(
    grid: SampleGrid, half: Floats, turned: Array | None = None
) -> tuple[_Positions, _Positions]:
    """Return the positions of the samples in the left and in the right image, for a known disparity.

    Args:
        grid: The samples.
        half: (N,) half the disparity [px].
        turned: Homography (3, 3) to the right image from one of a camera that is not turned; None where it
            is that.

    Returns:
        Columns and rows in the left image, and columns and rows in the right image, (N,) each [px].
    """
    left, right = (grid.u + half, grid.v), (grid.u - half, grid.v)
    return left, right if turned is None else _turned(right, turned)


def _turned(straight: _Positions, turned: Array) -> _Positions:
    """Return where points of a camera that is not turned lie in the image of one that is."""
    u, v = straight
    of_u, of_v, of_depth = turned.astype(np.float32)
    depth = of_depth[0] * u + of_depth[1] * v + of_depth[2]
    return (of_u[0] * u + of_u[1] * v + of_u[2]) / depth, (of_v[0] * u + of_v[1] * v + of_v[2]) / depth


def warp(images: tuple[Floats, Floats], positions: tuple[_Positions, _Positions]) -> tuple[Floats, Floats]:
    """Sample a channel of the left and of the right image, each at its own positions, (N,) each."""
    return sample(images[0], *positions[0]), sample(images[1], *positions[1])


def usable_samples(
    images: tuple[Image, Image], grid: SampleGrid, half: Floats, rig: StereoRig, blur_px: float | None
) -> Floats:
    """Return which samples can be used: 1 for these, 0 for the others, (N,).

    A sample is usable where it lies in both images and is neither dark nor saturated. Where a blur is given,
    it must also lie beyond the reach of blurred paint, so that it is independent of the stripes.

    Args:
        images: Left and right image, (H, W) uint8.
        grid: The samples.
        half: (N,) half the disparity [px].
        rig: Intrinsics and baseline.
        blur_px: Standard deviation of the blur along the row [px]; None where paint is to be used.
    """
    usable = np.ones(len(grid.u), dtype=bool)
    usable[grid.n_samples :] = False
    for image, sign in zip(images, (1.0, -1.0), strict=True):
        u = np.rint(grid.u + np.float32(sign) * half)
        grey = sample(image, u, grid.v, cv2.INTER_NEAREST)
        usable &= (u >= 0) & (u < rig.width) & (grey < _SATURATED) & (grey > _DARK)
        if blur_px is not None and sign > 0.0:  # both cameras see the same paint: one image is enough
            px_per_m = half * np.float32(2.0 / rig.baseline_m)  # disparity over baseline
            usable &= ~_paint(image, np.clip(u, 0, rig.width - 1), grid.v, px_per_m, blur_px)
    return usable.astype(np.float32)


def _paint(image: Image, u: Floats, v: Floats, px_per_m: Floats, blur_px: float) -> npt.NDArray[np.bool_]:
    """Find samples, at whole pixels, that are brighter than the road on both sides of them, (N,)."""
    first, last = int(v.min()), int(v.max())
    above = max(0, first - 1)  # the blur needs one more row above and below
    smooth = np.asarray(cv2.blur(image[above : last + 2], (3, 3)), np.uint8)[first - above :]
    v = v - np.float32(first)
    grey = sample(smooth, u, v, cv2.INTER_NEAREST).astype(np.int16)
    paint = np.zeros(len(u), dtype=bool)
    for flank_m in _FLANKS_M:
        reach = np.floor(px_per_m * np.float32(flank_m))
        sides = [sample(smooth, at, v, cv2.INTER_NEAREST) for at in (u - reach, u + reach)]
        contrast = grey - np.maximum(*sides)
        # Contrasts below the median are those of the road without paint. A quarter of a Gaussian lies below
        # -0.674 standard deviations.
        ordered = np.sort(contrast[::7])
        quarter, half = quantile(ordered, 0.25), quantile(ordered, 0.5)
        sigma = max((half - quarter) / 0.674, 1.0)
        paint |= contrast > half + _PAINT_SIGMAS * sigma
    if not paint.any():
        return paint
    # The margin on both sides along the row covers the smear of the blur and the ragged edge.
    row, column, margin_px = (
        values[paint].astype(np.intp) for values in (v, u, px_per_m * np.float32(_PAINT_MARGIN_M))
    )
    margin_px += int(np.ceil(_SMEAR_SIGMAS * blur_px)) + 1
    width = image.shape[1]
    # Each margin adds one where it begins and subtracts one where it ends. The cumulative sum along a row is
    # positive in between.
    depth = np.zeros((last + 1 - first, width + 1), np.int32)
    row *= width + 1
    np.add.at(depth.reshape(-1), row + np.maximum(column - margin_px, 0), np.int32(1))
    np.subtract.at(depth.reshape(-1), row + np.minimum(column + margin_px + 1, width), np.int32(1))
    covered = (np.cumsum(depth, axis=1, dtype=np.int32, out=depth) > 0).view(np.uint8)
    widened: npt.NDArray[np.bool_] = sample(covered, u, v, cv2.INTER_NEAREST) > 0
    return widened
