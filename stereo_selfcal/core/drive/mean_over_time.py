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

"""Robust mean of a series of measurements that scatter by something slow, beside their noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..numerics.linear import invert, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted
from ..numerics.statistics import SIGMA_OVER_MAD, upper_median
from ..rejection import Bound, NotFitted
from ..types import Array

_PRIOR_FREEDOM = 3.0  # independent values that the prior of a scatter is worth
_NO_TIME = 1e-3  # over the memory: the series is a single value
_QUANTILES: Array = np.arange(0.05, 1.01, 0.05)  # of what lasts, as limits
_TINY = 1e-12
_ROUNDS = 3  # of the scatter and the mean; they hardly change each other
_REWEIGHTING = Reweighting(rounds=4, absolute_rounds=2)
_DETERMINED = "numbers of a mean over time that the measurements determine"


@dataclass(frozen=True, slots=True)
class MeanOverTime:
    """What is known of the slow scatter of a series.

    Attributes:
        duration_s: Time that the measurements cover [s].
        memory_s: Time over which the scatter is correlated [s].
        scatter: Prior of its standard deviation, in the unit of the values.
    """

    duration_s: float
    memory_s: float
    scatter: float = 0.0

    def with_scatter(self, scatter: float) -> MeanOverTime:
        """Return the same with another scatter."""
        return replace(self, scatter=scatter)

    @property
    def of_mean(self) -> float:
        """Variance of the mean over that of a single value, for a correlation that decays exponentially."""
        times = self.duration_s / self.memory_s
        if times < _NO_TIME:
            return 1.0
        return 2.0 / times * (1.0 - (1.0 - math.exp(-times)) / times)


@dataclass(frozen=True, slots=True, eq=False)
class Mean:
    """A mean over time.

    Attributes:
        value: The mean.
        variance: Its variance, with the correlation of the scatter.
        slopes: (K,) change by each of the given factors.
        scatter: Standard deviation of the slow scatter.
        weights: (N,) robust weights 0 ... 1 of the values.
    """

    value: float
    variance: float
    slopes: Array
    scatter: float
    weights: Array


def mean_over_time(
    values: Array,
    noise: Array,
    over: MeanOverTime,
    common: Array | None = None,
    slopes: Sequence[tuple[Array, float]] = (),
    lasting: Array | None = None,
) -> Mean | NotFitted:
    """Return the robust mean of a series, and its variance.

    A value is the mean, its noise, which is independent of that of others, and a slow scatter. The scatter is
    measured where the series is long, and has a prior that decides where it is short.

    Args:
        values: (N,) measurements, in the order of time.
        noise: (N,) variances of their noise.
        over: The scatter: its memory, its prior, and the time that is covered.
        common: (N,) further variances of slow causes.
        slopes: For each factor (N,) that changes the values linearly: it, and the standard deviation of the
            change by one unit of it, whose mean is zero.
        lasting: (N,) standard deviations of causes that are the same in all values, however long the series
            is; no average lessens them.

    Returns:
        The mean, or why there is none.
    """
    n = len(values)
    common = np.zeros(n) if common is None else common
    lasting = np.zeros(n) if lasting is None else lasting
    design = np.column_stack([np.ones(n), *(factor for factor, _ in slopes)])
    prior = np.array([0.0, *(std**-2.0 for _, std in slopes)])
    scatter, weights = over.scatter, np.ones(n)
    solution = np.zeros(len(prior))
    for _ in range(_ROUNDS):
        variances = noise + common + lasting**2 + scatter**2
        found = _fit(values, variances, design, prior)
        if isinstance(found, NotFitted):
            return found
        solution, weights = found
        scatter = _scatter(values - design @ solution, noise + common, lasting, weights, over)
    slow = max(1.0, n * over.of_mean) * (common + scatter**2)
    best: tuple[float, float] | None = None
    for part in _parts(lasting):
        information = part * weights / (noise + common + scatter**2)
        response = invert((design.T * information) @ design + np.diag(prior), _DETERMINED)
        if isinstance(response, NotFitted):
            continue
        gains = (response @ (design.T * information))[0]
        spread = gains**2 @ (noise + slow) + response[0] ** 2 @ prior + (np.abs(gains) @ lasting) ** 2
        if best is None or spread < best[0]:
            best = float(spread), float(gains @ values)
    if best is None:
        return NotFitted(_DETERMINED, 0, Bound.LEAST, len(prior))
    variance, value = best
    return Mean(value, variance, solution[1:], scatter, weights)


def _parts(lasting: Array) -> Iterator[Array]:
    """Yield candidates of how much each value counts (N,), by what lasts in it.

    The best linear mean of values with such a cause would be one that counts values with much of it
    negatively: it would extrapolate to none of it, which nobody knows how to. Without that, it counts them
    the less, and not at all beyond a limit (a Lagrange multiplier). Which limit is best is tried.
    """
    yield np.ones(len(lasting))
    if np.any(lasting > 0.0):
        for limit in np.quantile(lasting, _QUANTILES) * (1.0 + _QUANTILES) + _TINY:
            yield np.maximum(1.0 - lasting / limit, 0.0)


def _fit(values: Array, variances: Array, design: Array, prior: Array) -> tuple[Array, Array] | NotFitted:
    """Return the robust solution of a linear fit, and the weights of the values."""

    def fit(weights: Array, _: float | Array) -> tuple[Array, Array] | NotFitted:
        weighted = design.T * (weights / variances)
        solution = solve_linear(weighted @ design + np.diag(prior), weighted @ values, _DETERMINED)
        if isinstance(solution, NotFitted):
            return solution
        return solution, (values - design @ solution) / np.sqrt(variances)

    # What is expected is expected: no outlier is told by a scatter that is smaller.
    found = fit_reweighted(
        fit,
        len(values),
        _REWEIGHTING,
        lambda residuals: max(1.0, SIGMA_OVER_MAD * upper_median(np.abs(residuals))),
    )
    return found if isinstance(found, NotFitted) else (found.solution, found.weights)


def _scatter(residuals: Array, noise: Array, lasting: Array, weights: Array, over: MeanOverTime) -> float:
    """Return the standard deviation of the slow scatter, by the residuals and its prior.

    In means over one memory each, the noise averages out, and the scatter does so less. Values in which more
    lasts than the prior has do not show it.
    """
    counted = np.flatnonzero((weights > 0.0) & (lasting <= over.scatter))
    n_counted = len(counted)
    shown = MeanOverTime(over.duration_s * n_counted / len(residuals), over.memory_s)
    # A series that is hardly longer than its memory does not show it.
    n_blocks = min(n_counted, math.floor(shown.duration_s / over.memory_s))
    freedom = max(0.0, n_blocks - 1.0)
    measured = 0.0
    if freedom:
        starts = np.arange(n_blocks) * n_counted // n_blocks
        sizes = np.diff([*starts, n_counted])
        means = np.add.reduceat(residuals[counted], starts) / sizes
        of_noise = np.add.reduceat(noise[counted], starts) / sizes**2
        seen = float(np.sum((means - means.mean()) ** 2)) / freedom - float(of_noise.mean())
        # What the scatter leaves in such means, and in their common mean, which is taken from them.
        in_block = max(MeanOverTime(shown.duration_s / n_blocks, over.memory_s).of_mean, n_blocks / n_counted)
        measured = max(0.0, seen) * freedom / (n_blocks * (in_block - shown.of_mean))
    variance = (_PRIOR_FREEDOM * over.scatter**2 + freedom * measured) / (_PRIOR_FREEDOM + freedom)
    return math.sqrt(variance)
