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

"""Pairs of lines of one frame, and which of them is the road: nothing lies below it."""

from dataclasses import replace

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.lanes.hypotheses import cross, lines_below_plane
from stereo_selfcal.core.lanes.lane_pair import LanePattern
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.03, 0.0)


def lane(left_m=1.75, right_m=-1.75, left_above_m=0.0, right_above_m=0.0):
    """Return two lines, each of them at a height over the road: seen by a camera that much lower."""
    patterns = [
        ideal_pattern(PAPER_RIG, Extrinsics(POSE.height_m - above, POSE.pitch_rad, 0.0), (left_m, right_m))
        for above in (left_above_m, right_above_m)
    ]
    rows = patterns[0].rows
    left, right = (
        (getattr(patterns[0], side)[0], getattr(patterns[1], side)[1]) for side in ("left", "right")
    )
    columns = np.array([[line.column_at(rows) for line in pair] for pair in (left, right)])
    return LanePattern(left, right, patterns[0].vanishing_point, rows, columns)


def test_lines_of_one_road_have_nothing_below():
    depths = lines_below_plane([lane(), lane(right_m=-5.0), lane(left_m=5.0)], PAPER_RIG)
    assert max(depth.depth_m for depth in depths) < 1e-3


@pytest.mark.parametrize("height_m", [0.08, 0.6])
def test_a_kerb_or_a_rail_has_the_line_below(height_m):
    """The plane through a rail and the other line passes over the line beside the rail."""
    road, rail = lane(), lane(left_m=2.2, left_above_m=height_m)
    own, wrong = lines_below_plane([road, rail], PAPER_RIG)
    assert own.depth_m < 1e-3 and not own.surely_below
    # At 1.75 m of the way from -1.75 to 2.2 m.
    assert wrong.depth_m == pytest.approx(height_m * 3.5 / 3.95, rel=0.2)
    assert wrong.surely_below


def test_a_line_that_is_badly_known_is_not_surely_below():
    """Lines far aside, in noise, were seen 47 to 74 mm too low, with 24 to 180 mm of deviation."""
    road, rail = lane(), lane(left_m=2.2, left_above_m=0.08)
    noisy = replace(road, left=tuple(replace(line, covariance=1e3 * line.covariance) for line in road.left))
    assert lines_below_plane([road, rail], PAPER_RIG)[1].surely_below
    assert not lines_below_plane([noisy, rail], PAPER_RIG)[1].surely_below


def test_roads_fall_beyond_their_own_lane():
    """By up to 5 % of the way against the own slope: no lower line; and farther aside nothing counts."""
    road = lane()
    assert lines_below_plane([road, lane(left_m=4.75, left_above_m=-0.14)], PAPER_RIG)[0].depth_m < 0.03
    assert lines_below_plane([road, lane(left_m=4.75, left_above_m=-0.25)], PAPER_RIG)[0].depth_m > 0.03
    assert lines_below_plane([road, lane(left_m=7.0, left_above_m=-0.5)], PAPER_RIG)[0].depth_m < 0.03


def test_lines_of_one_road_do_not_cross():
    road = lane()
    for other in (road, lane(left_m=2.0), lane(right_m=-5.0), lane(left_m=5.0, right_m=-2.0)):
        assert not cross(road, other) and not cross(other, road)
    slanted = [replace(line, slope=1.1 * line.slope) for line in road.left]
    assert cross(road, replace(road, left=tuple(slanted)))
    # What the noise of an edge does to a line is no crossing.
    shaken = [replace(line, u_mid=line.u_mid + 0.3, slope=line.slope + 0.002) for line in road.left]
    assert not cross(road, replace(road, left=tuple(shaken)))
