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

"""The road at this moment: what a cold frame shows; or a refusal, and never a wrong pose."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core import road_now
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.core.road_now import COLD_APART_S, COLD_EVERY_S, RoadTracker
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import LaneLine, Road, Scene

MOUNT = np.array([1.4, np.radians(3.0), np.radians(0.5)])
BRAKE = np.array([0.0, np.radians(1.0), 0.0])
RIDE = np.array([0.004, np.radians(0.1), np.radians(-0.15)])
# Standard deviations of the texture [grey levels]: its surface tells the pose, or its lines alone do.
TEXTURED, BARE = 45.0, 2.0
CONFIG = CalibratorConfig()


@cache
def frame_of(texture, motion=(0.0, 0.0, 0.0), way_m=0.0, texture_seed=3, seed=0):
    """Return the images of a car that has come some way, and moves its camera so against the mount."""
    lines = (LaneLine(-1.75), LaneLine(1.75, dash_m=4.0, gap_m=2.0))
    road = Road(lines=lines, texture_amplitude=texture, texture_seed=texture_seed)
    pose = Extrinsics.from_array(MOUNT + motion)
    scene = Scene(PAPER_RIG, pose, 0.01, 0.1, way_m, road).with_noise(0.01)
    images = render(scene, np.random.default_rng(seed))
    for image in images:
        image.flags.writeable = False
    return images


@cache
def cold_of(texture, motion=(0.0, 0.0, 0.0), way_m=0.0, texture_seed=3):
    return Calibrator(PAPER_RIG).calibrate_frame(*frame_of(texture, motion, way_m, texture_seed))


def tracker_of(texture, texture_seed=3):
    """Return a tracker that has seen one frame, at 10 s."""
    tracker = RoadTracker(PAPER_RIG, CONFIG, cold_of(texture, texture_seed=texture_seed))
    first = tracker.follow(*frame_of(texture, texture_seed=texture_seed), 10.0)
    assert first.accepted and not first.known_start  # nothing has been followed yet
    return tracker


def over_std(result, pose, std):
    return np.abs(result.extrinsics.as_array() - pose) / std.as_array()


@pytest.mark.parametrize("texture", [TEXTURED, BARE])
def test_a_followed_frame_gives_what_a_cold_look_gives(texture):
    tracker, motion = tracker_of(texture), tuple(RIDE)
    result = tracker.follow(*frame_of(texture, motion, 1.4), 10.1)
    cold = cold_of(texture, motion, 1.4)
    assert result.known_start and result.stamp_s == 10.1 and result.n_frames == 1
    assert [attempt.found_by for attempt in result.attempts] == [FoundBy.KNOWN]
    assert result.genetic is None
    assert np.all(over_std(result, cold.extrinsics.as_array(), cold.std) < 1.0)
    assert np.all(over_std(result, MOUNT + RIDE, result.std) < 3.0)
    assert all(gate.passed for gate in result.gates)
    total = np.sum([term.covariance for term in result.uncertainty], axis=0)
    np.testing.assert_allclose(total, result.covariance, atol=1e-12)


@pytest.mark.parametrize("texture", [TEXTURED, BARE])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_of_the_pitch_is_followed_at_the_next_frame(texture, sign):
    """Of 40 steps over roads of other textures, 39 were: half of the road under the car has to be seen."""
    step, followed = sign * BRAKE, 0
    for seed in (3, 4, 5):
        tracker = tracker_of(texture, seed)
        result = tracker.follow(*frame_of(texture, tuple(step), 1.4, seed), 10.1)
        if result.accepted:
            followed += result.known_start
            assert np.all(over_std(result, MOUNT + step, result.std) < 3.0)
            assert abs(result.extrinsics.pitch_rad - MOUNT[1] - step[1]) < 0.2 * abs(step[1])
    assert followed >= 2


def test_a_bare_road_is_found_again_after_a_gap():
    """As where a processor is slow, and the car has drifted meanwhile."""
    tracker = tracker_of(BARE)
    result = tracker.follow(*frame_of(BARE, tuple(BRAKE), 15.0), 11.2)
    assert result.accepted and result.known_start
    assert np.all(over_std(result, MOUNT + BRAKE, result.std) < 3.0)


@pytest.mark.parametrize("wrong", np.diag([0.08, np.radians(1.5), np.radians(3.0)]))
def test_a_mount_that_is_wrong_does_not_draw_the_road(wrong):
    cold = cold_of(TEXTURED)
    mount = replace(cold, extrinsics=Extrinsics.from_array(cold.extrinsics.as_array() + wrong))
    tracker = RoadTracker(PAPER_RIG, CONFIG, mount)
    tracker.follow(*frame_of(TEXTURED, (0.0, 0.0, 0.0), 3.0), 10.0)
    tracker._followed.clear()  # so that the next frame starts from the mount alone
    result = tracker.follow(*frame_of(TEXTURED), 10.1)
    assert result.accepted
    assert np.all(over_std(result, MOUNT, result.std) < 3.0)


NO_ROAD = {
    "other road": lambda: (frame_of(TEXTURED)[0], frame_of(TEXTURED, texture_seed=8)[1]),
    "exchanged": lambda: frame_of(TEXTURED)[::-1],
    "one image twice": lambda: (frame_of(TEXTURED)[0],) * 2,
    "late": lambda: (frame_of(TEXTURED)[0], frame_of(TEXTURED, way_m=2.0)[1]),
    "black": lambda: np.zeros((2, 480, 640), np.uint8),
    "white": lambda: np.full((2, 480, 640), 255, np.uint8),
    "noise": lambda: np.random.default_rng(0).integers(256, size=(2, 480, 640), dtype=np.uint8),
    "right one upside down": lambda: (frame_of(BARE)[0], frame_of(BARE)[1][::-1].copy()),
}


@pytest.mark.parametrize("what", NO_ROAD)
@pytest.mark.parametrize("texture", [TEXTURED, BARE])
def test_what_is_not_the_road_is_refused(texture, what):
    """By the known camera, and by the cold look that follows."""
    tracker, (left, right) = tracker_of(texture), NO_ROAD[what]()
    for stamp_s, cold in ((10.1, False), (10.0 + COLD_APART_S, True)):
        result = tracker.follow(left, right, stamp_s)
        assert not result.accepted and result.extrinsics is None and result.covariance is None
        assert result.reason is not None and result.message
        assert result.known_start is not cold
    # What follows is followed again.
    assert tracker.follow(*frame_of(texture), 10.2 + COLD_APART_S).accepted


@pytest.mark.parametrize("shape", [(0, 0), (8, 8), (480, 641)])
def test_images_of_another_size_are_refused_at_once(shape):
    image = np.zeros(shape, np.uint8)
    result = tracker_of(TEXTURED).follow(image, image, 10.1)
    assert not result.accepted and result.attempts == ()


def test_a_pose_that_no_motion_explains_is_looked_at_cold():
    """A camera that was turned by 8 deg: the road is where the cold frame has it."""
    turned = (0.0, 0.0, np.radians(8.0))
    tracker = tracker_of(TEXTURED)
    result = tracker.follow(*frame_of(TEXTURED, turned), 10.1)
    assert not result.accepted
    result = tracker.follow(*frame_of(TEXTURED, turned), 10.0 + COLD_APART_S)
    assert result.accepted and not result.known_start
    assert np.all(over_std(result, MOUNT + turned, result.std) < 3.0)


def test_a_cold_look_comes_now_and_then_unless_the_watch_has_come(monkeypatch):
    tracker = tracker_of(TEXTURED)
    looks = []
    look = Calibrator.calibrate_frame
    monkeypatch.setattr(
        Calibrator, "calibrate_frame", lambda *arguments: looks.append(arguments[3]) or look(*arguments)
    )
    images = frame_of(TEXTURED)
    for stamp_s in (10.1, 10.0 + COLD_EVERY_S, 10.1 + COLD_EVERY_S):
        tracker.follow(*images, stamp_s)
    assert looks == [10.0 + COLD_EVERY_S]
    assert tracker.compare(replace(cold_of(TEXTURED), stamp_s=10.1 + COLD_EVERY_S))
    tracker.follow(*images, 10.0 + 2.0 * COLD_EVERY_S)
    assert looks == [10.0 + COLD_EVERY_S]


def test_a_cold_look_of_others_that_contradicts_makes_the_next_frame_a_cold_one():
    tracker, cold = tracker_of(TEXTURED), cold_of(TEXTURED)
    turned = replace(cold, extrinsics=Extrinsics.from_array(MOUNT + 6.0 * BRAKE), stamp_s=10.0)
    refused = Calibrator(PAPER_RIG).calibrate_frame(*np.zeros((2, 480, 640), np.uint8), 10.0)
    assert tracker.compare(refused) and tracker.compare(replace(turned, stamp_s=20.0))
    assert tracker.follow(*frame_of(TEXTURED), 10.1).known_start
    assert not tracker.compare(turned)
    assert not tracker.follow(*frame_of(TEXTURED), 10.2).known_start


def test_time_that_jumps_back_is_another_drive():
    tracker = tracker_of(TEXTURED)
    result = tracker.follow(*frame_of(TEXTURED), 2.0)
    assert result.accepted and not result.known_start
    assert tracker.follow(*frame_of(TEXTURED), 2.1).known_start


def test_the_turn_of_the_right_camera_is_that_of_the_mount():
    """The images are freed of it, as those of the frames before were."""
    tracker = tracker_of(TEXTURED)
    turn = np.radians(0.1)
    covariance = np.diag(np.radians([0.005, 0.005, 0.05]) ** 2)
    mount = replace(cold_of(TEXTURED), alignment=Alignment(turn, 0.0, 0.0, covariance))
    turned = RoadTracker(PAPER_RIG, CONFIG, mount)
    assert turned._turn.pitch_rad == pytest.approx(turn, rel=0.05)
    assert not turned._turn.of_frame and not tracker._turn.of_frame
    assert turned._turn.rig_std(0.0).rows_measured is False
    # The road's rows are then those of a pair that is off by 0.1 deg: the gates see it where they are read.
    seen = []

    def turned_back(images, rig, turn, yaw_rad=0.0, first_row=0):
        seen.append((turn.pitch_rad, yaw_rad))
        return images, turn

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(road_now, "turned_back", turned_back)
        turned.follow(*frame_of(TEXTURED), 10.0)
        turned.follow(*frame_of(TEXTURED), 10.1)
    assert seen == [(turned._turn.pitch_rad, 0.0)]


def test_a_refusal_is_no_mount():
    refused = Calibrator(PAPER_RIG).calibrate_frame(*np.zeros((2, 480, 640), np.uint8))
    with pytest.raises(ValueError, match="accepted calibration of the mount"):
        RoadTracker(PAPER_RIG, CONFIG, refused)


def test_lines_alone_are_no_road_where_texture_is_required():
    config = CalibratorConfig.from_mapping({"texture.required": 1})
    tracker = RoadTracker(PAPER_RIG, config, cold_of(BARE))
    for stamp_s in (10.0, 10.1):
        result = tracker.follow(*frame_of(BARE), stamp_s)
        assert not result.accepted
    assert result.reason in (RejectReason.ROAD_WITHOUT_TEXTURE, RejectReason.TEXTURE_DISAGREES)
