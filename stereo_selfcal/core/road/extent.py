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

from ..numerics.robust import TUKEY_SIGMAS, scale_by_median, tukey_weights
from ..numerics.statistics import median
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
    starts = [_most_agreed(rows[inside], target[inside]) for inside in insides]
    chosen = [k for k, start in enumerate(starts) if not isinstance(start, NotFitted)]
    if not chosen:
        return NotFitted(_ENOUGH, 0, Bound.LEAST, 1)
    planes = np.array([starts[k] for k in chosen])
    all_weights, residuals = _robust_fits(rows, target, insides[chosen], planes)
    best: tuple[float, Extent] | None = None
    for k, weights, off in zip(chosen, all_weights, residuals * sigma, strict=True):
        strips, inside = extents[k], insides[k]
        # An outlier gets a larger variance, so that it counts less. The variances of the other cells stay as
        # they are; otherwise unevenness of the road would be treated as noise.
        outlier = weights < OUTLIER_WEIGHT
        variances = noise + np.where(outlier, off**2 / np.maximum(weights, LEAST_WEIGHT), 0.0)
        likelihood = _log_likelihood(
            heights, design, road + _beyond(strip, strips) + np.diag(np.where(inside, variances, noise))
        )
        likelihood -= _STEP_LOG_ODDS * ((strips[0] > first) + (strips[1] < last))
        if best is None or likelihood > best[0]:
            no_road = noise + (_STEP_STD_M / LEAST_WEIGHT) ** 2
            best = (
                likelihood,
                Extent(strips, np.where(inside, weights, 0.0), np.where(inside, variances, no_road)),
            )
    assert best is not None  # there are extents
    return best[1]


def _beyond(strip: Indices, strips: tuple[int, int]) -> Array:
    """Return the covariance (S, S) that a step on either side adds to the heights beyond it."""
    left, right = (strip < strips[0]).astype(float), (strip > strips[1]).astype(float)
    steps = _STEP_STD_M**2 * (np.outer(left, left) + np.outer(right, right))
    added: Array = steps + np.diag(_BESIDE_STD_M**2 * (left + right))
    return added


def _log_likelihood(heights: Array, design: Array, covariance: Array) -> float:
    """Return the restricted log likelihood of heights: that of the contrasts which no plane changes."""
    root = np.linalg.cholesky(covariance)
    whitened = np.linalg.solve(root, np.column_stack([design, heights]))
    # The last diagonal number of the triangular factor is the contrast's length.
    scales = np.maximum(np.abs(np.diag(np.linalg.qr(whitened, mode="r"))), np.finfo(float).tiny)
    log_determinant = np.log(np.diag(root)).sum() + np.log(scales[:-1]).sum()
    return float(-log_determinant - 0.5 * scales[-1] ** 2)


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
        scale = np.array([_scale(each[inside]) for each, inside in zip(residuals, insides, strict=True)])
    weights = insides * tukey_weights((residuals / (TUKEY_SIGMAS * scale[:, None])) ** 2, _LEAST_COUNT)
    return weights, residuals


def _most_agreed(rows: Array, target: Array) -> Array | NotFitted:
    """Return the plane (3,) through three of the cells that most cells agree with.

    Args:
        rows: (S, 3) derivative of the cells' heights by the parameters of a plane, in standard deviations.
        target: (S,) heights, in standard deviations.
    """
    n_numbers = rows.shape[1]
    if len(rows) < 2 * n_numbers:
        return NotFitted(_ENOUGH, len(rows), Bound.LEAST, 2 * n_numbers)
    chosen = np.random.default_rng(0).integers(len(rows), size=(_N_TRIPLES, n_numbers))
    triples = rows[chosen]
    spread = np.abs(np.linalg.det(triples)) / np.prod(np.linalg.norm(triples, axis=2), axis=1)
    apart = spread > _LEAST_SPREAD
    if not apart.any():
        return NotFitted(_ENOUGH, n_numbers - 1, Bound.LEAST, n_numbers)
    planes = np.linalg.solve(triples[apart], target[chosen[apart]][..., None])[..., 0]
    misfits = np.minimum(((target - planes @ rows.T) / TUKEY_SIGMAS) ** 2, 1.0).sum(axis=1)
    best: Array = planes[int(np.argmin(misfits))]
    return best


def _scale(residuals: Array) -> float:
    """Return the scale of residuals: no more than their standard deviations, or they are no road."""
    return min(1.0, scale_by_median(_LEAST_SCALE, median)(residuals))
