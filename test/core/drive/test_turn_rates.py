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

"""Turn rates and speeds of odometry and gyroscopes: their mean over a step, and where they contradict it."""

import math

import numpy as np
import pytest
from travel_making import step

from stereo_selfcal.core.drive import turn_rates as module
from stereo_selfcal.core.drive.turn_rates import MeanTurn, TurnRate, TurnRates, contradicts

RATES_HZ = [5.0, 10.0, 50.0, 100.0, 400.0]


def swerve(stamp_s):
    """Return the turn rate of a lane change of 4 s [rad/s]."""
    return 0.1 * math.sin(2 * math.pi * stamp_s / 4.0)


def sampled(rate_hz, duration_s=8.0, start_s=0.0, of=swerve, speed=None):
    count = int(duration_s * rate_hz) + 1
    stamps = [start_s + i / rate_hz for i in range(count)]
    return [TurnRate(each, of(each - start_s), None if speed is None else speed(each)) for each in stamps]


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("start_s", [0.0, 1.7e9])
def test_mean_is_the_integral_over_the_time(rate_hz, start_s):
    """Of the sine, whose integral is known; straight lines between the samples leave a part of its bend."""
    rates = TurnRates(sampled(rate_hz, start_s=start_s))
    for begin, end in [(0.33, 0.43), (1.0, 1.5), (2.0, 3.21)]:
        integral = 0.1 * 4.0 / (2 * math.pi) * (math.cos(math.pi * begin / 2) - math.cos(math.pi * end / 2))
        found = rates.over(start_s + begin, start_s + end)
        bend = 0.1 * (math.pi / 2) ** 2 * max(1 / rate_hz, module._BIN_S) ** 2 / 8.0
        assert found.yaw_rate_radps == pytest.approx(integral / (end - begin), abs=bend + 2e-7)
        assert found.speed_mps is None


def test_samples_in_any_order_give_the_same():
    """Within a bin, a mean has rounding."""
    samples = sampled(100.0, speed=lambda stamp: 10.0 + stamp)
    shuffled = list(samples)
    np.random.default_rng(1).shuffle(shuffled)
    for begin in np.arange(0.5, 7.0, 0.5):
        ordered, mixed = (TurnRates(each).over(begin, begin + 0.3) for each in (samples, shuffled))
        assert mixed.yaw_rate_radps == pytest.approx(ordered.yaw_rate_radps, abs=1e-12)
        assert mixed.speed_mps == pytest.approx(ordered.speed_mps, abs=1e-12) == pytest.approx(10.15 + begin)


def test_no_samples_no_mean():
    assert TurnRates().over(0.0, 1.0) is None
    assert TurnRates(sampled(10.0)).over(20.0, 20.1) is None
    assert TurnRates(sampled(10.0)).over(-5.0, -4.9) is None


@pytest.mark.parametrize(("missing_s", "known"), [(0.4, True), (0.7, False)])
def test_a_gap_of_more_than_half_a_second_is_no_mean(missing_s, known):
    rates = TurnRates(each for each in sampled(20.0) if not 2.0 < each.stamp_s < 2.0 + missing_s)
    assert (rates.over(2.1, 2.2) is not None) is known
    assert (rates.over(1.5, 2.5 + missing_s) is not None) is known
    assert rates.over(1.5, 1.9) is not None and rates.over(3.0, 3.5) is not None


@pytest.mark.parametrize(("late_s", "known"), [(0.09, True), (0.12, False)])
def test_last_sample_holds_for_a_tenth_of_a_second(late_s, known):
    rates = TurnRates(sampled(10.0))
    assert (rates.over(7.8, 8.0 + late_s) is not None) is known
    assert (rates.over(-late_s, 0.2) is not None) is known
    assert (rates.over(8.0, 8.0 + late_s) is not None) is known, "without a sample inside"


def test_no_time_has_no_mean():
    rates = TurnRates(sampled(10.0))
    assert rates.over(2.0, 2.0) is None and rates.over(2.1, 2.0) is None


def test_speed_is_that_of_those_who_tell_it():
    """Of an odometry at 10 Hz beside a gyroscope at 100 Hz."""
    rates = TurnRates([*sampled(100.0), *sampled(10.0, speed=lambda stamp: 12.0)])
    assert rates.over(3.0, 3.2).speed_mps == pytest.approx(12.0)
    rates = TurnRates([*sampled(100.0), *sampled(10.0, duration_s=2.0, speed=lambda stamp: 12.0)])
    assert rates.over(3.0, 3.2) is not None and rates.over(3.0, 3.2).speed_mps is None


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["stamp_s", "yaw_rate_radps", "speed_mps"])
def test_what_is_no_number_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} of a turn rate is {value}: a finite number is needed"):
        TurnRate(**{"stamp_s": 1.0, "yaw_rate_radps": 0.0, "speed_mps": 1.0} | {name: value})


def test_memory_is_bounded_and_keeps_the_newest(monkeypatch):
    monkeypatch.setattr(module, "_MOST_BINS", 100)
    rates = TurnRates(sampled(100.0, duration_s=60.0))
    assert len(rates._rates._bins) <= 100
    assert rates.over(59.0, 59.5) is not None and rates.over(30.0, 30.5) is None
    many = TurnRates(sampled(400.0, duration_s=1.0))
    assert len(many._rates._bins) <= 51, "samples of 20 ms are one"


def turn_of(turning, speed_mps=10.0):
    return MeanTurn(turning, speed_mps)


TURNING = step(0, turn=0.02)  # 0.2 rad/s at 10 m/s
# Noise of the landmarks of travel_making, and bias: standard deviation of the difference of the turn [rad].
NOISE_RAD = math.hypot(1e-4, math.radians(0.5) * 0.1)


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        (turn_of(0.2), False),
        (turn_of(-0.2), True),
        (turn_of(0.0), True),
        (turn_of(0.2 * 1.03), False),
        (turn_of(0.2 + math.radians(1.5)), False),
        (turn_of(0.2 + math.radians(4.0)), True),
        (turn_of(0.2, 10.0 * 1.15), False),
        (turn_of(0.2, 10.0 / 1.3), True),
        (turn_of(0.2, -10.0), True),
        (turn_of(0.2, 36.0), True),
        (turn_of(0.2, None), False),
        (turn_of(-0.2, None), True),
    ],
)
def test_a_sign_a_unit_and_a_fault_contradict_what_a_sensor_leaves_does_not(turn, expected):
    assert contradicts(TURNING, turn) is expected


@pytest.mark.parametrize(("sigmas", "expected"), [(3.9, False), (4.1, True)])
def test_four_standard_deviations_are_the_limit(sigmas, expected):
    straight = step(0)
    assert contradicts(straight, MeanTurn(sigmas * NOISE_RAD / 0.1 * 1.0075)) is expected
    # The scale of the rate is a part of its standard deviation: 4 sigmas make 0.75 % more of it.


@pytest.mark.parametrize(("sigmas", "expected"), [(3.95, False), (4.05, True)])
def test_limit_of_the_speed_has_the_noise_of_the_way_and_the_scale(sigmas, expected):
    """The way is known to 5 mm of 1 m, the speed to 5 %: both ways by which it differs so much are told."""
    scale, noise_m = sigmas * 0.05, sigmas * 0.005
    for way_m in np.roots([1.0 - scale**2, -2.0, 1.0 - noise_m**2]):
        assert contradicts(step(0), MeanTurn(0.0, float(way_m) / 0.1)) is expected


def test_a_car_that_reverses_has_a_negative_speed():
    back = step(0, way_m=-1.0)
    assert not contradicts(back, MeanTurn(0.0, -10.0)) and contradicts(back, MeanTurn(0.0, 10.0))


def test_a_lane_change_with_a_gyroscope_of_a_car_is_never_contradicted():
    """With its noise, bias, scale and the delay of 20 ms that its stamps may have."""
    rng = np.random.default_rng(5)
    samples = [
        TurnRate(
            each.stamp_s + 0.02,
            1.03 * each.yaw_rate_radps + math.radians(0.5) + rng.normal(0.0, math.radians(0.3)),
        )
        for each in sampled(100.0)
    ]
    rates = TurnRates(samples)
    for i in range(1, 79):
        begin = 0.1 * i
        turned = sum(swerve(begin + 0.001 * (j + 0.5)) for j in range(100)) * 0.001
        assert not contradicts(step(i, turn=turned + rng.normal(0.0, 1e-4)), rates.over(begin, begin + 0.1))
