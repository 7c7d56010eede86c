"""Test whether and when the mean of a series of frames has changed.

The errors of the frames are correlated over seconds. The model is the same for height, pitch and roll: a
frame shows the pose, plus the momentary motion of suspension and road, plus noise of known variance. The
motion has a variance that is measured, and is correlated within some seconds. docs/watch.md derives the
statistic and its rate of false alarms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..tolerances import WANDER_STD
from ..types import Array, Indices, Mask

# Prior of the scatter of frames: height [m], pitch [rad], roll [rad]. Braking and driving off pitch a car by
# 0.1 to 0.3 deg, its springs move it by a centimetre, and cambers roll it by 0.3 deg.
MOTION_STD: Array = np.array([0.01, math.radians(0.2), math.radians(0.3)])
# Weight of that prior, as a number of frames.
_MOTION_FRAMES = 10.0
# Least scatter as a fraction of the prior: the camera moves a little even on a perfectly even road.
_LEAST_MOTION = 0.05

# Prior of the correlation time of the motion: a braking lasts for seconds.
_MEMORY_S = 3.0
_MEMORY_FRAMES = 30.0  # weight of that prior, as a number of frames
# Frames farther apart than the horizon are taken as independent. The horizon is eight times the correlation
# time, or a sixtieth of the observed time. The window of such an estimate must grow with the series (Newey
# and West, Econometrica 55, 1987).
_SHORTEST_HORIZON_S = 24.0
_LONGEST_HORIZON_S = 60.0
_HORIZON_OF_SPAN = 1.0 / 60.0

# Number of frames on either side whose median a frame is compared with. A few deviating frames are outliers;
# a majority of them is a change.
_NEIGHBOURS = 5

# Fewest frames and shortest time of a change that can be distinguished from a long braking.
LEAST_FRAMES = 5
LEAST_SPAN_S = 20.0

# Numbers of frames since a change that are tested. They grow in steps of 5 %, which delays the detection by
# no more than that.
_LENGTHS: Indices = np.unique(np.geomspace(1, 1e5, 237).astype(np.intp))
# Rounds of measuring the scatter: it is measured about the means before and after the change.
_ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class FrameSeries:
    """Frames in the order of time.

    Attributes:
        times_s: (N,) times [s], rising.
        values: (N, 3) height_m, pitch_rad, roll_rad.
        variances: (N, 3) variances of their noise.
        used: (N,) False for outliers.
    """

    times_s: Array
    values: Array
    variances: Array
    used: Mask

    def __len__(self) -> int:
        return len(self.times_s)

    def part(self, which: slice) -> FrameSeries:
        """Return some of the frames."""
        return FrameSeries(self.times_s[which], self.values[which], self.variances[which], self.used[which])


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The mean before the first frame, as far as it is known.

    Attributes:
        mean: (3,) height_m, pitch_rad, roll_rad.
        variance: (3,) variances of the mean, without motion.
        moments: 1 if the mean is that of one moment of a moving car, 0 if it is a mean over minutes.
    """

    mean: Array
    variance: Array
    moments: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Scatter of the frames about their mean.

    Attributes:
        motion: (3,) variance of the motion by suspension and road.
        inflation: (3,) variance of a mean over its variance for independent frames.
        freedom: Degrees of freedom of that estimate.
    """

    motion: Array
    inflation: Array
    freedom: float


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


def prior_scatter() -> Scatter:
    """Return the scatter that is assumed before the first frame."""
    return Scatter(MOTION_STD**2, np.ones(3), _MOTION_FRAMES)


def mark_outliers(series: FrameSeries, known: int) -> Mask:
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
    # A few frames may lie close together by chance. A least scatter keeps the ordinary motion on a road from
    # being an outlier.
    scale = np.sqrt(np.maximum(spread, MOTION_STD / 2.0) ** 2 + series.variances[known:])
    used[known:] = np.all(np.abs(series.values[known:] - medians) <= OUTLIER_SIGMAS * scale, axis=1)
    return used


def settled_outliers(n: int) -> int:
    """Return how many of ``n`` frames have all the neighbours that decide whether they are outliers."""
    return max(0, n - _NEIGHBOURS)


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
        scatter = prior_scatter()
        for _ in range(_ROUNDS):
            scatter = measure_scatter(series, _best(series, candidates, reference, scatter).split)
    return _best(series, candidates, reference, scatter)


def measure_scatter(series: FrameSeries, split: int = 0) -> Scatter:
    """Return the scatter of frames about the means before and after a change.

    Args:
        series: The frames.
        split: Index of the first frame after the change; 0 for no change.
    """
    used = series.used
    residuals = np.zeros_like(series.values)
    for part in (slice(0, split), slice(split, None)):
        inside = used[part]
        if inside.any():
            residuals[part][inside] = series.values[part][inside] - series.values[part][inside].mean(axis=0)
    times, r = series.times_s[used], residuals[used]
    n = len(times)
    means = 1.0 + (split > 0)
    excess = (r**2 - series.variances[used]).sum(axis=0)
    motion = (_MOTION_FRAMES * MOTION_STD**2 + excess) / (_MOTION_FRAMES + max(n - means, 0.0))
    motion = np.maximum(motion, (_LEAST_MOTION * MOTION_STD) ** 2)
    if n < 2:
        return Scatter(motion, np.ones(3), _MOTION_FRAMES)
    step_s = max(float(np.median(np.diff(times))), 1e-3)
    repeated = math.exp(-step_s / _MEMORY_S)
    assumed = (1.0 + repeated) / (1.0 - repeated)
    horizon_s = float(
        np.clip(_HORIZON_OF_SPAN * (times[-1] - times[0]), _SHORTEST_HORIZON_S, _LONGEST_HORIZON_S)
    )
    lags = min(n - 1, int(horizon_s / step_s))
    power = (r**2).sum(axis=0)
    repeats = np.zeros(3)
    for lag in range(1, lags + 1):
        weight = np.maximum(0.0, 1.0 - (times[lag:] - times[:-lag]) / horizon_s)
        repeats += (weight[:, None] * r[lag:] * r[:-lag]).sum(axis=0)
    measured = 1.0 + 2.0 * repeats / np.maximum(power, np.finfo(float).tiny)
    inflation = (_MEMORY_FRAMES * assumed + n * np.maximum(measured, 1.0)) / (_MEMORY_FRAMES + n)
    # Degrees of freedom of a spectrum at frequency 0 by Bartlett's window: 3 n / 2 m (Priestley, Spectral
    # Analysis, table 6.2).
    freedom = _MOTION_FRAMES + 1.5 * n / max(lags, 1)
    return Scatter(motion, inflation, freedom)


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
    rougher = np.maximum(1.0, (_MOTION_FRAMES + chi2) / (_MOTION_FRAMES + n_after - 1.0))
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


def _as_normal(t: Array, freedom: float) -> Array:
    """Return the normal variable with the tail of Student's t (Wallace, Ann. Math. Stat. 30, 1959)."""
    factor = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    normal: Array = np.sign(t) * factor * np.sqrt(freedom * np.log1p(t**2 / freedom))
    return normal
