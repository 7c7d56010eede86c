"""The plane of a road that is none: robust fit to heights of cells, and what the unevenness leaves unknown.

The heights of a road deviate from a plane like fractional Brownian motion: the spectrum of roads falls with a
power of the wave number, so squared differences of heights grow with a power of the distance,
``E (e(a) - e(b))^2 = D |a - b|^1.5``. The walk starts on the road under the camera.
The one number D is the road's; it is estimated by restricted likelihood from the heights themselves, after
what the images' noise explains. The plane is the generalised least squares fit, and its covariance
contains the noise and the road: another sensor, or the same one on the next stretch, fits another plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..numerics.statistics import median
from ..rejection import Bound, NotFitted
from ..types import Array

# The spectrum of a road falls with its waviness as the power: 2 in ISO 8608's definition, 2.5 in the middle
# of what is measured (1.5 to 3.5, the smoother the road, the steeper). Squared differences of heights grow
# with the power of waviness - 1 of the distance.
_WAVINESS = 2.5
_EXPONENT = _WAVINESS - 1.0
# D tried: class A of ISO 8608 has a spectrum of 16e-6 m^3 at 0.1 cycles/m, and twice the integral of the
# spectrum times (1 - cos) over all wave numbers is 2.7e-6 m^2 / m^1.5: 9 mm between points 10 m apart. Each
# class has four times that of the one before it; tried from a thousandth, a plane in practice, to a field.
_CLASS_A = 2.7e-6
_ROUGHNESS = _CLASS_A * 4.0 ** np.arange(-5.0, 5.0, 0.5)
_TYPICAL_ROUGHNESS = 4.0 * _CLASS_A  # class B, before the road's own is known
# Error of disparity every cell has beyond the noise [px]: shine that moves with the camera, unlike blur,
# distortion, flecks of sunlight that are clipped. From none to more than any road has: where the range ends
# too early, what cells scatter passes for a road of hollows, which is far less sure.
_MISMATCH_PX = np.array([0.0, 0.02, 0.06, 0.2, 0.6])
# What a plane has of that, by the interpolation between pixels alone: rendered planes without noise show
# 0.004 to 0.021 px. More than that may be the road's.
_MISMATCH_OF_PLANE_PX = _MISMATCH_PX[:2]
_TYPICAL_MISMATCH_PX = 0.05
# Parabolic camber of a two-lane road, 2.5 % at its edge 3.5 m from the crown: z = -0.0036 y^2.
_CAMBER_PER_M = 0.0036
_PROFILES = np.array([0.125, 0.35, 1.0, 2.8])  # times that: from a plane in practice to a village street
_PROFILE_LENGTH_M = 1.0  # wheel tracks and gutters are half a metre to a metre wide
# A road is no plane where that is a hundred times less likely: rendered planes reach e^1, real roads e^15 and
# more, or as little as planes where little of them is seen.
_LEAST_EVIDENCE = math.log(100.0)
_WORST_STD_M = 0.3  # two kerbs: a cell that cannot tell them apart says nothing of the road
_LEAST_CELLS = 6  # twice the numbers of a plane
_OUTLIER_WEIGHT = 0.5  # Tukey's at 2.5 robust standard deviations
_ROUNDING = 1e-12  # of the greatest eigenvalue: what is less is that of the arithmetic
LEAST_WEIGHT = 1e-3  # an outlier's variance is a thousand times its squared distance at most
_REWEIGHTING = Reweighting(rounds=8, absolute_rounds=8, least_weight=LEAST_WEIGHT**2)
_SCALE = scale_by_median(1e-9, median)  # where three cells decide, nothing scatters


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Heights of the cells of a road.

    Attributes:
        heights: (C,) over a first plane [m]; NaN where a cell was not measured.
        variances: (C,) of them by the noise of the images [m^2].
        metres: (C,) height by which a pixel of disparity moves a cell [m].
        xy: (C, 2) position, from the point under the camera [m].
    """

    heights: Array
    variances: Array
    metres: Array
    xy: Array


@dataclass(frozen=True, slots=True)
class RoadUnevenness:
    """What of the road is no plane.

    Attributes:
        roughness: D, mean of its posterior: mean squared difference of heights over distance^1.5 [m^2/m^1.5].
        mismatch_px: Error of the cells' disparities that neither noise nor road explains, standard deviation.
        profile: Bend across the road, in units of a usual camber (2.5 % at the edge of a two-lane road), root
            mean square of its posterior.
        evidence: Logarithm of the likelihood of the best shape over that of a plane.
    """

    roughness: float
    mismatch_px: float
    profile: float
    evidence: float = math.inf

    @property
    def uneven(self) -> bool:
        """Whether the road is surely no plane, as far as the images show it."""
        return self.evidence > _LEAST_EVIDENCE


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Plane through heights of cells.

    Attributes:
        plane: (3,) coefficients of the design.
        covariance: (3, 3) of them, noise and unevenness.
        noise_covariance: (3, 3) by the noise alone.
        covariance_by_cause: What the covariance is the sum of, (3, 3) each, by name.
        shape: What of the road is no plane.
        weights: (C,) robust weights, 0 ... 1.
        residuals: (C,) heights over the plane [m]; NaN where not measured.
        noise_variance: (C,) of them [m^2].
    """

    plane: Array
    covariance: Array
    noise_covariance: Array
    covariance_by_cause: dict[str, Array]
    shape: RoadUnevenness
    weights: Array
    residuals: Array
    noise_variance: Array


def fit_surface(cells: Cells, design: Array, *, final: bool = True) -> Surface | NotFitted:
    """Fit the plane of a road.

    Args:
        cells: What was measured.
        design: (C, 3) heights by the parameters of the plane.
        final: Whether to estimate the road's own roughness; else a typical one serves.

    Returns:
        The plane, or why the measured cells do not determine one.
    """
    seen = np.isfinite(cells.heights) & (cells.variances < _WORST_STD_M**2)  # false for NaN as well
    n_seen = int(np.count_nonzero(seen))
    if n_seen < _LEAST_CELLS:
        return NotFitted("cells whose height is known", n_seen, Bound.LEAST, _LEAST_CELLS)
    y, x, noise, at = cells.heights[seen], design[seen], cells.variances[seen], cells.xy[seen]
    greatest = np.abs(x).max(axis=0)  # zero where all cells are straight before the camera
    rank = 0 if np.any(greatest == 0.0) else int(np.linalg.matrix_rank(x / greatest))
    if rank < x.shape[1]:
        return NotFitted("numbers of the plane that the cells determine", rank, Bound.LEAST, x.shape[1])
    kernel, profile = kernels(at)
    typical = (
        noise
        + (_TYPICAL_MISMATCH_PX * cells.metres[seen]) ** 2
        + _TYPICAL_ROUGHNESS * np.diag(kernel)
        + np.diag(profile)
    )
    weights, off = _robust_weights(y, x, np.sqrt(typical))
    # An outlier is a cell with a larger variance: it tells less of the plane.
    # No part of that for the others: it would pass for noise what is the road's shape.
    outlier = weights < _OUTLIER_WEIGHT
    inflated = noise + np.where(outlier, off**2 / np.maximum(weights, LEAST_WEIGHT), 0.0)
    shape = RoadUnevenness(_TYPICAL_ROUGHNESS, _TYPICAL_MISMATCH_PX, 1.0)
    if final:
        shape = _likely(y, x, inflated, profile, kernel, cells.metres[seen])
    inflated = inflated + (shape.mismatch_px * cells.metres[seen]) ** 2
    total = shape.roughness * kernel + shape.profile**2 * profile + np.diag(inflated)
    weighted = np.linalg.solve(total, x).T
    covariance = np.linalg.inv(weighted @ x)
    solve = covariance @ weighted
    plane = solve @ y
    everywhere = np.zeros(len(cells.heights))
    everywhere[seen] = weights
    return Surface(
        plane=plane,
        covariance=covariance,
        noise_covariance=(solve * inflated) @ solve.T,
        covariance_by_cause={
            "noise": (solve * noise) @ solve.T,
            "mismatch": (solve * (inflated - noise)) @ solve.T,
            "roughness": shape.roughness * solve @ kernel @ solve.T,
            "camber": shape.profile**2 * solve @ profile @ solve.T,
        },
        shape=shape,
        weights=everywhere,
        residuals=cells.heights - design @ plane,
        noise_variance=cells.variances + (shape.mismatch_px * cells.metres) ** 2,
    )


def kernels(xy: Array) -> tuple[Array, Array]:
    """Return the covariances (N, N) of a road's heights at places (N, 2): of unit roughness, of unit profile.

    The walk along the road starts under the camera. The profile is what runs along the road (camber, gutters,
    ruts); it begins beside the camera, where the plane is meant.
    """
    growth = np.linalg.norm(xy, axis=1) ** _EXPONENT
    apart = np.linalg.norm(xy[:, None] - xy, axis=-1)
    bent = _CAMBER_PER_M * xy[:, 1] ** 2
    alike = np.exp(-0.5 * ((xy[:, None, 1] - xy[:, 1]) / _PROFILE_LENGTH_M) ** 2)
    return 0.5 * (growth[:, None] + growth - apart**_EXPONENT), bent[:, None] * bent * alike


def _robust_weights(y: Array, x: Array, sigma: Array) -> tuple[Array, Array]:
    """Return the weights (S,) of a robust fit, from least absolute deviations on, and the distances (S,)."""
    rows, target = x / sigma[:, None], y / sigma

    def fit(weights: Array, _: object) -> tuple[Array, Array]:
        weighted = rows.T * weights
        plane = np.linalg.solve(weighted @ rows, weighted @ target)
        return plane, target - rows @ plane

    found = fit_reweighted(fit, len(y), _REWEIGHTING, _SCALE)
    assert not isinstance(found, NotFitted)  # the cells determine a plane, with any weights
    return found.weights, found.residuals * sigma


def _likely(y: Array, x: Array, noise: Array, profile: Array, kernel: Array, metres: Array) -> RoadUnevenness:
    """Return what the heights say of the road's shape: means of the posterior.

    The likelihood is the restricted one: of the contrasts that no plane changes. Before, all values
    tried are equally probable.
    """
    basis = np.linalg.qr(x, mode="complete")[0][:, x.shape[1] :]
    contrast, road_covariance = basis.T @ y, basis.T @ kernel @ basis
    noise_covariance, mismatch_covariance = (basis.T * noise) @ basis, (basis.T * metres**2) @ basis
    # One basis for everything else and the road, so that every roughness is a division.
    factor = np.linalg.cholesky(noise_covariance + _MISMATCH_PX[:, None, None] ** 2 * mismatch_covariance)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(inverse @ road_covariance @ np.swapaxes(inverse, 1, 2))
    scaled = 1.0 / np.sqrt(1.0 + np.clip(values, 0.0, None)[:, None] * _ROUGHNESS[:, None])
    # The profile is smooth: a few shapes across the road make it up, each with its own size. The Cholesky
    # factor of their products with each other and the contrast has what they leave of it in its last row.
    shapes = np.column_stack([basis.T @ _root(profile), contrast])
    turned = (np.swapaxes(vectors, 1, 2) @ (inverse @ shapes))[:, None] * scaled[..., None]
    products = np.swapaxes(turned, 2, 3) @ turned  # (mismatch, roughness, shapes + 1, shapes + 1)
    products[..., -1, -1] += products[..., -1, -1] * _ROUNDING + np.finfo(float).tiny
    products = np.repeat(products[:, :, None], len(_PROFILES), axis=2)
    np.einsum("...ii->...i", products)[..., :-1] += 1.0 / _PROFILES[:, None] ** 2
    pivots = np.diagonal(np.linalg.cholesky(products), axis1=-2, axis2=-1)
    log_likelihood = -0.5 * pivots[..., -1] ** 2 - np.log(pivots[..., :-1] * _PROFILES[:, None]).sum(axis=-1)
    log_likelihood += np.log(scaled).sum(axis=2)[..., None]  # (mismatch, roughness, profile)
    log_root = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)  # of the determinant
    log_likelihood -= log_root[:, None, None]
    posterior = np.exp(log_likelihood - log_likelihood.max())
    posterior /= posterior.sum()
    n = len(_MISMATCH_OF_PLANE_PX)  # the first of those tried
    plane = -0.5 * ((inverse[:n] @ contrast) ** 2).sum(axis=1) - log_root[:n]
    return RoadUnevenness(
        roughness=float(posterior.sum(axis=(0, 2)) @ _ROUGHNESS),
        mismatch_px=float(np.sqrt(posterior.sum(axis=(1, 2)) @ _MISMATCH_PX**2)),
        profile=float(np.sqrt(posterior.sum(axis=(0, 1)) @ _PROFILES**2)),
        evidence=float(log_likelihood.max() - plane.max()),
    )


def _root(covariance: Array) -> Array:
    """Return the root (N, K) of a covariance (N, N) of few shapes: root @ root.T is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    of_rank = values > _ROUNDING * values[-1]
    root: Array = vectors[:, of_rank] * np.sqrt(values[of_rank])
    return root
