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

"""The drives the watch is measured on: they scatter as they say, and are the same every time."""

import math

import numpy as np
import pytest

from benchmarks.watch import BUMPS, PERIOD_S, RIDES, Ride, drive, moved, run

SMOOTH = Ride("smooth", (0.002, 0.03, 0.03), 2.0)


@pytest.mark.parametrize("ride", RIDES, ids=lambda ride: ride.name)
def test_motion_has_the_scatter_and_memory_it_is_named_for(ride):
    times = np.arange(20_000) * PERIOD_S
    motion = moved(ride, times, np.random.default_rng(0))
    height_m, pitch_deg, roll_deg = ride.std
    expected = [height_m, math.radians(pitch_deg), math.radians(roll_deg)]
    np.testing.assert_allclose(motion.std(axis=0), expected, rtol=0.15)
    repeated = np.mean(motion[1:] * motion[:-1], axis=0) / motion.var(axis=0)
    assert repeated[0] == pytest.approx(math.exp(-PERIOD_S / ride.memory_s), abs=0.05)
    assert repeated[2] == pytest.approx(math.exp(-PERIOD_S / ride.memory_s / 2), abs=0.05)


def test_some_road_has_no_usable_frames():
    times, poses = drive(RIDES[0], 3600.0, np.random.default_rng(1))
    steps = np.diff(times)
    assert len(times) == len(poses) < 3600.0 / PERIOD_S * 0.95
    assert steps.max() > 10.0
    assert steps.min() == pytest.approx(PERIOD_S)


def test_a_run_is_the_same_every_time_and_sees_a_bump():
    first, again = (run(SMOOTH, 3, BUMPS["pitch 0.3°"]) for _ in range(2))
    assert (first.alarm_s, first.proof_s, first.better_s) == (again.alarm_s, again.proof_s, again.better_s)
    assert not first.false_alarm
    assert 0.0 < first.alarm_s <= first.proof_s <= first.better_s
