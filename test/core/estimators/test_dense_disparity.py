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

"""Dense disparities at low resolution: of a rendered road, and where they are looked up."""

import numpy as np
import pytest
from independent_camera import project

from stereo_selfcal.core.estimators.dense_disparity import DenseDisparities, SmallImages, in_images
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

NUMBER = 48


@pytest.fixture(scope="module")
def road():
    """Return a textured road and its small disparities."""
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    small = SmallImages.of(render(scene, np.random.default_rng(0)))
    return scene, small.match(NUMBER)


@pytest.mark.parametrize(
    ("size", "scale"), [((480, 640), 2), ((375, 1242), 3), ((1080, 1920), 5), ((90, 120), 1)]
)
def test_images_are_made_small_by_a_whole_number_to_about_400_columns(size, scale):
    image = np.zeros(size, np.uint8)
    small = SmallImages.of((image, image))
    assert small.scale == scale
    assert small.images[0].shape == small.images[1].shape == (size[0] // scale, size[1] // scale)


def test_a_pixel_of_a_small_image_is_the_mean_of_those_it_stands_for():
    image = np.tile(np.arange(0, 240, 3, dtype=np.uint8).repeat(10), (600, 1))
    small = SmallImages.of((image, image))
    columns = in_images(np.arange(small.images[0].shape[1]), small.scale)
    at = np.interp(columns, np.arange(800), image[0].astype(float))
    np.testing.assert_allclose(small.images[0][100], at, atol=1.6)
    # The middle of the first two columns.
    assert in_images(0, 2) == 0.5 and in_images([3], 1) == [3.0]


def test_disparities_of_a_road_are_those_of_its_places(road):
    """Places on the road that both cameras see, projected by OpenCV: to a quarter of a small pixel."""
    scene, dense = road
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(5.0, 20.0, 1.0), np.arange(-2.0, 2.1, 0.5)))
    places = np.column_stack([x, y, np.zeros_like(x)])
    left, right = (project(scene.rig, scene.extrinsics, camera, places) for camera in ("left", "right"))
    inside = np.all((left > 5.0) & (left < [scene.rig.width - 5.0, scene.rig.height - 5.0]), axis=1)
    inside &= right[:, 0] > 5.0
    found = dense.at(left[inside].astype(np.float32))
    known = found > 0.0
    assert np.count_nonzero(inside) > 60 and known.mean() > 0.9
    error = found[known] - (left - right)[inside, 0][known]
    assert np.median(np.abs(error)) < 0.25 * dense.scale


def test_what_the_right_camera_does_not_see_has_no_disparity(road):
    _, dense = road
    columns = np.arange(dense.values.shape[1])
    assert np.all(dense.values <= columns)
    assert dense.values.shape == (240, 320) and dense.number == NUMBER
    assert dense.values.max() <= NUMBER


def test_disparities_are_looked_up_in_pixels_of_the_images():
    values = np.full((4, 6), 2.0, np.float32)
    values[3, 5] = -1.0
    dense = DenseDisparities(values, 3, 16)
    points = np.array([[0.0, 0.0], [14.9, 11.0], [15.0, 9.0], [17.9, 11.9], [18.5, 12.5]], np.float32)
    np.testing.assert_array_equal(dense.at(points) > 0.0, [True, True, False, False, False])
    assert dense.at(points)[0] == 6.0
