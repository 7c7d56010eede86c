"""Samples of both images where a plane puts them, and which of them show asphalt."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .corridor import Corridor, Floats
from .extraction import Image
from .extrinsics import Array
from .rig import StereoRig

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
    """Both images, blurred along the rows, from a row on: grey value and its derivative as channels.

    Attributes:
        first_row: Row of the image that is row 0 here.
        left: (H, W, 2).
        right: (H, W, 2).
    """

    first_row: int
    left: Floats
    right: Floats


def prepare(images: tuple[Image, Image], blur_px: float, corridor: Corridor) -> Prepared:
    """Blur both images along the rows where the corridor is, and derive them."""
    first = max(0, int(corridor.v.min()) - _SPARE_ROWS)
    radius = int(np.ceil(4.0 * blur_px))
    kernel = cv2.getGaussianKernel(2 * radius + 1, blur_px, cv2.CV_32F).ravel()
    x = np.arange(-radius, radius + 1)
    slope = (x * kernel / blur_px**2).astype(np.float32)  # correlated, not convolved: rises to the right
    one = np.ones(1, np.float32)
    both = []
    for image in images:
        part = image[first:]
        both.append(cv2.merge([cv2.sepFilter2D(part, cv2.CV_32F, k, one) for k in (kernel, slope)]))
    return Prepared(first, np.asarray(both[0], np.float32), np.asarray(both[1], np.float32))


def sample(image: Floats | Image, u: Floats, v: Floats, how: int = cv2.INTER_CUBIC) -> Floats:
    """Sample an image (H, W) or (H, W, 2) at N points, (N,) or (2, N)."""
    shape = (-1, 256)
    sampled = cv2.remap(image, u.reshape(shape), v.reshape(shape), how, borderMode=cv2.BORDER_REPLICATE)
    if image.ndim == 2:
        return np.asarray(sampled.reshape(-1))
    return np.ascontiguousarray(sampled.reshape(-1, image.shape[2]).T)


def half_disparity(corridor: Corridor, plane: Array, rig: StereoRig) -> Floats:
    """Return half the disparity of the plane at each sample [px], (N,)."""
    base = plane[0] + plane[1] * rig.cx / rig.fx + plane[2] * rig.cy / rig.fy
    half: Floats = corridor.v * np.float32(-plane[2] / rig.fy / 2.0)
    half += corridor.u * np.float32(-plane[1] / rig.fx / 2.0)
    half += np.float32(base / 2.0)
    return half


def warp(
    prepared: Prepared, corridor: Corridor, half: Floats, vertical_px: float = 0.0, shift_px: float = 0.0
) -> tuple[Floats, Floats]:
    """Sample grey values and derivatives of both images where the plane puts them, (2, N) each.

    Args:
        prepared: The images.
        corridor: Where to sample.
        half: (N,) half the disparity [px].
        vertical_px: Row of a point in the right image minus that in the left one.
        shift_px: Wrong disparity added, to see what changes.
    """
    v = corridor.v - np.float32(prepared.first_row)
    half = half + np.float32(shift_px / 2.0)
    tilt = np.float32(vertical_px / 2.0)
    return sample(prepared.left, corridor.u + half, v - tilt), sample(
        prepared.right, corridor.u - half, v + tilt
    )


def usable_samples(
    images: tuple[Image, Image], corridor: Corridor, half: Floats, rig: StereoRig, blur_px: float | None
) -> Floats:
    """Return 1 for samples that are neither saturated nor, where a blur is given, reached by paint."""
    usable = np.ones(len(corridor.u), dtype=bool)
    usable[corridor.n_samples :] = False
    v = corridor.v.astype(np.intp)
    px_per_m = half * np.float32(2.0 / rig.baseline_m)  # disparity over baseline
    for image, sign in zip(images, (1.0, -1.0), strict=True):
        exact = corridor.u + np.float32(sign) * half
        u = np.rint(exact).astype(np.intp)
        inside = (u >= 0) & (u < rig.width)
        u = np.clip(u, 0, rig.width - 1)
        grey = image[v, u]
        usable &= inside & (grey < _SATURATED) & (grey > _DARK)
        if blur_px is not None and sign > 0.0:  # paint is seen alike by both
            usable &= ~_paint(np.asarray(cv2.blur(image, (3, 3)), np.uint8), u, v, px_per_m, blur_px)
    return usable.astype(np.float32)


def _paint(
    image: Image, u: npt.NDArray[np.intp], v: npt.NDArray[np.intp], px_per_m: Floats, blur_px: float
) -> npt.NDArray[np.bool_]:
    """Find samples that are brighter than the road on both sides of them."""
    grey = image[v, u].astype(np.int16)
    paint = np.zeros(len(u), dtype=bool)
    last = image.shape[1] - 1
    for flank_m in _FLANKS_M:
        reach = (flank_m * px_per_m).astype(np.intp)
        beside = np.maximum(image[v, np.clip(u - reach, 0, last)], image[v, np.clip(u + reach, 0, last)])
        contrast = grey - beside
        # The road itself, below the median, where no paint is: a quarter of a Gaussian lies below -0.674.
        quarter, half = np.percentile(contrast[::7], (25, 50))
        sigma = max((half - quarter) / 0.674, 1.0)
        paint |= contrast > half + _PAINT_SIGMAS * sigma
    if not paint.any():
        return paint
    # A margin to both sides along the row: what the blur smears, and the ragged edge.
    at = np.flatnonzero(paint)
    margin = (_PAINT_MARGIN_M * px_per_m[at]).astype(np.intp) + int(np.ceil(_SMEAR_SIGMAS * blur_px)) + 1
    first = int(v.min())
    width = last + 2
    row = (v[at] - first) * width
    size = (int(v.max()) - first + 1) * width
    ends = np.bincount(row + np.maximum(u[at] - margin, 0), minlength=size)
    ends -= np.bincount(row + np.minimum(u[at] + margin + 1, last + 1), minlength=size)
    widened: npt.NDArray[np.bool_] = np.cumsum(ends)[(v - first) * width + u] > 0
    return widened
