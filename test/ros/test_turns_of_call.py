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

"""Odometry and a gyroscope during a call of ~/calibrate. No DDS."""

import numpy as np
import pytest
from call_making import Source, config, pair
from travel_making import step

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive.turn_rates import TurnRate
from stereo_selfcal.core.drive.turn_topics import TurnMessage
from stereo_selfcal.ros import calibration, turns_of_call
from stereo_selfcal.ros.calibration import CalibrationCall
from stereo_selfcal.ros.turns_of_call import TurnsOfCall

BEND = tuple(step(i, turn=0.02) for i in range(30))


class HearingCalibrator:
    """Accepts every frame; the images say that the car drives through a bend."""

    made = ()
    travel_steps = BEND

    def __init__(self, rig, settings):
        self.rig, self.heard = rig, []
        HearingCalibrator.made = (*self.made, self)

    def note_turn_rate(self, rate):
        self.heard.append(rate)

    def add(self, left, right, stamp_s, stamp_difference_s):
        self.heard.append(stamp_s)
        return self.estimate

    @property
    def estimate(self):
        return CalibrationResult("fine", extrinsics=Extrinsics(1.2, 0, 0), covariance=np.eye(3), n_frames=2)


@pytest.fixture(autouse=True)
def calibrator(monkeypatch):
    HearingCalibrator.made = ()
    monkeypatch.setattr(calibration, "Calibrator", HearingCalibrator)


class TalkingSource(Source):
    """Before each pair, odometry says something."""

    def __init__(self, turns, said, *pairs):
        super().__init__(*pairs)
        self.turns, self.said = turns, list(said)

    def next_pair(self, timeout_s):
        for message in self.said.pop(0) if self.said else ():
            self.turns.hear(message)
        return super().next_pair(timeout_s)


def rates(*stamps, topic="/imu", of=0.2):
    return [TurnMessage(topic, TurnRate(stamp, of)) for stamp in stamps]


def test_calibrator_gets_what_has_come_before_each_frame():
    turns = TurnsOfCall(["/imu"])
    source = TalkingSource(turns, [rates(1.0, 1.1), [], rates(1.2)], *(pair(i * 10**9) for i in range(1, 4)))
    CalibrationCall(source, config(frames=3), turns=turns).run()
    (made,) = HearingCalibrator.made
    heard = [each if isinstance(each, float) else each.stamp_s for each in made.heard]
    # The first pair waits for the second one.
    assert heard == [1.0, 1.1, 1.0, 2.0, 1.2, 3.0]


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (rates(*(100.0 + 0.05 * i for i in range(60))), ""),
        (
            rates(*(100.0 + 0.05 * i for i in range(60)), of=-0.2),
            "; the turn rates of /imu do not agree with the images in 30 of 30 steps with a turn: with the "
            "other sign they would: is its z axis up?",
        ),
        ([], "; no message came on /imu, so that nothing is compared with it"),
        (
            [TurnMessage("/imu", problem="it is broken")],
            "; 1 of 1 messages on /imu are not used: it is broken",
        ),
    ],
)
def test_answer_says_what_is_wrong_with_a_topic(said, told):
    turns = TurnsOfCall(["/imu"])
    outcome = CalibrationCall(TalkingSource(turns, [said], pair(), pair(10**9)), config(), turns=turns).run()
    assert outcome.message == f"fine{told}"
    assert outcome.result is not None


def test_without_frames_it_is_told_too():
    outcome = CalibrationCall(Source(), config(), turns=TurnsOfCall(["/odom"])).run()
    assert outcome.result is None and "no message came on /odom" in outcome.message


def test_who_has_named_no_topic_is_told_nothing():
    assert CalibrationCall(Source(pair()), config()).run().message == "fine"


def test_what_waits_for_a_frame_is_bounded(monkeypatch):
    monkeypatch.setattr(turns_of_call, "_MOST_WAITING", 5)
    turns = TurnsOfCall(["/imu"])
    for message in rates(*range(20)):
        turns.hear(message)
    made = HearingCalibrator(None, None)
    turns.pass_on(made)
    assert [rate.stamp_s for rate in made.heard] == [15, 16, 17, 18, 19]
