"""The plane of an uneven road: a robust fit to the heights of cells, with the unevenness in its covariance.

The heights of a road deviate from a plane like fractional Brownian motion. The spectrum of roads falls with a
power of the wave number, so squared differences of heights grow with a power of the distance:
``E (e(a) - e(b))^2 = D |a - b|^1.5``. The deviation is zero on the road under the camera.
The roughness D is a property of the road. It is estimated by restricted likelihood from the heights, given
the noise of the images. The plane is the generalised least squares fit. Its covariance contains the noise and
the unevenness, because another sensor, or the same one on the next stretch of road, fits another plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numerics.linear import invert, is_covariance, rank_of, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..numerics.statistics import median
from ..rejection import Bound, NotFitted
from ..types import Array

# The spectrum of a road falls with its waviness as the power. The waviness is 2 in the definition of ISO
# 8608, and 2.5 in the middle of measured ones (1.5 to 3.5; the smoother the road, the steeper its spectrum).
# Squared differences of heights grow with the distance to the power of waviness - 1.
_WAVINESS = 2.5
_EXPONENT = _WAVINESS - 1.0
# Class A of ISO 8608 has a spectrum of 16e-6 m^3 at 0.1 cycles/m. D is twice the integral of the spectrum
# times (1 - cos) over all wave numbers, 2.7e-6 m^2 / m^1.5. This is 9 mm between points 10 m apart.
_CLASS_A = 2.7e-6
# Values of D that are tried. Each class of ISO 8608 has four times the D of the class before it. The values
# range from a thousandth of class A, in practice a plane, to a field.
_ROUGHNESS = _CLASS_A * 4.0 ** np.arange(-5.0, 5.0, 0.5)
_TYPICAL_ROUGHNESS = 4.0 * _CLASS_A  # class B, used before the road's own roughness is estimated
# Values of the mismatch that are tried: the error of disparity of each cell beyond the noise [px]. Its causes
# are reflections that move with the camera, different blur, distortion, and clipped flecks of sunlight. The
# values range from none to more than any road has. If the range ended too early, a large mismatch would be
# fitted as roughness, and the covariance would be far too large.
_MISMATCH_PX = np.array([0.0, 0.02, 0.06, 0.2, 0.6])
# Mismatch that a plane can have, caused by the interpolation between pixels alone. Rendered planes without
# noise show 0.004 to 0.021 px. A larger mismatch may come from the road.
_MISMATCH_OF_PLANE_PX = _MISMATCH_PX[:2]
_TYPICAL_MISMATCH_PX = 0.05
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
_WORST_STD_M = 0.3  # most standard deviation of a usable cell: the height of two kerbs
_DETERMINED = "numbers of the plane that the cells determine"
_LEAST_CELLS = 6  # twice the number of a plane's parameters
_OUTLIER_WEIGHT = 0.5  # Tukey's weight at 2.5 robust standard deviations
_ROUNDING = 1e-12  # eigenvalues below this fraction of the greatest one are rounding errors
LEAST_WEIGHT = 1e-3  # so the variance of an outlier is at most a thousand times its squared distance
_REWEIGHTING = Reweighting(rounds=8, absolute_rounds=8, least_weight=LEAST_WEIGHT**2)
_SCALE = scale_by_median(1e-9, median)  # the least scale matters where three cells are fitted exactly


@dataclass(frozen=True, slots=True, eq=False)
class CellHeights:
    """Heights of the cells of a road.

    Attributes:
        heights: (C,) heights over a first plane [m]; NaN where a cell was not measured.
        variances: (C,) variances of the heights caused by the noise of the images [m^2].
        metres: (C,) change of a cell's height for one pixel of disparity [m].
        xy: (C, 2) positions relative to the point under the camera [m].
    """

    heights: Array
    variances: Array
    metres: Array
    xy: Array


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


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Plane through the heights of cells.

    Attributes:
        plane: (3,) coefficients of the design's columns.
        covariance: (3, 3) of the coefficients, caused by noise and unevenness.
        noise_covariance: (3, 3) of the coefficients, caused by the noise and the mismatch alone.
        covariance_terms: Terms of the covariance, (3, 3) each, by name.
        unevenness: Deviation of the road from the plane.
        weights: (C,) robust weights, 0 ... 1.
        residuals: (C,) heights over the plane [m]; NaN where a cell was not measured.
        noise_variance: (C,) variances of these heights, caused by the noise and the mismatch [m^2].
    """

    plane: Array
    covariance: Array
    noise_covariance: Array
    covariance_terms: dict[str, Array]
    unevenness: RoadUnevenness
    weights: Array
    residuals: Array
    noise_variance: Array


def fit_surface(cells: CellHeights, design: Array, *, final: bool = True) -> Surface | NotFitted:
    """Fit the plane of a road.

    Args:
        cells: The measured heights.
        design: (C, 3) derivative of the heights by the parameters of the plane.
        final: Whether to estimate the road's own unevenness; else a typical one is used.

    Returns:
        The plane, or the reason why the measured cells do not determine one.
    """
    seen = np.isfinite(cells.heights) & (cells.variances < _WORST_STD_M**2)  # false for NaN as well
    n_seen = int(np.count_nonzero(seen))
    if n_seen < _LEAST_CELLS:
        return NotFitted("cells whose height is known", n_seen, Bound.LEAST, _LEAST_CELLS)
    y, x, noise, at = cells.heights[seen], design[seen], cells.variances[seen], cells.xy[seen]
    greatest = np.abs(x).max(axis=0)  # a column is zero where all cells are straight ahead of the camera
    rank = 0 if np.any(greatest == 0.0) else rank_of(x / greatest)
    if rank < x.shape[1]:
        return NotFitted(_DETERMINED, rank, Bound.LEAST, x.shape[1])
    kernel, profile = unit_covariances(at)
    typical = (
        noise
        + (_TYPICAL_MISMATCH_PX * cells.metres[seen]) ** 2
        + _TYPICAL_ROUGHNESS * np.diag(kernel)
        + np.diag(profile)
    )
    robust = _robust_weights(y, x, np.sqrt(typical))
    if isinstance(robust, NotFitted):
        return robust
    weights, off = robust
    # An outlier gets a larger variance, so that it counts less. The variances of the other cells stay as they
    # are; otherwise unevenness of the road would be treated as noise.
    outlier = weights < _OUTLIER_WEIGHT
    inflated = noise + np.where(outlier, off**2 / np.maximum(weights, LEAST_WEIGHT), 0.0)
    unevenness = RoadUnevenness(_TYPICAL_ROUGHNESS, _TYPICAL_MISMATCH_PX, 1.0)
    if final:
        try:
            unevenness = _estimate_unevenness(y, x, inflated, profile, kernel, cells.metres[seen])
        except np.linalg.LinAlgError:  # variances so different that rounding decides
            return NotFitted("covariances of the cells that can be inverted", 0, Bound.LEAST, 1)
    inflated = inflated + (unevenness.mismatch_px * cells.metres[seen]) ** 2
    total = unevenness.roughness * kernel + unevenness.camber**2 * profile + np.diag(inflated)
    least_squares = _least_squares(total, x)
    if isinstance(least_squares, NotFitted):
        return least_squares
    covariance, solve = least_squares
    plane = solve @ y
    everywhere = np.zeros(len(cells.heights))
    everywhere[seen] = weights
    return Surface(
        plane=plane,
        covariance=covariance,
        noise_covariance=(solve * inflated) @ solve.T,
        covariance_terms={
            "noise": (solve * noise) @ solve.T,
            "mismatch": (solve * (inflated - noise)) @ solve.T,
            "roughness": unevenness.roughness * solve @ kernel @ solve.T,
            "camber": unevenness.camber**2 * solve @ profile @ solve.T,
        },
        unevenness=unevenness,
        weights=everywhere,
        residuals=cells.heights - design @ plane,
        noise_variance=cells.variances + (unevenness.mismatch_px * cells.metres) ** 2,
    )


def unit_covariances(xy: Array) -> tuple[Array, Array]:
    """Return the covariances (N, N) of a road's heights for unit roughness, and for unit camber.

    The deviation by roughness is zero under the camera. The camber stands for everything that runs along the
    road: camber, gutters, ruts. It is zero along the camera's path, where the plane is defined.

    Args:
        xy: (N, 2) positions on the road, relative to the point under the camera [m].
    """
    growth = np.linalg.norm(xy, axis=1) ** _EXPONENT
    apart = np.linalg.norm(xy[:, None] - xy, axis=-1)
    bent = _CAMBER_PER_M * xy[:, 1] ** 2
    alike = np.exp(-0.5 * ((xy[:, None, 1] - xy[:, 1]) / _PROFILE_LENGTH_M) ** 2)
    return 0.5 * (growth[:, None] + growth - apart**_EXPONENT), bent[:, None] * bent * alike


def _least_squares(total: Array, x: Array) -> tuple[Array, Array] | NotFitted:
    """Return the covariance (3, 3) of a plane, and the matrix (3, S) that gives it from the heights.

    Args:
        total: (S, S) covariance of the heights.
        x: (S, 3) derivative of the heights by the parameters of the plane.
    """
    weighted = solve_linear(total, x, "heights of the cells that are independent")
    if isinstance(weighted, NotFitted):
        return weighted
    covariance = invert(weighted.T @ x, _DETERMINED)
    if isinstance(covariance, NotFitted):
        return covariance
    if not is_covariance(covariance):
        return NotFitted(_DETERMINED, min(rank_of(covariance), 2), Bound.LEAST, len(covariance))
    return covariance, covariance @ weighted.T


def _robust_weights(y: Array, x: Array, sigma: Array) -> tuple[Array, Array] | NotFitted:
    """Return the weights (S,) and the residuals (S,) of a robust fit that begins with absolute deviations."""
    rows, target = x / sigma[:, None], y / sigma

    def fit(weights: Array, _: object) -> tuple[Array, Array] | NotFitted:
        weighted = rows.T * weights
        plane = solve_linear(weighted @ rows, weighted @ target, _DETERMINED)
        if isinstance(plane, NotFitted):
            return plane
        return plane, target - rows @ plane

    found = fit_reweighted(fit, len(y), _REWEIGHTING, _SCALE)
    if isinstance(found, NotFitted):
        return found
    return found.weights, found.residuals * sigma


def _estimate_unevenness(
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
