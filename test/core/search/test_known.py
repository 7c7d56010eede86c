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

"""Frames that are followed from an accepted cold one: what a cold look shows, or a cold look."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.search.known import LANDMARKS_EVERY_S, KnownCamera
from stereo_selfcal.core.search.parts_of_time import PartsOfTime
from stereo_selfcal.core.search.strategy import choose
from stereo_selfcal.offline.bag import BagSource
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene
from stereo_selfcal.synth.world import LaneLine, Road, Scene

BAGS = Path(__file__).resolve().parents[3] / "bags"
MOUNT = np.array([1.4, np.radians(3.0), np.radians(0.5)])
RIDE = np.array([0.004, np.radians(0.1), np.radians(-0.15)])
BRAKE = np.array([0.0, np.radians(1.0), 0.0])
# Standard deviations of the texture [grey levels]: its surface tells the pose, or its lines alone do.
TEXTURED, BARE = 45.0, 2.0
BOTH = pytest.mark.parametrize("texture", [TEXTURED, BARE])


@cache
def frame_of(texture, motion=(0.0, 0.0, 0.0), way_m=0.0, seed=0, lines=True, yaw_rad=0.01, aside_m=0.1):
    """Return the images of a car that has come some way, and moves its camera so against the mount."""
    painted = (LaneLine(-1.75), LaneLine(1.75, dash_m=4.0, gap_m=2.0)) if lines else ()
    road = Road(lines=painted, texture_amplitude=texture, texture_seed=3)
    pose = Extrinsics.from_array(MOUNT + motion)
    scene = Scene(PAPER_RIG, pose, yaw_rad, aside_m, way_m, road).with_noise(0.01)
    images = render(scene, np.random.default_rng(seed))
    for image in images:
        image.flags.writeable = False
    return images


@cache
def cold_of(texture, motion=(0.0, 0.0, 0.0), way_m=0.0):
    return Calibrator(PAPER_RIG).calibrate_frame(*frame_of(texture, motion, way_m))


def follower_of(texture, **config):
    """Return a calibrator that has seen one frame, at 10 s."""
    calibrator = Calibrator(PAPER_RIG, CalibratorConfig.from_mapping(config))
    first = calibrator.calibrate_next(*frame_of(texture), 10.0)
    assert first.accepted and not first.known_start
    return calibrator


def over_std(result, pose, std):
    return np.abs(result.extrinsics.as_array() - pose) / std.as_array()


@BOTH
def test_a_followed_frame_gives_what_a_cold_look_gives(texture):
    calibrator, motion = follower_of(texture), tuple(RIDE)
    images = frame_of(texture, motion, 1.4, 1, True, 0.015, 0.07)
    result = calibrator.calibrate_next(*images, 10.1)
    cold = Calibrator(PAPER_RIG).calibrate_frame(*images)
    assert result.known_start and result.stamp_s == 10.1 and result.n_frames == 1
    assert [attempt.found_by for attempt in result.attempts] == [FoundBy.KNOWN]
    assert result.genetic is None
    assert np.all(over_std(result, cold.extrinsics.as_array(), result.std) < 2.0)
    assert np.all(over_std(result, MOUNT + RIDE, result.std) < 3.0)
    assert all(gate.passed for gate in result.gates)
    total = np.sum([term.covariance for term in result.uncertainty], axis=0)
    np.testing.assert_allclose(total, result.covariance, atol=1e-12)


def test_the_noise_of_the_rows_of_a_cold_frame_is_not_put_into_those_that_follow():
    """The rows of its frames hardly tell a turn, which is left in the images of both looks."""
    scene = named_scene("straight_road")
    calibrator = Calibrator(scene.scene.rig)
    for index in range(4):
        frame = scene.frame(index)
        result = calibrator.calibrate_next(frame.left, frame.right, frame.stamp_s)
        cold = Calibrator(scene.scene.rig).calibrate_frame(frame.left, frame.right, frame.stamp_s)
        assert result.known_start == (index > 0)
        assert np.all(over_std(result, cold.extrinsics.as_array(), cold.std) < 0.02)


@BOTH
def test_many_frames_are_followed_one_after_the_other(texture):
    calibrator, rng = follower_of(texture), np.random.default_rng(4)
    for index in range(1, 6):
        motion = tuple(RIDE * rng.uniform(-1.0, 1.0, 3))
        result = calibrator.calibrate_next(*frame_of(texture, motion, 1.4 * index, index), 10.0 + index / 10)
        assert result.known_start and result.accepted
        assert np.all(over_std(result, MOUNT + motion, result.std) < 3.0)


def test_a_followed_frame_does_not_measure_the_alignment_again():
    calibrator = follower_of(BARE)
    result = calibrator.calibrate_next(*frame_of(BARE, tuple(RIDE), 1.4), 10.1)
    assert result.known_start and result.alignment is None


def test_what_rows_of_the_cold_frame_leave_is_one_error_of_all_that_follow():
    cold, result = cold_of(TEXTURED), follower_of(TEXTURED).calibrate_next(*frame_of(TEXTURED), 10.1)
    names = [term.name for term in result.uncertainty]
    assert ("turn_before" in names) is bool(np.all(cold.alignment.known()[:2]))
    assert "vergence" in names and "rectification" in names


@BOTH
def test_a_brake_is_followed_or_looked_at_cold(texture):
    for sign in (1.0, -1.0):
        result = follower_of(texture).calibrate_next(*frame_of(texture, tuple(sign * BRAKE), 1.4), 10.1)
        assert result.accepted
        assert np.all(over_std(result, MOUNT + sign * BRAKE, result.std) < 3.0)


@BOTH
def test_a_road_that_has_gone_leads_to_a_cold_look_and_the_next_one_is_cold_too(texture):
    nothing = np.full((2, 480, 640), 90, np.uint8)
    calibrator = follower_of(texture)
    refused = calibrator.calibrate_next(*nothing, 10.1)
    assert not refused.accepted and not refused.known_start
    assert refused.message == Calibrator(PAPER_RIG).calibrate_frame(*nothing).message
    assert not calibrator.calibrate_next(*frame_of(texture), 10.2).known_start
    assert calibrator.calibrate_next(*frame_of(texture), 10.3).known_start


def test_a_start_that_claims_to_be_sure_and_is_wrong_confirms_nothing():
    cold = cold_of(BARE)
    chosen = choose(cold.attempts)
    for wrong in np.diag([0.08, np.radians(1.0), np.radians(3.0)]):
        pose = Extrinsics.from_array(cold.extrinsics.as_array() + wrong)
        sure = tuple(replace(term, covariance=term.covariance / 1e4) for term in chosen.estimate.terms)
        attempt = replace(chosen, estimate=replace(chosen.estimate, pose=pose, terms=sure))
        known = KnownCamera.after(attempt, cold.alignment, 10.0, PAPER_RIG, CalibratorConfig())
        found = known.follow(frame_of(BARE, tuple(RIDE), 1.4), 10.1, 0.0)
        assert found is None


def test_refused_frames_tell_nothing():
    refused = Calibrator(PAPER_RIG).calibrate_frame(*np.full((2, 480, 640), 90, np.uint8))
    for attempt in (choose(refused.attempts), None):
        known = KnownCamera.after(attempt, refused.alignment, 10.0, PAPER_RIG, CalibratorConfig())
        assert known is None


def test_landmarks_are_looked_for_now_and_then():
    calibrator = follower_of(BARE)
    stamps_s = 10.0 + np.arange(1, 16) / 10.0
    results = [calibrator.calibrate_next(*frame_of(BARE), stamp_s) for stamp_s in stamps_s]
    assert all(result.known_start for result in results)
    found = [index for index, result in enumerate(results, 1) if result.landmarks is not None]
    assert found == [round(10 * LANDMARKS_EVERY_S * each) for each in (1, 2, 3, 4, 5)]


def test_the_first_frame_of_each_part_of_the_time_is_cold():
    def followed(stamps_s, cold_every_s=0.5):
        parts, found = PartsOfTime(cold_every_s), []
        for stamp_s in stamps_s:
            found.append(parts.of_next(stamp_s) is not None)
            parts.note(object())
        return found

    assert followed([10.0, 10.1, 10.2, 10.3, 10.4, 10.5, 10.6]) == [False, *[True] * 4, False, True]
    # A recording that begins in the middle of a part is the same from the next part on.
    assert followed([10.3, 10.4, 10.5, 10.6]) == [False, True, False, True]
    assert followed([10.0, 10.1, 10.2], cold_every_s=0.0) == [False] * 3
    assert followed([0.0, 0.0, 0.0]) == [False] * 3  # images without stamps
    assert followed([10.1, 10.0]) == [False] * 2


def test_after_a_frame_that_tells_nothing_the_next_one_is_cold():
    parts = PartsOfTime(0.5)
    parts.of_next(10.0)
    parts.note(object())
    assert parts.of_next(10.1) is not None
    assert parts.of_next(10.2) is None  # a fault has come up on the frame before, and nothing was noted


def test_a_calibrator_that_is_to_look_cold_gives_what_single_frames_give():
    images, cold = frame_of(BARE, tuple(RIDE), 1.4), cold_of(BARE, tuple(RIDE), 1.4)
    calibrator = follower_of(BARE, **{"known.cold_every_s": 0.0})
    result = calibrator.calibrate_next(*images, 10.1)
    assert not result.known_start
    np.testing.assert_array_equal(result.extrinsics.as_array(), cold.extrinsics.as_array())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["straight_road", "noisy_10", "noisy_20", "curve", "no_lines"])
def test_recordings_give_what_cold_looks_give(name):
    with BagSource([BAGS / name]) as source:
        frames = list(source.frames())
    calibrator = Calibrator(source.rig)
    n_known = 0
    for frame in frames:
        cold = calibrator.calibrate_frame(frame.left, frame.right, frame.stamp_s)
        result = calibrator.calibrate_next(frame.left, frame.right, frame.stamp_s)
        assert (result.accepted, result.reason) == (cold.accepted, cold.reason)
        n_known += result.known_start
        if result.known_start:
            assert np.all(over_std(result, cold.extrinsics.as_array(), cold.std) < 1.0)
    assert n_known == {"straight_road": 9, "noisy_10": 1, "noisy_20": 1}.get(name, 0)


def test_a_car_has_stood_between_two_looks_at_its_place():
    """Frames between landmarks say nothing of the place; what is on both sides of them does."""
    calibrator = Calibrator(PAPER_RIG)
    for index in range(5):
        calibrator.add(*frame_of(TEXTURED, seed=index), 10.0 + 0.1 * index)
    estimate = calibrator.estimate
    assert estimate.n_frames == 5 and estimate.mount is not None and estimate.mount.stood
