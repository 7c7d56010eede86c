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

from stereo_selfcal.core.drive.landmark_matches import different_bits, match_anywhere, match_near
from stereo_selfcal.core.estimators.landmarks import Landmarks


def landmarks(rng, n):
    left = rng.uniform(0, 600, (n, 2)).astype(np.float32)
    return Landmarks(left, left - 10.0, rng.integers(0, 256, (n, 32), dtype=np.uint8))


def test_bits_are_counted():
    rng = np.random.default_rng(1)
    first, second = landmarks(rng, 5), landmarks(rng, 7)
    expected = np.unpackbits(first.descriptors[:, None] ^ second.descriptors, axis=2).sum(axis=2)
    np.testing.assert_array_equal(different_bits(first, second), expected)


def test_landmarks_are_found_in_another_order():
    rng = np.random.default_rng(2)
    first = landmarks(rng, 50)
    order = rng.permutation(50)
    second = Landmarks(first.left[order], first.right[order], first.descriptors[order])
    before, after = match_anywhere(different_bits(first, second))
    np.testing.assert_array_equal(order[after], before)
    assert len(before) == 50


def test_what_looks_like_two_others_is_not_matched():
    rng = np.random.default_rng(3)
    first = landmarks(rng, 20)
    twice = np.concatenate([np.arange(20), [4]])
    second = Landmarks(first.left[twice], first.right[twice], first.descriptors[twice])
    before, _ = match_anywhere(different_bits(first, second))
    np.testing.assert_array_equal(before, np.delete(np.arange(20), 4))


def test_near_the_expected_place_the_likest_one_is_matched():
    rng = np.random.default_rng(4)
    first = landmarks(rng, 20)
    twice = np.concatenate([np.arange(20), [4]])
    place = np.column_stack([first.left, np.full(20, 10.0)])
    found = place[twice].copy()
    found[4] += 100.0
    second = Landmarks(first.left[twice], first.right[twice], first.descriptors[twice])
    expected = place.copy()
    expected[7] = np.nan
    before, after = match_near(different_bits(first, second), expected, found, 5.0)
    assert 7 not in before
    assert after[list(before).index(4)] == 20
    assert len(before) == 19
