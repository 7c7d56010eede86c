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

from itertools import pairwise

import numpy as np
import pytest
from landmark_making import RIG, SHORT_RIG, START, cloud, seen
from street_making import Place, along, street_pair

from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.motion_between_frames import FrameMotion, estimate_motion
from stereo_selfcal.core.estimators.coarse_road import find_coarse_road
from stereo_selfcal.core.estimators.landmarks import Landmarks, describe_points
from stereo_selfcal.core.estimators.matched_points import match_points
from stereo_selfcal.core.rejection import NotFitted


def motion(world, rig, before, after, seed, **seen_by):
    rng = np.random.default_rng(seed)
    first, second = (seen(world, rig, place, rng, **seen_by) for place in (before, after))
    found = estimate_motion(first, second, rig)
    assert isinstance(found, FrameMotion), found.reason
    return found


def truth(before, after):
    moved = before.rotation.T @ np.array(
        [after.x_m - before.x_m, after.y_m - before.y_m, after.z_m - before.z_m]
    )
    turned = before.rotation.T @ after.rotation
    # For small turns, the rotation vector is the antisymmetric part.
    vector = 0.5 * np.array(
        [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
    )
    return np.concatenate([vector, moved])


AFTER = Place(x_m=1.3, y_m=0.05, z_m=1.52, yaw_rad=0.04, pitch_rad=0.031, roll_rad=0.008)


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
def test_a_motion_without_noise_is_exact(rig):
    world = cloud(np.random.default_rng(1))
    found = motion(world, rig, START, AFTER, 2, place_px=0.0, disparity_px=0.0)
    values = np.concatenate([found.turned_rad, found.moved_m])
    np.testing.assert_allclose(values, truth(START, AFTER), atol=2e-5)
    assert found.right_yaw_rad == pytest.approx(0.0, abs=2e-6)


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
def test_a_right_camera_that_is_turned_is_found_and_does_not_bend_the_motion(rig):
    world = cloud(np.random.default_rng(1))
    found = motion(world, rig, START, AFTER, 2, place_px=0.0, disparity_px=0.0, right_yaw_rad=0.002)
    assert found.right_yaw_rad == pytest.approx(0.002, abs=1e-5)
    np.testing.assert_allclose(found.moved_m, truth(START, AFTER)[3:], atol=1e-3)


@pytest.mark.parametrize("way_m", [0.3, 4.0, 10.0, 15.0])
def test_short_and_long_ways(way_m):
    world = cloud(np.random.default_rng(3), 4000, 150.0)
    found = motion(world, RIG, START, along(START, way_m), 4, most=800)
    error = np.concatenate([found.turned_rad, found.moved_m]) - truth(START, along(START, way_m))
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(found.covariance)[:6]))
    assert abs(error[3]) < 0.03 * max(1.0, way_m)


def test_errors_are_as_large_as_the_covariance_says():
    ratios = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        found = motion(cloud(rng), RIG, START, AFTER, seed + 1000)
        error = np.append(
            np.concatenate([found.turned_rad, found.moved_m]) - truth(START, AFTER), found.right_yaw_rad
        )
        ratios.append(error / np.sqrt(np.diag(found.covariance)))
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((rms > 0.6) & (rms < 1.5)), rms


def test_other_cars_do_not_count():
    world = cloud(np.random.default_rng(5))
    rng = np.random.default_rng(6)
    before, after = seen(world, RIG, START, rng), seen(world.moved(0.3, 1.1), RIG, AFTER, rng)
    found = estimate_motion(before, after, RIG)
    error = np.concatenate([found.turned_rad, found.moved_m]) - truth(START, AFTER)
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(found.covariance)[:6]))


def test_standing_still():
    found = motion(cloud(np.random.default_rng(7)), RIG, START, START, 8)
    assert np.linalg.norm(found.moved_m) < 0.05
    assert np.abs(found.turned_rad).max() < 1e-3


def test_the_same_landmarks_give_the_same_bits():
    world = cloud(np.random.default_rng(7))
    first, second = (motion(world, RIG, START, AFTER, 9) for _ in range(2))
    assert np.array_equal(first.moved_m, second.moved_m)
    assert np.array_equal(first.covariance, second.covariance)


def test_frames_of_different_places_have_no_motion():
    first, second = (cloud(np.random.default_rng(seed)) for seed in (10, 11))
    rng = np.random.default_rng(12)
    found = estimate_motion(seen(first, RIG, START, rng), seen(second, RIG, AFTER, rng), RIG)
    assert isinstance(found, NotFitted)
    assert "landmarks" in found.reason


@pytest.mark.parametrize("number", [0, 1, 19])
def test_too_few_landmarks_are_a_reason(number):
    rng = np.random.default_rng(12)
    landmarks = seen(cloud(rng), RIG, START, rng)
    few = Landmarks(landmarks.left[:number], landmarks.right[:number], landmarks.descriptors[:number])
    for pair in ((few, landmarks), (landmarks, few), (few, few)):
        assert isinstance(estimate_motion(*pair, RIG), NotFitted)


@pytest.mark.slow
def test_images_of_a_street_give_the_motion_and_the_turn_of_the_right_camera():
    rig = SHORT_RIG
    found = []
    for right_yaw_rad in (0.0, 0.002):
        landmarks = []
        for i in range(3):
            images = street_pair(rig, along(START, 1.2 * i), right_yaw_rad=right_yaw_rad, seed=i)
            _, disparities = find_coarse_road(images, rig, CalibratorConfig().search, 0)
            landmarks.append(describe_points(images[0], match_points(images, disparities)))
        for before, after in pairwise(landmarks):
            each = estimate_motion(before, after, rig)
            error = np.concatenate([each.turned_rad, each.moved_m]) - truth(START, along(START, 1.2))
            assert np.all(np.abs(error) < 5.0 * np.sqrt(np.diag(each.covariance)[:6]))
            assert each.right_yaw_rad == pytest.approx(right_yaw_rad, abs=4e-4)
            found.append(each)
    assert len(found) == 4
