"""How far the road extends to either side, and which of its cells are no road surface.

A pavement, a verge or a traffic island beside the lane may hold half of the cells. It is higher than the road
by a step that runs along it. So each side may end at a step: the heights beyond it have an unknown offset.
Of all such extents, the one with the greatest likelihood is taken, with a prior against steps. Within it,
cars and other obstacles are outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..numerics.statistics import SIGMA_OVER_MAD
from ..rejection import Bound, NotFitted
from ..types import Array, Indices, Mask

# Standard deviation of the height of what begins at a step: kerbs are 6 to 18 cm high. Each cell beyond it
# deviates further, as verges are no planes.
_STEP_STD_M, _BESIDE_STD_M = 0.15, 0.03
# A step within the few metres beside a lane is taken as rare as one in twenty, so that it needs evidence.
_STEP_LOG_ODDS = math.log(20.0)
_LEAST_STRIPS = 2  # of a road: with one, the roll is open

OUTLIER_WEIGHT = 0.5  # Tukey's weight at 2.5 robust standard deviations
LEAST_WEIGHT = 1e-3  # so the variance of an outlier is at most a thousand times its squared distance
_ROUNDS = 8  # of reweighting
_LEAST_COUNT = LEAST_WEIGHT**2  # least weight in the fit: it keeps the equations regular
# Planes through three cells that are tried: with 60 % of outliers, all but one in 10 000 of such draws hold a
# triple without any.
_N_TRIPLES = 200
_LEAST_SPREAD = 1e-4  # of a triple of cells: the determinant of its rows, each of length 1
# Least scale of the residuals: a road has no cell to a third of what the prior of its unevenness says.
_LEAST_SCALE = 1.0 / 3.0
_BORDER = 1e100  # more than any whitened height
_ENOUGH = "cells of a road of two strips that determine a plane"


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The cells that are road.

    Attributes:
        strips: First and last strip of the road.
        weights: (S,) robust weights, 0 ... 1; 0 beyond the road.
        variances: (S,) variances of the heights by noise; of outliers, and beyond the road, by their distance
            from it [m^2].
    """

    strips: tuple[int, int]
    weights: Array
    variances: Array


def find_extent(
    heights: Array, design: Array, noise: Array, road: Array, strip: Indices, middle: int
) -> Extent | NotFitted:
    """Return which cells are road.

    Args:
        heights: (S,) heights of the cells over a first plane [m].
        design: (S, 3) derivative of the heights by the parameters of a plane.
        noise: (S,) variances of the heights by noise [m^2].
        road: (S, S) covariance of the heights of a usual road.
        strip: (S,) strip along the road in which each cell lies.
        middle: Strip of the camera's path, which is road.
    """
    sigma = np.sqrt(noise + np.diag(road))
    first, last = int(strip.min()), int(strip.max())
    extents = [
        (i, j)
        for i in range(first, middle + 1)
        for j in range(middle, last + 1)
        if j - i + 1 >= _LEAST_STRIPS
    ]
    insides = np.array([(strip >= i) & (strip <= j) for i, j in extents]).reshape(-1, len(strip))
    rows, target = design / sigma[:, None], heights / sigma
    chosen, planes = _most_agreed(rows, target, insides)
    if not len(chosen):
        return NotFitted(_ENOUGH, 0, Bound.LEAST, 1)
    insides = insides[chosen]
    weights, residuals = _robust_fits(rows, target, insides, planes)
    # An outlier gets a larger variance, so that it counts less. The variances of the other cells stay as they
    # are; otherwise unevenness of the road would be treated as noise.
    added = (residuals * sigma) ** 2 / np.maximum(weights, LEAST_WEIGHT)
    variances = noise + np.where(insides & (weights < OUTLIER_WEIGHT), added, 0.0)
    ends = np.array(extents)[chosen]
    likelihoods = _log_likelihoods(heights, design, road + _beyond(strip, ends), variances)
    likelihoods -= _STEP_LOG_ODDS * ((ends[:, 0] > first).astype(float) + (ends[:, 1] < last))
    best = int(np.argmax(likelihoods))
    inside, no_road = insides[best], noise + (_STEP_STD_M / LEAST_WEIGHT) ** 2
    return Extent(
        extents[chosen[best]],
        np.where(inside, weights[best], 0.0),
        np.where(inside, variances[best], no_road),
    )


def _beyond(strip: Indices, ends: Indices) -> Array:
    """Return the covariances (E, S, S) that the steps at the ends (E, 2) of extents add beyond them."""
    left, right = (strip < ends[:, :1]).astype(float), (strip > ends[:, 1:]).astype(float)
    steps = left[:, :, None] * left[:, None] + right[:, :, None] * right[:, None]
    steps *= _STEP_STD_M**2
    np.einsum("eii->ei", steps)[...] += _BESIDE_STD_M**2 * (left + right)
    added: Array = steps
    return added


def _log_likelihoods(heights: Array, design: Array, covariances: Array, variances: Array) -> Array:
    """Return restricted log likelihoods of heights: those of the contrasts which no plane changes.

    Args:
        heights: (S,) heights.
        design: (S, 3) derivative of the heights by the parameters of a plane.
        covariances: (E, S, S) of the heights, without what differs from cell to cell.
        variances: (E, S) of that.
    """
    n, columns = len(heights), np.column_stack([design, heights])
    # The factor of a covariance with more rows below it holds these rows, whitened. Their own part of it is
    # of no use, and as large as keeps the whole positive definite.
    bordered = np.zeros((len(covariances), n + columns.shape[1], n + columns.shape[1]))
    bordered[:, :n, :n] = covariances
    bordered[:, n:, :n] = columns.T
    diagonal = np.einsum("eii->ei", bordered)
    diagonal[:, :n] += variances
    diagonal[:, n:] = _BORDER
    factors = np.linalg.cholesky(bordered)  # of the lower triangles
    whitened = np.swapaxes(factors[:, n:, :n], 1, 2)
    # The last diagonal number of the triangular factor is the contrast's length.
    diagonals = np.abs(np.diagonal(np.linalg.qr(whitened, mode="r"), axis1=1, axis2=2))
    scales = np.maximum(diagonals, np.finfo(float).tiny)
    roots = np.diagonal(factors, axis1=1, axis2=2)[:, :n]
    log_determinants = np.log(roots).sum(axis=1) + np.log(scales[:, :-1]).sum(axis=1)
    likelihoods: Array = -log_determinants - 0.5 * scales[:, -1] ** 2
    return likelihoods


def _robust_fits(rows: Array, target: Array, insides: Mask, planes: Array) -> tuple[Array, Array]:
    """Fit a plane robustly to each extent, from a first one: MM-estimates (Yohai, 1987), all at once.

    Args:
        rows: (S, 3) derivative of the cells' heights by the parameters of a plane, in standard deviations.
        target: (S,) heights, in standard deviations.
        insides: (E, S) cells of each extent.
        planes: (E, 3) first planes.

    Returns:
        Robust weights (E, S), 0 ... 1, and residuals (E, S) in standard deviations.
    """
    products = rows[:, :, None] * rows[:, None, :]
    residuals = target - planes @ rows.T
    scale = np.ones(len(insides))
    for _ in range(_ROUNDS):
        weights = insides * tukey_weights((residuals / (TUKEY_SIGMAS * scale[:, None])) ** 2, _LEAST_COUNT)
        normal = np.tensordot(weights, products, axes=1)
        normal = normal + np.finfo(float).eps * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        planes = np.linalg.solve(normal, ((weights * target) @ rows)[..., None])[..., 0]
        residuals = target - planes @ rows.T
        scale = _scales(residuals, insides)
    weights = insides * tukey_weights((residuals / (TUKEY_SIGMAS * scale[:, None])) ** 2, _LEAST_COUNT)
    return weights, residuals


def _most_agreed(rows: Array, target: Array, insides: Mask) -> tuple[Indices, Array]:
    """Return for each extent the plane through three of its cells that most of them agree with.

    Args:
        rows: (S, 3) derivative of the cells' heights by the parameters of a plane, in standard deviations.
        target: (S,) heights, in standard deviations.
        insides: (E, S) cells of each extent.

    Returns:
        Which extents have enough cells that determine a plane, (K,), and these planes (K, 3).
    """
    n_numbers = rows.shape[1]
    enough = np.flatnonzero(insides.sum(axis=1) >= 2 * n_numbers)
    cells = [np.flatnonzero(insides[k]) for k in enough]
    drawn = [
        each[np.random.default_rng(0).integers(len(each), size=(_N_TRIPLES, n_numbers))] for each in cells
    ]
    chosen = np.array(drawn, np.intp).reshape(-1, n_numbers)
    first, second, third = np.moveaxis(rows[chosen], 1, 0)
    # Cramer's rule, as thousands of equations with three unknowns are solved.
    normals = np.stack([_cross(second, third), _cross(third, first), _cross(first, second)], axis=1)
    determinants = np.einsum("ni,ni->n", first, normals[:, 0])
    lengths = np.sqrt(np.einsum("si,si->s", rows, rows))
    apart = np.abs(determinants) > _LEAST_SPREAD * lengths[chosen].prod(axis=1)
    heights = target[chosen[apart]] / determinants[apart, None]
    all_planes = np.einsum("nj,nji->ni", heights, normals[apart]) / TUKEY_SIGMAS
    ends = np.cumsum(apart.reshape(-1, _N_TRIPLES).sum(axis=1))
    found, planes = [], []
    for k, own, inside in zip(enough, np.split(all_planes, ends), cells, strict=False):
        if len(own):
            off = target[inside] / TUKEY_SIGMAS - own @ rows[inside].T
            off *= off
            found.append(k)
            planes.append(TUKEY_SIGMAS * own[int(np.argmin(np.minimum(off, 1.0, out=off).sum(axis=1)))])
    return np.array(found, np.intp), np.array(planes).reshape(-1, n_numbers)


def _cross(first: Array, second: Array) -> Array:
    """Return the cross products (N, 3) of vectors (N, 3)."""
    x, y, z = first.T
    u, v, w = second.T
    return np.column_stack([y * w - z * v, z * u - x * w, x * v - y * u])


def _scales(residuals: Array, insides: Mask) -> Array:
    """Return the scale (E,) of residuals (E, S): by the median, no more than their standard deviations."""
    ordered = np.sort(np.where(insides, np.abs(residuals), np.inf), axis=1)
    count, index = insides.sum(axis=1), np.arange(len(insides))
    medians = 0.5 * (ordered[index, (count - 1) // 2] + ordered[index, count // 2])
    scales: Array = np.clip(SIGMA_OVER_MAD * medians, _LEAST_SCALE, 1.0)
    return scales
