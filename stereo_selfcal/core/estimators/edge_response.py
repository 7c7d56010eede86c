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

"""The response of pixel and lens to the edge of a stripe, tabulated.

A pixel is a box of area 1. For a straight edge that moves m columns a row, this box acts along the row like
a box of width 1 convolved with a box of width m. A Gaussian lens of standard deviation s blurs the edge along
the row by ``s sqrt(1 + m^2)``. The step response S is the second integral of the normal distribution at the
four corners of the trapezium that the two boxes form::

    S(t) = [Q(t + a + b) - Q(t + a - b) - Q(t - a + b) + Q(t - a - b)] / (4 a b),  a = 1/2, b = |m| / 2
    Q(x) = (x^2 + s^2) / 2 * Phi(x / s) + s x / 2 * phi(x / s)

The derivative of S by the variance of the Gaussian is half its second derivative by t (the heat equation).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import as_strided

from ..types import Array

# Entries of the tables per pixel. Between the entries the response is extrapolated by its first and second
# derivative. The error is at most 4e-5 for a lens that blurs by a fifth of a pixel; the rounding of grey
# levels is larger.
_ENTRIES_PER_PX = 16
_STEP_PX = 1.0 / _ENTRIES_PER_PX
# The tables end this many standard deviations of the Gaussian beyond the trapezium. The error there is 3e-6.
_REACH_SIGMAS = 4.5

# Least slant of an edge [columns per row]; a more upright edge is treated as this slanted. This adds 2e-4
# px^2 to the variance of the response, which is at least 1/12 px^2. It keeps the difference quotients exact
# to 1e-5.
_MIN_SLANT = 0.05
_CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) / 2.0
_SIGNS = np.array([1.0, -1.0, -1.0, 1.0])

# Polynomial of the normal distribution, exact to 7.5e-8: M. Abramowitz and I. Stegun, Handbook of
# Mathematical Functions, 26.2.17.
_TAIL = (1.330274429, -1.821255978, 1.781477937, -0.356563782, 0.319381530)
_TAIL_SCALE = 0.2316419


class StepResponse:
    """Tables of the step response of E edges, each with its own slope and blur.

    Pixels are looked up as runs of neighbours. The entries of a table that are whole pixels apart are stored
    side by side, so that a run is one contiguous piece of the table.

    Args:
        slope: (E,) columns an edge moves a row.
        variance: (E,) variance of the Gaussian along the row [px^2].
        run_px: Pixels of a run.
    """

    def __init__(self, slope: Array, variance: Array, run_px: int) -> None:
        slant = np.maximum(np.abs(slope), _MIN_SLANT)[:, None]
        sigma = np.sqrt(variance)[:, None]
        reach_px = math.ceil(float((0.5 + slant / 2.0 + _REACH_SIGMAS * sigma).max()))
        # (corner, edge, entry)
        x = (
            _CORNERS[:, :1, None]
            + _CORNERS[:, 1:, None] * slant
            + _STEP_PX * np.arange(reach_px * _ENTRIES_PER_PX + 1)
        )
        below, normal = _normal(x / sigma)
        normal *= sigma
        integral = x * below + normal
        slope = (_SIGNS @ below.reshape(len(x), -1)).reshape(x.shape[1:]) / slant
        density = (_SIGNS @ integral.reshape(len(x), -1)).reshape(x.shape[1:]) / slant
        # (x^2 + s^2) Phi + s x phi
        integral *= x
        integral += sigma**2 * below
        share = (_SIGNS @ integral.reshape(len(x), -1)).reshape(x.shape[1:]) / (2.0 * slant)
        self._run_px, self._reach_px = run_px, reach_px
        # The share is odd about one half, the density is even, its slope is odd: half of each was computed.
        self._share = self._table(1.0 - share[:, :0:-1], share, beyond=1.0)
        self._density = self._table(density[:, :0:-1], density)
        self._density_slope = self._table(-slope[:, :0:-1], slope)

    def _table(self, left: Array, right: Array, beyond: float = 0.0) -> Array:
        """Return all runs of a table, (entries where a run may begin, run_px), a view of (E, 16, pixels)."""
        n_pixels = 2 * self._reach_px
        table = np.zeros((len(left), _ENTRIES_PER_PX, n_pixels + 2 * self._run_px))
        pixels = np.concatenate([left, right[:, :-1]], axis=1).reshape(len(left), n_pixels, _ENTRIES_PER_PX)
        table[..., self._run_px : self._run_px + n_pixels] = np.swapaxes(pixels, 1, 2)
        table[..., self._run_px + n_pixels :] = beyond
        return runs_of(table.ravel(), self._run_px)

    def at(self, distance_px: Array, edges: npt.NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Look up edges at runs of pixels.

        Args:
            distance_px: (...) columns from the edge to the middle of the first pixel of each run [px]; > 0
                where the pixel is right of the edge.
            edges: Index of the edge of each run, 0 ... E - 1; broadcasts with the distances.

        Returns:
            Share of the pixel right of the edge, its derivative by the distance [1/px], and its derivative by
            the variance of the blur [1/px^2], (..., run_px) each.
        """
        position = distance_px * float(_ENTRIES_PER_PX)
        nearest = np.rint(position)
        offset_px = ((position - nearest) * _STEP_PX)[..., None]
        pixel = np.floor(nearest * _STEP_PX)
        phase = (nearest - pixel * _ENTRIES_PER_PX).astype(np.intp)
        # The table is padded by one run on either side.
        first = self._reach_px + self._run_px
        index = np.clip(pixel, -first, self._reach_px).astype(np.intp)
        index += first
        index = index + (edges * _ENTRIES_PER_PX + phase) * (first + self._reach_px + self._run_px)
        slope, density, share = self._density_slope[index], self._density[index], self._share[index]
        change = slope * offset_px
        share += (density + change * 0.5) * offset_px
        density += change
        slope *= 0.5  # by the variance of the blur
        return share, density, slope


def runs_of(values: npt.NDArray[Any], run: int) -> npt.NDArray[Any]:
    """Return all runs of neighbours of a row of N values, (N - run + 1, run), as a view without a copy."""
    return as_strided(values, (len(values) - run + 1, run), 2 * values.strides, writeable=False)


def _normal(z: Array) -> tuple[Array, Array]:
    """Return the normal distribution's integral and density."""
    normal = np.exp(-0.5 * z * z) * (1.0 / math.sqrt(2.0 * math.pi))
    k = 1.0 / (1.0 + _TAIL_SCALE * np.abs(z))
    tail = np.zeros_like(z)
    for coefficient in _TAIL:
        tail += coefficient
        tail *= k
    tail *= normal
    return np.where(z > 0.0, 1.0 - tail, tail), normal
