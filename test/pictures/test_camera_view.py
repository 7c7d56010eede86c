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

"""The camera view: drawn where the geometry says."""

from dataclasses import replace

import numpy as np
import pytest
from picture_making import ACCEPTED, BLACK, LINES, PATTERN, POSE, REJECTION, RIG

from stereo_selfcal.core.geometry.homography import apply_homography, image_from_road
from stereo_selfcal.core.results import rejected
from stereo_selfcal.pictures.camera_view import draw_camera_view, shown_extrinsics
from stereo_selfcal.pictures.canvas import GREEN, ORANGE, SKY_BLUE, WHITE, YELLOW
from stereo_selfcal.pictures.overview import draw_debug_image
from stereo_selfcal.pictures.road_grid import GRID_LABELS_M
from stereo_selfcal.pictures.verdict import StripContent, verdict_strip


def test_lines_lie_on_their_pixels():
    bare = replace(
        PATTERN, left=tuple(replace(each, rows=np.empty(0), columns=np.empty(0)) for each in LINES)
    )
    view = draw_camera_view(BLACK, RIG, rejected(REJECTION, pattern=bare))
    across = np.arange(640)
    for row in (310, 380, 470):
        for each in LINES:
            ink = np.where(np.abs(across - each.column_at(row)) < 8, view[row, :, 2].astype(float), 0.0)
            assert (ink * across).sum() / ink.sum() == pytest.approx(each.column_at(row), abs=0.25)


def test_points_lie_on_their_pixels():
    view = draw_camera_view(BLACK, RIG, rejected(REJECTION, pattern=PATTERN))
    row = LINES[0].rows[0]
    for each in LINES:
        assert tuple(view[round(row), round(each.column_at(row))]) == WHITE


@pytest.mark.parametrize("x_m", GRID_LABELS_M)
def test_grid_lies_on_the_road(x_m):
    """At a crossing of the grid the picture is painted, beside it it is not."""
    view = draw_camera_view(BLACK, RIG, replace(ACCEPTED, pattern=None), 3.0)
    crossing = apply_homography(image_from_road(RIG, POSE, "left"), [x_m, 0.0])
    u, v = np.round((crossing + 0.5) * 3.0 - 0.5).astype(int)
    assert view[v - 1 : v + 2, u - 1 : u + 2].max() > 60
    beside = apply_homography(image_from_road(RIG, POSE, "left"), [x_m + 2.5, 0.5])
    u, v = np.round((beside + 0.5) * 3.0 - 0.5).astype(int)
    assert view[v, u].max() == 0


def test_refused_result_shows_its_last_stage():
    stages = {"genetic": POSE, "closed_form": replace(POSE, height_m=2.0)}
    assert shown_extrinsics(rejected(REJECTION, stages=stages)).height_m == 2.0
    assert shown_extrinsics(rejected(REJECTION)) is None


def test_horizon_of_a_stream_lies_where_parallel_lines_meet():
    """The blue line runs through the image of the point at infinity straight ahead of the rig."""
    verdict = StripContent("", GREEN)
    picture, header = draw_debug_image(BLACK, RIG, ACCEPTED, verdict), verdict_strip(verdict, 960)
    view = picture[len(header) : len(header) + 720].astype(float)
    far = apply_homography(image_from_road(RIG, POSE, "left"), [1e9, 0.0])
    column, row = ((far + 0.5) * 1.5 - 0.5).round().astype(int)
    blue = np.where(np.abs(view - SKY_BLUE).max(axis=2) < 60, 1.0, 0.0)[:, column]
    rows = np.flatnonzero(blue)
    assert rows.size and abs(rows.mean() - row) < 1.5


def test_stripes_are_painted_though_nothing_came_of_them():
    """Without a result or a rig, too: they tell whether paint is seen at all."""
    verdict = StripContent("not calibrated", YELLOW)
    places = np.array([[100.0, 200.0], [300.0, 400.0], [-5.0, 3.0], [5000.0, 3.0]])
    view = draw_camera_view(BLACK, None, None, 2.0, stripes=places)
    painted = np.argwhere((view == ORANGE).all(axis=2))
    assert {tuple(p) for p in np.round(painted / 2.0 / 20) * 20} == {(200.0, 100.0), (400.0, 300.0)}
    assert draw_debug_image(BLACK, None, None, verdict, places).shape[1] == 960
