"""Samples of both images where a plane puts them, and which of them show asphalt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, PlaneCamera
from ..numerics.statistics import quantile
from ..road.cell_grid import Corridor
from ..types import Floats, Image

_SPARE_ROWS = 6  # above the corridor of the first pass, for those after it
_SATURATED = 250  # clipping begins a few levels before 255, by noise and interpolation
_DARK = 3

# Stripes: brighter than the road on both sides at these distances [m] (stripes are 6 to 54 cm wide), by this
# many standard deviations of what the road does there.
_FLANKS_M = (0.2, 0.45)
_PAINT_SIGMAS = 5.0
_SMEAR_SIGMAS = 3.0  # of 120 grey levels of contrast, a tenth of one is left there
_PAINT_MARGIN_M = 0.06  # the edges of worn paint are ragged


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Both images, blurred along the rows, from a row on, one array a channel: sampled faster.

    Attributes:
        first_row: Row of the image that is row 0 here.
        grey: Grey value of the left and of the right image, (H, W) each.
        slope: Its derivative along the row, (H, W) each.
    """

    first_row: int
    grey: tuple[Floats, Floats]
    slope: tuple[Floats, Floats]


def prepare(images: tuple[Image, Image], blur_px: float, corridor: Corridor) -> Prepared:
    """Blur both images along the rows where the corridor is, and derive them."""
    first = max(0, int(corridor.v.min()) - _SPARE_ROWS)
    radius = int(np.ceil(4.0 * blur_px))
    kernel = cv2.getGaussianKernel(2 * radius + 1, blur_px, cv2.CV_32F).ravel()
    x = np.arange(-radius, radius + 1)
    derivative = (x * kernel / blur_px**2).astype(np.float32)  # correlated, not convolved: rises to the right
    one = np.ones(1, np.float32)
    grey, slope = (
        [np.asarray(cv2.sepFilter2D(image[first:], cv2.CV_32F, k, one), np.float32) for image in images]
        for k in (kernel, derivative)
    )
    return Prepared(first, (grey[0], grey[1]), (slope[0], slope[1]))


def sample(image: npt.NDArray[Any], u: Floats, v: Floats, how: int = cv2.INTER_CUBIC) -> npt.NDArray[Any]:
    """Sample an image (H, W) at points of any shape, a multiple of 256 of them."""
    shape = (-1, 256)
    sampled = cv2.remap(image, u.reshape(shape), v.reshape(shape), how, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled.reshape(u.shape))


def half_disparity(corridor: Corridor, plane: DisparityPlane, rig: StereoRig) -> Floats:
    """Return half the disparity of the plane at each sample [px], (N,)."""
    # The product with all pixels' rays (`core.geometry.rays`), written out in single precision.
    p = plane.of_camera(PlaneCamera.MIDDLE, rig).coefficients
    base = p[0] + p[1] * rig.cx / rig.fx + p[2] * rig.cy / rig.fy
    half: Floats = corridor.v * np.float32(-p[2] / rig.fy / 2.0)
    half += corridor.u * np.float32(-p[1] / rig.fx / 2.0)
    half += np.float32(base / 2.0)
    return half


def places(
    first_row: int, corridor: Corridor, half: Floats, vertical_px: float = 0.0
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return where a plane puts the samples in the left and in the right image: columns and rows, (N,) each.

    Args:
        first_row: Row that is row 0 of the images (:class:`Prepared`).
        corridor: Where to sample.
        half: (N,) half the disparity [px].
        vertical_px: Row of a point in the right image minus that in the left one.
    """
    v = corridor.v - np.float32(first_row)
    tilt = np.float32(vertical_px / 2.0)
    return (corridor.u + half, v - tilt), (corridor.u - half, v + tilt)


def warp(
    images: tuple[Floats, Floats], place: tuple[tuple[Floats, Floats], tuple[Floats, Floats]]
) -> tuple[Floats, Floats]:
    """Sample a channel of the left and of the right image at their places, (N,) each."""
    return sample(images[0], *place[0]), sample(images[1], *place[1])


def usable_samples(
    images: tuple[Image, Image], corridor: Corridor, half: Floats, rig: StereoRig, blur_px: float | None
) -> Floats:
    """Return 1 for samples that are neither saturated nor, where a blur is given, reached by paint."""
    usable = np.ones(len(corridor.u), dtype=bool)
    usable[corridor.n_samples :] = False
    for image, sign in zip(images, (1.0, -1.0), strict=True):
        u = np.rint(corridor.u + np.float32(sign) * half)
        grey = sample(image, u, corridor.v, cv2.INTER_NEAREST)
        usable &= (u >= 0) & (u < rig.width) & (grey < _SATURATED) & (grey > _DARK)
        if blur_px is not None and sign > 0.0:  # paint is seen alike by both
            px_per_m = half * np.float32(2.0 / rig.baseline_m)  # disparity over baseline
            usable &= ~_paint(image, np.clip(u, 0, rig.width - 1), corridor.v, px_per_m, blur_px)
    return usable.astype(np.float32)


def _paint(image: Image, u: Floats, v: Floats, px_per_m: Floats, blur_px: float) -> npt.NDArray[np.bool_]:
    """Find samples, at whole pixels, that are brighter than the road on both sides of them."""
    first, last = int(v.min()), int(v.max())
    above = max(0, first - 1)  # a row more to either side, for the blur
    smooth = np.asarray(cv2.blur(image[above : last + 2], (3, 3)), np.uint8)[first - above :]
    v = v - np.float32(first)
    grey = sample(smooth, u, v, cv2.INTER_NEAREST).astype(np.int16)
    paint = np.zeros(len(u), dtype=bool)
    for flank_m in _FLANKS_M:
        reach = np.floor(px_per_m * np.float32(flank_m))
        sides = [sample(smooth, at, v, cv2.INTER_NEAREST) for at in (u - reach, u + reach)]
        contrast = grey - np.maximum(*sides)
        # The road itself, below the median, where no paint is: a quarter of a Gaussian lies below -0.674.
        ordered = np.sort(contrast[::7])
        quarter, half = quantile(ordered, 0.25), quantile(ordered, 0.5)
        sigma = max((half - quarter) / 0.674, 1.0)
        paint |= contrast > half + _PAINT_SIGMAS * sigma
    if not paint.any():
        return paint
    # A margin to both sides along the row: what the blur smears, and the ragged edge.
    row, column, margin_px = (
        values[paint].astype(np.intp) for values in (v, u, px_per_m * np.float32(_PAINT_MARGIN_M))
    )
    margin_px += int(np.ceil(_SMEAR_SIGMAS * blur_px)) + 1
    width = image.shape[1]
    # Up by one where a margin begins, down where it ends: the sum along a row is above zero in between.
    depth = np.zeros((last + 1 - first, width + 1), np.int32)
    row *= width + 1
    np.add.at(depth.reshape(-1), row + np.maximum(column - margin_px, 0), np.int32(1))
    np.subtract.at(depth.reshape(-1), row + np.minimum(column + margin_px + 1, width), np.int32(1))
    covered = (np.cumsum(depth, axis=1, dtype=np.int32, out=depth) > 0).view(np.uint8)
    widened: npt.NDArray[np.bool_] = sample(covered, u, v, cv2.INTER_NEAREST) > 0
    return widened
