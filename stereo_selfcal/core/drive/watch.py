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

"""The continuous watch: it tests whether the frames still agree with the active calibration.

The method is derived in docs/watch.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import POSE_COMPONENTS
from ..geometry.uncertainty import total_covariance
from ..results import CalibrationResult
from ..tolerances import AGREEMENT
from ..types import Array
from .drift import (
    LEAST_FRAMES,
    LEAST_SPAN_S,
    DriftChange,
    Reference,
    find_change,
    mean_of,
    measure_scatter,
    reference_variance,
)
from .frame_series import FrameSeries
from .fusion import frame_series, fuse_frames, own_covariance
from .motion import mark_outliers, settled_outliers
from .states import WatchVerdict

# Least |z| that raises an alarm: one false alarm in some hundred hours of good road.
ALARM_SIGMAS = 5.0
# Least log likelihood ratio against the drift that withdraws the alarm: 1000 to 1 (as in Wald's test).
RECOVERY_EVIDENCE = math.log(1000.0)
# Least |z| of the frames after the alarm alone that proves the drift. These frames did not select the alarm.
PROOF_SIGMAS = 3.0
# The recovery is tested against this fraction of the drift that was found. An alarm tends to overestimate the
# drift, by 1.5 of its five standard deviations.
_LEAST_OF_DRIFT = 0.7
# Limits of a frame's share of the drift, beyond 0 (no drift) and 1 (all of the drift). An outlier then counts
# as three frames.
_LEAST_SHARE, _GREATEST_SHARE = -1.0, 2.0

_BOUND_SIGMAS = 2.0

# Least frames and time of a mean that replaces a calibration. On so much road, a bump or a camber has little
# influence.
PROPOSAL_FRAMES = 12
PROPOSAL_SPAN_S = 60.0
# Least |z| of a change within the frames of such a mean. The frames before the change belong to another pose.
_SPLIT_SIGMAS = 4.0

# Most frames that are kept, which limits memory and time. Dropped frames are merged into the reference.
_MOST_FRAMES = 1500
_DROPPED = 500

# Growth of the number of frames after which their scatter is measured anew.
_SCATTER_STEP = 0.05

# Longest time that a step between two frames counts: during a longer pause no road was seen.
_LONGEST_STEP_S = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class _Alarm:
    """An alarm, with the state at the time when it was raised.

    Attributes:
        change: The change that raised the alarm.
        n_before: Number of frames between the change and the alarm.
    """

    change: DriftChange
    n_before: int


class Watch:
    """Compares the frames since a calibration with this calibration. It must be used by one thread at a time.

    For every possible moment of a change, the frames after it are compared with the calibration and the
    frames before it. Rejected frames are ignored.
    """

    def __init__(self) -> None:
        self.start(None)

    def start(self, result: CalibrationResult | None) -> None:
        """Start to watch a calibration.

        Args:
            result: The active calibration; None if there is none, in which case a mean is collected. Where it
                is no estimate of the mount, as from a file of an earlier version, its covariance does not
                hold the motion of the car: it is taken for that of one moment.
        """
        self._reference: Reference | None = None
        if result is not None and result.extrinsics is not None and result.covariance is not None:
            self._reference = _reference(result, result.extrinsics.as_array())
        self._forget()

    def _forget(self) -> None:
        self._results: list[CalibrationResult] = []
        self._series = FrameSeries.of(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        self._last_stamp_s: float | None = None
        self._time_s = 0.0
        self._change: DriftChange | None = None
        self._next_scatter = 0
        self._alarm: _Alarm | None = None
        self._verdict = WatchVerdict()

    @property
    def verdict(self) -> WatchVerdict:
        """Current verdict."""
        return self._verdict

    @property
    def n_frames(self) -> int:
        """Number of frames that are kept."""
        return len(self._series)

    @property
    def deviation(self) -> float:
        """Most significant deviation of the frames since any moment, in standard deviations; 0 at first."""
        return 0.0 if self._change is None else self._change.size

    @property
    def progress(self) -> float:
        """Progress towards the first comparison, 0 to 1."""
        if self._reference is None:
            frames, span_s = PROPOSAL_FRAMES, PROPOSAL_SPAN_S
        else:
            frames, span_s = LEAST_FRAMES, LEAST_SPAN_S
        series = self._series
        seen_s = float(series.times_s[-1] - series.times_s[0]) if len(series) else 0.0
        return min(1.0, np.count_nonzero(series.used) / frames, seen_s / span_s)

    def explain(self) -> str:
        """Return the state of the watch as one sentence."""
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
            f"no drift in {seen}: the greatest deviation is {drift} of the {component.label}, "
            f"{self.deviation:.1f} standard deviations; an alarm needs at least {ALARM_SIGMAS:g}"
        )

    def add(self, result: CalibrationResult) -> WatchVerdict:
        """Add a frame and return the verdict; the time of the frame is :attr:`CalibrationResult.stamp_s`.

        A frame of a car that stands where an earlier one was taken tells nothing new: it is passed over.
        """
        if result.extrinsics is None or result.covariance is None or result.stood:
            return self._verdict
        self._append(result)
        if self._alarm is None:
            self._look_for_change()
        else:
            self._review_alarm(self._alarm)
        return self._verdict

    def proposal(self, rig: StereoRig) -> CalibrationResult | None:
        """Return a calibration that is proven to be better than the active one, None if there is none.

        It is the mean of at least a minute of road since the change. Its covariance includes the motion of
        the car. Where no calibration is active, any such mean is better.

        Args:
            rig: The rig that all frames come from.
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
        return fuse_frames([r for r, use in zip(self._results[start:], series.used, strict=True) if use], rig)

    def _append(self, result: CalibrationResult) -> None:
        assert result.extrinsics is not None and result.covariance is not None
        if self._last_stamp_s is not None:
            # A clock that jumps back, because a recording starts anew, is treated as a pause.
            step_s = result.stamp_s - self._last_stamp_s
            self._time_s += min(step_s, _LONGEST_STEP_S) if step_s > 0.0 else _LONGEST_STEP_S
        self._last_stamp_s = result.stamp_s
        self._results.append(replace(result.without_pictures(), genetic=None, gates=()))
        old = self._series
        series = old.joined(replace(frame_series([result]), times_s=np.array([self._time_s])))
        self._series = replace(series, used=mark_outliers(series, settled_outliers(len(old))))
        if len(self._series) > _MOST_FRAMES:
            self._shorten()

    def _shorten(self) -> None:
        """Merge the oldest frames into the reference; the frames since an alarm are dropped instead."""
        oldest, kept = self._series.part(slice(0, _DROPPED)), slice(_DROPPED, None)
        if self._alarm is not None:
            self._alarm = replace(self._alarm, n_before=max(0, self._alarm.n_before - _DROPPED))
        elif self._reference is not None:
            scatter = self._change.scatter if self._change else measure_scatter(oldest)
            mean, variance = mean_of(oldest, scatter)
            known, new = 1.0 / reference_variance(self._reference, scatter), 1.0 / variance
            total = known + new
            self._reference = Reference(
                (known * self._reference.mean + new * mean) / total, 1.0 / total, np.zeros(3)
            )
        self._series, self._results = self._series.part(kept), self._results[kept]
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
        self._alarm = _Alarm(self._change, len(self._series) - self._change.split)
        # The mean before the change is stored in the change itself. Only the frames after it are kept.
        after = slice(self._change.split, None)
        self._series, self._results = self._series.part(after), self._results[after]
        self._measure_drift(self._alarm, proven=False)

    def _review_alarm(self, alarm: _Alarm) -> None:
        change, axis = alarm.change, alarm.change.axis
        since = self._series.part(slice(alarm.n_before, None))
        scatter = change.scatter
        moved = since.values[since.used, axis] - change.before[axis]
        variance = (scatter.motion[axis] + since.variances[since.used, axis]) * scatter.inflation[axis]
        if self._evidence(moved, variance, _LEAST_OF_DRIFT * change.drift[axis]) <= -RECOVERY_EVIDENCE:
            self._withdraw_alarm(alarm)
            return
        proven = self._verdict.proven
        if len(moved) and not proven:
            weights = 1.0 / variance
            std = math.sqrt(1.0 / weights.sum() + change.before_variance[axis])
            mean = float((weights * moved).sum() / weights.sum())
            proven = mean * math.copysign(1.0, change.drift[axis]) >= PROOF_SIGMAS * std
        self._measure_drift(alarm, proven)

    @staticmethod
    def _evidence(moved: Array, variance: Array, drift: float) -> float:
        """Return the log likelihood ratio of a drift over no drift, minus its greatest value so far."""
        share = np.clip(moved / drift, _LEAST_SHARE, _GREATEST_SHARE)
        sums = np.cumsum(drift**2 * (2.0 * share - 1.0) / (2.0 * variance))
        if not len(sums):
            return 0.0
        return float(sums[-1] - max(sums.max(), 0.0))

    def _withdraw_alarm(self, alarm: _Alarm) -> None:
        """Continue with the reference before the change, because the frames show the old pose again."""
        change = alarm.change
        self._forget()
        self._reference = Reference(change.before, change.before_variance, np.zeros(3))

    def _measure_drift(self, alarm: _Alarm, proven: bool) -> None:
        """Update the verdict with the size of the drift, measured from all frames since the change."""
        change = alarm.change
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
            f"(std {unit.text(std[axis])}), at most {unit.text(AGREEMENT[axis])} allowed",
        )


def _reference(result: CalibrationResult, mean: Array) -> Reference:
    """Return what an active calibration tells of the mean before the first frame.

    Of one moment, the motion is known by the prior alone: the frames of the watch tell more of it. The more
    moments a mean is worth, the more its own covariance counts.

    Args:
        result: The calibration.
        mean: (3,) its height, pitch and roll.
    """
    variance = np.diagonal(own_covariance(result)).copy()
    if result.mount is None:
        return Reference(mean, variance)
    of_motion = total_covariance(each for each in result.uncertainty if each.name == "motion").diagonal()
    moments = 1.0 / result.mount.looks
    return Reference(mean, variance - moments * of_motion, moments * (of_motion > 0.0))
