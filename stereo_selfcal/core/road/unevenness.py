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

"""Unevenness of a road: deviations of its heights from a plane, as a random field whose size is estimated.

The heights of a road deviate from a plane like fractional Brownian motion. The spectrum of roads falls with a
power of the wave number, so squared differences of heights grow with a power of the distance:
``E (e(a) - e(b))^2 = D |a - b|^1.5``. The deviation is zero on the road under the camera.
The roughness D is a property of the road. It is estimated by restricted likelihood from the heights, given
the noise of the images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import Array

# The spectrum of a road falls with its waviness as the power. The waviness is 2 in the definition of ISO
# 8608, and 2.5 in the middle of measured ones (1.5 to 3.5; the smoother the road, the steeper its spectrum).
# Squared differences of heights grow with the distance to the power of waviness - 1.
_WAVINESS = 2.5
_EXPONENT = _WAVINESS - 1.0  # `_grown` has it written out
# Class A of ISO 8608 has a spectrum of 16e-6 m^3 at 0.1 cycles/m. D is twice the integral of the spectrum
# times (1 - cos) over all wave numbers, 2.7e-6 m^2 / m^1.5. This is 9 mm between points 10 m apart.
_CLASS_A = 2.7e-6
# Values of D that are tried. Each class of ISO 8608 has four times the D of the class before it. The values
# range from a thousandth of class A, in practice a plane, to a field.
_ROUGHNESS = _CLASS_A * 4.0 ** np.arange(-5.0, 5.0, 0.5)
TYPICAL_ROUGHNESS = 4.0 * _CLASS_A  # class B, used before the road's own roughness is estimated
# Values of the mismatch that are tried: the error of disparity of each cell beyond the noise [px]. Its causes
# are reflections that move with the camera, different blur, distortion, and clipped flecks of sunlight. The
# values range from none to more than any road has. If the range ended too early, a large mismatch would be
# fitted as roughness, and the covariance would be far too large.
_MISMATCH_PX = np.array([0.0, 0.02, 0.06, 0.2, 0.6])
# Mismatch that a plane can have, caused by the interpolation between pixels alone. Rendered planes without
# noise show 0.004 to 0.021 px. A larger mismatch may come from the road.
_MISMATCH_OF_PLANE_PX = _MISMATCH_PX[:2]
TYPICAL_MISMATCH_PX = 0.05
# Parabolic camber of a two-lane road, with a slope of 2.5 % at its edge 3.5 m from the crown: z = -0.0036
# y^2.
_CAMBER_PER_M = 0.0036
# Values of the camber that are tried, in units of that one: from a plane in practice to a village street.
_CAMBERS = np.array([0.125, 0.35, 1.0, 2.8])
_PROFILE_LENGTH_M = 1.0  # correlation length across the road: wheel tracks and gutters are 0.5 m to 1 m wide
# Least logarithm of the likelihood ratio at which a road is uneven: a plane is a hundred times less likely.
# Rendered planes reach e^1 and real roads e^15 and more. Real roads of which little is visible reach no more
# than planes.
_LEAST_LOG_LIKELIHOOD_RATIO = math.log(100.0)
_ROUNDING = 1e-12  # eigenvalues below this fraction of the greatest one are rounding errors


@dataclass(frozen=True, slots=True)
class RoadUnevenness:
    """Deviation of a road from a plane.

    Attributes:
        roughness: D, the mean squared difference of heights over distance^1.5 [m^2/m^1.5]; the mean of its
            posterior.
        mismatch_px: Standard deviation of the errors of the cells' disparities that neither the noise nor the
            road explains [px]; the root mean square of its posterior.
        camber: Bend across the road, in units of a usual camber (2.5 % at the edge of a two-lane road); the
            root mean square of its posterior.
        log_likelihood_ratio: Logarithm of the likelihood of the best unevenness over that of a plane.
    """

    roughness: float
    mismatch_px: float
    camber: float
    log_likelihood_ratio: float = math.inf

    @property
    def uneven(self) -> bool:
        """Whether the images show significantly that the road is not a plane."""
        return self.log_likelihood_ratio > _LEAST_LOG_LIKELIHOOD_RATIO

    @property
    def significance(self) -> float:
        """Part of the evidence for an uneven road that planes do not reach, 0 ... 1; continuous."""
        return max(0.0, 1.0 - _LEAST_LOG_LIKELIHOOD_RATIO / max(self.log_likelihood_ratio, 1e-9))

    @classmethod
    def typical(cls) -> RoadUnevenness:
        """Return the unevenness of a usual road, before its own is estimated."""
        return cls(TYPICAL_ROUGHNESS, TYPICAL_MISMATCH_PX, 1.0)


def unit_covariances(xy: Array) -> tuple[Array, Array]:
    """Return the covariances (N, N) of a road's heights for unit roughness, and for unit camber.

    The deviation by roughness is zero under the camera. The camber stands for everything that runs along the
    road: camber, gutters, ruts. It is zero along the camera's path, where the plane is defined.

    Args:
        xy: (N, 2) positions on the road, relative to the point under the camera [m].
    """
    x, y = np.ascontiguousarray(xy.T)
    beside = y[:, None] - y
    squares = beside * beside
    bent = _CAMBER_PER_M * y**2
    alike = np.exp(squares * (-0.5 / _PROFILE_LENGTH_M**2))
    alike *= bent[:, None]
    alike *= bent
    ahead = x[:, None] - x
    ahead *= ahead
    squares += ahead
    growth = _grown(x**2 + y**2)
    kernel = growth[:, None] + growth
    kernel -= _grown(squares)
    kernel *= 0.5
    return kernel, alike


def _grown(squares: Array) -> Array:
    """Return distances to the power of ``_EXPONENT``, for squared distances: by roots, which are faster."""
    distances = np.sqrt(squares)
    grown: Array = distances * np.sqrt(distances)
    return grown


def estimate_unevenness(
    y: Array, x: Array, noise: Array, profile: Array, kernel: Array, metres: Array
) -> RoadUnevenness:
    """Return the unevenness of the road, as means of its posterior.

    The likelihood is the restricted one: that of the contrasts which no plane changes. The prior gives all
    tried values the same probability.

    Args:
        y: (S,) heights of the cells [m].
        x: (S, 3) derivative of the heights by the parameters of the plane.
        noise: (S,) variances of the heights by the noise [m^2].
        profile: (S, S) covariance of the heights for unit camber.
        kernel: (S, S) covariance of the heights for unit roughness.
        metres: (S,) change of a cell's height for one pixel of disparity [m].
    """
    basis = np.linalg.qr(x, mode="complete")[0][:, x.shape[1] :]
    contrast, road_covariance = basis.T @ y, basis.T @ kernel @ basis
    noise_covariance, mismatch_covariance = (basis.T * noise) @ basis, (basis.T * metres**2) @ basis
    # In the common eigenvectors of the noise's and the roughness's covariance, both are diagonal. So each
    # value of the roughness costs one division.
    factor = np.linalg.cholesky(noise_covariance + _MISMATCH_PX[:, None, None] ** 2 * mismatch_covariance)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(inverse @ road_covariance @ np.swapaxes(inverse, 1, 2))
    scaled = 1.0 / np.sqrt(1.0 + np.clip(values, 0.0, None)[:, None] * _ROUGHNESS[:, None])
    # The camber is smooth, so that a few shapes across the road represent it, each with its own size. The
    # last row of the Cholesky factor of all products holds the part of the contrast that the shapes do not
    # explain.
    shapes = np.column_stack([basis.T @ _root(profile), contrast])
    turned = (np.swapaxes(vectors, 1, 2) @ (inverse @ shapes))[:, None] * scaled[..., None]
    products = np.swapaxes(turned, 2, 3) @ turned  # (mismatch, roughness, shapes + 1, shapes + 1)
    products[..., -1, -1] += products[..., -1, -1] * _ROUNDING + np.finfo(float).tiny
    products = np.repeat(products[:, :, None], len(_CAMBERS), axis=2)
    np.einsum("...ii->...i", products)[..., :-1] += 1.0 / _CAMBERS[:, None] ** 2
    pivots = np.diagonal(np.linalg.cholesky(products), axis1=-2, axis2=-1)
    log_likelihood = -0.5 * pivots[..., -1] ** 2 - np.log(pivots[..., :-1] * _CAMBERS[:, None]).sum(axis=-1)
    log_likelihood += np.log(scaled).sum(axis=2)[..., None]  # (mismatch, roughness, profile)
    log_root = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(
        axis=1
    )  # half the logarithm of the determinant
    log_likelihood -= log_root[:, None, None]
    posterior = np.exp(log_likelihood - log_likelihood.max())
    posterior /= posterior.sum()
    n = len(_MISMATCH_OF_PLANE_PX)  # these are the first of the values that are tried
    plane = -0.5 * ((inverse[:n] @ contrast) ** 2).sum(axis=1) - log_root[:n]
    return RoadUnevenness(
        roughness=float(posterior.sum(axis=(0, 2)) @ _ROUGHNESS),
        mismatch_px=float(np.sqrt(posterior.sum(axis=(1, 2)) @ _MISMATCH_PX**2)),
        camber=float(np.sqrt(posterior.sum(axis=(0, 1)) @ _CAMBERS**2)),
        log_likelihood_ratio=float(log_likelihood.max() - plane.max()),
    )


def _root(covariance: Array) -> Array:
    """Return the root (N, K) of a covariance (N, N) of rank K: root @ root.T is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    of_rank = values > _ROUNDING * values[-1]
    root: Array = vectors[:, of_rank] * np.sqrt(values[of_rank])
    return root
