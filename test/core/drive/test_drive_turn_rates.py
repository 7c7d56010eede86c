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

"""Odometry and gyroscopes beside the images: steps that they contradict tell nothing of the yaw."""

import copy
import math

import pytest
from travel_making import YAW, step

from stereo_selfcal.core.calibrator import Calibrator
from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.drive.turn_rates import TurnRate
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
REFUSAL = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines", 0, Bound.LEAST, 2, "", "paint some"))
# Behind a lorry that turns off, the images say that the car turns and moves aside.
WRONG = range(100, 300)
STEPS = [step(i, yaw=YAW + 0.03, turn=0.02) if i in WRONG else step(i) for i in range(300)]


def driven(rates):
    calibrator = Calibrator(RIG)
    calibrator.remember(REFUSAL)
    calibrator._memory._steps = list(STEPS)
    for rate in rates:
        calibrator.note_turn_rate(rate)
    return calibrator


def of_car(rate_hz=20.0, yaw_rate=0.0):
    """Return the turn rates of the car, which drives straight on all the time."""
    return [TurnRate(100.0 + i / rate_hz, yaw_rate) for i in range(int(30.0 * rate_hz) + 1)]


def test_steps_that_the_turn_rates_contradict_are_not_used():
    travel = driven(of_car()).estimate.travel
    assert travel.n_steps <= 100 and travel.driven_s == pytest.approx(10.0)
    assert travel.yaw_rad == pytest.approx(YAW, abs=math.radians(0.05))


def test_without_turn_rates_all_steps_are_used():
    travel = driven([]).estimate.travel
    assert travel.driven_s == pytest.approx(30.0)
    assert not travel.tells_yaw or abs(travel.yaw_rad - YAW) < 3.0 * travel.std[0]


def test_steps_in_a_gap_of_the_turn_rates_are_used():
    travel = driven(rate for rate in of_car() if rate.stamp_s < 110.0).estimate.travel
    assert travel.driven_s > 29.0


def test_all_steps_are_remembered_whatever_contradicts_them():
    """They are compared with each source, to tell which one is wrong."""
    assert driven(of_car()).travel_steps == tuple(STEPS)


def test_a_copy_has_turn_rates_of_its_own():
    calibrator = driven([])
    copied = copy.deepcopy(calibrator)
    shallow = copy.copy(calibrator._memory)
    for rate in of_car():
        calibrator.note_turn_rate(rate)
    assert calibrator.estimate.travel.driven_s == pytest.approx(10.0)
    assert copied.estimate.travel.driven_s == shallow.drive.estimate.travel.driven_s == pytest.approx(30.0)
