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

"""Turn rates and speeds of the car by its odometry or a gyroscope, beside what the images say of its motion.

They are optional. Each step between two frames is compared with them: what one of both has wrong is not used.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import shortened
from ..types import Array
from .travel import TravelStep

# Gyroscopes send up to 400 samples each second. Within 20 ms, a car turns evenly; its vibrations average out.
_BIN_S = 0.02
_MOST_BINS = 2**20  # nearly six hours without a pause, of 32 bytes each
_LEAST_KEPT = 0.9  # of the bins, where the oldest are dropped: not one by one
# Between two samples, a rate is interpolated: a driver needs a second to steer into a bend.
_LONGEST_GAP_S = 0.5
# Before the first sample and after the last one, it is taken to stay: messages come a little late.
_LONGEST_HOLD_S = 0.1

# What a gyroscope in a car leaves when its offset was measured at standstill. Data sheets of MEMS gyroscopes
# have offsets of 0.5 deg/s (Bosch BMI270) to 3 deg/s (BMI160), and scales to a few per cent. An IMU that is
# tilted by some degrees against the road sees the roll of the car as well: 2 deg/s, a tenth of it.
_BIAS_RADPS = math.radians(0.5)
_RATE_SCALE = 0.03
# Speeds by the wheels are as wrong as the radius of the tyres: by wear (7 mm of 310 mm), pressure, load and
# another size of tyre. A camera ahead of the rear axle has another speed in bends, by less than a per cent.
_SPEED_SCALE = 0.05
# One of 16 000 steps without a fault differs by more.
_CONTRADICTS_SIGMAS = 4.0


@dataclass(frozen=True, slots=True)
class TurnRate:
    """One sample of how the car turns.

    Attributes:
        stamp_s: Time stamp [s].
        yaw_rate_radps: Turn rate about the vertical [rad/s], > 0: to the left (REP-103).
        speed_mps: Speed ahead [m/s], < 0: backwards; None where the source does not tell it.

    Raises:
        ValueError: A number is not finite.
    """

    stamp_s: float
    yaw_rate_radps: float
    speed_mps: float | None = None

    def __post_init__(self) -> None:
        """Refuse what would spoil every mean."""
        for name in self.__slots__:
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} of a turn rate is {shortened(value)}: a finite number is needed")


@dataclass(frozen=True, slots=True)
class MeanTurn:
    """How the car has turned over some time, in the mean.

    Attributes:
        yaw_rate_radps: Turn rate [rad/s], > 0: to the left.
        speed_mps: Speed ahead [m/s]; None where it is not known.
    """

    yaw_rate_radps: float
    speed_mps: float | None = None


class _Series:
    """Values over time, averaged in bins; those that come late find their place. Not thread-safe."""

    def __init__(self) -> None:
        self._bins, self._counts = array("q"), array("q")
        self._stamps, self._values = array("d"), array("d")

    def add(self, stamp_s: float, value: float) -> None:
        of_bin = math.floor(stamp_s / _BIN_S)
        place = bisect_left(self._bins, of_bin)
        if place == len(self._bins) or self._bins[place] != of_bin:
            self._bins.insert(place, of_bin)
            self._counts.insert(place, 0)
            self._stamps.insert(place, 0.0)
            self._values.insert(place, 0.0)
        self._counts[place] += 1
        for means, new in ((self._stamps, stamp_s), (self._values, value)):
            means[place] += (new - means[place]) / self._counts[place]
        if len(self._bins) > _MOST_BINS:
            oldest = len(self._bins) - int(_LEAST_KEPT * _MOST_BINS)
            del self._bins[:oldest], self._counts[:oldest], self._stamps[:oldest], self._values[:oldest]

    def mean(self, start_s: float, end_s: float) -> float | None:
        """Return the mean over a time by the trapezoid; None where it has a gap, or no time passes."""
        first = bisect_left(self._stamps, start_s - _LONGEST_GAP_S)
        last = bisect_right(self._stamps, end_s + _LONGEST_GAP_S)
        if first == last or not start_s < end_s:
            return None
        # Of those outside, the nearest one on each side; without one, the value at the end stays.
        first = max(first, bisect_right(self._stamps, start_s) - 1)
        last = min(last, bisect_left(self._stamps, end_s) + 1)
        stamps: Array = np.array(self._stamps[first:last])
        values: Array = np.array(self._values[first:last])
        held_s = max(float(stamps[0]) - start_s, end_s - float(stamps[-1]))
        if held_s > _LONGEST_HOLD_S or np.any(np.diff(stamps) > _LONGEST_GAP_S):
            return None
        inside = stamps[(stamps > start_s) & (stamps < end_s)]
        times = np.concatenate([[start_s], inside, [end_s]])
        rates = np.interp(times, stamps, values)
        return float(np.sum((rates[1:] + rates[:-1]) / 2.0 * np.diff(times))) / (end_s - start_s)


class TurnRates:
    """The samples of a drive, in any order; of six hours at most. Not thread-safe: callers lock.

    Those of several sources are averaged.
    """

    def __init__(self, rates: Iterable[TurnRate] = ()) -> None:
        self._rates, self._speeds = _Series(), _Series()
        for rate in rates:
            self.add(rate)

    def add(self, rate: TurnRate) -> None:
        """Add a sample."""
        self._rates.add(rate.stamp_s, rate.yaw_rate_radps)
        if rate.speed_mps is not None:
            self._speeds.add(rate.stamp_s, rate.speed_mps)

    def over(self, start_s: float, end_s: float) -> MeanTurn | None:
        """Return how the car has turned between two times, in the mean.

        Args:
            start_s: The first time [s].
            end_s: The second time [s].

        Returns:
            The means; None where there are no samples, or a gap of more than half a second.
        """
        rate = self._rates.mean(start_s, end_s)
        return None if rate is None else MeanTurn(rate, self._speeds.mean(start_s, end_s))

    def contradict(self, step: TravelStep) -> bool:
        """Return whether the samples contradict what the images say of a step; not where there are none."""
        turn = self.over(step.stamp_s, step.stamp_s + step.duration_s)
        return turn is not None and contradicts(step, turn)


def turn_differs(step: TravelStep, yaw_rate_radps: float) -> bool:
    """Return whether a turn rate contradicts what the images say of the turn of a step.

    Args:
        step: The step.
        yaw_rate_radps: Mean turn rate during the step [rad/s].
    """
    turned_rad = yaw_rate_radps * step.duration_s
    variance = float(step.motion.covariance[2, 2])
    variance += (_BIAS_RADPS * step.duration_s) ** 2 + (_RATE_SCALE * turned_rad) ** 2
    return _is_unlikely(float(step.motion.turned_rad[2]) - turned_rad, variance)


def speed_differs(step: TravelStep, speed_mps: float) -> bool:
    """Return whether a speed contradicts what the images say of the way of a step.

    Args:
        step: The step.
        speed_mps: Mean speed ahead during the step [m/s].
    """
    moved_m = step.motion.moved_m
    ahead = moved_m / max(float(np.linalg.norm(moved_m)), np.finfo(float).tiny)
    way_m = speed_mps * step.duration_s
    variance = float(ahead @ step.motion.covariance[3:6, 3:6] @ ahead) + (_SPEED_SCALE * way_m) ** 2
    return _is_unlikely(step.way_m - way_m, variance)


def contradicts(step: TravelStep, turn: MeanTurn) -> bool:
    """Return whether odometry or a gyroscope contradicts what the images say of a step.

    Args:
        step: The step.
        turn: How the car has turned during the step, in the mean.
    """
    if turn_differs(step, turn.yaw_rate_radps):
        return True
    return turn.speed_mps is not None and speed_differs(step, turn.speed_mps)


def _is_unlikely(difference: float, variance: float) -> bool:
    return abs(difference) > _CONTRADICTS_SIGMAS * math.sqrt(variance)
