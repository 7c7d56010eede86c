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

"""The yaw of the calibration before, where a new one has not measured it."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal.core.drive.kept_yaw import with_kept_yaw
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.results import CalibrationResult

STD = np.array([0.005, 0.002, 0.004])


def travel(yaw_rad=0.02, std_rad=0.002):
    return Travel(yaw_rad, 0.05, np.eye(2) * std_rad**2, 100, 1.3, 30.0)


def calibration(known, pitch_rad=0.05):
    pose = Extrinsics(1.4, pitch_rad, 0.01)
    return CalibrationResult("new", extrinsics=pose, covariance=np.diag(STD**2), travel=known, n_frames=5)


@pytest.mark.parametrize("own", [None, travel(0.1, 0.05), travel(0.022, 0.01)])
def test_a_steady_camera_keeps_the_yaw_that_is_known_better(own):
    old = calibration(travel())
    kept = with_kept_yaw(calibration(own), old)
    assert kept.travel is old.travel
    assert "yaw +1.14" in kept.message and "kept as it was known before" in kept.message


def test_a_yaw_that_is_measured_better_is_taken():
    new = calibration(travel(0.021, 0.001))
    assert with_kept_yaw(new, calibration(travel())) is new


def test_a_yaw_that_contradicts_the_one_before_is_taken_as_the_camera_was_turned():
    new = calibration(travel(0.08, 0.004))
    assert with_kept_yaw(new, calibration(travel())) is new


def test_a_camera_that_was_moved_has_lost_its_yaw_and_that_is_told():
    new = with_kept_yaw(calibration(None, pitch_rad=0.07), calibration(travel()))
    assert new.travel is None
    assert "the yaw of before is not kept, as the camera was moved since" in new.message
    own = calibration(travel(0.03, 0.01), pitch_rad=0.07)
    assert with_kept_yaw(own, calibration(travel())) is own


@pytest.mark.parametrize("known", [None, travel(std_rad=0.1)])
def test_what_was_not_known_is_not_kept(known):
    new = calibration(None)
    assert with_kept_yaw(new, replace(new, travel=known)) is new
