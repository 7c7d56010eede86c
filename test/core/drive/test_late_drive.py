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

"""Drives whose right images are late: what is measured of each frame, and what of all of them."""

from dataclasses import replace

import numpy as np
import pytest
from street_making import Place, along, street_pair

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.delay_report import is_late
from stereo_selfcal.core.drive.motion_between_frames import FrameMotion
from stereo_selfcal.core.drive.right_delay import SeenAhead, estimate_delay, speeds_at
from stereo_selfcal.core.drive.travel import TravelStep
from stereo_selfcal.core.rejection import NotFitted, RejectReason

RIG = StereoRig(620, 188, 360.0, 360.0, 305.0, 90.0, 0.54)
STD_M = 0.003
START = Place(yaw_rad=0.01, pitch_rad=0.035, roll_rad=0.01)


def steps_at(speeds_mps, period_s=0.1):
    def motion(way_m):
        return FrameMotion(np.zeros(3), np.array([way_m, 0.0, 0.0]), 0.0, np.eye(7), 50, 1.0)

    return [
        TravelStep(i * period_s, period_s, motion(speed * period_s)) for i, speed in enumerate(speeds_mps)
    ]


def test_the_delay_is_what_the_stamps_do_not_say():
    steps = steps_at(np.linspace(5.0, 15.0, 40))
    stamps = np.arange(1, 39) * 0.1
    speeds = speeds_at(stamps, steps)
    seen = [SeenAhead(t, 0.012 * v, STD_M, 0.008) for t, v in zip(stamps, speeds, strict=True)]
    assert estimate_delay(seen, steps, RIG).delay_s == pytest.approx(0.004, abs=1e-4)
    unstamped = [replace(each, stamp_difference_s=0.0) for each in seen]
    assert estimate_delay(unstamped, steps, RIG).delay_s == pytest.approx(0.012, abs=1e-4)


def test_without_steps_no_speed_is_known():
    assert isinstance(estimate_delay([SeenAhead(0.1 * i, 0.0, STD_M) for i in range(9)], [], RIG), NotFitted)
    assert isinstance(estimate_delay([], [], RIG), NotFitted)


def test_refused_frames_tell_the_delay():
    """Images that are 20 ms late are refused for that, and all of them together say how late."""
    delay_s, period_s = 0.02, 0.1
    calibrator, results = Calibrator(RIG), []
    for index in range(6):
        stamp_s = index * period_s
        way_m = [6.0 * time_s + 8.0 * time_s**2 for time_s in (stamp_s, stamp_s + delay_s)]
        places = [along(START, each) for each in way_m]
        results.append(
            calibrator.add(*street_pair(RIG, places[0], right_place=places[1], seed=index), stamp_s)
        )
    assert {result.reason for result in results} == {RejectReason.IMAGES_NOT_SYNCHRONISED}
    assert all(result.lateness.surely for result in results)
    estimate = calibrator.estimate
    assert not estimate.accepted
    assert estimate.delay.delay_s == pytest.approx(delay_s, abs=2e-3)  # six frames of half a second
    assert estimate.delay.std[0] < 2e-3
    assert is_late(estimate.delay)
