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

"""Pictures of structured noise give a result, and never a fault; the long run is a benchmark."""

import numpy as np
import pytest

from benchmarks.structured_noise import KINDS, SIZES, frame, try_frame

# Frames that once raised, as they have two lines of one slope.
ONCE_FAULTY = (2108, 2618, 2976)


def faults_of(indices):
    return [fault for index in indices for fault in try_frame(index)[2]]


def test_frames_are_the_same_every_time_and_of_every_kind():
    kinds, sizes = set(), set()
    for index in range(60):
        kind, rig, left, right = frame(index)
        again = frame(index)
        assert (kind, rig) == again[:2]
        np.testing.assert_array_equal(left, again[2])
        np.testing.assert_array_equal(right, again[3])
        assert left.shape == right.shape == (rig.height, rig.width) and left.dtype == np.uint8
        kinds.add(kind)
        sizes.add((rig.width, rig.height))
    assert kinds == {*KINDS, "spoiled road"}
    assert set(SIZES) <= sizes


@pytest.mark.parametrize("index", ONCE_FAULTY)
def test_frames_that_once_raised_have_a_result(index):
    assert faults_of([index]) == []


@pytest.mark.slow
def test_structured_noise_gives_results_and_no_faults():
    assert faults_of(range(100)) == []
