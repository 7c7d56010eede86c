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

"""The camera against the direction of travel: in words, and in what replay prints."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from result_making import TRAVEL, a_mount

from stereo_selfcal.cli.report import as_json, table_summary
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.drive import Drive, DriveSegment
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.offline import FrameRow, Replay
from stereo_selfcal.report.travel import travel_sentence
from stereo_selfcal.synth.scenes import PAPER_RIG

KNOWN = (
    "The yaw against the direction of travel is -1.910 deg (std 0.115 deg), the pitch against it +0.001 deg "
    "(std 0.172 deg), by 41 steps of 25.5 s of drive"
)
HARDLY_MOVED = (
    "The yaw against the direction of travel is not known: no motion is seen between the frames: the car "
    "stood or drove backwards, they are more than 1.5 s or 20 m apart, or show too few points beside the road"
)
BENDS_ONLY = (
    "The yaw against the direction of travel is not known better than that of any mount (std 1.200 deg after "
    "41 steps of 25.5 s of drive): the car drove bends only, or too short a way"
)
IN_BENDS = replace(TRAVEL, covariance=np.diag([math.radians(1.2) ** 2, 9e-6]))
CASES = [(TRAVEL, KNOWN), (None, HARDLY_MOVED), (IN_BENDS, BENDS_ONLY)]


def replay_of(travel, **changes):
    estimate = a_mount(travel=travel, **changes)
    segment = DriveSegment(0.0, 30.0, estimate, Extrinsics(0.01, 0.02, 0.03), None)
    rows = (FrameRow.from_result(replace(estimate, n_frames=1), 0.0),)
    return Replay(rows, Drive(estimate, (segment,)), PAPER_RIG, CalibratorConfig())


@pytest.mark.parametrize(("travel", "sentence"), CASES)
def test_sentence_says_the_yaw_or_why_it_is_not_known(travel, sentence):
    assert travel_sentence(travel) == sentence
    assert sentence in table_summary(replay_of(travel)).splitlines()


@pytest.mark.parametrize("travel", [TRAVEL, IN_BENDS])
def test_json_has_the_numbers_whether_they_tell_the_yaw_or_not(travel):
    content = json.loads(as_json(replay_of(travel)))
    assert content["travel"] == content["segments"][0]["travel"]
    assert content["travel"] == {
        "yaw_known": travel is TRAVEL,
        "yaw_rad": -1 / 30,
        "yaw_std_rad": math.sqrt(travel.covariance[0, 0]),
        "pitch_rad": 1e-05,
        "pitch_std_rad": 0.003,
        "n_steps": 41,
        "lever_m": 4 / 3,
        "driven_s": 25.5,
    }


def test_json_has_null_where_nothing_tells_it():
    content = json.loads(as_json(replay_of(None)))
    assert content["travel"] is content["segments"][0]["travel"] is None


def test_pitch_that_is_not_that_of_the_travel_is_told_as_a_reservation():
    reservation = Reservation(ReservationKind.PITCH_NOT_OF_TRAVEL, "+1.20 deg more (std 0.10)", 3)
    content = json.loads(as_json(replay_of(TRAVEL, reservations=(reservation,))))
    assert [each["kind"] for each in content["reservations"]] == ["pitch_not_of_travel"]
    assert "+1.20 deg more (std 0.10)" in content["reservations"][0]["message"]
