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

"""Points of texture that both images show: where they are, and where none are matched."""

from functools import cache

import cv2
import numpy as np
import pytest
from independent_camera import project

from stereo_selfcal.core.estimators import matched_points
from stereo_selfcal.core.estimators.dense_disparity import DenseDisparities, SmallImages
from stereo_selfcal.core.estimators.matched_points import MatchedPoints, match_points
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

SIZE = 300, 400


@cache
def texture(shift_px=(0.0, 0.0), seed=0):
    """Return an image of smooth random texture, its content moved by (columns, rows): a sum of waves."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    grey = np.full(SIZE, 128.0)
    for along, down, phase in rng.uniform([-1.0, -1.0, 0.0], [1.0, 1.0, 6.3], (30, 3)):
        grey += 12.0 * np.cos(along * (u - shift_px[0]) + down * (v - shift_px[1]) + phase)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def all_at(disparity_px):
    return DenseDisparities(np.full(SIZE, disparity_px, np.float32), 1, 16)


@pytest.mark.parametrize("shift_px", [(-7.3, 0.4), (-4.0, -1.3)])
def test_points_are_matched_to_a_part_of_a_pixel_along_the_row_and_across_it(shift_px):
    """The dense disparities are off by a pixel, and know nothing of rows."""
    points = match_points((texture(), texture(shift_px)), all_at(1.0 - shift_px[0]))
    assert len(points) > 150
    found = points.right - points.left
    np.testing.assert_allclose(np.median(found, axis=0), shift_px, atol=0.01)
    assert np.percentile(np.abs(found - shift_px), 90) < 0.05


def test_points_are_matched_where_there_are_disparities():
    dense = all_at(5.0)
    dense.values[:, :200] = -1.0
    points = match_points((texture(), texture((-5.0, 0.0))), dense)
    assert len(points) > 50 and points.left[:, 0].min() > 195.0


def test_what_leads_back_to_another_point_is_no_match():
    """Of two images that show different things, few patches look alike by chance."""
    same = match_points((texture(), texture()), all_at(0.5))
    other = match_points((texture(), texture(seed=1)), all_at(0.5))
    assert len(other) < 0.25 * len(same)


def test_images_without_texture_have_no_points():
    blank = np.full(SIZE, 90, np.uint8)
    points = match_points((blank, blank), all_at(5.0))
    assert len(points) == 0 and points.right.shape == (0, 2)


def test_points_are_chosen_by_a_mask():
    points = MatchedPoints(np.arange(8.0, dtype=np.float32).reshape(4, 2), np.zeros((4, 2), np.float32))
    chosen = points.chosen(np.array([True, False, False, True]))
    np.testing.assert_array_equal(chosen.left, [[0.0, 1.0], [6.0, 7.0]])
    assert len(chosen) == len(chosen.right) == 2


def test_points_of_a_road_are_where_the_right_camera_sees_its_places():
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    images = render(scene, np.random.default_rng(0))
    points = match_points(images, SmallImages.of(images).match(48))
    # A plane moves from one image to the other by a homography, which four of its places determine.
    corners = [(5.0, 2.0, 0.0), (5.0, -2.0, 0.0), (30.0, 4.0, 0.0), (30.0, -4.0, 0.0)]
    left, right = (project(scene.rig, scene.extrinsics, camera, corners) for camera in ("left", "right"))
    expected = through_homography(left, right, points.left)
    near = points.left[:, 1] > left[:, 1].min()
    assert np.count_nonzero(near) > 200
    error = (points.right - expected)[near]
    assert np.all(np.abs(np.median(error, axis=0)) < 0.03)
    assert np.all(np.median(np.abs(error), axis=0) < 0.15)


def through_homography(before, after, points):
    """Return points (N, 2) as the plane moves them of which four points are given before and after."""
    rows = []
    for (x, y), (u, v) in zip(before, after, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    matrix = np.append(np.linalg.solve(np.array(rows), after.ravel()), 1.0).reshape(3, 3)
    moved = matrix @ np.column_stack([points, np.ones(len(points))]).T
    return (moved[:2] / moved[2]).T


def test_stronger_corners_are_those_of_all(monkeypatch):
    """Sorting fewer of them chooses the same ones."""
    images = texture(), texture((-7.3, 0.4))
    both = match_points(images, all_at(8.0))
    monkeypatch.setattr(matched_points, "_QUALITIES", matched_points._QUALITIES[1:])
    of_all = match_points(images, all_at(8.0))
    np.testing.assert_array_equal(both.left, of_all.left)
    np.testing.assert_array_equal(both.right, of_all.right)


def test_points_of_wide_images_are_followed_in_smaller_ones(monkeypatch):
    """They are found where they are in the images, to a part of a pixel of the smaller ones."""
    monkeypatch.setattr(matched_points, "_FOLLOWED_WIDTH_PX", SIZE[1] // 2)
    shift_px = -8.0, 0.0
    points = match_points((smooth(), smooth(shift_px)), all_at(8.0))
    assert len(points) > 20
    np.testing.assert_allclose(np.median(points.right - points.left, axis=0), shift_px, atol=0.02)


def smooth(shift_px=(0.0, 0.0)):
    return cv2.GaussianBlur(texture(shift_px), (0, 0), 2.0)
