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

import math

import numpy as np
import pytest
from landmark_making import RIG, SHORT_RIG

from stereo_selfcal.core.drive.motion_between_frames import FrameMotion
from stereo_selfcal.core.drive.right_delay import RightDelay, fit_delay, speeds_at
from stereo_selfcal.core.drive.travel import TravelStep
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road.priors import BASELINE_DIRECTION_STD_RAD

NOISE = np.eye(7) * 1e-6


def step_at(stamp_s, duration_s, way_m):
    motion = FrameMotion(np.zeros(3), np.array([way_m, 0.0, 0.0]), 0.0, NOISE, 100, 1.0)
    return TravelStep(stamp_s, duration_s, motion)


STD_M = 0.0015


def measured(rng, delay_s, offset_m, speed):
    return offset_m + speed * delay_s + STD_M * rng.standard_normal(len(speed))


def fit(ahead, speed, rig=RIG):
    found = fit_delay(ahead, np.full(len(speed), STD_M), speed, rig)
    assert isinstance(found, RightDelay), found.reason
    return found


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
@pytest.mark.parametrize("delay_s", [0.0, 0.002, 0.005, 0.02, -0.008])
def test_delay_and_offset_come_apart_where_the_speed_varies(rig, delay_s):
    speed = np.linspace(5.0, 15.0, 60)
    found = fit(measured(np.random.default_rng(1), delay_s, 0.0005, speed), speed, rig)
    assert found.delay_s == pytest.approx(delay_s, abs=0.3e-3)
    assert found.std[0] < 0.2e-3


def test_at_constant_speed_only_the_sum_is_known():
    speed = np.full(60, 10.0)
    found = fit(measured(np.random.default_rng(1), 0.0, 0.02, speed), speed)
    assert found.offset_m + 10.0 * found.delay_s == pytest.approx(0.02, abs=1e-3)
    prior_m = math.hypot(BASELINE_DIRECTION_STD_RAD * RIG.baseline_m, 0.02)
    assert found.std[0] == pytest.approx(prior_m / 10.0, rel=0.05)
    assert found.std[1] == pytest.approx(prior_m, rel=0.05)
    correlation = found.covariance[0, 1] / (found.std[0] * found.std[1])
    assert correlation < -0.95
    of_sum = np.array([10.0, 1.0])
    assert math.sqrt(of_sum @ found.covariance @ of_sum) < 0.001


def test_errors_are_as_large_as_the_covariance_says():
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(200):
        speed = rng.uniform(5.0, 15.0, 60)
        offset_m = BASELINE_DIRECTION_STD_RAD * RIG.baseline_m * rng.standard_normal()
        found = fit(measured(rng, 0.004, offset_m, speed), speed)
        ratios.append(([found.delay_s, found.offset_m] - np.array([0.004, offset_m])) / found.std)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((rms > 0.85) & (rms < 1.15)), rms


def test_wrong_frames_do_not_count():
    speed = np.linspace(5.0, 15.0, 60)
    ahead = measured(np.random.default_rng(3), 0.005, 0.0, speed)
    ahead[::6] += 0.2
    found = fit(ahead, speed)
    assert found.delay_s == pytest.approx(0.005, abs=0.5e-3)
    assert found.n_frames <= 51


def test_unknown_speeds_are_left_out_and_too_few_frames_are_a_reason():
    speed = np.array([5.0, math.nan, 10.0, 15.0])
    assert fit(0.004 * np.nan_to_num(speed), speed).n_frames == 3
    assert isinstance(fit_delay([0.0, 0.0], [1.0, 1.0], [1.0, 2.0], RIG), NotFitted)


def test_speeds_are_those_of_the_steps_around():
    steps = [step_at(100.0, 0.1, 1.0), step_at(100.1, 0.1, 2.0)]
    found = speeds_at([100.0, 100.1, 100.2, 102.0], steps)
    np.testing.assert_allclose(found, [math.nan, 15.0, math.nan, math.nan], rtol=1e-6)
    assert np.all(np.isnan(speeds_at([1.0], [])))


def test_a_wrong_step_changes_no_speed_and_noise_averages_out():
    rng = np.random.default_rng(5)
    times = 100.0 + 0.1 * np.arange(40)
    true_mps = 5.0 + 2.5 * (times + 0.05 - 100.0)
    ways = 0.1 * true_mps * (1.0 + 0.05 * rng.standard_normal(40))
    ways[20] *= 3.0
    found = speeds_at(times[8:32], [step_at(time, 0.1, way) for time, way in zip(times, ways, strict=True)])
    np.testing.assert_allclose(found, true_mps[8:32] - 0.125, rtol=0.05)
