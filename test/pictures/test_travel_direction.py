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

"""The direction of travel: drawn where a rendered truth has it, and only while the yaw is known."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from picture_making import ACCEPTED, BLACK, FRAME, POSE, REJECTION, RIG, SCENE, has_colour, replace_size

from stereo_selfcal.core.geometry.homography import apply_homography, image_from_road
from stereo_selfcal.core.geometry.travel import MOUNT_YAW_STD_RAD, Travel
from stereo_selfcal.core.results import rejected
from stereo_selfcal.pictures import canvas
from stereo_selfcal.pictures.birds_eye import BIRDS_EYE_FAR_M, BIRDS_EYE_HALF_WIDTH_M, draw_birds_eye
from stereo_selfcal.pictures.camera_view import draw_camera_view
from stereo_selfcal.pictures.canvas import BLUE
from stereo_selfcal.pictures.overview import draw_debug_image, draw_fringes, draw_overview
from stereo_selfcal.pictures.road_grid import near_edge_m
from stereo_selfcal.pictures.travel_direction import label_of, road_heading, shown_travel, vanishing_point
from stereo_selfcal.pictures.verdict import verdict_of
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.world import Road

SCALE = 1.5


# Verdict, image, legend and the road from above, as before there was a direction of travel.
GOLDEN_HEIGHT_PX = 1229


def travel(yaw_rad, std_rad=1e-4):
    return Travel(yaw_rad, 0.0, np.diag([std_rad, 1e-3]) ** 2, 20, 1.3, 2.0)


def known(yaw_rad, std_rad=1e-4, **changes):
    return replace(ACCEPTED, pattern=None, travel=travel(yaw_rad, std_rad), **changes)


def scene(yaw_deg, pitch_deg, roll_deg):
    """A lane of two solid lines on a road without texture, so that its paint can be measured in the image."""
    pose = replace(POSE, pitch_rad=math.radians(pitch_deg), roll_rad=math.radians(roll_deg))
    road = Road(texture_amplitude=0.0)
    made = replace(SCENE.scene, rig=RIG, road=road, extrinsics=pose, lane_yaw_rad=math.radians(yaw_deg))
    return made.with_noise(0.0)


def where_paint_meets(image):
    """Return where two painted lines meet (2,) [px]: the middle of the paint of each row, in both halves."""
    lines = []
    for half in (slice(0, RIG.width // 2), slice(RIG.width // 2, RIG.width)):
        rows, columns = [], []
        for row in np.arange(280, 420):
            part = image[row, half].astype(float)
            ink = np.clip(part - np.median(part) - 8.0, 0.0, None)
            if ink.max() > 40.0 and ink[:2].max() == ink[-2:].max() == 0.0:  # all of the line is in view
                rows.append(row)
                columns.append(half.start + (ink * np.arange(part.size)).sum() / ink.sum())
        assert len(rows) > 30
        lines.append(np.polyfit(rows, columns, 1))
    (slope_a, at_a), (slope_b, at_b) = lines
    row = (at_b - at_a) / (slope_a - slope_b)
    return np.array([slope_a * row + at_a, row])


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "roll_deg"), [(1.5, 3.0, 0.8), (-2.0, 2.0, -1.5), (0.0, 5.0, 0.0)]
)
def test_the_car_drives_to_where_the_rendered_lines_meet(yaw_deg, pitch_deg, roll_deg):
    """The direction of its lane is that of travel there. The paint is measured in the image."""
    made = scene(yaw_deg, pitch_deg, roll_deg)
    left, _ = render(made, np.random.default_rng(0))
    meets = where_paint_meets(left)
    pose, yaw_rad = made.extrinsics, math.radians(yaw_deg)
    assert np.abs(vanishing_point(RIG, pose, road_heading(yaw_rad)) - meets).max() < 1.0
    # The dot is there, and not where a yaw of the other sign would put it.
    dot = blue_dot(draw_camera_view(BLACK, RIG, known(yaw_rad, extrinsics=pose), SCALE))
    assert np.abs(dot - meets).max() < 1.0
    if yaw_deg:
        mirrored = vanishing_point(RIG, pose, road_heading(-yaw_rad))
        assert np.abs(dot - mirrored).max() > 20.0


def blue_dot(view):
    """Return the middle of the dot [px] of the camera image: blue, in the widest rows of what is not text."""
    blue = (view == BLUE).all(axis=2)
    widest = np.array([runs(row) for row in blue])
    rows = np.flatnonzero(widest == widest.max())
    columns = [np.flatnonzero(blue[row]).mean() for row in rows]
    return (np.array([np.mean(columns), rows.mean()]) + 0.5) / SCALE - 0.5


def runs(row):
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(int)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def test_the_line_lies_in_the_middle_of_the_lane_that_the_car_follows():
    """From under the middle of the baseline, along the lane: as far from its middle as the scene has it."""
    made = scene(1.5, 3.0, 0.8)
    view = draw_camera_view(BLACK, RIG, known(math.radians(1.5), extrinsics=made.extrinsics), SCALE)
    matrix = image_from_road(RIG, made.extrinsics, "left")
    for x_m in (6.0, 9.0, 14.0):
        column, row = apply_homography(matrix, [x_m, -math.tan(math.radians(1.5)) * x_m])
        v = round((row + 0.5) * SCALE - 0.5)
        blue = np.flatnonzero((view[v] == BLUE).all(axis=1))
        assert (blue.mean() + 0.5) / SCALE - 0.5 == pytest.approx(column, abs=0.5)


UNKNOWN = [None, travel(0.01, 1.01 * MOUNT_YAW_STD_RAD), travel(0.01, math.inf)]


@pytest.mark.parametrize("unknown", UNKNOWN)
def test_nothing_is_drawn_while_the_yaw_is_unknown(unknown):
    """Then a picture is, to the last pixel, that of a result without travel."""
    result = replace(ACCEPTED, travel=unknown)
    assert shown_travel(result) is None
    verdict = verdict_of(ACCEPTED)
    for draw in (
        lambda each: draw_overview(FRAME.left, FRAME.right, RIG, each),
        lambda each: draw_debug_image(FRAME.left, RIG, each, verdict),
        lambda each: draw_fringes(FRAME.left, FRAME.right, RIG, POSE, verdict, shown_travel(each)),
    ):
        np.testing.assert_array_equal(draw(result), draw(replace(ACCEPTED, travel=None)))
        assert has_colour(draw(result), BLUE, 0) == 0
        assert has_colour(draw(replace(result, travel=travel(0.01))), BLUE, 0) > 300


def test_nothing_is_drawn_over_images_of_another_size():
    view = draw_camera_view(np.zeros((240, 320), np.uint8), RIG, known(0.01))
    assert has_colour(view, BLUE, 0) == 0


@pytest.mark.parametrize("std_deg", [0.02, 0.5, 0.9])
def test_the_uncertainty_is_a_fan_where_it_is_wider_than_a_pixel(std_deg):
    """A standard deviation to either side, below the horizon."""
    std_rad = math.radians(std_deg)
    bare, fan = (draw_camera_view(BLACK, RIG, known(0.01, each), SCALE) for each in (1e-9, std_rad))
    row = 400
    tinted = np.flatnonzero((fan[row] != bare[row]).any(axis=1))
    if std_deg < 0.1:  # narrower than a pixel
        assert tinted.size == 0
        return
    matrix = image_from_road(RIG, POSE, "left")
    road_row = (row + 0.5) / SCALE - 0.5
    edges = []
    for yaw_rad in (0.01 - std_rad, 0.01 + std_rad):
        ends = [matrix @ [x, -math.tan(yaw_rad) * x, 1.0] for x in (2.0, 1e9)]
        (u0, v0), (u1, v1) = (end[:2] / end[2] for end in ends)
        edges.append(((u0 + (u1 - u0) * (road_row - v0) / (v1 - v0)) + 0.5) * SCALE - 0.5)
    assert [tinted.min(), tinted.max()] == pytest.approx(sorted(edges), abs=1.5)


@pytest.mark.parametrize(("width", "height"), [(320, 240), (640, 480), (1226, 370), (1920, 1080)])
@pytest.mark.parametrize("yaw_deg", [-25.0, -2.0, 0.5, 6.0])
@pytest.mark.parametrize("pitch_deg", [-15.0, 3.0, 20.0])
def test_no_label_is_cut_off_or_hidden(monkeypatch, width, height, yaw_deg, pitch_deg):
    """Each text has its place in the picture, and none lies over another one."""
    rig = replace_size(width, height)
    image = np.full((height, width), 90, np.uint8)
    boxes = written_boxes(monkeypatch)
    pose = replace(POSE, pitch_rad=math.radians(pitch_deg))
    result = known(math.radians(yaw_deg), 0.005, extrinsics=pose)
    for draw in (
        lambda: draw_camera_view(image, rig, result, max(1.0, 960 / width)),
        lambda: draw_birds_eye(image, image, rig, pose, 960, result.travel),
    ):
        picture = draw()
        texts = dict(boxes)
        boxes.clear()
        for text, (left, top, right, bottom) in texts.items():
            assert left >= 0 and top >= 0, text
            assert right <= picture.shape[1] and bottom <= picture.shape[0], text
        label = label_of(result.travel)
        if label not in texts:  # the point lies behind the camera, or far outside
            continue
        others = [box for text, box in texts.items() if text != label]
        assert not any(overlap(texts[label], box) for box in others)


def overlap(a, b):
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def written_boxes(monkeypatch):
    """Note where each text is written: left, top, right, bottom [px]."""
    boxes = []
    put = cv2.putText

    def noted(pixels, text, place, font, scale, colour, thickness, kind):
        (width, height), below = cv2.getTextSize(text, font, scale, thickness)
        boxes.append((text, (place[0], place[1] - height, place[0] + width, place[1] + below)))
        return put(pixels, text, place, font, scale, colour, thickness, kind)

    monkeypatch.setattr(canvas.cv2, "putText", noted)
    return boxes


def test_the_line_from_above_leads_along_the_lane():
    """To the right of the camera's heading where that points left; at its place in metres."""
    yaw_rad = math.radians(2.0)
    bare, view = (
        draw_birds_eye(FRAME.left, FRAME.right, RIG, POSE, 960, each) for each in (None, travel(yaw_rad))
    )
    assert bare.shape == view.shape
    near_m = near_edge_m(RIG, POSE)
    across = view.shape[0] / (2 * BIRDS_EYE_HALF_WIDTH_M)
    for column in (100, 300, 500):
        x_m = near_m + column * (BIRDS_EYE_FAR_M - near_m) / 960
        row = across * (BIRDS_EYE_HALF_WIDTH_M + math.tan(yaw_rad) * x_m)
        blue = np.flatnonzero((view[:, column] == BLUE).all(axis=1))
        assert blue.mean() == pytest.approx(row, abs=1.0)


def test_pictures_with_it_have_the_size_of_those_without():
    plain, told = (
        draw_overview(FRAME.left, FRAME.right, RIG, replace(ACCEPTED, travel=each))
        for each in (None, travel(0.01))
    )
    assert plain.shape == told.shape == (GOLDEN_HEIGHT_PX, 960, 3)


def test_a_refused_drive_that_knows_its_yaw_shows_it_over_its_last_pose():
    refused = rejected(REJECTION, stages={"genetic": POSE}, travel=travel(0.01))
    assert has_colour(draw_overview(FRAME.left, FRAME.right, RIG, refused), BLUE, 0) > 300
    assert has_colour(draw_overview(FRAME.left, FRAME.right, RIG, replace(refused, stages={})), BLUE, 0) == 0
