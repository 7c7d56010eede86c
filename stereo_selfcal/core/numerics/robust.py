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
# In a fit of least absolute deviations, a smaller residual gets the weight of this fraction of the scale. The
# weight of a residual of zero would be infinite.
_LEAST_DEVIATION = 0.1

Solution = TypeVar("Solution")
Floating = TypeVar("Floating", bound=np.ndarray)  # of either precision


@dataclass(frozen=True, slots=True)
class Reweighting:
    """Settings of an iteratively reweighted fit.

    Attributes:
        rounds: Number of fits with Tukey's weights. The very first fit has equal weights.
        absolute_rounds: Number of fits of least absolute deviations before them. They tolerate many outliers
            at the start.
        limit: Residual over its scale at which the weight of an observation becomes zero.
        least_weight: Least weight of an outlier; it keeps the equations regular.
        of_squares: Whether residuals are given as squares, such as the deviances of several numbers together;
            limit and scale then refer to the squares.
        settled: The fit ends early where the common scale changes by at most this fraction; None: never.
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
        solution: Solution of the last fit.
        residuals: (N,) residuals of the last fit.
        scale: Standard deviation of the residuals that are no outliers.
        weights: (N,) weights 0 ... 1 that follow from these residuals; a next fit would use them.
    """

    solution: Solution
    residuals: Array
    scale: float | Array
    weights: Array


def tukey_weights(squares: Floating, least: float = 0.0) -> Floating:
    """Return Tukey's biweight of residuals.

    Args:
        squares: Squared residuals over the square of the limit at which the weight becomes zero; of any shape
            and precision.
        least: Weight beyond the limit.
    """
    weights = np.maximum(1.0 - squares, 0.0)
    weights *= weights
    # NumPy's types do not say that the precision stays that of the argument.
    return weights if least == 0.0 else np.maximum(weights, least)  # type: ignore[return-value]


def scale_by_median(
    least: float, median: Callable[[Array], float] = upper_median
) -> Callable[[Array], float]:
    """Return an estimator of scale by the median absolute residual; up to half of the values may be outliers.

    Args:
        least: Least scale.
        median: Median of values (N,).
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
    """Fit by iteratively reweighted least squares: the residuals of a fit give the weights of the next one.

    Args:
        fit: Takes weights (N,) and the previous scale (1 at first). It returns a solution and its residuals
            (N,), or the reason why the weighted observations do not determine one.
        n: Number of observations, at least one.
        how: Rounds and limits.
        scale_of: Takes residuals (N,) and returns their scale: one number, or one for each residual (N,).

    Returns:
        The last fit, or the reason why one of the fits is undetermined.
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
