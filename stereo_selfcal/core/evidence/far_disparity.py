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

"""The disparity of what is farthest away, in a band along and above the horizon.

Nothing is farther than infinity, so no disparity is negative: where many things have a negative one, the
right camera has turned about the vertical. And where the farthest things in many directions have the same
disparity, it is likely that of infinity. Points of strong upright edges are matched along the row, to a part
of a pixel. A match counts where the way back leads to the same point and others beside it agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import horizon_row
from ..geometry.pose import Extrinsics
from ..numerics.statistics import median
from ..rejection import Bound, NotFitted
from ..road.priors import RECTIFICATION_STD_PX
from ..types import Array, Floats, Image, Indices, Mask

# Width to which images are made smaller, by a whole number: a twentieth of a pixel of it is 0.003 deg.
_WIDTH_PX = 960
# The band, over the width of the image: above the horizon up to trees and houses, and below it as far as a
# pitch that is wrong by a degree or two needs.
_ABOVE, _BELOW = 0.08, 0.02
# Turns that are searched. Beyond, a pair of images is hardly matched at all.
MOST_TURN_RAD = math.radians(0.5)
# Nearer things are searched for as well, up to so many times that disparity, lest they be matched wrongly.
_NEAR = 3
# Half of a patch; an upright edge is wider than high. One point, the one of most gradient, in each cell.
_HALF_ROWS, _HALF_COLUMNS = 3, 7
_CELL_ROWS, _COLUMNS_OF_CELLS = 9, 64
_BLUR_PX = 0.7
# The blur leaves noise that is correlated over this many pixels; the standard deviation of a match grows by
# its square root.
_CORRELATED_PX2 = 4.0 * math.pi * _BLUR_PX**2
_LEAST_GRADIENT = 1.0  # grey levels per pixel, root mean square over the patch: sensor noise is below
# Least correlation of two patches, its lead over that of any other place, and the way back [px].
_LEAST_CORRELATION, _LEAD, _WAY_BACK_PX = 0.9, 0.1, 0.3
_NEXT_PEAK_PX = 3  # nearer places belong to the same peak
# A point counts where so many others near by agree within this [px], or three standard deviations.
_AGREEING, _AGREEMENT_PX, _STDS = 2, 0.25, 3.0
_NEAR_COLUMNS, _NEAR_ROWS = 1 / 20, 1 / 40  # over the width of the image
_LEAST_STD_PX = 0.05  # the parabola through three correlations is no better
# Directions, side by side, each of which has a farthest thing; it is seen where so many points count.
_SECTORS, _LEAST_POINTS = 16, 3
# A repeated pattern, such as a fence, may be matched wrongly in a few directions: no fewer than these count,
# and a quarter of those that see anything. In 50 recorded frames, no more were below -1.3 px.
_LEAST_SECTORS, _PART_OF_SECTORS = 3, 0.25
_FARTHEST_SCATTER_PX = 0.1  # of the disparities of things at infinity, in as many directions
# So many directions with the same least disparity are no accident: the odds grow from none to sure between
# these. In 50 recorded frames, up to three and a half were equal without being infinitely far.
_FEW_EQUAL, _MANY_EQUAL = 3.0, 4.0
# Odds of infinity where they are equal in all directions: woods and hills around a plain are as equal.
_INFINITE_PART = 0.3
_WHAT = "directions in which far things are seen"


@dataclass(frozen=True, slots=True)
class FarDisparity:
    """The least disparity that surely is seen: that at infinity is at most this.

    Attributes:
        disparity_px: The disparity [px].
        std_px: Its standard deviation [px].
        n_equal: Number of directions whose farthest thing has this disparity, by weight: things at a
            distance differ, those at infinity are equal.
    """

    disparity_px: float
    std_px: float
    n_equal: float


def infinitely_far(far: FarDisparity) -> float:
    """Return how likely what is farthest away is infinitely far, 0 ... 1."""
    equally_far = min(max((far.n_equal - _FEW_EQUAL) / (_MANY_EQUAL - _FEW_EQUAL), 0.0), 1.0)
    return _INFINITE_PART * equally_far


def first_far_row(rig: StereoRig, extrinsics: Extrinsics) -> int:
    """Return the first row in which far things are looked for.

    Args:
        rig: Intrinsics.
        extrinsics: Pose over the road.
    """
    return int(min(max(0.0, float(horizon_row(rig, extrinsics, rig.cx)) - _ABOVE * rig.width), rig.height))


def far_disparity(
    images: tuple[Image, Image], rig: StereoRig, extrinsics: Extrinsics
) -> FarDisparity | NotFitted:
    """Measure the disparity of what is farthest away.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        extrinsics: Pose over the road; it gives the row of the horizon, good to a degree or two.

    Returns:
        The disparity, or why there is none: the band is not in view, or too little is matched in it.
    """
    scale = max(1, round(rig.width / _WIDTH_PX))
    middle = float(horizon_row(rig, extrinsics, rig.cx))
    first = first_far_row(rig, extrinsics)
    rows = int(min(rig.height - 1.0, middle + _BELOW * rig.width)) - first
    least_rows = (2 * _HALF_ROWS + _CELL_ROWS) * scale
    if rows < least_rows:
        return NotFitted("rows around the horizon that are in view", max(rows, 0), Bound.LEAST, least_rows)
    left, right = (_band(image[first : first + rows], scale) for image in images)
    reach = math.ceil(MOST_TURN_RAD * rig.fx / scale) + 1
    near = _NEAR * reach
    u, v, energy = _strong_points(left, near)
    disparity, std, good = _match(left, right, u, v, energy, (near, reach))
    u, v, energy, disparity, std = u[good], v[good], energy[good], disparity[good], std[good]
    back, _, good = _match(right, left, np.rint(u - disparity).astype(np.intp), v, energy, (reach, near))
    good &= np.abs(back + disparity) < _WAY_BACK_PX
    u, v, disparity, std = u[good], v[good], disparity[good], std[good]
    good = _confirmed(u, v, disparity, std, left.shape[1]) & (disparity < reach)
    farthest = _farthest(u[good], disparity[good], left.shape[1])
    if len(farthest) < _LEAST_SECTORS:
        return NotFitted(_WHAT, len(farthest), Bound.LEAST, _LEAST_SECTORS)
    count = max(_LEAST_SECTORS, math.ceil(_PART_OF_SECTORS * len(farthest)))
    least = float(farthest[count - 1])
    spread = math.hypot(_FARTHEST_SCATTER_PX, _LEAST_STD_PX)
    equal = float(np.exp(-0.5 * ((farthest - float(np.median(farthest[:count]))) / spread) ** 2).sum())
    return FarDisparity(least * scale, math.hypot(RECTIFICATION_STD_PX, _LEAST_STD_PX * scale), equal)


def _band(image: Image, scale: int) -> Floats:
    """Return the rows of an image, smaller and blurred."""
    size = image.shape[1] // scale, image.shape[0] // scale
    used = image[: size[1] * scale, : size[0] * scale]
    small = used if scale == 1 else cv2.resize(used, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small.astype(np.float32), (0, 0), _BLUR_PX), np.float32)


def _strong_points(image: Floats, reach: int) -> tuple[Indices, Indices, Array]:
    """Return column, row and squared gradient (sum over the patch) of the strongest point of each cell."""
    gradient = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)
    size = 2 * _HALF_COLUMNS + 1, 2 * _HALF_ROWS + 1
    energy = cv2.boxFilter(gradient * gradient, -1, size, normalize=False)
    margin = reach + _HALF_COLUMNS + 1
    inner = energy[_HALF_ROWS:-_HALF_ROWS, margin : image.shape[1] - margin]
    width = max(_CELL_ROWS, image.shape[1] // _COLUMNS_OF_CELLS)
    n_rows, n_columns = inner.shape[0] // _CELL_ROWS, inner.shape[1] // width
    cells = inner[: n_rows * _CELL_ROWS, : n_columns * width].reshape(n_rows, _CELL_ROWS, n_columns, width)
    cells = cells.transpose(0, 2, 1, 3).reshape(n_rows * n_columns, -1)
    best = cells.argmax(axis=1)
    index = np.arange(len(cells))
    v = index // n_columns * _CELL_ROWS + best // width + _HALF_ROWS
    u = index % n_columns * width + best % width + margin
    strength = cells[index, best].astype(np.float64)
    strong = strength > size[0] * size[1] * _LEAST_GRADIENT**2
    return u[strong], v[strong], strength[strong]


def _match(
    fixed: Floats, moving: Floats, u: Indices, v: Indices, energy: Array, reach: tuple[int, int]
) -> tuple[Array, Array, Mask]:
    """Match patches along the row.

    Args:
        fixed: Image of the patches.
        moving: Image in which they are looked for.
        u: (N,) columns of their middles.
        v: (N,) rows of them.
        energy: (N,) squared gradients, summed over each patch.
        reach: Greatest shift to the left and to the right [px].

    Returns:
        How far the patches lie to the left in the other image [px], the standard deviation of that, and
        which of them are matched.
    """
    width, (left, right) = 2 * _HALF_COLUMNS + 1, reach
    least, most = left + _HALF_COLUMNS, moving.shape[1] - 1 - right - _HALF_COLUMNS
    inside = (u >= least) & (u <= most)
    u = np.clip(u, least, most)
    # The points come last in all arrays, as there are most of them: sums over a patch are sums of long rows.
    around = np.arange(-_HALF_ROWS, _HALF_ROWS + 1)[:, None, None] * moving.shape[1]
    columns = np.arange(-_HALF_COLUMNS - left, _HALF_COLUMNS + right + 1)[:, None]
    middles = v * moving.shape[1] + u
    patch = fixed.ravel().take(middles + around + columns[left : left + width])
    strip = moving.ravel().take(middles + around + columns)
    patch -= patch.mean(axis=(0, 1))
    strip -= strip.mean(axis=(0, 1))
    n = width * (2 * _HALF_ROWS + 1)
    shifts = range(left + right + 1)
    products = (
        np.array([np.einsum("ijn,ijn->n", patch, strip[:, each : each + width]) for each in shifts]) / n
    )
    mean, square = (
        _sums(each, width) / n for each in (strip.sum(axis=0), np.einsum("ijn,ijn->jn", strip, strip))
    )
    variance = np.einsum("ijn,ijn->n", patch, patch) / n
    both = np.sqrt(np.maximum(variance * (square - mean**2), np.finfo(np.float32).eps))
    correlation = products / both
    index, best = np.arange(len(u)), correlation.argmax(axis=0)
    inside &= (best > 0) & (best < left + right)
    best = np.clip(best, 1, left + right - 1)
    before, at, after = (correlation[best + step, index] for step in (-1, 0, 1))
    part = 0.5 * (before - after) / np.minimum(before - 2.0 * at + after, -np.finfo(np.float32).eps)
    elsewhere = np.abs(np.arange(left + right + 1)[:, None] - best) > _NEXT_PEAK_PX
    other = np.where(elsewhere, correlation, -1.0).max(axis=0)
    good = inside & (at > _LEAST_CORRELATION) & (other < at - _LEAD)
    to_left = (left - best - part).astype(np.float64)
    rest = _CORRELATED_PX2 * np.maximum(2.0 * variance * (1.0 - at), 0.0)
    std = np.hypot(_LEAST_STD_PX, np.sqrt(rest / energy))
    return to_left, std, good


def _sums(values: Floats, width: int) -> Floats:
    """Return the sums (M - width + 1, N) of neighbouring values (M, N)."""
    total = np.cumsum(np.pad(values.astype(np.float64), ((1, 0), (0, 0))), axis=0)
    sums: Floats = (total[width:] - total[:-width]).astype(np.float32)
    return sums


def _confirmed(u: Indices, v: Indices, disparity: Array, std: Array, width: int) -> Mask:
    """Whether other points near by have the same disparity."""
    # In the order of the columns, the points that may be near to each one follow one another.
    order = np.argsort(u, kind="stable")
    ordered, reach = u[order], _NEAR_COLUMNS * width
    first = np.searchsorted(ordered, ordered - reach, "right")
    count = np.searchsorted(ordered, ordered + reach, "left") - first
    one = np.repeat(order, count)
    other = order[np.arange(len(one)) + np.repeat(first - np.cumsum(count) + count, count)]
    limit = np.maximum(_AGREEMENT_PX, _STDS * np.hypot(std[one], std[other]))
    equal = (np.abs(v[one] - v[other]) < _NEAR_ROWS * width) & (
        np.abs(disparity[one] - disparity[other]) < limit
    )
    confirmed: Mask = np.bincount(one[equal], minlength=len(u)) - 1 >= _AGREEING
    return confirmed


def _farthest(u: Indices, disparity: Array, width: int) -> Array:
    """Return the least disparities of the directions in which something is seen, in order."""
    sector = np.minimum(u * _SECTORS // width, _SECTORS - 1)
    order = np.lexsort((disparity, sector))
    ends = np.searchsorted(sector[order], np.arange(1, _SECTORS))
    least = []
    for own in np.split(disparity[order], ends):
        if len(own) >= _LEAST_POINTS:
            # The second least one, and what is as far as that: a single one may be a wrong match.
            least.append(median(own[(own >= own[1]) & (own < own[1] + _AGREEMENT_PX)]))
    return np.sort(np.array(least))
