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

"""Large images are looked at in a smaller size, and what is found lies where the images show it."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.camera.working_size import WorkingSize
from stereo_selfcal.core.geometry.plane import PlaneCamera, plane_from_pose
from stereo_selfcal.core.geometry.rays import pixel_rays
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene


def rig_of(width, height):
    focal_px = PAPER_RIG.fx * width / PAPER_RIG.width
    centre = (width - 1) / 2, (height - 1) / 2
    return StereoRig(width, height, focal_px, focal_px, *centre, PAPER_RIG.baseline_m)


@pytest.mark.parametrize(
    ("width", "scale"), [(320, 1), (640, 1), (1280, 1), (1400, 1), (1600, 2), (1920, 2), (2448, 3), (3840, 4)]
)
def test_the_width_comes_near_to_that_of_the_limits(width, scale):
    size = WorkingSize.of(rig_of(width, width // 2))
    assert size.scale == scale
    assert WorkingSize.of(size.rig).scale == 1
    assert size.rig.width == width // scale


def test_a_ray_goes_through_the_same_point_of_both_sizes():
    rig = rig_of(1921, 1081)  # the last column and row are left out
    size = WorkingSize.of(rig)
    columns, rows = np.array([0.0, 17.0, 959.0]), np.array([3.0, 200.0, 539.0])
    np.testing.assert_allclose(
        pixel_rays(size.rig, columns, rows), pixel_rays(rig, size.in_images(columns), size.in_images(rows))
    )


def test_a_principal_point_at_the_border_stays_inside():
    for cx, cy in ((0.0, 0.0), (1920.0, 1080.0)):
        smaller = WorkingSize.of(replace(rig_of(1920, 1080), cx=cx, cy=cy)).rig
        assert 0.0 <= smaller.cx <= smaller.width and 0.0 <= smaller.cy <= smaller.height


def test_pixels_are_the_mean_of_those_of_the_images():
    rng = np.random.default_rng(0)
    images = tuple(rng.integers(0, 256, (2, 1080, 1920)).astype(np.uint8))
    for image, small in zip(images, WorkingSize.of(rig_of(1920, 1080)).images(images), strict=True):
        means = image.reshape(540, 2, 960, 2).mean(axis=(1, 3))
        assert small.dtype == np.uint8 and np.abs(small - means).max() <= 0.5


def test_small_images_are_taken_as_they_are():
    images = np.zeros((480, 640), np.uint8), np.ones((480, 640), np.uint8)
    assert WorkingSize.of(PAPER_RIG).images(images) is images


@pytest.fixture(scope="module")
def large():
    rig = rig_of(1920, 1080)
    scene = random_scene(np.random.default_rng(5), 0.01, rig=rig, texture_amplitude=10.0)
    return scene, render(scene, np.random.default_rng(0))


def test_lines_and_points_of_large_images_lie_in_them(large):
    scene, (left, right) = large
    result = Calibrator(scene.rig).calibrate_frame(left, right)
    assert result.accepted
    error = np.abs(result.extrinsics.as_array() - scene.extrinsics.as_array())
    assert np.all(error < 4.0 * result.std.as_array())
    # The plane predicts in the right image what the left one shows of a stripe, in pixels of the images.
    plane = plane_from_pose(scene.extrinsics, scene.rig, PlaneCamera.LEFT)
    for of_left, of_right in result.pattern.pairs:
        rows = np.array([of_left.v_mid, scene.rig.height - 100.0])
        columns = of_left.column_at(rows)
        disparity = plane.disparities(pixel_rays(scene.rig, columns, rows))
        np.testing.assert_allclose(of_right.column_at(rows), columns - disparity, atol=1.5)
    assert result.pattern.rows.max() > 900.0
    points = result.landmarks.left
    assert points[:, 0].max() > 1000.0 and points[:, 1].max() > 600.0
    assert all(line.rows.max() <= 1079.5 for line in result.unused_lines)


def test_a_large_frame_is_followed_as_a_small_one(large):
    scene, (left, right) = large
    calibrator = Calibrator(scene.rig)
    cold = calibrator.add(left, right, 0.0)
    followed = calibrator.add(left, right, 0.4)
    assert followed.known_start
    change = followed.extrinsics.as_array() - cold.extrinsics.as_array()
    assert np.all(np.abs(change) < cold.std.as_array())
    np.testing.assert_allclose(followed.landmarks.left.max(axis=0), cold.landmarks.left.max(axis=0), rtol=0.2)
