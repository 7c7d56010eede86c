"""The continuous watch: does the road still show the calibration in force? Derived in docs/watch.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import POSE_COMPONENTS
from ..results import CalibrationResult
from ..tolerances import AGREEMENT
from ..types import Array
from .drift import (
    LEAST_FRAMES,
    LEAST_SPAN_S,
    DriftChange,
    Reference,
    Series,
    find_change,
    mark_outliers,
    mean_of,
    measure_scatter,
    prior_scatter,
    reference_variance,
    settled_outliers,
)
from .fusion import fuse_frames
from .states import WatchVerdict

# |z| from which on the alarm is raised: one false alarm in some hundred hours of good road.
ALARM_SIGMAS = 5.0
# Log likelihood ratio against the drift from which on it is taken back: 1000 to 1 (as in Wald's test).
RECOVERY_EVIDENCE = math.log(1000.0)
# |z| of the frames after the alarm alone, from which on they prove the drift: they were not chosen for it.
PROOF_SIGMAS = 3.0
# Against a drift of at least this part of the one found, as an alarm finds it too large rather than too
# small: by 1.5 of its standard deviations, of which it has five.
_LEAST_OF_DRIFT = 0.7
# How far beyond "none" and "all of the drift" a frame may speak: then an outlier counts as three.
_LEAST_SHARE, _GREATEST_SHARE = -1.0, 2.0

_BOUND_SIGMAS = 2.0

# A mean that takes the place of a calibration: enough road for a bump or a camber to be little of it.
PROPOSAL_FRAMES = 12
PROPOSAL_SPAN_S = 60.0
# A change within the frames of such a mean: what is before it belongs to another pose.
_SPLIT_SIGMAS = 4.0

# Bounds memory and time. What is dropped goes into the reference.
_MOST_FRAMES = 1500
_DROPPED = 500

# Their scatter is measured anew whenever there are so many more.
_SCATTER_STEP = 0.02

# Between two frames farther apart than this no road was seen: it counts as so much.
_LONGEST_STEP_S = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class _Doubt:
    """An alarm: everything as it was then.

    Attributes:
        change: The change that raised it.
        n_before: Frames from the change on that were there then.
    """

    change: DriftChange
    n_before: int


class Watch:
    """Compares the frames since a calibration with it; one thread at a time.

    Frames after a possible change are compared with the calibration and the frames before it, for every
    moment the change may have come at. Rejected frames are passed over.
    """

    def __init__(self) -> None:
        self.start(None)

    def start(self, result: CalibrationResult | None, settled: bool = False) -> None:
        """Watch over a calibration from now on.

        Args:
            result: The calibration in force, None if there is none: then a mean is gathered.
            settled: Whether it is the mean of minutes of road, so that its covariance has the motion
                of the car in it. A frame of a moving car, or ten in a second, are of one moment.
        """
        self._reference: Reference | None = None
        if result is not None and result.extrinsics is not None and result.covariance is not None:
            variance = np.diagonal(result.covariance).copy()
            self._reference = Reference(result.extrinsics.as_array(), variance, 0.0 if settled else 1.0)
        self._forget()

    def _forget(self) -> None:
        self._results: list[CalibrationResult] = []
        self._series = Series(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=bool))
        self._last_stamp_s: float | None = None
        self._time_s = 0.0
        self._change: DriftChange | None = None
        self._next_scatter = 0
        self._doubt: _Doubt | None = None
        self._verdict = WatchVerdict()

    @property
    def verdict(self) -> WatchVerdict:
        """What it thinks now."""
        return self._verdict

    @property
    def n_frames(self) -> int:
        """Frames it has in mind."""
        return len(self._series)

    @property
    def deviation(self) -> float:
        """Greatest deviation of the frames since any moment, in standard deviations; 0 before the first."""
        return 0.0 if self._change is None else self._change.size

    @property
    def progress(self) -> float:
        """How far it is on its way to its first comparison, 0 to 1."""
        if self._reference is None:
            frames, span_s = PROPOSAL_FRAMES, PROPOSAL_SPAN_S
        else:
            frames, span_s = LEAST_FRAMES, LEAST_SPAN_S
        series = self._series
        seen_s = float(series.times_s[-1] - series.times_s[0]) if len(series) else 0.0
        return min(1.0, np.count_nonzero(series.used) / frames, seen_s / span_s)

    def explain(self) -> str:
        """Return what it has to say, one sentence."""
        seen = f"{self.n_frames} frames"
        if self._verdict.doubted:
            proven = "proven" if self._verdict.proven else "not proven"
            return f"drift, {proven} by the frames since the alarm: {self._verdict.message}"
        if self._reference is None:
            return f"nothing to compare with; {seen}, {self.progress:.0%} of what a mean takes"
        if self._change is None:
            return f"{seen}, {self.progress:.0%} of what a first comparison takes"
        axis = self._change.axis
        component = POSE_COMPONENTS[axis]
        drift = component.small_unit.text(self._change.drift[axis], "+")
        return (
            f"no drift in {seen}: {component.label} by {drift} at most, "
            f"{self.deviation:.1f} standard deviations; alarm at {ALARM_SIGMAS:g}"
        )

    def add(self, result: CalibrationResult) -> WatchVerdict:
        """Take in a frame; :attr:`CalibrationResult.stamp_s` says when it was."""
        if result.extrinsics is None or result.covariance is None:
            return self._verdict
        self._append(result)
        if self._doubt is None:
            self._look_for_change()
        else:
            self._look_at_doubt(self._doubt)
        return self._verdict

    def proposal(self, rig: StereoRig) -> CalibrationResult | None:
        """Return a calibration that is proven to be better than the one in force, None if there is none.

        It is the mean of at least a minute of road since the change; its covariance has the motion of the
        car in it. Where no calibration is in force, any such mean is better.

        Args:
            rig: The rig all frames come from.
        """
        if self._reference is not None and not self._verdict.proven:
            return None
        start = 0
        change = find_change(self._series, None)
        if change is not None and change.size >= _SPLIT_SIGMAS:
            start = change.split
        series = self._series.part(slice(start, None))
        if np.count_nonzero(series.used) < PROPOSAL_FRAMES:
            return None
        if series.times_s[-1] - series.times_s[0] < PROPOSAL_SPAN_S:
            return None
        used = [r for r, use in zip(self._results[start:], series.used, strict=True) if use]
        scatter = measure_scatter(series)
        return fuse_frames(used, rig, np.diag(scatter.motion), float(scatter.inflation.max()))

    def _append(self, result: CalibrationResult) -> None:
        assert result.extrinsics is not None and result.covariance is not None
        if self._last_stamp_s is not None:
            # A clock that jumps back (a recording that starts anew) is a pause like any other.
            step_s = result.stamp_s - self._last_stamp_s
            self._time_s += min(step_s, _LONGEST_STEP_S) if step_s > 0.0 else _LONGEST_STEP_S
        self._last_stamp_s = result.stamp_s
        self._results.append(replace(result, pattern=None, unused_lines=(), genetic=None, gates=()))
        old = self._series
        series = Series(
            np.append(old.times_s, self._time_s),
            np.vstack([old.values, result.extrinsics.as_array()]),
            np.vstack([old.variances, np.diagonal(result.covariance)]),
            np.append(old.used, True),
        )
        self._series = replace(series, used=mark_outliers(series, settled_outliers(len(old))))
        if len(self._series) > _MOST_FRAMES:
            self._shorten()

    def _shorten(self) -> None:
        """Take the oldest frames into the reference; those since an alarm are only forgotten."""
        oldest, rest = self._series.part(slice(0, _DROPPED)), slice(_DROPPED, None)
        if self._doubt is not None:
            self._doubt = replace(self._doubt, n_before=max(0, self._doubt.n_before - _DROPPED))
        elif self._reference is not None:
            scatter = self._change.scatter if self._change else prior_scatter()
            mean, variance = mean_of(oldest, scatter)
            known, new = 1.0 / reference_variance(self._reference, scatter), 1.0 / variance
            total = known + new
            self._reference = Reference((known * self._reference.mean + new * mean) / total, 1.0 / total, 0.0)
        self._series, self._results = self._series.part(rest), self._results[rest]
        self._next_scatter = 0

    def _look_for_change(self) -> None:
        if self._reference is None:
            return
        n = len(self._series)
        if n >= self._next_scatter:
            self._change = find_change(self._series, self._reference)
            self._next_scatter = n + 1 + int(n * _SCATTER_STEP)
        else:
            scatter = None if self._change is None else self._change.scatter
            self._change = find_change(self._series, self._reference, scatter)
        if self._change is None or self._change.size < ALARM_SIGMAS:
            return
        self._doubt = _Doubt(self._change, len(self._series) - self._change.split)
        # What was before it is in the change; what comes after it is looked at alone.
        after = slice(self._change.split, None)
        self._series, self._results = self._series.part(after), self._results[after]
        self._judge(self._doubt, proven=False)

    def _look_at_doubt(self, doubt: _Doubt) -> None:
        change, axis = doubt.change, doubt.change.axis
        since = self._series.part(slice(doubt.n_before, None))
        scatter = change.scatter
        moved = since.values[since.used, axis] - change.before[axis]
        variance = (scatter.motion[axis] + since.variances[since.used, axis]) * scatter.inflation[axis]
        if self._evidence(moved, variance, _LEAST_OF_DRIFT * change.drift[axis]) <= -RECOVERY_EVIDENCE:
            self._take_back(doubt)
            return
        proven = self._verdict.proven
        if len(moved) and not proven:
            weights = 1.0 / variance
            std = math.sqrt(1.0 / weights.sum() + change.before_variance[axis])
            mean = float((weights * moved).sum() / weights.sum())
            proven = mean * math.copysign(1.0, change.drift[axis]) >= PROOF_SIGMAS * std
        self._judge(doubt, proven)

    @staticmethod
    def _evidence(moved: Array, variance: Array, drift: float) -> float:
        """Return the log likelihood ratio for a drift over none since it was last at its greatest."""
        share = np.clip(moved / drift, _LEAST_SHARE, _GREATEST_SHARE)
        sums = np.cumsum(drift**2 * (2.0 * share - 1.0) / (2.0 * variance))
        if not len(sums):
            return 0.0
        return float(sums[-1] - max(sums.max(), 0.0))

    def _take_back(self, doubt: _Doubt) -> None:
        """The road shows the old pose again: go on from what was known before the change."""
        change = doubt.change
        self._forget()
        self._reference = Reference(change.before, change.before_variance, 0.0)

    def _judge(self, doubt: _Doubt, proven: bool) -> None:
        """Say how large the drift is, over all frames since the change."""
        change = doubt.change
        mean, variance = mean_of(self._series, change.scatter)
        drift, std = mean - change.before, np.sqrt(variance + change.before_variance)
        least = (np.abs(drift) - _BOUND_SIGMAS * std) / AGREEMENT
        most = (np.abs(drift) + _BOUND_SIGMAS * std) / AGREEMENT
        axis = int(np.argmax(least)) if least.max() >= 1.0 else change.axis
        component = POSE_COMPONENTS[axis]
        unit = component.small_unit
        self._verdict = WatchVerdict(
            doubted=True,
            proven=proven,
            least=float(least.max()),
            most=float(most.max()),
            message=f"{component.label} over the road has changed by {unit.text(drift[axis], '+')} "
            f"(std {unit.text(std[axis])}; limit {unit.text(AGREEMENT[axis])})",
        )
