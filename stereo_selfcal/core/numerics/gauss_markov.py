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

"""Mean of a series that wanders: a Gauss-Markov process about the mean, and noise.

The process forgets its state exponentially (Ornstein and Uhlenbeck, 1930). With a state of unit variance, a
Kalman filter gives the likelihood of a series, its best linear mean and the residual of each value from all
others, in a time that grows with the number of values alone (Harvey, "Forecasting, structural time series
models and the Kalman filter", 1989, chapters 3 and 4). All functions work on several columns, and on many
candidates of size and memory, at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array

# Least variance of the noise over that of the process: smaller ones cannot be told from it in double
# precision.
_LEAST_NOISE = 1e-6
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """How well candidates of size and memory explain a series with an unknown mean.

    Attributes:
        log: (G, K) logarithms of the likelihood, over all means alike.
        mean: (G, K) best linear mean under each candidate.
        variance: (G, K) its variance.
    """

    log: Array
    mean: Array
    variance: Array


def likelihood(gaps: Array, values: Array, noise: Array, size: Array, memory: Array) -> Likelihood:
    """Return the likelihood of a series under candidates.

    Args:
        gaps: (N,) time from the value before; the first one does not count.
        values: (N, K) the series, a column for each quantity.
        noise: (N, K) variances of their noise, greater than 0.
        size: (N, G, K) or (1, G, K) standard deviations of the process.
        memory: (G, K) times after which the process has forgotten all but 1/e of its state.
    """
    n = len(values)
    shape = memory.shape
    sizes = np.broadcast_to(size, (n, *shape))
    state, unit = np.zeros(shape), np.zeros(shape)
    variance = np.ones(shape)
    logs, squares, cross, ones = (np.zeros(shape) for _ in range(4))
    kept = np.exp(-gaps[:, None, None] / memory)
    kept[0] = 0.0
    for i in range(n):
        keep, response = kept[i], sizes[i]
        state, unit = keep * state, keep * unit
        variance = 1.0 + keep * keep * (variance - 1.0)
        seen = response * variance
        total = response * seen + noise[i]
        gain = seen / total
        off, off_unit = values[i] - response * state, 1.0 - response * unit
        over = off_unit / total
        logs += np.log(total)
        squares += off * off / total
        cross += over * off
        ones += over * off_unit
        state, unit = state + gain * off, unit + gain * off_unit
        variance = variance - gain * seen
    mean = cross / ones
    log = -0.5 * (logs + np.log(ones) + squares - cross * mean)
    return Likelihood(log, mean, 1.0 / ones)


@dataclass(frozen=True, slots=True, eq=False)
class LinearMean:
    """The best linear mean of a series under one size and memory for each column.

    Attributes:
        weights: (N, K) weights of the values; their sum is 1.
        mean: (K,) the mean.
        residuals: (N, K) each value less what all others predict for it, over its standard deviation.
    """

    weights: Array
    mean: Array
    residuals: Array


def linear_mean(gaps: Array, values: Array, noise: Array, size: Array, memory: Array) -> LinearMean:
    """Return the best linear mean of a series.

    Args:
        gaps: (N,) time from the value before; the first one does not count.
        values: (N, K) the series.
        noise: (N, K) variances of their noise.
        size: (N, K) or (1, K) standard deviations of the process.
        memory: (K,) its memory.
    """
    n, columns = values.shape
    sizes = np.broadcast_to(size, (n, columns))
    noise = np.maximum(noise, _LEAST_NOISE * sizes**2 + _TINY)
    kept = np.exp(-gaps[:, None] / memory)
    kept[0] = 0.0
    # Two series are smoothed alike: the values, and a series of ones. So the mean need not be known.
    series = np.stack([values, np.ones_like(values)])
    state, variance = np.zeros((2, columns)), np.ones(columns)
    filtered, predicted = np.empty((2, n, columns)), np.empty((2, n, columns))
    spread, spread_before = np.empty((n, columns)), np.empty((n, columns))
    for i in range(n):
        keep, response = kept[i], sizes[i]
        state = keep * state
        variance = 1.0 + keep * keep * (variance - 1.0)
        predicted[:, i], spread_before[i] = state, variance
        gain = response * variance / (response * response * variance + noise[i])
        state = state + gain * (series[:, i] - response * state)
        variance = variance - gain * response * variance
        filtered[:, i], spread[i] = state, variance
    smooth, left = filtered[:, -1], spread[-1]
    for i in range(n - 2, -1, -1):
        back = spread[i] * kept[i + 1] / spread_before[i + 1]
        smooth = filtered[:, i] + back * (smooth - predicted[:, i + 1])
        left = spread[i] + back * back * (left - spread_before[i + 1])
        filtered[:, i], spread[i] = smooth, left
    # V^-1 y = (y - smoothed y) / noise, for V the covariance of the series.
    solved = (series - sizes * filtered) / noise
    diagonal = np.maximum((1.0 - sizes**2 * spread / noise) / noise, _TINY)
    weights = solved[1] / solved[1].sum(axis=0)
    mean = (weights * values).sum(axis=0)
    return LinearMean(weights, mean, (solved[0] - mean * solved[1]) / np.sqrt(diagonal))


def variance_of_mean(gaps: Array, weights: Array, memory: Array) -> Array:
    """Return the variance of a weighted mean of the process, for a state of unit variance.

    Args:
        gaps: (N,) time from the value before; the first one does not count.
        weights: (N, K) weights of the values, times the size of the process.
        memory: (G, K) memories.

    Returns:
        (G, K) variances.
    """
    kept = np.exp(-gaps[:, None, None] / memory)
    total, before = np.zeros(memory.shape), np.zeros(memory.shape)
    for i, weight in enumerate(weights):
        if i:
            before = kept[i] * before
        total += weight * (weight + 2.0 * before)
        before = before + weight
    return total
