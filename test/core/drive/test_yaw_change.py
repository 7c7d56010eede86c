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

"""A camera that is turned about the vertical during a drive, and what passes by."""

import math

import numpy as np
import pytest
from travel_making import YAW, step

from stereo_selfcal.core.drive.travel import DrivenSteps
from stereo_selfcal.core.drive.yaw_change import find_yaw_change, travel_at_end
from stereo_selfcal.core.reservations import ReservationKind

LEVEL = (0.0, 0.0)


def noisy(rng, yaws):
    return [step(i, yaw + math.radians(0.12) * rng.standard_normal()) for i, yaw in enumerate(yaws)]


def turned(rng, n_before, n_after, by_deg):
    return noisy(rng, [YAW] * n_before + [YAW + math.radians(by_deg)] * n_after)


def change_of(steps):
    return find_yaw_change(DrivenSteps.of(steps, 0.0))


def test_a_steady_camera_has_not_changed():
    found = [change_of(noisy(np.random.default_rng(i), [YAW] * 300)) for i in range(40)]
    assert found == [None] * 40


@pytest.mark.parametrize("by_deg", [-3.0, 1.5, 3.0])
def test_after_a_turn_the_yaw_is_that_since_and_the_turn_is_told(by_deg):
    steps = turned(np.random.default_rng(1), 150, 150, by_deg)
    change = change_of(steps)
    assert change.at_s == pytest.approx(115.0, abs=1.5)
    assert math.degrees(change.by_rad) == pytest.approx(by_deg, rel=0.15)
    found = travel_at_end(steps, LEVEL, 10)
    assert abs(math.degrees(found.travel.yaw_rad - YAW) - by_deg) < 3.0 * math.degrees(found.travel.std[0])
    (reservation,) = found.reservations
    assert reservation.kind is ReservationKind.YAW_CHANGED
    assert f"{'+' if by_deg > 0 else '-'}" in reservation.detail and " deg at 11" in reservation.detail


def test_a_turn_just_before_the_end_leaves_the_yaw_uncertain_by_half_of_it():
    found = travel_at_end(turned(np.random.default_rng(2), 200, 50, 3.0), LEVEL, 10)
    assert not found.travel.tells_yaw
    assert found.reservations


def test_a_lorry_that_passes_for_a_second_is_no_turn():
    rng = np.random.default_rng(3)
    yaws = [YAW] * 300
    yaws[200:212] = [YAW + 0.05] * 12
    assert change_of(noisy(rng, yaws)) is None


def test_bends_are_no_turn_of_the_camera():
    rng = np.random.default_rng(4)
    turns = np.concatenate([np.zeros(100), np.full(100, 0.012), np.zeros(100)])
    steps = [
        step(i, YAW - 2.0 * turn + math.radians(0.12) * rng.standard_normal(), turn=turn)
        for i, turn in enumerate(turns)
    ]
    assert change_of(steps) is None
