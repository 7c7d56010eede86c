"""The response of pixel and lens to the edge of a stripe, tabulated.

A pixel is a box of area 1. A straight edge that moves m columns a row is felt by it as by a box of
width 1 convolved with a box as wide as m, and a Gaussian lens of standard deviation s blurs it along
the row by ``s sqrt(1 + m^2)``. The step response is the second integral of the normal distribution at the
four corners of that trapezium::

    S(t) = [Q(t + a + b) - Q(t + a - b) - Q(t - a + b) + Q(t - a - b)] / (4 a b),  a = 1/2, b = |m| / 2
    Q(x) = (x^2 + s^2) / 2 * Phi(x / s) + s x / 2 * phi(x / s)

and its derivative by the variance of the Gaussian is half its second derivative by t (the heat equation).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import as_strided

from ..types import Array

# Spacing of the tables, a part of a pixel. Between the places the response is continued by its first and
# second derivative: exact to 4e-5 for a lens that blurs by a fifth of a pixel, less than a grey level has by
# rounding.
_PLACES_PER_PX = 16
_STEP_PX = 1.0 / _PLACES_PER_PX
# Reach of the tables in standard deviations of the Gaussian beyond the trapezium: exact to 3e-6 as well.
_REACH_SIGMAS = 4.5

# An edge more upright than this [columns per row] is taken as this slanted: it adds 2e-4 px^2 to the
# variance of the response, 1/12 px^2 and more, and keeps the quotients of differences exact to 1e-5.
_MIN_SLANT = 0.05
_CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) / 2.0
_SIGNS = np.array([1.0, -1.0, -1.0, 1.0])

# Normal distribution, M. Abramowitz and I. Stegun, Handbook of Mathematical Functions, 26.2.17: to 7.5e-8.
_TAIL = (1.330274429, -1.821255978, 1.781477937, -0.356563782, 0.319381530)
_TAIL_SCALE = 0.2316419


class StepResponse:
    """Tables of the step response of E edges, each with its own slope and blur.

    Pixels are looked up as runs of neighbours: a table has the places that are whole pixels apart side by
    side, so that a run is one piece of it.

    Args:
        slope: (E,) columns an edge moves a row.
        variance: (E,) variance of the Gaussian along the row [px^2].
        run_px: Pixels of a run.
    """

    def __init__(self, slope: Array, variance: Array, run_px: int) -> None:
        slant = np.maximum(np.abs(slope), _MIN_SLANT)[:, None]
        sigma = np.sqrt(variance)[:, None]
        reach_px = math.ceil(float((0.5 + slant / 2.0 + _REACH_SIGMAS * sigma).max()))
        # (corner, edge, place)
        x = (
            _CORNERS[:, :1, None]
            + _CORNERS[:, 1:, None] * slant
            + _STEP_PX * np.arange(reach_px * _PLACES_PER_PX + 1)
        )
        below, normal = _normal(x / sigma)
        normal *= sigma
        integral = x * below + normal
        bend = (_SIGNS @ below.reshape(len(x), -1)).reshape(x.shape[1:]) / slant
        density = (_SIGNS @ integral.reshape(len(x), -1)).reshape(x.shape[1:]) / slant
        # (x^2 + s^2) Phi + s x phi
        integral *= x
        integral += sigma**2 * below
        share = (_SIGNS @ integral.reshape(len(x), -1)).reshape(x.shape[1:]) / (2.0 * slant)
        self._run_px, self._reach_px = run_px, reach_px
        # Odd about one half, even, odd: half of the table is enough.
        self._share = self._table(1.0 - share[:, :0:-1], share, beyond=1.0)
        self._density = self._table(density[:, :0:-1], density)
        self._bend = self._table(-bend[:, :0:-1], bend)

    def _table(self, left: Array, right: Array, beyond: float = 0.0) -> Array:
        """Return all runs of a table, (places where a run may begin, run_px), a view of (E, 32, pixels)."""
        n_pixels = 2 * self._reach_px
        table = np.zeros((len(left), _PLACES_PER_PX, n_pixels + 2 * self._run_px))
        by_pixel = np.concatenate([left, right[:, :-1]], axis=1).reshape(len(left), n_pixels, _PLACES_PER_PX)
        table[..., self._run_px : self._run_px + n_pixels] = np.swapaxes(by_pixel, 1, 2)
        table[..., self._run_px + n_pixels :] = beyond
        return runs_of(table.ravel(), self._run_px)

    def at(self, distance_px: Array, edges: npt.NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Look up edges at runs of pixels.

        Args:
            distance_px: (...) columns from the edge to the middle of the first pixel of each run, > 0: right
                of it [px].
            edges: Their edges, 0 ... E - 1; of a shape that fits.

        Returns:
            Share of the pixel right of the edge, its derivative by the distance [1/px], and its derivative by
            the variance of the blur [1/px^2], (..., run_px) each.
        """
        place = distance_px * float(_PLACES_PER_PX)
        nearest = np.rint(place)
        rest = ((place - nearest) * _STEP_PX)[..., None]
        pixel = np.floor(nearest * _STEP_PX)
        phase = (nearest - pixel * _PLACES_PER_PX).astype(np.intp)
        # Beyond its reach the table goes on for a run.
        first = self._reach_px + self._run_px
        index = np.clip(pixel, -first, self._reach_px).astype(np.intp)
        index += first
        index = index + (edges * _PLACES_PER_PX + phase) * (first + self._reach_px + self._run_px)
        bend, density, share = self._bend[index], self._density[index], self._share[index]
        change = bend * rest
        share += (density + change * 0.5) * rest
        density += change
        bend *= 0.5
        return share, density, bend


def runs_of(values: npt.NDArray[Any], run: int) -> npt.NDArray[Any]:
    """Return all runs of neighbours of a row of values, (N - run + 1, run), as a view that costs nothing."""
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
