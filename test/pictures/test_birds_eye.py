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

"""The bird's-eye view: metric, and without fringes only for the right pose."""

import math
from dataclasses import replace

import numpy as np
import pytest
from picture_making import FRAME, POSE, RIG, SCENE

from stereo_selfcal.pictures import birds_eye
from stereo_selfcal.pictures.birds_eye import BIRDS_EYE_FAR_M, BIRDS_EYE_HALF_WIDTH_M, draw_birds_eye
from stereo_selfcal.pictures.road_grid import near_edge_m


@pytest.fixture
def no_grid(monkeypatch):
    monkeypatch.setattr(birds_eye, "_blend_line", lambda canvas, points: None)


def fringes(pose):
    """Share of pixels on which the two cameras differ clearly in the bird's-eye view."""
    view = draw_birds_eye(FRAME.left, FRAME.right, RIG, pose).astype(int)
    inside = (view > 0).all(axis=2)
    return (np.abs(view[:, :, 2] - view[:, :, 0])[inside] > 40).mean()


def test_birds_eye_agrees_only_for_the_right_pose(no_grid):
    best = fringes(POSE)
    assert best < 0.003
    assert fringes(replace(POSE, pitch_rad=POSE.pitch_rad + math.radians(1.0))) > 3 * best
    assert fringes(replace(POSE, height_m=POSE.height_m * 1.1)) > 3 * best
    assert fringes(replace(POSE, roll_rad=POSE.roll_rad + math.radians(3.0))) > 3 * best


def test_birds_eye_is_metric():
    """A solid line at a known place of the road lies on its row, forward is right, left is up."""
    view = draw_birds_eye(FRAME.left, FRAME.right, RIG, POSE)
    across = view.shape[0] / (2 * BIRDS_EYE_HALF_WIDTH_M)
    scene = SCENE.scene
    for column in (200, 400):
        x_m = near_edge_m(RIG, POSE)
        x_m += column * (BIRDS_EYE_FAR_M - x_m) / view.shape[1]
        y_m = -1.75 - scene.lateral_offset_m - math.tan(scene.lane_yaw_rad) * x_m
        row = across * (BIRDS_EYE_HALF_WIDTH_M - y_m)
        lower = view[220:390, column].mean(axis=1)
        assert 220 + lower.argmax() == pytest.approx(row, abs=0.08 * across)


def test_brightness_of_the_cameras_does_not_tint_the_road(no_grid):
    darker = (FRAME.right * 0.6).astype(np.uint8)
    view = draw_birds_eye(FRAME.left, darker, RIG, POSE).astype(float)
    inside = (view > 0).all(axis=2)
    assert view[:, :, 2][inside].mean() == pytest.approx(view[:, :, 0][inside].mean(), rel=0.02)


def test_fringes_are_orange_and_blue(no_grid):
    """Not red and green, which most of those who are colour-blind cannot tell apart."""
    left, right = np.full((480, 640), 60, np.uint8), np.full((480, 640), 60, np.uint8)
    left[:, :280] = right[:, 360:] = 200  # left of the road only the left camera sees something bright
    view = draw_birds_eye(left, right, RIG, POSE)[40:, 500:].astype(int)
    blue, green, red = view[:150].reshape(-1, 3).mean(axis=0)
    assert red > green + 10 > blue + 20
    blue, green, red = view[-150:-40].reshape(-1, 3).mean(axis=0)
    assert blue > green + 10 > red + 20
