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

"""The motion of a car over its road: one model, for the mean of a drive, its changes and the watch.

A frame shows the pose of the mount, what springs, brakes and the shape of the road add at that moment, and
noise of known variance. The motion is a Gauss-Markov process of unknown size and memory, for height, pitch
and roll each. Both have a prior, which decides where a drive is short, and are weighed by how well they
explain the frames (Bayes, on a grid). While the car stands, its springs rest, and no time passes for the
motion: all frames of a stop are one moment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..numerics.gauss_markov import likelihood, linear_mean, variance_of_mean
from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..road.priors import RIDE_MEMORY_S, RIDE_STD, STANDING_STD
from ..types import Array, Mask
from .frame_series import FrameSeries

USUAL_STD: Array = np.array(RIDE_STD)
# Of calm and rough rides, which pitch by 0.05 to 0.4 deg and remember for 0.5 to 5 s, nearly all lie within
# two standard deviations of the logarithms.
_SIZE_LOG_STD, _MEMORY_LOG_STD = 0.5, 0.6
# Candidates: 1/32 to 16 times the usual size, and 1/4 to 32 s. Their likelihood is computed in steps of the
# root of two and in octaves, and interpolated to steps that are a quarter of these: a long drive tells both
# better than the steps are apart.
_SIZES: Array = 2.0 ** np.arange(-5.0, 4.1, 0.5)
_MEMORIES_S: Array = 2.0 ** np.arange(-2.0, 5.1)
_FINER = 4
# Of longer series, stretches of so many frames are taken to measure their motion.
_MOST_VALUES = 1200
_STRETCH = 200
# Neighbours on either side whose median a frame is compared with. A few deviating frames are outliers; a
# majority of them is a change.
_NEIGHBOURS = 5
_FEWEST_FOR_OUTLIERS = 4  # with three frames, one of them decides the median deviation
_OUTLIER_ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Candidates of size and memory: all sizes for each memory, in their order.

    Attributes:
        sizes: (S,) sizes over the usual ones.
        memories_s: (M,) memories [s].
        size: (M S, 3) standard deviations of height, pitch and roll.
        memory_s: (M S, 3) memories [s].
        log_prior: (M S, 1) logarithm of the prior.
    """

    sizes: Array
    memories_s: Array
    size: Array
    memory_s: Array
    log_prior: Array

    @classmethod
    def of(cls, sizes: Array, memories_s: Array) -> _Candidates:
        """Return the candidates of these sizes and memories."""
        size, memory_s = (each.ravel() for each in np.meshgrid(sizes, memories_s))
        prior = -0.5 * (
            (np.log(size) / _SIZE_LOG_STD) ** 2 + (np.log(memory_s / RIDE_MEMORY_S) / _MEMORY_LOG_STD) ** 2
        )
        return cls(
            sizes,
            memories_s,
            size[:, None] * USUAL_STD,
            np.repeat(memory_s[:, None], 3, axis=1),
            prior[:, None],
        )


@cache
def _computed() -> _Candidates:
    """Return the candidates whose likelihood is computed."""
    return _Candidates.of(_SIZES, _MEMORIES_S)


@cache
def _candidates() -> _Candidates:
    """Return the candidates to which it is interpolated."""
    finer = (np.exp2(_finer(len(each)) @ np.log2(each)) for each in (_SIZES, _MEMORIES_S))
    return _Candidates.of(*finer)


@cache
def _finer(n: int) -> Array:
    """Return the matrix (M, n) that interpolates n values in finer steps: cubic polynomials through four."""
    places = np.arange((n - 1) * _FINER + 1) / _FINER
    first = np.clip(np.floor(places).astype(np.intp) - 1, 0, n - 4)
    matrix = np.zeros((len(places), n))
    for k in range(4):
        others = [first + j for j in range(4) if j != k]
        node = first + k
        matrix[np.arange(len(places)), node] = np.prod(
            [(places - other) / (node - other) for other in others], axis=0
        )
    return matrix


@dataclass(frozen=True, slots=True, eq=False)
class CarMotion:
    """What is known of the motion of a car over its road.

    Attributes:
        probability: (G, 3) of the candidates of size and memory, for height, pitch and roll; each column adds
            up to 1.
    """

    probability: Array

    @property
    def variance(self) -> Array:
        """(3,) variance of the motion."""
        expected: Array = (self.probability * _candidates().size ** 2).sum(axis=0)
        return expected

    @property
    def memory_s(self) -> Array:
        """(3,) memory that gives means over a long time the variance they have [s]."""
        long = _candidates().size ** 2 * _candidates().memory_s
        expected: Array = (self.probability * long).sum(axis=0) / self.variance
        return expected

    def of_mean(self, series: FrameSeries, weights: Array) -> tuple[Array, Array]:
        """Return the variance (3,) that the motion leaves in a weighted mean, and its standard deviation.

        Args:
            series: The frames.
            weights: (N, 3) their weights.
        """
        rest = series.at_rest[:, None]
        memory_s = np.repeat(_candidates().memories_s[:, None], 3, axis=1)
        # Driving and standing have nothing in common. Only what driving leaves grows with the size.
        driving, standing = (
            variance_of_mean(series.forgets_s, weights * response, memory_s)[:, None]
            for response in (np.where(rest, 0.0, USUAL_STD), np.where(rest, STANDING_STD, 0.0))
        )
        each = (standing + _candidates().sizes[:, None] ** 2 * driving).reshape(-1, 3)
        expected = (self.probability * each).sum(axis=0)
        spread = (self.probability * (each - expected) ** 2).sum(axis=0)
        return expected, np.sqrt(spread)

    def of_block(self, seconds: float) -> Array:
        """Return the variance (3,) of means over blocks of time, in the mean of many blocks."""
        # In the mean over n blocks, a process of memory tau has the variance 2 tau / (n seconds) of its own.
        each = _candidates().size ** 2 * np.minimum(1.0, 2.0 * _candidates().memory_s / seconds)
        expected: Array = (self.probability * each).sum(axis=0)
        return expected


def _weighed(log_likelihood: Array) -> CarMotion:
    coarse = log_likelihood.reshape(len(_MEMORIES_S), len(_SIZES), 3)
    finer = np.einsum("ms,nt,stk->mnk", _finer(len(_MEMORIES_S)), _finer(len(_SIZES)), coarse, optimize=True)
    log = finer.reshape(-1, 3) + _candidates().log_prior
    probability = np.exp(log - log.max(axis=0))
    return CarMotion(probability / probability.sum(axis=0))


def measure_motion(*parts: FrameSeries) -> CarMotion:
    """Return what frames tell of the motion.

    Args:
        *parts: Frames of drives between which the mount, or the road, has changed: each has its own mean.
            Without any, what is known of cars beforehand remains.
    """
    size, memory_s = _computed().size, _computed().memory_s
    total = np.zeros(size.shape)
    for series in (stretch for part in parts for stretch in _stretches(part.good())):
        if len(series) < 2:
            continue
        noise = _positive(series.alone(series.variances))
        total += likelihood(series.forgets_s, series.values, noise, series.response(size), memory_s).log
    return _weighed(total)


def _positive(variances: Array) -> Array:
    """Return variances that are not zero: noise far below the least motion makes no difference."""
    positive: Array = np.maximum(variances, (1e-3 * _SIZES[0] * USUAL_STD) ** 2)
    return positive


def _stretches(series: FrameSeries) -> list[FrameSeries]:
    """Return a series, or stretches of it where it is longer than is needed.

    Means over neighbours would not do: the motion averages out in them.
    """
    n = len(series)
    if n <= _MOST_VALUES:
        return [series]
    starts = np.linspace(0, n - _STRETCH, _MOST_VALUES // _STRETCH).astype(np.intp)
    return [series.part(slice(start, start + _STRETCH)) for start in starts]


def weights_of_mean(series: FrameSeries, variances: Array, motion: CarMotion) -> tuple[Array, Array]:
    """Return the weights (N, 3) of the best linear mean, and how far each frame (N, 3) is off.

    Args:
        series: The frames, all of which count.
        variances: (N, 3) of each frame, by all that does not wander with the motion.
        motion: What is known of the motion.

    Returns:
        The weights, whose sum is 1; and each frame less what all others predict for it, over its standard
        deviation.
    """
    sizes, noise = series.response(np.sqrt(motion.variance)), _positive(series.alone(variances))
    found = linear_mean(series.forgets_s, series.values, noise, sizes, motion.memory_s)
    return found.weights, found.residuals


def mark_outliers(series: FrameSeries, known: int = 0) -> Mask:
    """Return which frames are used, (N,); an outlier is far from the median of its neighbours on either side.

    Args:
        series: The frames; ``used`` is already decided for the first ones.
        known: Number of these first frames; their neighbours have not changed.
    """
    n = len(series)
    used: Mask = series.used.copy()
    around = np.arange(known, n)[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1)
    inside = (around >= 0) & (around < n)
    # Neighbours that do not exist are sorted behind those that do.
    ranked = np.sort(np.where(inside[..., None], series.values[np.clip(around, 0, n - 1)], np.inf), axis=1)
    row, count = np.arange(n - known), inside.sum(axis=1)
    medians = (ranked[row, (count - 1) // 2] + ranked[row, count // 2]) / 2.0
    recent = series.values[max(0, known - 2 * _NEIGHBOURS) :]
    spread = SIGMA_OVER_MAD * np.median(np.abs(recent - np.median(recent, axis=0)), axis=0)
    # A few frames may lie close together by chance: the usual motion on a road is no outlier.
    scale = np.sqrt(np.maximum(spread, USUAL_STD / 2.0) ** 2 + series.variances[known:])
    used[known:] = np.all(np.abs(series.values[known:] - medians) <= OUTLIER_SIGMAS * scale, axis=1)
    return used


def _near_the_median(series: FrameSeries) -> Mask:
    """Return which frames (N,) are as near to the median of all as usual motion brings them."""
    off = np.abs(series.values - np.median(series.values, axis=0))
    spread = np.maximum(SIGMA_OVER_MAD * np.median(off, axis=0), USUAL_STD)
    near: Mask = np.all(off <= OUTLIER_SIGMAS * np.sqrt(spread**2 + series.variances), axis=1)
    return near


def settled_outliers(n: int) -> int:
    """Return how many of ``n`` frames have all the neighbours that decide whether they are outliers."""
    return max(0, n - _NEIGHBOURS)


def without_outliers(series: FrameSeries, variances: Array) -> tuple[FrameSeries, CarMotion]:
    """Return a series in which outliers are not used, and its motion.

    First, frames far from their neighbours, or far from most others, are left out: who brakes hard shows the
    mount no better than a wrong frame. Then those go that the others, moving as they do, do not explain.

    Args:
        series: The frames.
        variances: (N, 3) of each frame, by all that does not wander with the motion.
    """
    if len(series) < _FEWEST_FOR_OUTLIERS:
        return series, measure_motion(series)
    series = _with_used(series, mark_outliers(series) & _near_the_median(series))
    motion = measure_motion(series)
    for _ in range(_OUTLIER_ROUNDS):
        if np.count_nonzero(series.used) < _FEWEST_FOR_OUTLIERS:
            break
        _, off = weights_of_mean(series.good(), variances[series.used], motion)
        far = np.any(np.abs(off) > OUTLIER_SIGMAS, axis=1)
        if not far.any():
            break
        used = series.used.copy()
        used[used] = ~far
        series = _with_used(series, used)
        motion = measure_motion(series)
    return series, motion


def _with_used(series: FrameSeries, used: Mask) -> FrameSeries:
    """Return the series with these frames used; all of them, where most would be set aside."""
    most = 2 * np.count_nonzero(used) >= len(used)
    return replace(series, used=used if most else np.ones(len(used), dtype=bool))
