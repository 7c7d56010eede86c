"""Robust fits: iteratively reweighted least squares with Tukey's biweight (Huber, Robust Statistics)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ..rejection import NotFitted
from ..types import Array
from .statistics import SIGMA_OVER_MAD, upper_median

TUKEY_SIGMAS = 4.685  # 95 % efficiency for normal residuals (Huber, Robust Statistics)
# In a fit of least absolute deviations no residual weighs as if it were less than this part of the scale:
# those of zero would weigh infinitely.
_LEAST_DEVIATION = 0.1

Solution = TypeVar("Solution")
Floating = TypeVar("Floating", bound=np.ndarray)  # of either precision


@dataclass(frozen=True, slots=True)
class Reweighting:
    """How a fit is repeated.

    Attributes:
        rounds: Fits with Tukey's weights; the first of all has equal weights.
        absolute_rounds: Fits of least absolute deviations before them, which bear a start with many outliers.
        limit: Residual over its scale from which on an observation does not count.
        least_weight: What an outlier keeps, so that the equations stay regular.
        of_squares: Whether residuals are given as their squares, as the deviances of several numbers together
            are; limit and scale are those of squares then.
        settled: The fit ends early where the scale, one of all, has changed by this part of it; None: never.
    """

    rounds: int
    absolute_rounds: int = 0
    limit: float = TUKEY_SIGMAS
    least_weight: float = 0.0
    of_squares: bool = False
    settled: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RobustFit(Generic[Solution]):
    """Outcome of a robust fit.

    Attributes:
        solution: What the last fit has found.
        residuals: (N,) of it.
        scale: Standard deviation of the residuals that are no outliers.
        weights: (N,) 0 ... 1, by these residuals: those of the fit that would come next.
    """

    solution: Solution
    residuals: Array
    scale: float | Array
    weights: Array


def tukey_weights(squares: Floating, least: float = 0.0) -> Floating:
    """Return Tukey's biweight of residuals.

    Args:
        squares: Squared residuals over the square of the limit from which on one does not count; of any shape
            and precision.
        least: Weight of what is beyond.
    """
    weights = np.maximum(1.0 - squares, 0.0)
    weights *= weights
    return weights if least == 0.0 else np.maximum(weights, least)  # type: ignore[return-value]


def scale_by_median(
    least: float, median: Callable[[Array], float] = upper_median
) -> Callable[[Array], float]:
    """Return an estimator of scale by the median absolute residual, which half of outliers do not move.

    Args:
        least: Scale that is taken where residuals are smaller.
        median: Of values (N,).
    """

    def scale(residuals: Array) -> float:
        return max(least, SIGMA_OVER_MAD * median(np.abs(residuals)))

    return scale


def fit_reweighted(
    fit: Callable[[Array, float | Array], tuple[Solution, Array] | NotFitted],
    n: int,
    how: Reweighting,
    scale_of: Callable[[Array], float | Array],
) -> RobustFit[Solution] | NotFitted:
    """Fit by weighted least squares, again and again with the weights that the last fit's residuals have.

    Args:
        fit: Takes weights (N,) and the scale before (1 at first), returns a solution and its residuals (N,);
            or why the weighted observations do not determine one.
        n: Number of observations, at least one.
        how: Rounds and limits.
        scale_of: Takes residuals (N,), returns their scale: a number, or one of each (N,).

    Returns:
        The last fit, or why one of them is undetermined.
    """
    weights: Array = np.ones(n)
    scale: float | Array = 1.0
    for i in range(how.absolute_rounds + how.rounds):
        found = fit(weights, scale)
        if isinstance(found, NotFitted):
            return found
        solution, residuals = found
        previous, scale = scale, scale_of(residuals)
        if i < how.absolute_rounds:
            weights = 1.0 / np.maximum(np.abs(residuals), _LEAST_DEVIATION * scale)
            continue
        relative = residuals / (how.limit * scale)
        weights = tukey_weights(relative if how.of_squares else relative**2, how.least_weight)
        if how.settled is not None and i and _unchanged(previous, scale, how.settled):
            break
    return RobustFit(solution, residuals, scale, weights)


def _unchanged(before: float | Array, after: float | Array, part: float) -> bool:
    return isinstance(before, float) and isinstance(after, float) and abs(after - before) <= part * after
