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

"""A recording from the first frame to the estimate."""

import pickle
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereo_selfcal.bags import StereoFrame
from stereo_selfcal.core.calibrator import Calibrator
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.search.attempt import Verdict
from stereo_selfcal.offline import (
    AttemptSummary,
    BagSource,
    FrameSource,
    Selection,
    calibrate_recording,
    look_again,
)
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import PAPER_RIG, custom_scene

BAGS = Path(__file__).resolve().parents[2] / "bags"


@pytest.fixture(scope="module")
def road(tmp_path_factory):
    path = tmp_path_factory.mktemp("offline") / "road"
    write_bag(path, custom_scene(name="road", n_frames=3, noise_fraction=0.02))
    return path


@pytest.fixture(scope="module")
def replayed(road):
    """Return an open source of that road, and what comes of it."""
    with BagSource([road]) as source:
        yield source, calibrate_recording(source)


class Frames(FrameSource):
    """Black images, whose frames know whether they are still there."""

    name, left_name, right_name = "frames", "left", "right"
    rig, selection, start_ns = PAPER_RIG, Selection(), 0

    def __init__(self, n):
        self.n_images = n, n
        self.alive = []

    def frames(self):
        for index in range(self.n_images[0]):
            black = np.zeros((PAPER_RIG.height, PAPER_RIG.width), np.uint8)
            self.alive.append(weakref.ref(black))
            yield StereoFrame(index / 10, black, black, index, f"{index}.png")
            del black
            assert sum(each() is not None for each in self.alive) <= 2

    def frame_at(self, recorded_ns):
        raise NotImplementedError


def test_every_frame_is_a_row_and_the_estimate_is_that_of_one_calibrator(road):
    calibrator = Calibrator(PAPER_RIG)
    seen = []
    with BagSource([road]) as source:
        for frame in source.frames():
            calibrator.add(frame.left, frame.right, frame.stamp_s)
        replay = calibrate_recording(source, on_row=seen.append)
    assert len(replay.rows) == 3
    assert seen == list(replay.rows)
    assert replay.estimate.accepted
    assert replay.estimate.message == calibrator.estimate.message
    np.testing.assert_array_equal(replay.estimate.covariance, calibrator.estimate.covariance)
    assert replay.rig == PAPER_RIG


def test_rows_hold_what_a_report_needs(replayed):
    row = replayed[1].rows[-1]
    assert row.accepted
    assert row.covariance.shape == (3, 3)
    assert row.confirmed == ("textured" in row.stages)
    assert ({"refined"} if row.known_start else {"genetic", "refined"}) <= set(row.stages)
    assert all(gate.passed for gate in row.gates)
    assert row.recorded_ns > 0
    assert abs(row.lane_yaw_rad) < 0.1


def test_a_refused_frame_keeps_its_reason_limit_and_remedy():
    row = calibrate_recording(Frames(1)).rows[0]
    assert not row.accepted
    assert not row.confirmed
    assert row.extrinsics is row.covariance is row.lane_yaw_rad is None
    assert row.reason == str(row.rejection.reason)
    assert row.rejection.remedy
    assert row.name == "0.png"


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    path = tmp_path_factory.mktemp("offline") / "bend"
    write_bag(path, custom_scene(name="bend", n_frames=1, curvature_per_m=1 / 150.0))
    with BagSource([path]) as source:
        yield source, calibrate_recording(source)


@pytest.mark.parametrize("scene_kind", ["accepted", "refused"])
def test_rows_hold_every_attempt_in_brief(request, scene_kind):
    """Those of the workers' slim results too: a row is all that is left of a frame."""
    source, replay = request.getfixturevalue("bent" if scene_kind == "refused" else "replayed")
    row = replay.rows[0]
    _, result = look_again(source, row)
    assert row.attempts
    assert row.attempts == tuple(map(AttemptSummary.of, result.attempts))
    for brief, attempt in zip(row.attempts, result.attempts, strict=True):
        assert (brief.found_by, brief.verdict) == (attempt.found_by, attempt.verdict)
        assert brief.message == attempt.message
        assert brief.reason == (None if attempt.reason is None else str(attempt.reason))
    if scene_kind == "refused":
        last = result.attempts[-1].readings[-1]
        assert row.attempts[-1].gate == last.label and not last.passed
    else:
        assert row.attempts[-1].verdict is Verdict.ACCEPTED and row.attempts[-1].gate == ""


def test_attempts_do_not_double_the_rows():
    """Whole attempts would make a refused frame up to ten times as big."""
    with BagSource([BAGS / "curve"]) as source:
        rows = calibrate_recording(source).rows
    assert all(row.attempts for row in rows)
    without = [replace(row, attempts=()) for row in rows]
    assert sum(len(pickle.dumps(row)) for row in rows) < 1.6 * sum(len(pickle.dumps(row)) for row in without)


def test_a_frame_is_found_and_calibrated_again(road):
    config = CalibratorConfig(seed=5)
    with BagSource([road]) as source:
        replay = calibrate_recording(source, config)
        for row in replay.rows:
            frame, result = look_again(source, row, config)
            assert frame.stamp_s == row.stamp_s
            assert result.extrinsics == row.extrinsics
            assert result.pattern is not None


def test_the_last_accepted_row_is_shown():
    replay = calibrate_recording(Frames(2))
    assert replay.shown is replay.rows[-1]


def test_memory_holds_two_frames_however_long_the_recording():
    source = Frames(10)
    assert len(calibrate_recording(source).rows) == 10
    assert len(source.alive) == 10
