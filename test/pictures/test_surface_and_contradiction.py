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

"""The road surface in the pictures, the single line, and what lines and surface say where they differ."""

from dataclasses import replace

import numpy as np
import pytest
from picture_making import ACCEPTED, BLACK, FRAME, LINES, PATTERN, POSE, REJECTION, RIG, has_colour

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.evidence.road_surface import SurfaceCells
from stereo_selfcal.core.geometry.homography import apply_homography, image_from_road, road_from_image
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.pictures.camera_view import Drawn, draw_camera_view, legend
from stereo_selfcal.pictures.canvas import GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION, WHITE, YELLOW
from stereo_selfcal.pictures.contradiction import contradicts, draw_contradiction, place_in_right_image
from stereo_selfcal.pictures.overview import draw_overview
from stereo_selfcal.pictures.surface_cells import CELL_OPACITY

AGREES, BESIDE, BARE = [8.0, 0.0], [8.0, 1.5], [8.0, -1.5]
CELLS = SurfaceCells(
    POSE,
    np.array([AGREES, BESIDE, BARE], np.float32),
    np.array([0.001, 0.08, np.nan], np.float32),
    np.array([1.0, 0.1, 0.0], np.float32),
)
DISAGREES = replace(REJECTION, reason=RejectReason.TEXTURE_DISAGREES)


def at(view, xy, scale=1.0):
    """Return the pixels of a view around a place on the road."""
    u, v = apply_homography(image_from_road(RIG, POSE, "left"), xy) * scale
    return view[round(v) - 2 : round(v) + 3, round(u) - 2 : round(u) + 3].astype(int)


def test_cells_in_the_plane_are_tinted_where_they_lie_others_are_not():
    view = draw_camera_view(BLACK, RIG, rejected(REJECTION, surface=CELLS))
    assert np.abs(at(view, AGREES) - CELL_OPACITY * np.array(GREEN)).max() < 12
    assert has_colour(at(view, BESIDE), VERMILION) and not has_colour(at(view, BESIDE), GREEN)
    assert at(view, BARE).max() == 0
    assert at(view, [4.0, 0.0]).max() == 0


def test_cells_are_left_out_of_an_image_of_another_camera():
    view = draw_camera_view(np.zeros((240, 320), np.uint8), RIG, rejected(REJECTION, surface=CELLS))
    assert view.max() == 0


def test_the_single_line_is_drawn_as_a_lane_line_from_the_horizon_on():
    result = replace(ACCEPTED, pattern=None, lane_line=LINES[0], lane_yaw_rad=None)
    view = draw_camera_view(BLACK, RIG, result)
    row = 430
    column = round(float(LINES[0].column_at(row)))
    near = view[row - 1 : row + 2, column - 4 : column + 5]
    assert has_colour(near, VERMILION) or has_colour(near, WHITE)
    assert not has_colour(view[:150], VERMILION)


@pytest.mark.parametrize(
    ("drawn", "colours"),
    [
        (Drawn(), ()),
        (Drawn(pose=POSE), (SKY_BLUE, YELLOW)),
        (Drawn(pattern=PATTERN), (VERMILION, PURPLE)),
        (Drawn(lane_line=LINES[0]), (VERMILION,)),
        (Drawn(other_lines=LINES), (ORANGE,)),
        (Drawn(surface=CELLS), (GREEN, VERMILION)),
        (Drawn(surface=replace(CELLS, height_m=np.full(3, np.nan))), ()),
        (Drawn(stripes=np.zeros((1, 2))), (ORANGE,)),
    ],
)
def test_the_legend_names_what_is_drawn_and_nothing_else(drawn, colours):
    strip = legend(960, drawn)
    for colour in (SKY_BLUE, YELLOW, VERMILION, PURPLE, ORANGE, GREEN):
        assert (has_colour(strip, colour, 10) > 0) is (colour in colours), colour


def test_a_full_legend_fits_into_the_picture():
    everything = Drawn(POSE, CELLS, PATTERN, LINES[0], LINES, np.zeros((1, 2)))
    for width in (960, 1280, 2048):
        strip = legend(width, everything)
        assert strip.shape[1] == width
        assert not has_colour(strip[:, -width // 100 :], VERMILION)
        assert has_colour(strip[:, width // 2 :], VERMILION) and has_colour(strip, GREEN)


def test_the_surface_has_a_line_of_the_road_where_the_right_camera_sees_it():
    """Points of the left line, brought to the road and from there into the right image, for any pose."""
    pose = Extrinsics(1.7, 0.05, -0.03)
    places = place_in_right_image(LINES[0], pose, RIG, 300.0)
    rows = places[:, 1]
    left = np.column_stack([LINES[0].column_at(rows), rows])
    road = apply_homography(road_from_image(RIG, pose, "left"), left)
    right = apply_homography(image_from_road(RIG, pose, "right"), road)
    assert np.abs(right - places).max() < 1e-6


def test_a_contradiction_is_shown_in_the_right_image():
    result = rejected(DISAGREES, pattern=PATTERN, surface=CELLS)
    assert contradicts(result)
    view, strip = draw_contradiction(BLACK, RIG, result, 1.5)
    assert has_colour(view, VERMILION) and has_colour(view, GREEN)
    assert has_colour(strip, VERMILION) and has_colour(strip, GREEN)
    with_it, without = (
        draw_overview(FRAME.left, FRAME.right, RIG, each) for each in (result, replace(result, surface=None))
    )
    assert with_it.shape[0] > without.shape[0] + view.shape[0] - 5
    assert draw_contradiction(BLACK[::2, ::2], RIG, result, 1.5) == []


def test_a_contradiction_of_dense_disparities_alone_is_shown_too():
    assert contradicts(rejected(DISAGREES, pattern=PATTERN, stages={"coarse": POSE}))
    assert not contradicts(rejected(DISAGREES, pattern=PATTERN))
    assert not contradicts(rejected(DISAGREES, surface=CELLS))
    assert not contradicts(rejected(REJECTION, pattern=PATTERN, surface=CELLS))
    assert not contradicts(ACCEPTED)


def test_what_is_remembered_of_a_result_has_no_pictures():
    slim = replace(ACCEPTED, surface=CELLS, lane_line=LINES[0], unused_lines=LINES).slim()
    assert (slim.surface, slim.lane_line, slim.pattern, slim.unused_lines) == (None, None, None, ())
