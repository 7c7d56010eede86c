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

"""The copies of real pairs show the road they say: made of a rendered pair, whose pose is known."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.frames import READABLE
from benchmarks.harmless import COPIES, MIRRORED, Copy, cut, mirrored, noisy, scaled
from benchmarks.road_pairs import RoadPair
from benchmarks.road_verdicts import RoadVerdict
from benchmarks.steady import Judged
from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

RIGHT = np.array([5.0, 0.05, 0.15])  # mm, deg, deg: a copy whose rig is off by a pixel is off by more
SPREAD = np.array([1.0, 0.1, 0.2])


@pytest.fixture(scope="module")
def pair():
    scene = random_scene(np.random.default_rng(3), 0.005)
    scene = replace(scene, rig=replace(scene.rig, width=1242, cx=600.5))  # wide enough to be cut
    left, right = render(scene, np.random.default_rng(4))
    truth = scene.extrinsics.as_array() * READABLE
    return RoadPair("rendered", "3", "rendered", "accepted", scene.rig, left, right, truth, truth + SPREAD)


def ray(rig, column, row):
    return (column - rig.cx) / rig.fx, (row - rig.cy) / rig.fy


@pytest.mark.parametrize("copy", COPIES, ids=lambda copy: copy.name)
def test_copy_has_the_pose_it_says(pair, copy):
    made = copy.make(pair)
    assert made.left.shape == made.right.shape == (made.rig.height, made.rig.width)
    assert made.left.dtype == made.right.dtype == np.uint8
    result = calibrate(made.left, made.right, made.rig)
    assert result.accepted, result.message
    assert np.all(np.abs(result.extrinsics.as_array() * READABLE - pair.low * copy.signs) < RIGHT)


def test_eleven_copies_are_harmless():
    assert sum(copy.harmless for copy in COPIES) == 11


def test_mirrored_twice_is_the_pair(pair):
    again = mirrored(mirrored(pair))
    assert again.rig == pair.rig
    for name in ("left", "right", "low", "high"):
        np.testing.assert_array_equal(getattr(again, name), getattr(pair, name))


def test_mirrored_keeps_the_order_of_the_reference(pair):
    made = mirrored(pair)
    assert (made.low <= made.high).all()
    np.testing.assert_array_equal(made.low[2], -pair.high[2])
    np.testing.assert_array_equal(made.high[:2], pair.high[:2])


def test_mirrored_swaps_the_cameras_and_keeps_disparities_positive(pair):
    made = mirrored(pair)
    np.testing.assert_array_equal(made.left, pair.right[:, ::-1])
    # The same point: a column farther right in the left image than in the right one, before and after.
    left_column, right_column = 700.0, 690.0
    width = pair.rig.width
    assert (width - 1 - right_column) - (width - 1 - left_column) == left_column - right_column


def test_cut_keeps_the_rays(pair):
    made = cut(pair, left=7, top=5, right=3, bottom=2)
    np.testing.assert_array_equal(made.left, pair.left[5:-2, 7:-3])
    assert ray(made.rig, 93, 195) == pytest.approx(ray(pair.rig, 100, 200))


def test_scaled_keeps_the_rays_of_the_borders(pair):
    made = scaled(pair, 0.8)
    assert ray(made.rig, -0.5, -0.5) == pytest.approx(ray(pair.rig, -0.5, -0.5))
    far = made.rig.width - 0.5, made.rig.height - 0.5
    assert ray(made.rig, *far) == pytest.approx(ray(pair.rig, pair.rig.width - 0.5, pair.rig.height - 0.5))


def test_copies_are_the_same_every_time(pair):
    for copy in COPIES:
        np.testing.assert_array_equal(copy.make(pair).right, copy.make(pair).right)


def test_cameras_have_noise_of_their_own(pair):
    dark = replace(pair, left=np.full_like(pair.left, 100), right=np.full_like(pair.right, 100))
    made = noisy(dark)
    noise = [image.astype(float) - 100.0 for image in (made.left, made.right)]
    assert np.std(noise[0]) == pytest.approx(3.0, rel=0.05)
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.01


def verdict(pose, std, reason=""):
    unknown = np.full(3, np.nan)
    return RoadVerdict(
        "rendered",
        "3",
        "any",
        "welcome",
        reason,
        np.array(pose),
        np.array(std),
        unknown,
        unknown,
        np.zeros(3),
    )


@pytest.mark.parametrize(
    ("pose", "std", "same"),
    [
        ((1029.0, 1.0, -2.0), (10.0, 0.1, 0.1), True),
        ((1031.0, 1.0, -2.0), (10.0, 0.1, 0.1), False),
        ((1031.0, 1.0, -2.0), (11.0, 0.1, 0.1), True),  # the greater standard deviation counts
        ((1000.0, 1.0, 2.0), (10.0, 0.1, 0.1), False),  # roll changes its sign
    ],
)
def test_same_pose_is_within_three_standard_deviations(pose, std, same):
    copy = Copy("mirrored", mirrored, MIRRORED)
    original = verdict((1000.0, 1.0, 2.0), (10.0, 0.1, 0.1))
    assert Judged(copy, original, verdict(pose, std)).same is same


def test_refused_copy_is_not_the_same():
    original = verdict((1000.0, 1.0, 2.0), (10.0, 0.1, 0.1))
    refused = verdict([], [], "no_lines_found")
    assert not Judged(COPIES[0], original, refused).same
