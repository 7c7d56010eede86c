"""Robust mean of a series of measurements that scatter by something slow, beside their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..numerics.linear import invert, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted
from ..numerics.statistics import SIGMA_OVER_MAD, upper_median
from ..rejection import NotFitted
from ..types import Array

_PRIOR_FREEDOM = 3.0  # independent values that the prior of a scatter is worth
_NO_TIME = 1e-3  # over the memory: the series is a single value
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
        slope: Change by the given factor; 0 without one.
        scatter: Standard deviation of the slow scatter.
        weights: (N,) robust weights 0 ... 1 of the values.
    """

    value: float
    variance: float
    slope: float
    scatter: float
    weights: Array


def mean_over_time(
    values: Array,
    noise: Array,
    over: MeanOverTime,
    common: Array | None = None,
    slope: tuple[Array, float] | None = None,
) -> Mean | NotFitted:
    """Return the robust mean of a series, and its variance.

    A value is the mean, its noise, which is independent of that of others, and a slow scatter. The scatter is
    measured where the series is long, and has a prior that decides where it is short.

    Args:
        values: (N,) measurements.
        noise: (N,) variances of their noise.
        over: The scatter: its memory, its prior, and the time that is covered.
        common: (N,) further variances of slow causes.
        slope: (N,) a factor that changes the values linearly, and the standard deviation of the change by one
            unit of it, whose mean is zero.

    Returns:
        The mean, or why there is none.
    """
    n = len(values)
    common = np.zeros(n) if common is None else common
    design = np.ones((n, 1)) if slope is None else np.column_stack([np.ones(n), slope[0]])
    prior = np.zeros(design.shape[1])
    if slope is not None:
        prior[1] = slope[1] ** -2.0
    scatter, weights = over.scatter, np.ones(n)
    solution = np.zeros(len(prior))
    for _ in range(_ROUNDS):
        variances = noise + common + scatter**2
        found = _fit(values, variances, design, prior)
        if isinstance(found, NotFitted):
            return found
        solution, weights = found
        scatter = _scatter(values - design @ solution, noise + common, over)
    information = weights / variances
    response = invert((design.T * information) @ design + np.diag(prior), _DETERMINED)
    if isinstance(response, NotFitted):
        return response
    slow = max(1.0, n * over.of_mean) * (common + scatter**2)
    spread = (design.T * (information**2 * (noise + slow))) @ design + np.diag(prior)
    covariance = response @ spread @ response
    by_factor = float(solution[1]) if slope is not None else 0.0
    return Mean(float(solution[0]), float(covariance[0, 0]), by_factor, scatter, weights)


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


def _scatter(residuals: Array, noise: Array, over: MeanOverTime) -> float:
    """Return the standard deviation of the slow scatter, by the residuals and its prior."""
    spread = SIGMA_OVER_MAD * upper_median(np.abs(residuals))
    measured = max(0.0, spread**2 - upper_median(noise))
    independent = over.duration_s / (2.0 * over.memory_s)
    # A series that is hardly longer than its memory does not show it.
    freedom = max(0.0, independent - 1.0)
    variance = (_PRIOR_FREEDOM * over.scatter**2 + freedom * measured) / (_PRIOR_FREEDOM + freedom)
    return math.sqrt(variance)
