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

"""Stripe points: where an image row crosses the left edge of a painted stripe (paper section 2.2).

The paper correlates each row with [-1 0 1] and marks a positive peak that is followed, one stripe width
farther, by a negative one. Here the same is done at several widths. For a stripe of w pixels, the means of w
/ 2 pixels on both sides of the edge are compared. So the near, wide part of a line is found in noise that
hides it from single pixels. The narrowest width is the paper's kernel. The positive peak is marked and not
the middle of the stripe, as perspective moves the middle.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import cv2
import numpy as np
import numpy.typing as npt

from ..config import ExtractionConfig
from ..numerics.statistics import SIGMA_OVER_MAD
from ..types import Array, Image, Mask

Response = npt.NDArray[np.float32]
Sums = npt.NDArray[np.int16]
Limits = tuple[Array, Array]

# Half widths of the edge filters [px]. Filter k finds stripes of 2k ... 4k + 1 pixels, so together they find
# stripes of 2 ... 65 px: a 15 cm line from 0.7 m under a 500 px camera to 40 m ahead.
# Stripes of four pixels and more are near and long, so every second row is enough for them. In images of more
# rows than so many, by so many times fewer rows are enough for all: a line has as many points.
_LENGTHS_BY_ROW_STEP = (((1,), 1), ((2, 4, 8, 16), 2))
_ROWS_PX = 600

# The weaker edge of a stripe has at least this share of the contrast of the stronger one: the road surface on
# both sides of paint is darker by about the same. A single step (a shadow, a kerb, a verge) is no stripe.
_MIN_EDGE_RATIO = 0.5

# Painted lines are brighter than their road by at least this [grey levels], however little noise there is:
# worn paint in deep shadow is brighter by about 10 grey levels; the texture of a road surface varies by 3.
MIN_CONTRAST_GREY = 8.0

# Rows above and below in which a stripe should continue, along its own direction; times the thinning of rows.
_CONTINUITY_ROWS = (-4, -2, 2, 4)  # even, as the wide filters mark every second row
_CONTINUITY_REACH_PX = 1  # on either side: a direction off by 0.25 over four rows

# Least noise [grey levels]: rounding to 8 bits alone gives 1 / sqrt(12) = 0.29, cameras without JPEG about
# 0.5.
_MIN_NOISE_GREY = 0.5

# J. Immerkaer, "Fast noise variance estimation", CVIU 64 (1996): this mask has no
# response to planes, and an L2 norm of 6.
_NOISE_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
_NOISE_MASK_NORM = 6.0
_NOISE_ROW_STEP = 10  # every tenth strip of three rows gives two digits,
_MOST_NOISE_STRIPS = 40  # and so do these


@dataclass(frozen=True, slots=True, eq=False)
class MarkedPoints:
    """Marked points of one image, filter by filter, row by row.

    Attributes:
        rows: (N,) rows [px].
        columns: (N,) sub-pixel columns of the stripe's left edge [px].
        widths: (N,) widths of the stripe along the row [px].
        contrast: (N,) contrast of the weaker edge [grey levels].
        counts: (N,) number of image rows that each point represents.
        slopes: (N,) du/dv of the edge from the grey-value gradient around the point.
        slope_std: (N,) its standard deviation by the image noise.
        continuity: (N,) share of the neighbouring rows in which the stripe continues, 0 ... 1.
    """

    rows: Array
    columns: Array
    widths: Array
    contrast: Array
    counts: Array
    slopes: Array
    slope_std: Array
    continuity: Array

    def chosen(self, which: Mask) -> MarkedPoints:
        """Return the points of a mask (N,)."""
        return MarkedPoints(*(getattr(self, each.name)[which] for each in fields(self)))


class StripePoints:
    """One image as lines are found and measured in it: its gradient, and its stripe points.

    The points are marked when they are asked for. A line that was found in one image needs only the gradient
    of the other one.

    Attributes:
        noise_grey: Standard deviation of the image noise [grey levels].
        gradient: (H, W) gradient by the paper's kernel, in which the lines are measured.
    """

    def __init__(
        self,
        noise_grey: float,
        gradient: Response,
        mark: Callable[[Limits | None], MarkedPoints],
        limits: Limits | None = None,
    ) -> None:
        """Create from noise and gradient.

        Args:
            noise_grey: Standard deviation of the image noise [grey levels].
            gradient: (H, W) gradient by the paper's kernel.
            mark: Marks the points, within limits if there are any.
            limits: First and last column of each row in which points are marked; None to mark all.
        """
        self.noise_grey, self.gradient = noise_grey, gradient
        self._mark, self._limits = mark, limits

    @functools.cached_property
    def marked(self) -> MarkedPoints:
        """The stripe points."""
        return self._mark(self._limits)

    @classmethod
    def none(cls) -> StripePoints:
        """Return those of an image in which none are looked for."""
        empty = np.empty(0)
        marked = MarkedPoints(empty, empty, empty, empty, empty, empty, empty, empty)
        return cls(0.0, np.empty((0, 0), np.float32), lambda _: marked)

    @property
    def rows(self) -> Array:
        """Rows (N,) of the points [px]."""
        return self.marked.rows

    @property
    def columns(self) -> Array:
        """Columns (N,) of the points [px]."""
        return self.marked.columns

    def chosen(self, which: Mask) -> StripePoints:
        """Return some of the points, with the same image.

        Args:
            which: (N,) whether to take each point.
        """
        chosen = self.marked.chosen(which)
        return StripePoints(self.noise_grey, self.gradient, lambda _: chosen)

    def within(self, limits: Limits) -> StripePoints:
        """Return the points of a part of the image at least, with the same image.

        Args:
            limits: First and last column (H,) of each row [px].
        """
        if "marked" in self.__dict__:
            return self
        return StripePoints(self.noise_grey, self.gradient, self._mark, limits)


def noise_grey(image: Image) -> float:
    """Return the standard deviation of the pixel noise [grey levels] (Immerkaer 1996, median)."""
    step = 3 * max(_NOISE_ROW_STEP, image.shape[0] // (3 * _MOST_NOISE_STRIPS))
    strips = np.concatenate([image[i : i + 3] for i in range(0, image.shape[0] - 2, step)])
    response = cv2.filter2D(strips, cv2.CV_32F, _NOISE_MASK)[1::3, 1:-1]
    middle = strips[1::3, 1:-1]
    # Clipped pixels (a white sky) have no noise and would lower the estimate.
    usable = (middle > 0) & (middle < 255)
    if not usable.any():
        return _MIN_NOISE_GREY
    median = float(np.median(np.abs(response[usable])))
    return max(_MIN_NOISE_GREY, SIGMA_OVER_MAD * median / _NOISE_MASK_NORM)


def edge_response(image: Image, length_px: int) -> Response:
    """Return the mean of ``length_px`` pixels right of each pixel minus the mean left of it.

    ``length_px`` = 1 is the paper's kernel [-1 0 1].

    Returns:
        (H, W) float32; columns closer than ``length_px`` to the border are 0.
    """
    *_, (_, sums) = _edge_sums(image, length_px)
    response = sums.astype(np.float32)
    response /= np.float32(length_px)
    return response


def _edge_sums(image: Image, longest_px: int) -> Iterator[tuple[int, Sums]]:
    """Yield lengths of 1, 2, 4, ... px, and the sums of so many pixels right of each pixel minus those left.

    The sums (H, W) are zero in columns closer than the length to the border.
    """
    width, length = image.shape[1], 1
    # of_length[u] is the sum of u ... u + length - 1: each is that of two of half the length.
    of_length = image.astype(np.int16)
    while True:
        sums = np.zeros(image.shape, np.int16)
        if width > 2 * length:
            np.subtract(
                of_length[:, length + 1 :],
                of_length[:, : width - 2 * length],
                out=sums[:, length : width - length],
            )
        yield length, sums
        if length >= longest_px:
            return
        of_length, length = of_length[:, :-length] + of_length[:, length:], 2 * length


def row_thinning(height: int) -> int:
    """Return how many times fewer rows are looked at in an image of a height [px] than in a small one."""
    return max(1, round(height / _ROWS_PX))


def find_stripe_points(image: Image, config: ExtractionConfig, first_row: int = 0) -> StripePoints:
    """Mark the left edges of all painted stripes, row by row.

    Args:
        image: (H, W) uint8.
        config: Settings; ``min_contrast_sigma`` is the least contrast of either edge, over the noise of the
            filter that found it.
        first_row: Row from which on stripes are looked for; the gradient is zero above it.
    """
    noise = noise_grey(image)
    gradient = np.zeros(image.shape, np.float32)
    gradient[first_row:] = edge_response(image[first_row:], 1)
    return StripePoints(noise, gradient, lambda limits: _mark_points(image, noise, config, first_row, limits))


def _mark_points(
    image: Image, noise: float, config: ExtractionConfig, first_row: int, limits: Limits | None
) -> MarkedPoints:
    """Mark the points of an image from a row on."""
    thinning = row_thinning(image.shape[0])
    image = image[first_row:]
    mask = None
    if limits is not None:
        across = np.arange(image.shape[1])
        first, last = (each[first_row:, None] for each in limits)
        mask = (across >= first) & (across <= last)
    found = []
    for lengths, row_step in _LENGTHS_BY_ROW_STEP:
        every = thinning * row_step
        for length, sums in _edge_sums(image[::every], lengths[-1]):
            if length in lengths:
                within = None if mask is None else mask[::every]
                found.append(_points_of_sums(sums, length, every, noise, config, within))
    rows, columns, widths, contrast, counts = (np.concatenate(parts) for parts in zip(*found, strict=True))
    slopes, slope_std = _edge_directions(image, rows, columns, noise)
    continuity = _continuity(rows, columns, slopes, image.shape, thinning)
    return MarkedPoints(
        rows.astype(np.float64) + first_row,
        columns,
        widths,
        contrast,
        counts,
        slopes,
        slope_std,
        continuity,
    )


def _edge_directions(
    image: Image, rows: npt.NDArray[np.intp], columns: Array, noise: float
) -> tuple[Array, Array]:
    """Return du/dv of the edges at the points, and its standard deviation."""
    smooth = cv2.blur(image, (3, 3))
    u = np.clip(np.rint(columns).astype(np.intp), 1, image.shape[1] - 2)
    v = np.clip(rows, 1, image.shape[0] - 2)
    # Twice the derivatives of the grey value.
    across = smooth[v, u + 1].astype(np.float64) - smooth[v, u - 1]
    down = smooth[v + 1, u].astype(np.float64) - smooth[v - 1, u]
    steepness = np.maximum(across, 1.0)
    # Iso-grey direction: I_u du + I_v dv = 0. Either difference is that of two means of 9 pixels, 3 of
    # which they share: its noise is sigma * sqrt(12) / 9, about 0.4 sigma.
    slopes = -down / steepness
    return slopes, 0.4 * noise / steepness * np.sqrt(1.0 + slopes**2)


def _continuity(
    rows: npt.NDArray[np.intp], columns: Array, slopes: Array, shape: tuple[int, ...], thinning: int
) -> Array:
    """Return the share of neighbouring rows with a point where the edge direction of each point leads."""
    points = np.zeros(shape, dtype=np.uint8)
    points[rows, np.rint(columns).astype(np.intp)] = 1
    marked = cv2.dilate(points, np.ones((1, 2 * _CONTINUITY_REACH_PX + 1), np.uint8))
    found = np.zeros(len(rows))
    for step in np.multiply(_CONTINUITY_ROWS, thinning):
        v = np.clip(rows + step, 0, shape[0] - 1)
        u = np.clip(np.rint(columns + step * slopes).astype(np.intp), 0, shape[1] - 1)
        found += marked[v, u]
    return found / len(_CONTINUITY_ROWS)


def _points_of_sums(
    sums: Sums,
    length: int,
    row_step: int,
    noise: float,
    config: ExtractionConfig,
    mask: Mask | None,
) -> tuple[npt.NDArray[np.intp], Array, Array, Array, Array]:
    """Return rows, columns, widths, contrasts and row counts of the stripes 2 ... 4 filter lengths wide."""
    # Mean of length pixels minus mean of length pixels.
    threshold = max(MIN_CONTRAST_GREY, config.min_contrast_sigma * noise * np.sqrt(2.0 / length))
    narrowest, widest = 2 * length, 4 * length + 1
    if sums.shape[1] <= length + widest + 2:
        empty = np.empty(0)
        return empty.astype(np.intp), empty, empty, empty, empty
    # Local maximum over the length of the filter. The next steps use only these pixels, a few in a hundred.
    greatest = cv2.dilate(sums, np.ones((1, 2 * length + 1), np.uint8))
    peak = (sums >= greatest) & (sums > np.int16(min(threshold * length, np.iinfo(np.int16).max)))
    if mask is not None:
        peak &= mask
    peak[:, : length + 1] = False
    peak[:, -widest - 1 :] = False
    flat, at = sums.ravel(), np.flatnonzero(peak)
    one = np.float32(length)
    here = flat.take(at) / one
    # The strongest negative peak, narrowest ... widest pixels to the right.
    least = cv2.erode(sums, np.ones((1, widest - narrowest + 1), np.uint8), anchor=(0, 0))
    opposite = np.maximum(-least.ravel().take(at + narrowest) / one, np.float32(0.0))
    weaker, stronger = np.minimum(here, opposite), np.maximum(here, opposite)
    stripe = (weaker > threshold) & (weaker > _MIN_EDGE_RATIO * stronger)
    at, here, weaker = at[stripe], here[stripe], weaker[stripe]
    rows, columns = np.divmod(at, sums.shape[1])
    rising = flat.take(at[:, None] + np.arange(narrowest, widest + 1))
    widths = narrowest + np.argmin(rising, axis=1) if len(at) else np.empty(0)
    before, after = flat.take(at - 1) / one, flat.take(at + 1) / one
    # Parabola through three values: exact for a step edge averaged over a box-shaped pixel.
    curvature = np.minimum(before - 2.0 * here + after, -1e-6)
    shift_px = np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)
    return (
        rows * row_step,
        columns.astype(np.float64) + shift_px,
        np.asarray(widths, dtype=np.float64),
        weaker.astype(np.float64),
        np.full(len(rows), float(row_step)),
    )
