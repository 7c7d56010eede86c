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

import numpy as np
import pytest

from stereo_selfcal.core.estimators.landmarks import describe_points
from stereo_selfcal.core.estimators.matched_points import MatchedPoints

RNG = np.random.default_rng(1)


@pytest.fixture(scope="module")
def image():
    coarse = RNG.integers(0, 200, (60, 100)).astype(np.float64)
    return np.kron(coarse, np.ones((6, 6))).astype(np.uint8)


def points(n=80, disparity_px=20.0):
    left = np.column_stack([RNG.uniform(60, 540, n), RNG.uniform(60, 300, n)]).astype(np.float32)
    return MatchedPoints(left, left - np.array([disparity_px, 0.0], np.float32))


def different_bits(first, second):
    return np.unpackbits(first.descriptors ^ second.descriptors, axis=1).sum(axis=1)


def test_a_point_has_256_bits(image):
    found = describe_points(image, points())
    assert found.descriptors.shape == (80, 32)
    assert found.descriptors.dtype == np.uint8
    assert len(found) == 80


def test_light_changes_few_bits_and_other_places_change_half(image):
    where = points()
    found = describe_points(image, where)
    darker = describe_points((0.6 * image + 20.0).astype(np.uint8), where)
    assert different_bits(found, darker).max() < 30
    other = different_bits(found, describe_points(image, points()))
    assert 90 < np.median(other) < 166


def test_an_image_that_is_shifted_has_the_same_bits(image):
    where = points()
    shifted = np.roll(image, (5, 9), axis=(0, 1))
    moved = MatchedPoints(
        where.left + np.array([9, 5], np.float32), where.right + np.array([9, 5], np.float32)
    )
    assert different_bits(describe_points(image, where), describe_points(shifted, moved)).max() <= 2


def test_the_neighbourhood_grows_with_the_disparity(image):
    # Twice as near, everything is twice as large.
    far = points(disparity_px=12.0)
    larger = np.kron(image, np.ones((2, 2))).astype(np.uint8)[:360, :600]
    inside = (far.left[:, 0] < 290) & (far.left[:, 1] < 170)
    left = 2.0 * far.left + 0.5
    near = MatchedPoints(left.astype(np.float32), (left - [24.0, 0.0]).astype(np.float32))
    bits = different_bits(describe_points(image, far), describe_points(larger, near))[inside]
    assert len(bits) > 10
    assert np.median(bits) < 40


def test_points_at_the_border_and_no_points_at_all(image):
    corners = np.array([[0, 0], [599, 0], [0, 359], [599, 359]], np.float32)
    assert len(describe_points(image, MatchedPoints(corners, corners))) == 4
    none = np.zeros((0, 2), np.float32)
    assert describe_points(image, MatchedPoints(none, none)).descriptors.shape == (0, 32)


def test_the_same_image_gives_the_same_bits(image):
    where = points()
    first, second = (describe_points(image, where, 0.1) for _ in range(2))
    assert np.array_equal(first.descriptors, second.descriptors)
    assert first.ahead == 0.1
