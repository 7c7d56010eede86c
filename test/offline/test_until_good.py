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

"""A recording that is read until the mount is known as well as asked."""

import dataclasses

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.bags import BagError, StereoFrame
from stereo_selfcal.cli.report import as_json
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.offline import FrameSource, Selection, as_csv, calibrate_recording, pool
from stereo_selfcal.offline.frame import FrameHead
from stereo_selfcal.offline.run import assemble_replay
from stereo_selfcal.offline.until_good import Goal, GoalWatch, NotedFrames
from stereo_selfcal.synth.scenes import PAPER_RIG, custom_scene

STD = np.array([0.02, 0.002, 0.004])
REFUSAL = Rejection(RejectReason.NO_LINES_FOUND, "{value} of {limit} lines", 0, Bound.LEAST, 2, "", "drive")


def frames(n, refused=(), error=None):
    """Yield frames of a car that moves by the noise of its frames alone, 10 a second."""
    rng = np.random.default_rng(4)
    for index in range(n):
        pose = Extrinsics.from_array([1.4, 0.05, 0.01] + STD * rng.normal(size=3))
        result = CalibrationResult(
            "", extrinsics=pose, covariance=np.diag(STD**2), n_frames=1, stamp_s=index / 10
        )
        if index in refused:
            result = rejected(REFUSAL, index / 10)
        yield FrameHead(index / 10, index, f"{index}.png"), result
    if error is not None:
        raise error


def replay_of(given, targets):
    return assemble_replay(given, Calibrator(PAPER_RIG), until=targets)


def std_after(n):
    return assemble_replay(frames(n), Calibrator(PAPER_RIG)).estimate.std


def test_it_ends_with_the_first_frame_that_makes_it_good():
    asked = std_after(9)
    targets = Targets(asked.height_m, asked.pitch_rad, asked.roll_rad)
    replay = replay_of(frames(30), targets)
    n = len(replay.rows)
    assert n < 30
    assert targets.reached(replay.estimate)
    assert not targets.reached(assemble_replay(frames(n - 1), Calibrator(PAPER_RIG)).estimate)
    assert replay.goal.reached and replay.goal.stopped
    assert (replay.goal.frames, replay.goal.shortfall) == (n, "")
    assert replay.goal.duration_s == pytest.approx((n - 1) / 10)
    assert replay.goal.message.endswith(
        f"is reached after {n} frames, {(n - 1) / 10:.1f} s; nothing more was read"
    )


def test_refused_frames_are_read_but_do_not_count():
    replay = replay_of(frames(30, refused=(0, 1, 3)), Targets(frames=4))
    assert [row.accepted for row in replay.rows] == [False, False, True, False, True, True, True]
    assert replay.goal.message == (
        "the asked number of frames is reached after 7 frames, 0.6 s; nothing more was read"
    )


def test_targets_that_are_not_reached_cost_no_calibration():
    replay = replay_of(frames(8), Targets(height_std_m=1e-5))
    assert replay.estimate.accepted and len(replay.rows) == 8
    assert not replay.goal.reached and not replay.goal.stopped
    assert replay.goal.message.startswith(
        "the asked std of 0.01 mm, any, any is not reached in 8 frames, 0.7 s: the height has a std of"
    )


def test_a_recording_that_is_good_at_its_end_says_so_although_nobody_looked_before():
    """With many frames not every one is looked at: the whole recording is, at its end."""
    estimate = assemble_replay(frames(5), Calibrator(PAPER_RIG)).estimate
    goal = Goal.of(Targets(), estimate, 131, 13.0, stopped=False)
    assert goal.reached and goal.shortfall == ""
    assert goal.message == "the asked number of frames is reached after 131 frames, 13.0 s"


def test_nothing_accepted_tells_why():
    replay = replay_of(frames(3, refused=range(3)), Targets())
    assert not replay.goal.reached
    assert replay.goal.shortfall == replay.estimate.message


def test_damage_behind_the_last_frame_that_is_needed_is_none():
    damaged = BagError("broken")
    assert replay_of(frames(2, error=damaged), Targets(frames=2)).damage is None
    late = replay_of(frames(2, error=damaged), Targets(frames=3))
    assert late.damage.startswith("broken") and not late.goal.reached


def test_without_targets_every_frame_is_read():
    replay = assemble_replay(frames(5), Calibrator(PAPER_RIG))
    assert len(replay.rows) == 5 and replay.goal is None


def test_an_hour_of_frames_is_not_looked_at_after_every_one():
    looks = []
    estimate = CalibrationResult("", extrinsics=Extrinsics(1.4, 0.0, 0.0), covariance=np.eye(3), n_frames=5)

    class Looked:
        index = 0

        @property
        def estimate(self):
            looks.append(self.index)
            return estimate

    watch, looked = GoalWatch(Targets(height_std_m=1e-9, frames=5)), Looked()
    for looked.index in range(1, 36_001):
        assert not watch.is_reached(looked)
    assert looks[0] == 5
    assert sum(looks) < 60 * 36_000, "as much as 60 estimates of the whole"


class Road(FrameSource):
    """Frames of a road, over and over, that remark on themselves as they are read."""

    name, left_name, right_name = "road", "left", "right"
    rig, selection, start_ns = PAPER_RIG, Selection(), 0

    def __init__(self, n):
        self.n_images = n, n
        scene = custom_scene(name="road", n_frames=2, noise_fraction=0.02)
        self.images = [(frame.left, frame.right) for frame in scene.frames()]
        self.read = 0

    @property
    def remarks(self):
        return tuple(f"frame {index} is odd" for index in range(2, self.read + 1, 3))

    def frames(self):
        for index in range(self.n_images[0]):
            self.read = index + 1
            yield StereoFrame(index / 10, *self.images[index % 2], index, f"{index}.png")

    def frame_at(self, recorded_ns):
        raise NotImplementedError


def test_remarks_are_those_on_the_frames_that_count():
    noted = NotedFrames(Road(7))
    assert len(list(noted.frames())) == 7
    assert noted.remarks_until(1) == ()
    assert noted.remarks_until(4) == ("frame 2 is odd",)
    assert noted.remarks_until(7) == ("frame 2 is odd", "frame 5 is odd")


@pytest.mark.slow
def test_it_ends_with_the_same_frame_with_any_number_of_jobs(monkeypatch):
    monkeypatch.setattr(pool, "_ALONE_FRAMES", 1)
    quick = CalibratorConfig.from_mapping({"texture": {"check": 0}})
    alone, together = (
        calibrate_recording(Road(12), quick, jobs=jobs, until=Targets(frames=4)) for jobs in (1, 2)
    )
    assert len(alone.rows) == 4 and alone.remarks == ("frame 2 is odd",)
    assert as_json(together) + as_csv(together.rows) == as_json(alone) + as_csv(alone.rows)
    assert dataclasses.astuple(together.goal) == dataclasses.astuple(alone.goal)
