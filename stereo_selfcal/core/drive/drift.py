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

"""Test whether and when the mean of a series of frames has changed.

The errors of the frames are correlated over seconds. The model is the same for height, pitch and roll: a
frame shows the pose, plus the momentary motion of suspension and road, plus noise of known variance. The
motion has a variance that is measured, and is correlated within some seconds. docs/watch.md derives the
statistic and its rate of false alarms.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..tolerances import WANDER_STD
from ..types import Array, Indices
from .frame_series import FrameSeries
from .motion import measure_motion

# Fewest frames and shortest time of a change that can be distinguished from a long braking.
LEAST_FRAMES = 5
LEAST_SPAN_S = 20.0

# Numbers of frames since a change that are tested. They grow in steps of 5 %, which delays the detection by
# no more than that.
_LENGTHS: Indices = np.unique(np.geomspace(1, 1e5, 237).astype(np.intp))
# The road after a change is as rough as that before, as far as so many frames would show it.
_ROUGHER_FRAMES = 10.0
# Rounds of measuring the scatter: it is measured about the means before and after the change.
_ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The mean before the first frame, as far as it is known.

    Attributes:
        mean: (3,) height_m, pitch_rad, roll_rad.
        variance: (3,) variances of the mean, without that part.
        moments: (3,) part of the variance of the motion that is left in it: 1 for one moment of a moving car,
            0 where the variance of the mean holds it already.
    """

    mean: Array
    variance: Array
    moments: Array = field(default_factory=lambda: np.ones(3))


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Scatter of the frames about their mean.

    Attributes:
        motion: (3,) variance of the motion by suspension and road.
        inflation: (3,) variance of a mean over its variance for independent frames.
        freedom: (3,) degrees of freedom of that estimate.
    """

    motion: Array
    inflation: Array
    freedom: Array


@dataclass(frozen=True, slots=True, eq=False)
class DriftChange:
    """The most likely change.

    Attributes:
        z: (3,) change of height, pitch and roll over its standard deviation, as a standard normal variable; 0
            where there are too few frames.
        split: Index of the first frame after the change.
        drift: (3,) mean after the change minus mean before it.
        std: (3,) standard deviation of the drift.
        before: (3,) mean before the change, reference included.
        before_variance: (3,) variance of the mean before the change.
        scatter: Scatter of the frames.
    """

    z: Array
    split: int
    drift: Array
    std: Array
    before: Array
    before_variance: Array
    scatter: Scatter

    @property
    def axis(self) -> int:
        """Index of the quantity with the most significant change."""
        return int(np.argmax(np.abs(self.z)))

    @property
    def size(self) -> float:
        """|z| of that quantity."""
        return float(np.abs(self.z).max())


def find_change(
    series: FrameSeries, reference: Reference | None, scatter: Scatter | None = None
) -> DriftChange | None:
    """Compare the frames after every possible change with those before it and with the reference.

    Args:
        series: The frames.
        reference: The known mean before the first frame, None if there is none.
        scatter: Scatter of the frames, None to measure it.

    Returns:
        The most significant change, however weak it is; None as long as there are too few frames.
    """
    candidates = _candidates(series, reference is None)
    if not len(candidates):
        return None
    if scatter is None:
        scatter = measure_scatter(series)
        for _ in range(_ROUNDS):
            scatter = measure_scatter(series, _best(series, candidates, reference, scatter).split)
    return _best(series, candidates, reference, scatter)


def measure_scatter(series: FrameSeries, split: int = 0) -> Scatter:
    """Return the scatter of frames about the means before and after a change.

    Args:
        series: The frames.
        split: Index of the first frame after the change; 0 for no change.
    """
    motion = measure_motion(*(series.part(part) for part in (slice(0, split), slice(split, None))))
    used = series.good()
    n = max(len(used), 1)
    # In a mean of all frames, the motion lasts from one to the next, and the noise does not.
    noise = used.variances.sum(axis=0) / n**2
    of_mean, std = motion.of_mean(used, np.full((len(used), 3), 1.0 / n))
    independent = motion.variance / n + noise
    # As many degrees of freedom as a variance that is known as well as this one.
    freedom = 2.0 * ((of_mean + noise) / np.maximum(std, np.finfo(float).tiny)) ** 2
    return Scatter(motion.variance, np.maximum(1.0, (of_mean + noise) / independent), freedom)


def mean_of(series: FrameSeries, scatter: Scatter) -> tuple[Array, Array]:
    """Return the mean of all frames and its variance, (3,) each."""
    weights = series.used[:, None] / (series.variances + scatter.motion)
    total = weights.sum(axis=0)
    return (weights * series.values).sum(axis=0) / total, scatter.inflation / total


def reference_variance(reference: Reference, scatter: Scatter) -> Array:
    """Return the variance (3,) of a reference, motion included."""
    return reference.variance + reference.moments * scatter.motion


def _candidates(series: FrameSeries, between: bool) -> Indices:
    """Return the indices of possible changes: enough frames lie after each.

    Args:
        series: The frames.
        between: Whether enough frames have to lie before the change as well.
    """
    counts = np.concatenate([[0], np.cumsum(series.used)])
    n = len(series)
    if not n:
        return np.zeros(0, dtype=np.intp)
    lengths = _LENGTHS[n >= _LENGTHS]
    index: Indices = n - lengths[::-1]
    enough = (counts[n] - counts[index] >= LEAST_FRAMES) & (
        series.times_s[-1] - series.times_s[index] >= LEAST_SPAN_S
    )
    if between:
        enough &= (counts[index] >= LEAST_FRAMES) & (
            series.times_s[index] - series.times_s[0] >= LEAST_SPAN_S
        )
    candidates: Indices = index[enough]
    return candidates


def _best(
    series: FrameSeries, candidates: Indices, reference: Reference | None, scatter: Scatter
) -> DriftChange:
    weights = series.used[:, None] / (series.variances + scatter.motion)
    summed = np.zeros((3, len(series) + 1, 3))
    for moment in range(3):
        np.cumsum(weights * series.values**moment, axis=0, out=summed[moment, 1:])
    before, after = summed[:, candidates], summed[:, -1:] - summed[:, candidates]
    counts = np.concatenate([[0], np.cumsum(series.used)])
    n_after = (counts[-1] - counts[candidates])[:, None]
    precision, moment = before[0] / scatter.inflation, before[1] / scatter.inflation
    if reference is not None:
        known = 1.0 / reference_variance(reference, scatter)
        precision, moment = precision + known, moment + known * reference.mean
    mean_before, mean_after = moment / precision, after[1] / after[0]
    # Where the scatter has increased since the change, because the road is rougher, the new scatter is used.
    chi2 = after[2] - after[0] * mean_after**2
    rougher = np.maximum(1.0, (_ROUGHER_FRAMES + chi2) / (_ROUGHER_FRAMES + n_after - 1.0))
    drift = mean_after - mean_before
    variance = rougher * scatter.inflation / after[0] + 1.0 / precision + WANDER_STD**2
    std = np.sqrt(variance)
    z = _as_normal(drift / std, scatter.freedom)
    best = int(np.argmax(np.abs(z).max(axis=1)))
    return DriftChange(
        z[best],
        int(candidates[best]),
        drift[best],
        std[best],
        mean_before[best],
        1.0 / precision[best],
        scatter,
    )


def _as_normal(t: Array, freedom: Array) -> Array:
    """Return the normal variable with the tail of Student's t (Wallace, Ann. Math. Stat. 30, 1959)."""
    factor = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    normal: Array = np.sign(t) * factor * np.sqrt(freedom * np.log1p(t**2 / freedom))
    return normal
