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

"""A call of ~/calibrate that asks for standard deviations: when it ends, what it says. No DDS."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from call_making import RIG, Source, config, image, pair
from improving_calibrator import ImprovingCalibrator, reached_by, use_improving

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.ros import calibration
from stereo_selfcal.ros.calibration import INTERRUPTED, RESET, CalibrationCall
from stereo_selfcal.ros.call_progress import CallProgress

DARK = image(10)
NS = 10**9


@pytest.fixture(autouse=True)
def calibrator(monkeypatch):
    return use_improving(monkeypatch, calibration)


class Camera(Source):
    """A camera whose waiting reader can be woken; ``at`` is called with the number of each pair taken."""

    def __init__(self, *pairs, at=lambda number: None, **settings):
        super().__init__(*pairs, **settings)
        self.at, self.taken, self.woken = at, 0, threading.Event()

    def next_pair(self, timeout_s):
        self.at(self.taken)
        self.taken += 1
        return None if self.woken.is_set() else super().next_pair(timeout_s)

    def interrupt(self):
        self.woken.set()


def asking(targets, **changes):
    stds = dict(zip(("height_std_m", "pitch_std_rad", "roll_std_rad"), targets.std.as_array(), strict=True))
    return config(**{f"target_{name}": float(value) for name, value in stds.items()}, **changes)


def frames(n, dark=()):
    return [pair(i * NS, DARK if i in dark else None) for i in range(n)]


def test_it_ends_with_the_frame_that_reaches_the_targets():
    source = Camera(*frames(20, dark=(1, 3)))
    outcome = CalibrationCall(source, asking(reached_by(5))).run()
    assert outcome.reached and outcome.result.n_frames == 5
    assert outcome.stamp_ns == 6 * NS
    assert outcome.message.startswith("calibrated from 5 frames in 6.0 s: height 1.4000 m (std ")
    assert "; targets reached with 5 of 7 frames in 0 s (asked 20 mm, 0.096, 1.1 deg)" in outcome.message
    assert source.taken <= 8


def test_it_goes_on_for_the_least_number_of_frames():
    outcome = CalibrationCall(Camera(*frames(20)), asking(reached_by(3), frames=7)).run()
    assert outcome.reached and outcome.result.n_frames == 7


def test_at_the_timeout_it_says_what_keeps_it_from_the_targets():
    outcome = CalibrationCall(Camera(*frames(5)), asking(reached_by(20))).run()
    assert not outcome.reached
    assert (outcome.result.n_frames, outcome.stamp_ns) == (5, 4 * NS)
    assert (
        "; targets not reached with 5 of 5 frames in 0 s (asked 20 mm, 0.05, 1.1 deg): the pitch has a std "
        "of 0.0917 deg, asked 0.0495 deg: 95% of its variance is motion of the car (4 s of drive show 5.0 "
        "independent moments of it): drive longer" in outcome.message
    )
    outcome = CalibrationCall(Camera(*frames(50)), asking(Targets(0.0, np.radians(0.01), 0.0))).run()
    assert "is the rig's part" in outcome.message and "raise target_pitch_std_rad" in outcome.message


def test_mostly_refused_frames_are_told_with_the_last_refusal():
    source = Camera(*frames(5, dark=(0, 1, 4)))
    message = CalibrationCall(source, asking(reached_by(20))).run().message
    assert "with 2 of 5 frames" in message
    assert "; last refusal: lines: 0, at least 2 needed; drive on" in message
    few = CalibrationCall(Camera(*frames(5, dark=(0,))), asking(reached_by(20))).run().message
    assert "last refusal" not in few


def test_fewer_than_the_least_number_of_frames_are_no_result():
    outcome = CalibrationCall(Camera(*frames(3)), asking(reached_by(2), frames=4)).run()
    assert outcome.result is None
    assert outcome.message.startswith("3 of 4 frames accepted, 3 pairs in 0.0 s: raise timeout_s or lower")


def test_the_last_frames_count_at_the_timeout_though_none_was_looked_at(calibrator):
    """From 50 frames on, an estimate is made every so many frames: the end is always looked at."""
    outcome = CalibrationCall(Camera(*frames(119)), asking(reached_by(119))).run()
    assert outcome.reached and "targets reached with 119 of 119 frames" in outcome.message


def test_the_estimate_is_made_of_accepted_frames_only_and_ever_more_rarely(calibrator):
    CalibrationCall(Camera(*frames(40, dark=range(10, 40))), asking(reached_by(20))).run()
    assert calibrator.estimates == 11  # 10, and at the timeout
    calibrator.estimates = 0
    CalibrationCall(Camera(*frames(2000)), asking(Targets(0.0, np.radians(0.01), 0.0))).run()
    assert calibrator.estimates < 250


def test_an_estimate_that_is_refused_is_waited_for(monkeypatch):
    """The drive contradicts the rig until the sixth frame."""
    refusal = Rejection(RejectReason.IMAGES_NOT_RECTIFIED, "turn", 2.0, Bound.MOST, 1.0, "px", "calibrate")
    plain = ImprovingCalibrator.estimate.fget
    late = property(lambda self: plain(self) if len(self.stamps_s) > 5 else rejected(refusal))
    monkeypatch.setattr(ImprovingCalibrator, "estimate", late)
    outcome = CalibrationCall(Camera(*frames(9)), asking(reached_by(2))).run()
    assert outcome.reached and outcome.result.n_frames == 6
    outcome = CalibrationCall(Camera(*frames(4)), asking(reached_by(2))).run()
    assert outcome.result is None
    assert outcome.message.startswith(refusal.message + "; targets not reached with 4 of 4 frames")
    # Where any standard deviation is good enough, the number of frames alone ends it.
    outcome = CalibrationCall(Camera(*frames(9)), config(frames=3)).run()
    assert (outcome.result, outcome.message) == (None, refusal.message), (
        "any is good enough: as many as asked"
    )


def test_frames_of_other_cameras_do_not_count_for_the_targets():
    k = [5.0, 0, 1.5, 0, 5.0, 1.0, 0, 0, 1]

    def infos(baseline_m):
        p = [5.0, 0, 1.5, 0.0, 0, 5.0, 1.0, 0, 0, 0, 1, 0]
        right = [*p[:3], -5.0 * baseline_m, *p[4:]]
        return tuple(SimpleNamespace(width=4, height=3, k=k, p=each) for each in (p, right))

    source = Camera(*frames(12))
    source.camera_infos_of = lambda each: infos(0.2 if each.stamp_ns < 4 * NS else 0.3)
    source.camera_infos = infos(0.3)
    none = {f"rig__{name}": type(value)(0) for name, value in RIG.items()}
    outcome = CalibrationCall(source, asking(reached_by(6), **none)).run()
    assert outcome.reached and outcome.result.n_frames == 6
    assert (outcome.rig.baseline_m, outcome.stamp_ns) == (pytest.approx(0.3), 9 * NS)
    assert "CameraInfo changed at 4.0 s" in outcome.message


@pytest.mark.parametrize("number", [0, 3, 4])
def test_it_can_be_ended_whatever_it_is_doing(number):
    """The fifth frame would reach the targets."""
    source = Camera(*frames(20), at=lambda i: call.cancel() if i == number else None)
    call = CalibrationCall(source, asking(reached_by(5)))
    assert call.run().message == RESET
    assert call.cancelled


def test_ended_while_the_frame_that_reaches_the_targets_is_calibrated():
    reports = []

    def end(report):
        reports.append(report)
        if len(reports) == 5:
            call.cancel()

    call = CalibrationCall(Camera(*frames(20)), asking(reached_by(5)), end)
    outcome = call.run()
    assert (outcome.message, outcome.result) == (RESET, None)


def test_a_shutdown_is_told_first():
    source = Camera(*frames(20))
    source.at = lambda i: setattr(source, "stopped", i == 3) or (i == 3 and source.woken.set())
    assert CalibrationCall(source, asking(reached_by(9))).run().message == INTERRUPTED


def test_progress_is_told_once_a_second_and_not_at_all_without_frames(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(calibration.time, "monotonic", lambda: now[0])

    def pass_time(number):
        now[0] += 0.4 if number < 10 else 30.0

    told = []
    source = Camera(*frames(10, dark=(0, 1, 2)), at=pass_time)
    call = CalibrationCall(source, asking(reached_by(20), timeout_s=60.0), None, told.append)
    call.run()
    assert [(each.accepted, each.seen) for each in told] == [(0, 3), (3, 6), (6, 9)]
    assert (
        told[0].text
        == "0 of 3 frames in 1 s; the last one was refused: road_not_seen; asked 20 mm, 0.05, 1.1 deg"
    )
    assert told[1].text == "3 of 6 frames in 2 s; std 5.8 mm, 0.12, 0.2 deg; asked 20 mm, 0.05, 1.1 deg"
    assert call.progress.elapsed_s > 30.0


def test_progress_in_words_and_in_numbers():
    asked = Targets(0.01, np.radians(0.1), np.radians(0.2))
    progress = CallProgress(14, 31, 8.2, 60.0, asked, Extrinsics(0.012, np.radians(0.15), np.radians(0.3)))
    assert progress.text == "14 of 31 frames in 8 s; std 12 mm, 0.15, 0.3 deg; asked 10 mm, 0.1, 0.2 deg"
    assert progress.values() == {
        "call": progress.text,
        "call_frames_accepted": "14",
        "call_frames_seen": "31",
        "call_elapsed_s": "8.200",
        "call_timeout_s": "60.0",
        "call_height_std_m": "0.012",
        "call_target_height_std_m": "0.01",
        "call_pitch_std_rad": repr(float(np.radians(0.15))),
        "call_target_pitch_std_rad": repr(float(np.radians(0.1))),
        "call_roll_std_rad": repr(float(np.radians(0.3))),
        "call_target_roll_std_rad": repr(float(np.radians(0.2))),
    }
    bare = replace(progress, std=None, accepted=0, targets=Targets(frames=3))
    assert bare.text == "0 of 31 frames in 8 s; at least 3 frames"
    assert "call_height_std_m" not in bare.values()
