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

from ..numerics.linear import solve_linear
from ..numerics.robust import (
    TUKEY_SIGMAS,
    Reweighting,
    fit_reweighted,
    scale_by_median,
    tukey_weights,
)
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
_REWEIGHTING = Reweighting(rounds=8, least_weight=LEAST_WEIGHT**2)
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
    best: tuple[float, Extent] | None = None
    first, last = int(strip.min()), int(strip.max())
    for strips in [(i, j) for i in range(first, middle + 1) for j in range(middle, last + 1)]:
        inside = (strip >= strips[0]) & (strip <= strips[1])
        if strips[1] - strips[0] + 1 < _LEAST_STRIPS:
            continue
        robust = _robust_weights(heights, design, sigma, inside)
        if isinstance(robust, NotFitted):
            continue
        weights, off = robust
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
    return NotFitted(_ENOUGH, 0, Bound.LEAST, 1) if best is None else best[1]


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


def _robust_weights(
    heights: Array, design: Array, sigma: Array, inside: Mask
) -> tuple[Array, Array] | NotFitted:
    """Return the weights (S,) and the residuals (S,) of a robust fit: an MM-estimate (Yohai, 1987).

    Of planes through three cells each, the one that most cells agree with is the start (MSAC: Torr and
    Zisserman, 2000).
    """
    rows, target = design[inside] / sigma[inside, None], heights[inside] / sigma[inside]
    start = _most_agreed(rows, target)
    if isinstance(start, NotFitted):
        return start
    agreeing = tukey_weights(((target - rows @ start) / TUKEY_SIGMAS) ** 2, _REWEIGHTING.least_weight)

    def fit(weights: Array, _: object) -> tuple[Array, Array] | NotFitted:
        weighted = rows.T * weights
        plane = solve_linear(weighted @ rows, weighted @ target, _ENOUGH)
        if isinstance(plane, NotFitted):
            return plane
        return plane, target - rows @ plane

    found = fit_reweighted(fit, len(target), _REWEIGHTING, _scale, agreeing)
    if isinstance(found, NotFitted):
        return found
    all_weights, residuals = np.zeros(len(heights)), np.zeros(len(heights))
    all_weights[inside], residuals[inside] = found.weights, found.residuals * sigma[inside]
    return all_weights, residuals


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
