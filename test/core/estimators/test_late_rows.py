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

"""Rows of points in right images that are late: the right camera seems to sit farther ahead."""

import math

import numpy as np
import pytest
from landmark_making import RIG, SHORT_RIG, START, cloud, seen

from stereo_selfcal.core.estimators.matched_points import MatchedPoints
from stereo_selfcal.core.estimators.row_alignment import RowAlignment, align_rows


def rows(rig, seed, ahead_m):
    rng = np.random.default_rng(seed)
    found = seen(cloud(rng, 3000, 60.0), rig, START, rng, right_ahead_m=ahead_m, place_px=0.0)
    right = found.right + np.array([0.0, 1.0]) * 0.15 * rng.standard_normal((len(found), 1))
    aligned = align_rows(MatchedPoints(found.left, right.astype(np.float32)), rig)
    assert isinstance(aligned, RowAlignment), aligned.reason
    return aligned


# 2, 5 and 20 ms at 5 to 15 m/s.
@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
@pytest.mark.parametrize("ahead_m", [0.0, 0.01, 0.03, 0.075, 0.3, -0.1])
def test_the_way_of_late_images_is_measured(rig, ahead_m):
    ratios = []
    for seed in range(10):
        found = rows(rig, seed, ahead_m)
        error_m = found.ahead * rig.baseline_m - ahead_m
        ratios.append(error_m / (math.sqrt(found.covariance[4, 4]) * rig.baseline_m))
        assert abs(found.turn[0]) < math.radians(0.02)
    assert math.sqrt(np.mean(np.square(ratios))) < 1.6
