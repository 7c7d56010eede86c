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

import numpy as np
import numpy.typing as npt

from .extrinsics import Array

# Spacing and reach of the tables [px]. Between the places the response is continued by its first and second
# derivative: exact to 1e-5 for a pixel behind no lens at all.
_STEP_PX = 1.0 / 32.0
_REACH_PX = 14.0
_HALF = round(_REACH_PX / _STEP_PX)
_PLACES = np.arange(_HALF + 1) * _STEP_PX

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

    Args:
        slope: (E,) columns an edge moves a row.
        variance: (E,) variance of the Gaussian along the row [px^2].
    """

    def __init__(self, slope: Array, variance: Array) -> None:
        slant = np.maximum(np.abs(slope), _MIN_SLANT)[:, None]
        sigma = np.sqrt(variance)[:, None]
        share, density, bend = np.zeros((3, len(slope), len(_PLACES)))
        for (a, b), sign in zip(_CORNERS, _SIGNS, strict=True):
            x = _PLACES + a + b * slant
            z = x / sigma
            below, normal = _normal(z)
            share += sign * ((x * x + sigma**2) / 2.0 * below + sigma * x / 2.0 * normal)
            density += sign * (x * below + sigma * normal)
            bend += sign * below
        # Odd about one half, even, odd: half of the table is enough.
        self._share = np.concatenate([1.0 - share[:, :0:-1] / slant, share / slant], axis=1).ravel()
        self._density = np.concatenate([density[:, :0:-1], density], axis=1).ravel() / np.repeat(
            slant, 2 * _HALF + 1
        )
        self._bend = np.concatenate([-bend[:, :0:-1], bend], axis=1).ravel() / np.repeat(slant, 2 * _HALF + 1)
        self._first = (np.arange(len(slope)) * (2 * _HALF + 1) + _HALF)[:, None]

    def at(self, distance_px: Array) -> tuple[Array, Array, Array]:
        """Look up all edges at their pixels.

        Args:
            distance_px: (E, N) columns from the edge to the middle of the pixel, > 0: right of it [px].

        Returns:
            Share of the pixel right of the edge, its derivative by the distance [1/px], and its derivative by
            the variance of the blur [1/px^2], (E, N) each.
        """
        place = np.clip(distance_px * (1.0 / _STEP_PX), -_HALF, _HALF)
        nearest = np.rint(place)
        rest = (place - nearest) * _STEP_PX
        index: npt.NDArray[np.intp] = nearest.astype(np.intp)
        index += self._first
        bend = self._bend[index]
        density = self._density[index]
        share = self._share[index]
        share += rest * (density + rest * bend * 0.5)
        density += rest * bend
        bend *= 0.5
        return share, density, bend


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
