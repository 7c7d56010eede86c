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

"""Heights of lines over a road where it is turned against them: which rows and which side count."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.estimators.texture_fit import TextureFit, TextureQuality
from stereo_selfcal.core.evidence.lane_heights import _heights_along, heights_over_surface, surely_no_kerb
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.road.unevenness import RoadUnevenness
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, 0.0)


def seen_rows_m():
    """Return how far ahead the rows of the lines are [m]."""
    pattern = ideal_pattern(PAPER_RIG, POSE)
    below = (pattern.rows - PAPER_RIG.cy) / PAPER_RIG.fy
    return POSE.height_m / np.tan(np.arctan(below) + POSE.pitch_rad)


def test_a_row_has_the_weight_of_its_pixels():
    """Over a road that falls away, height grows with distance; a far row shows it by fewer pixels.

    A pixel of disparity is a height that grows with distance: weights go by its inverse square.
    """
    fall_rad = 0.002
    falling = Extrinsics(POSE.height_m, POSE.pitch_rad - fall_rad, 0.0)  # of the camera against that road
    ahead_m = seen_rows_m()
    expected = np.average(ahead_m * math.tan(fall_rad), weights=ahead_m**-2.0)
    unweighted = np.mean(ahead_m * math.tan(fall_rad))
    along = _heights_along(ideal_pattern(PAPER_RIG, POSE), PAPER_RIG, POSE, falling)
    found = np.abs([np.average(heights_m, weights=weights) for heights_m, weights, _ in along])
    assert unweighted > 1.3 * expected
    np.testing.assert_allclose(found, expected, rtol=0.05)


def own_lane():
    """Return a flat lane between both lines, well seen."""
    places = np.array([(x, y) for x in np.arange(6.0, 25.0, 2.0) for y in (-1.2, 0.0, 1.2)])
    quality = TextureQuality(50.0, 0.9, 0.9, 0.9, (1e-3, 1e-4, 1e-4))
    unevenness = RoadUnevenness(1e-7, 0.0, 0.0)
    terms = (UncertaintyTerm("noise", np.eye(3) * 1e-10),)
    n = len(places)
    return TextureFit(POSE, terms, quality, unevenness, places, np.zeros(n), np.ones(n), np.full(n, 1e-6))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_kerb_on_either_side_is_a_kerb(side):
    """A plane through the line on one side, 6 cm over the lane on the other; half of that is none."""
    pattern = ideal_pattern(PAPER_RIG, POSE)
    for higher_m, excluded in ((0.065, False), (0.02, True)):
        # Higher by this at 1.75 m to that side, and by nothing at the other.
        turned = replace(POSE, height_m=POSE.height_m - higher_m / 2.0, roll_rad=side * higher_m / 3.5)
        heights = heights_over_surface(pattern, PAPER_RIG, turned, own_lane())
        assert (surely_no_kerb(heights) >= 1.0) == excluded
        higher = max(heights, key=lambda height: height.value_m)
        assert higher.value_m == pytest.approx(higher_m, rel=0.1)
