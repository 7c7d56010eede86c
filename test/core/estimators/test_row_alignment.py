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

"""The turn of the right camera by the rows of points, against points that another projection places."""

import math

import numpy as np
import pytest
from independent_camera import seen_turned

from stereo_selfcal.core.estimators.matched_points import MatchedPoints
from stereo_selfcal.core.estimators.row_alignment import LEAST_SMOOTH_PX, align_rows, row_derivatives
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.scenes import PAPER_RIG

RIG = PAPER_RIG
TURN = {"pitch_rad": math.radians(0.1), "roll_rad": math.radians(-0.2), "yaw_rad": math.radians(0.15)}


def seen(n=300, up=0.0, ahead=0.0, seed=0, **angles_rad):
    """Return points all over the image, near and far, as both cameras see them."""
    rng = np.random.default_rng(seed)
    left = rng.uniform([0.0, 0.0], [RIG.width - 1.0, RIG.height - 1.0], (n, 2))
    depth_m = 1.0 / rng.uniform(1 / 200.0, 1 / 4.0, n)
    rays = (left - [RIG.cx, RIG.cy]) / [RIG.fx, RIG.fy]
    # From the place of the right camera: x to the right, y down, z ahead.
    places = np.column_stack([rays, np.ones(n)]) * depth_m[:, None]
    places -= RIG.baseline_m * np.array([1.0, -up, ahead])
    straight = places[:, :2] / places[:, 2:] * [RIG.fx, RIG.fy] + [RIG.cx, RIG.cy]
    return left, seen_turned(RIG, straight, **angles_rad)


def aligned(left, right):
    return align_rows(MatchedPoints(left.astype(np.float32), right.astype(np.float32)), RIG)


def test_derivatives_are_those_of_the_projection():
    left, straight = seen()
    steps = {
        "pitch_rad": 1e-5,
        "roll_rad": 1e-5,
        "yaw_rad": 1e-5,
        "up": 1e-4,
        "ahead": 1e-4,
    }
    rows = [(seen(**{name: step})[1] - straight)[:, 1] / step for name, step in steps.items()]
    found = row_derivatives(RIG, MatchedPoints(left, straight))
    np.testing.assert_allclose(found, np.column_stack(rows), rtol=0.01, atol=0.02 * RIG.fy * 0.1)


@pytest.mark.parametrize("others", [{}, {"up": 0.004, "ahead": -0.003}])
def test_turn_of_exact_points_is_exact_to_second_order(others):
    """A fifth of a degree squared is 0.006 px."""
    found = aligned(*seen(**TURN, **others))
    np.testing.assert_allclose(found.turn, list(TURN.values()), atol=5e-5)
    assert found.up == pytest.approx(others.get("up", 0.0), abs=1e-3)
    assert found.ahead == pytest.approx(others.get("ahead", 0.0), abs=2e-3)
    assert found.yaw == (found.turn[2], math.sqrt(found.covariance[2, 2]))


@pytest.mark.parametrize("ahead", [-0.2, 0.3])
def test_images_that_are_late_are_those_of_a_camera_that_sits_ahead(ahead):
    """By a third of the baseline, sixty times what calibrations leave: such a prior has heavy tails."""
    found = aligned(*seen(ahead=ahead, pitch_rad=TURN["pitch_rad"], roll_rad=TURN["roll_rad"]))
    assert found.ahead == pytest.approx(ahead, rel=0.02)
    error = found.turn - [TURN["pitch_rad"], TURN["roll_rad"], 0.0]
    assert np.all(np.abs(error) < 2.0 * np.sqrt(np.diag(found.covariance)[:3]))


def test_error_is_what_is_claimed():
    """Rigs as calibrations leave them, rows in noise, and a smooth error that is a pitch or a roll."""
    rng, relative = np.random.default_rng(1), []
    for seed in range(80):
        angles = rng.normal(0.0, math.radians(0.05), 3)
        up, ahead = rng.normal(0.0, 0.005, 2)
        named = dict(zip(TURN, angles, strict=True))
        left, right = seen(120, up, ahead, seed, **named)
        smooth = rng.normal(0.0, LEAST_SMOOTH_PX, 2)
        right[:, 1] += smooth[0] + smooth[1] * (right[:, 0] - RIG.cx) / (RIG.width / 2)
        right[:, 1] += rng.normal(0.0, 0.2, len(right))
        found = aligned(left, right)
        assert found.scatter_px == pytest.approx(0.2, rel=0.4)
        relative.append((found.turn - angles)[:2] / np.sqrt(np.diag(found.covariance)[:2]))
    rms = np.sqrt(np.mean(np.square(relative), axis=0))
    # 80 draws give a standard deviation to 8 %.
    assert np.all((rms > 0.75) & (rms < 1.25)), rms


def test_wrong_matches_are_left_out():
    left, right = seen(**TURN)
    rng = np.random.default_rng(2)
    right[:, 1] += rng.normal(0.0, 0.1, len(right))
    before = aligned(left, right)
    wrong = rng.permutation(len(right))[: len(right) // 4]
    right[wrong, 1] += rng.uniform(2.0, 20.0, len(wrong))
    after = aligned(left, right)
    assert np.all(np.abs(after.turn - before.turn) < 2.0 * np.sqrt(np.diag(before.covariance)[:3]))
    assert after.n_points <= len(right) - len(wrong) + 3


def test_a_smooth_error_that_no_turn_explains_is_told_and_is_in_the_covariance():
    left, right = seen(1500, pitch_rad=TURN["pitch_rad"], roll_rad=TURN["roll_rad"])
    plain = aligned(left, right)
    error_px = 0.3 * np.sin(right[:, 0] / RIG.width * 4.0 * math.pi)
    right[:, 1] += error_px
    found = aligned(left, right)
    assert plain.distortion_px == pytest.approx(LEAST_SMOOTH_PX, rel=0.3)
    assert found.distortion_px == pytest.approx(float(np.std(error_px)), rel=0.4)
    assert found.covariance[0, 0] > 9.0 * plain.covariance[0, 0]


def test_few_points_or_points_that_do_not_agree_tell_nothing():
    left, right = seen(29)
    few = aligned(left, right)
    assert isinstance(few, NotFitted)
    assert few.reason == "points of texture that both images show: 29, at least 30 needed"
    assert not isinstance(aligned(*seen(30)), NotFitted)
    left, right = seen()
    right[:, 1] += np.random.default_rng(3).normal(0.0, 3.0, len(right))
    loose = aligned(left, right)
    assert isinstance(loose, NotFitted) and "scatter of the rows of matched points" in loose.reason
