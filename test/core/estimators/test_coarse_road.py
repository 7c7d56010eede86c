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

"""The coarse plane of dense disparities: which one it is, how much of the road agrees, when there is none."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import CalibratorConfig, Extrinsics
from stereo_selfcal.core.estimators import coarse_road
from stereo_selfcal.core.estimators.coarse_road import LEAST_SHARE, CoarseRoad, find_coarse_road
from stereo_selfcal.core.estimators.dense_disparity import DenseDisparities, SmallImages
from stereo_selfcal.core.geometry.plane import PlaneCamera, plane_from_pose
from stereo_selfcal.core.geometry.rays import pixel_rays
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

SEARCH = CalibratorConfig().search
POSE = Extrinsics(1.4, 0.05, 0.02)
SCALE = 2  # of the paper's rig
SMALL = PAPER_RIG.height // SCALE, PAPER_RIG.width // SCALE
BLANK = np.zeros((PAPER_RIG.height, PAPER_RIG.width), np.uint8)


@cache
def rendered(texture_amplitude):
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    return scene, render(scene, np.random.default_rng(0))


def rays():
    rows, columns = SCALE * (np.indices(SMALL) + 0.5) - 0.5
    return pixel_rays(PAPER_RIG, columns, rows)


def disparities_of(pose):
    """Return the disparities (h, w) of a road in the small left image [px of it]."""
    plane = plane_from_pose(pose, PAPER_RIG, PlaneCamera.LEFT)
    return plane.disparities(rays()) / SCALE


def aside_m(pose):
    """Return how far to the left of the camera the road of each pixel lies (h, w) [m]."""
    return rays()[..., 1] * PAPER_RIG.fx * PAPER_RIG.baseline_m / (disparities_of(pose) * SCALE)


def relative_error(found):
    """Return the errors (3,) of a plane over their standard deviations."""
    return (found.extrinsics.as_array() - POSE.as_array()) / np.sqrt(np.diag(found.covariance))


def given(monkeypatch, dense):
    """Let small images have these disparities, whatever they show, and let both show the same."""
    monkeypatch.setattr(
        SmallImages, "match", lambda small, number: DenseDisparities(dense, small.scale, number)
    )
    monkeypatch.setattr(coarse_road, "_correlation", lambda _, disparity: np.ones_like(disparity))


def found_in(monkeypatch, disparity, search=SEARCH, seed=0):
    """Return the plane found in given disparities."""
    dense = np.where(disparity > 0.0, disparity, -1.0).astype(np.float32)
    given(monkeypatch, dense)
    return find_coarse_road((BLANK, BLANK), PAPER_RIG, search, seed)[0]


@pytest.mark.parametrize("pose", [POSE, Extrinsics(0.6, -0.02, -0.06), Extrinsics(2.2, 0.3, 0.0)])
def test_plane_of_exact_disparities_is_exact_without_any_prior_pose(monkeypatch, pose):
    found = found_in(monkeypatch, disparities_of(pose))
    np.testing.assert_allclose(found.extrinsics.as_array(), pose.as_array(), atol=1e-6)
    assert found.share == found.matched_share == 1.0 and found.clear and found.scale == SCALE


def test_a_smooth_error_of_a_fifth_of_a_small_pixel_is_in_its_covariance(monkeypatch):
    """A constant, and what grows to the side or to the bottom of the image: one draw of each, turned."""
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    v, u = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in SMALL), indexing="ij")
    exact = disparities_of(POSE)
    errors = [
        relative_error(found_in(monkeypatch, exact + 0.2 * (constant + across * u + down * v)))
        for constant, across, down in turned
    ]
    # Where everything is linear, the squares of three such draws add up to the variance.
    scatter = np.sqrt(np.sum(np.square(errors), axis=0))
    np.testing.assert_allclose(scatter, 1.0, atol=0.15)


def test_cars_and_walls_do_not_move_the_plane(monkeypatch):
    exact = disparities_of(POSE)
    disparity = exact.copy()
    car = (aside_m(POSE) > 0.3) & (exact > 3.0) & (exact < 9.0)  # a third of the road in view
    disparity[car] = 9.0
    disparity[:110] = 4.0  # a wall from side to side
    found = found_in(monkeypatch, disparity)
    assert np.all(np.abs(relative_error(found)) < 0.5)  # the foot of the car is as high as the road
    assert 0.5 < found.share < 0.85 and found.matched_share == pytest.approx(1.0, abs=0.01)


def test_nothing_is_seen_below_a_road(monkeypatch):
    """Beds 0.4 m high cover more of the image than the road of 2.2 m between them."""
    higher = replace(POSE, height_m=POSE.height_m - 0.4)
    road = np.abs(aside_m(POSE)) < 1.1
    disparity = np.where(road, disparities_of(POSE), disparities_of(higher))
    found = found_in(monkeypatch, disparity)
    assert np.all(np.abs(relative_error(found)) < 2.0)
    # If the points below it did not count, the plane of the beds would have more of the road ahead.
    monkeypatch.setattr(coarse_road, "_BELOW_PX", 1e9)
    found = found_in(monkeypatch, disparity)
    assert found.extrinsics.height_m == pytest.approx(higher.height_m, abs=0.02)


def test_share_is_of_the_road_in_view_and_decides_what_is_clear(monkeypatch):
    """Holes of the disparity image: half of the road's rows are not matched."""
    disparity = disparities_of(POSE)
    disparity[::2] = -1.0
    holes = found_in(monkeypatch, disparity)
    assert holes.share == pytest.approx(0.5, abs=0.02) == pytest.approx(holes.matched_share, abs=0.04)
    disparity[1::4] += 3.0  # of the rest, half is somewhere else
    less = found_in(monkeypatch, disparity)
    assert less.share == pytest.approx(0.25, abs=0.02) and less.matched_share > 0.45
    assert not less.clear
    for share, clear in ((LEAST_SHARE, True), (0.99 * LEAST_SHARE, False)):
        assert replace(less, share=share).clear == clear


def test_no_plane_where_there_are_no_disparities_or_no_road(monkeypatch):
    nothing = found_in(monkeypatch, np.full(SMALL, -1.0))
    assert isinstance(nothing, NotFitted)
    assert nothing.reason == "points of the disparity image that may lie on a road: 0, at least 100 needed"
    wall = found_in(monkeypatch, np.full(SMALL, 6.0))
    assert isinstance(wall, NotFitted) and "within the search range" in wall.reason
    # A road lower than any that is searched.
    low = CalibratorConfig.from_mapping({"search.height_max_m": 1.2}).search
    assert isinstance(found_in(monkeypatch, disparities_of(POSE), low), NotFitted)


def test_another_seed_tries_other_planes_and_finds_the_same_road(monkeypatch):
    rng = np.random.default_rng(0)
    disparity = disparities_of(POSE) + rng.normal(0.0, 0.3, SMALL)
    poses = [found_in(monkeypatch, disparity, seed=seed).extrinsics.as_array() for seed in (0, 0, 1)]
    np.testing.assert_array_equal(poses[0], poses[1])
    np.testing.assert_allclose(poses[0], poses[2], atol=2e-3)


def test_textured_road_is_found_and_nearly_all_of_it_agrees():
    """What semi-global matching leaves is within three of the standard deviations that are stated."""
    scene, images = rendered(12.0)
    found, _ = find_coarse_road(images, scene.rig, SEARCH, 0)
    error = found.extrinsics.as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(found.covariance)))
    assert found.share > 0.95 and found.clear


def test_bare_road_has_no_clear_plane():
    """The smooth surface is filled by guesses: they are no road that contradicts lines."""
    scene, images = rendered(0.0)
    found, _ = find_coarse_road(images, scene.rig, SEARCH, 0)
    assert isinstance(found, NotFitted) or not found.clear


def test_only_what_both_images_show_agrees_with_the_plane():
    """The noise of both cameras is no road, whatever disparities are found in it."""
    scene, images = rendered(20.0)
    of_road, _ = find_coarse_road(images, scene.rig, SEARCH, 0)
    noise = np.random.default_rng(0).integers(110, 120, (2, *images[0].shape)).astype(np.uint8)
    bare = tuple(np.where(image > 200, image, each) for image, each in zip(images, noise, strict=True))
    of_noise, _ = find_coarse_road(bare, scene.rig, SEARCH, 0)
    assert of_road.share > 0.9
    assert isinstance(of_noise, NotFitted) or of_noise.share < 0.5 * LEAST_SHARE


def test_images_of_any_width_are_made_as_small(monkeypatch):
    """A rig of three times the resolution has the same small images, and the same plane."""
    disparity = disparities_of(POSE)
    fine = replace(
        PAPER_RIG,
        width=3 * PAPER_RIG.width,
        height=3 * PAPER_RIG.height,
        fx=3 * PAPER_RIG.fx,
        fy=3 * PAPER_RIG.fy,
        cx=3 * (PAPER_RIG.cx + 0.5) - 0.5,
        cy=3 * (PAPER_RIG.cy + 0.5) - 0.5,
    )
    coarse = found_in(monkeypatch, disparity)
    # 1920 columns are made 384, 640 are made 320.
    dense = disparity_at(fine, 5).astype(np.float32)
    given(monkeypatch, dense)
    blank = np.zeros((fine.height, fine.width), np.uint8)
    found, _ = find_coarse_road((blank, blank), fine, SEARCH, 0)
    assert isinstance(found, CoarseRoad) and (coarse.scale, found.scale) == (2, 5)
    np.testing.assert_allclose(found.extrinsics.as_array(), POSE.as_array(), atol=1e-6)
    # A pixel of the smaller image is more of the road.
    assert math.sqrt(found.covariance[1, 1]) < math.sqrt(coarse.covariance[1, 1])


def disparity_at(rig, scale):
    size = rig.height // scale, rig.width // scale
    rows, columns = scale * (np.indices(size) + 0.5) - 0.5
    found = plane_from_pose(POSE, rig, PlaneCamera.LEFT).disparities(pixel_rays(rig, columns, rows)) / scale
    return np.where(found > 0.0, found, -1.0)


@pytest.mark.parametrize(("matched_part", "times"), [(1.0, 1), (0.3, 2)])
def test_more_disparities_are_matched_where_most_of_the_road_has_none(monkeypatch, matched_part, times):
    """A road that is seen and not clear has no nearer things in front of it."""
    dense = disparities_of(POSE)
    rng = np.random.default_rng(0)
    dense[rng.random(SMALL) < 0.6] += 5.0  # of other things: the road is not clear
    dense[rng.random(SMALL) > matched_part] = -1.0
    asked = []

    def match(small, number):
        asked.append(number)
        return DenseDisparities(dense, small.scale, number)

    monkeypatch.setattr(SmallImages, "match", match)
    found, _ = find_coarse_road((BLANK, BLANK), PAPER_RIG, SEARCH, 0)
    assert isinstance(found, CoarseRoad) and not found.clear
    assert len(asked) == times and asked == sorted(asked)


def test_high_images_are_made_smaller_still():
    small = SmallImages.of((np.zeros((2048, 2448), np.uint8),) * 2)
    assert small.images[0].size <= 120_000 and small.scale == 7
