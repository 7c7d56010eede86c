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

"""What the node remembers of frames, and that a call reports every one of them."""

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from call_making import ANY_STD

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.camera.pairing import PairCounts, StampedPair
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.ros.calibration import CalibrationCall
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.pair_source import InputState, Topics
from stereo_selfcal.ros.record import FrameRecord, FrameReport
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

ACCEPTED = CalibrationResult("good", extrinsics=Extrinsics(1.4, 0, 0), covariance=np.eye(3), n_frames=1)
IMAGE = np.zeros((2, 2), np.uint8)


def refused(reason):
    return rejected(Rejection(reason, "what", 1.0, Bound.LEAST, 2.0, "px", "remedy"))


def frame(result, elapsed_s=0.05):
    return FrameReport(IMAGE, IMAGE, PAPER_RIG, result, 0, elapsed_s)


def test_nothing_yet():
    statistics = FrameRecord().statistics
    assert (statistics.total, statistics.rejected, statistics.last_rejection) == (0, {}, None)


def test_frames_are_counted_by_reason_and_timed():
    now_s = [100.0]
    record = FrameRecord(lambda: now_s[0])
    record.add(frame(refused(RejectReason.LINES_NOT_STRAIGHT), 0.1))
    record.add(frame(refused(RejectReason.NO_LINES_FOUND), 0.2))
    now_s[0] = 130.0
    record.add(frame(refused(RejectReason.NO_LINES_FOUND), 0.4))
    now_s[0] = 142.0
    record.add(frame(ACCEPTED, 0.1))
    statistics = record.statistics
    assert statistics.accepted == 1 and statistics.total == 4
    assert list(statistics.rejected.items()) == [("no_lines_found", 2), ("lines_not_straight", 1)]
    assert statistics.last_rejection.reason is RejectReason.NO_LINES_FOUND
    assert statistics.last_rejection_age_s == 12.0
    assert (statistics.last_s, statistics.longest_s) == (0.1, 0.4)
    assert statistics.mean_s == pytest.approx(0.2)


def message(pixels):
    height, width = pixels.shape
    return SimpleNamespace(
        data=pixels.tobytes(), width=width, height=height, step=width, encoding="mono8", is_bigendian=0
    )


class Source:
    """Delivers pairs, one per request, and then nothing; the camera infos come with the second one."""

    topics = Topics("/left", "/right", "/left_info", "/right_info")
    stopped = False
    camera_infos = (None, None)
    state = InputState(PairCounts(), None)

    def __init__(self, *frames):
        self.pairs = deque(
            StampedPair(message(left), message(right), 10**9 * (i + 1) + 7, 10**9 * (i + 1) + 7)
            for i, (left, right) in enumerate(frames)
        )

    def camera_infos_of(self, _pair):
        return self.camera_infos

    def publishers(self, topic):
        return 1

    def next_pair(self, timeout_s):
        return self.pairs.popleft() if self.pairs else None


def config(**changes):
    values = {name: setting.default for name, setting in SETTINGS.items()}
    values.update({f"rig.{name}": value for name, value in PAPER_RIG.to_mapping().items()})
    return NodeConfig.from_values({**values, **ANY_STD, **changes})


def test_call_reports_every_frame_with_what_came_of_it():
    """The real estimator; what is told is what went in and came out."""
    road = named_scene("straight_road").frame(0)
    bare = np.full_like(road.left, 90)
    told = []
    outcome = CalibrationCall(Source((bare, bare), (road.left, road.right)), config(), told.append).run()
    assert outcome.result.extrinsics == told[1].result.extrinsics
    assert [report.result.reason for report in told] == [RejectReason.ROAD_NOT_SEEN, None]
    assert [report.stamp_ns for report in told] == [1_000_000_007, 2_000_000_007]
    assert outcome.stamp_ns == told[1].stamp_ns
    np.testing.assert_array_equal(told[1].left, road.left)
    np.testing.assert_array_equal(told[1].right, road.right)
    assert told[1].result.pattern is not None and told[1].rig == PAPER_RIG == outcome.rig
    assert all(0 < report.elapsed_s < 60 for report in told)


def test_frames_before_the_rig_is_known_are_no_frames():
    """They did not reach the estimator; the answer of the call is the one it always was."""
    told = []
    rig = {f"rig.{name}": type(value)(0) for name, value in PAPER_RIG.to_mapping().items()}
    bare = np.full((480, 640), 90, np.uint8)
    outcome = CalibrationCall(Source((bare, bare)), config(timeout_s=0.1, **rig), told.append).run()
    assert told == []
    assert "no CameraInfo on /left_info (1 publisher)" in outcome.message
