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

"""Turned right cameras are turned as the interface defines it: checked against points projected here."""

import numpy as np
import pytest

from benchmarks.rig_errors.angles import AS_IT_IS, Angles, turned_on
from benchmarks.rig_errors.drawn import BOTH, NONE, ONE, Road
from benchmarks.rig_errors.warp import old_from_new, turned
from stereo_selfcal import StereoRig

RIG = StereoRig(640, 480, 516.6, 520.0, 310.2, 236.7, 0.1481)
TURN = Angles(pitch_deg=0.05, roll_deg=-0.3, yaw_deg=0.2)
ONE_BY_ONE = (Angles(pitch_deg=0.1), Angles(roll_deg=0.1), Angles(yaw_deg=0.1), TURN)


def content_moves_by(rig, turn, column, row):
    """Return how far content moves, by the first-order formulas of the issue (x right, y down)."""
    pitch, roll, yaw = np.radians([turn.pitch_deg, turn.roll_deg, turn.yaw_deg])
    x, y = (column - rig.cx) / rig.fx, (row - rig.cy) / rig.fy
    dx = yaw * (1 + x * x) + roll * y - pitch * x * y
    dy = -roll * x - pitch * (1 + y * y) + yaw * x * y
    return rig.fx * dx, rig.fy * dy


def place_in(rig, turn, column, row):
    """Return where the turned camera sees a far point: its body's axes are R_z(yaw) R_y(pitch) R_x(roll)."""
    pitch, roll, yaw = np.radians([turn.pitch_deg, turn.roll_deg, turn.yaw_deg])
    ahead, left, up = 1.0, -(column - rig.cx) / rig.fx, -(row - rig.cy) / rig.fy
    # Undone one by one: the head turned back to the right, the nose up, the right side up.
    ahead, left = ahead * np.cos(yaw) + left * np.sin(yaw), left * np.cos(yaw) - ahead * np.sin(yaw)
    ahead, up = ahead * np.cos(pitch) - up * np.sin(pitch), up * np.cos(pitch) + ahead * np.sin(pitch)
    left, up = left * np.cos(roll) + up * np.sin(roll), up * np.cos(roll) - left * np.sin(roll)
    return rig.cx - rig.fx * left / ahead, rig.cy - rig.fy * up / ahead


@pytest.mark.parametrize("turn", ONE_BY_ONE, ids=lambda turn: turn.name)
def test_content_moves_as_the_interface_says(turn):
    columns, rows = np.array([5.0, 320.0, 600.0, 50.0]), np.array([470.0, 240.0, 30.0, 100.0])
    seen = np.linalg.inv(old_from_new(RIG, turn)) @ np.stack([columns, rows, np.ones(4)])
    moved = seen[:2] / seen[2] - [columns, rows]
    # What the first order leaves out: the square of 0.3 deg is 0.01 px.
    np.testing.assert_allclose(moved, content_moves_by(RIG, turn, columns, rows), atol=0.03)


def test_spots_are_where_they_should_be_to_two_hundredths_of_a_pixel():
    rows, columns = np.mgrid[: RIG.height, : RIG.width]
    middles = np.array([(80.0, 420.0), (320.0, 240.0), (560.0, 90.0)])
    spots = sum(np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 3.0**2)) for u, v in middles)
    image = turned(np.rint(200 * spots).astype(np.uint8), RIG, TURN).astype(float)
    for u, v in middles:
        near = np.hypot(columns - u, rows - v) < 20
        found = [np.average(places[near], weights=image[near]) for places in (columns, rows)]
        # Grey levels are whole: the faint rims of a spot are lost.
        np.testing.assert_allclose(found, place_in(RIG, TURN, u, v), atol=0.02)


def test_no_turn_changes_nothing():
    image = np.random.default_rng(1).integers(0, 256, (RIG.height, RIG.width)).astype(np.uint8)
    np.testing.assert_array_equal(turned(image, RIG, AS_IT_IS), image)


def test_turns_add_up():
    np.testing.assert_allclose(turned_on(np.array([0.01, 0.2, -0.1]), TURN), [0.06, -0.1, 0.1], atol=1e-3)


@pytest.mark.slow
def test_rendered_turn_is_the_warped_one():
    road = Road("zed", True, BOTH, seed=1, index=0)
    straight, rendered = road.pair(), road.pair(TURN)
    warped = turned(straight.right, straight.rig, TURN)
    inner = (slice(8, -8), slice(8, -8))
    off = [np.std(image[inner].astype(float) - rendered.right[inner]) for image in (warped, straight.right)]
    assert off[0] < 0.4 * off[1]
    np.testing.assert_array_equal(rendered.left, straight.left)
    np.testing.assert_array_equal(rendered.low, straight.low)


def test_paint_is_out_on_one_side_or_on_both():
    counts = {
        paint: len(Road("paper", False, paint, seed=1, index=1).world.scene.stripes)
        for paint in (BOTH, ONE, NONE)
    }
    assert counts[NONE] == 0 < counts[ONE] < counts[BOTH]


def test_paint_meets_at_the_angle_that_is_drawn():
    slopes = [
        [stripe.slope for stripe in Road("zed", False, BOTH, 1, index, 5e-3).world.scene.stripes[-2:]]
        for index in range(40)
    ]
    assert np.std(np.diff(slopes)) == pytest.approx(5e-3, rel=0.35)
