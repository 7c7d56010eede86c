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

"""Lines that are followed: found again where they are, and not where none is."""

from dataclasses import replace

import numpy as np

from stereo_selfcal import CalibratorConfig
from stereo_selfcal.core.lanes.detector import detect_by_hough
from stereo_selfcal.core.lanes.following import follow_lines, moved_line
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.synth.scenes import custom_scene


def points_of(**changes):
    (frame,) = custom_scene(n_frames=1, **changes).frames()
    return find_stripe_points(frame.left, CalibratorConfig().extraction), frame.left


def strongest(points, image):
    return [max(side, key=lambda each: each.votes) for side in detect_by_hough(points, image)]


def test_a_line_is_found_again_from_some_pixels_beside_it():
    points, image = points_of(noise_fraction=0.05)
    for index, found in enumerate(strongest(points, image)):
        for shift_px in (-6.0, 0.0, 6.0):
            expected = replace(found.line, u_mid=found.line.u_mid + shift_px, slope=found.line.slope + 0.02)
            sides = [[], []]
            sides[index] = [expected]
            (again,) = follow_lines(points, sides)[index]
            ends = np.array([found.line.rows.min(), found.line.rows.max()])
            np.testing.assert_allclose(again.line.column_at(ends), found.line.column_at(ends), atol=0.1)
            assert again.votes > 0.5 * found.votes


def test_where_no_line_is_none_is_found():
    points, image = points_of()
    empty, _ = points_of(no_lines=True)
    lines = [[found.line] for found in strongest(points, image)]
    assert follow_lines(empty, lines) == ([], [])
    far = [[replace(side[0], u_mid=side[0].u_mid + 40.0)] for side in lines]
    assert follow_lines(points, far) == ([], [])


def test_lines_move_with_their_image():
    points, image = points_of()
    line = strongest(points, image)[0].line
    moved = moved_line(line, np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 3.0], [0.0, 0.0, 1.0]]))
    rows = np.array([200.0, 300.0])
    np.testing.assert_allclose(moved.column_at(rows + 3.0), line.column_at(rows) + 5.0, atol=1e-9)
    assert moved_line(line, np.diag([1.0, 1.0, -1.0])) is None  # behind the camera
    assert moved_line(line, np.diag([1.0, -1.0, 1.0])) is None  # upside down
