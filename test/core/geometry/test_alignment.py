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

"""How the right camera is turned, against turns of its body about single axes, projected by OpenCV."""

import math

import numpy as np
import pytest
from independent_camera import seen_turned

from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.synth.scenes import PAPER_RIG

RIG = PAPER_RIG
MATRIX = np.array([[RIG.fx, 0.0, RIG.cx], [0.0, RIG.fy, RIG.cy], [0.0, 0.0, 1.0]])
# Around the principal point, by a tenth of the focal length to the side and down.
POINTS = np.array(
    [[RIG.cx + 0.1 * RIG.fx * i, RIG.cy + 0.1 * RIG.fy * j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
)
MIDDLE = 4


def moved(**angles_rad):
    return seen_turned(RIG, POINTS, **angles_rad) - POINTS


def aligned(pitch=0.0, roll=0.0, yaw=0.0, std=(0.001, 0.002, 0.003)):
    return Alignment(pitch, roll, yaw, np.diag(np.square(std)))


def test_the_test_turns_as_the_convention_says():
    """Nose down: content moves up. Right side down: what is to the right moves up. To the left: right."""
    assert moved(pitch_rad=0.01)[MIDDLE] == pytest.approx([0.0, -0.01 * RIG.fy], rel=1e-3, abs=1e-6)
    assert moved(yaw_rad=0.01)[MIDDLE] == pytest.approx([0.01 * RIG.fx, 0.0], rel=1e-3, abs=1e-6)
    to_the_right, below = moved(roll_rad=0.01)[[7, 5]]
    assert to_the_right == pytest.approx([0.0, -0.001 * RIG.fy], abs=0.01)
    assert below == pytest.approx([0.001 * RIG.fx, 0.0], abs=0.01)


@pytest.mark.parametrize(
    "angles", [(0.02, 0.0, 0.0), (0.0, -0.03, 0.0), (0.0, 0.0, 0.01), (0.01, 0.03, -0.02)]
)
def test_rotation_leads_from_the_right_camera_to_the_left_one(angles):
    pitch, roll, yaw = angles
    seen = seen_turned(RIG, POINTS, pitch_rad=pitch, roll_rad=roll, yaw_rad=yaw)
    rays = np.linalg.inv(MATRIX) @ np.column_stack([seen, np.ones(len(seen))]).T
    straight = MATRIX @ aligned(*angles).left_from_right @ rays
    np.testing.assert_allclose((straight[:2] / straight[2]).T, POINTS, atol=1e-6)


def test_content_moves_to_first_order_as_the_documentation_says():
    pitch, roll, yaw = 1e-4, -2e-4, 1.5e-4
    x, y = ((POINTS - [RIG.cx, RIG.cy]) / [RIG.fx, RIG.fy]).T
    dx = yaw * (1 + x * x) + roll * y - pitch * x * y
    dy = -roll * x - pitch * (1 + y * y) + yaw * x * y
    found = moved(pitch_rad=pitch, roll_rad=roll, yaw_rad=yaw)
    np.testing.assert_allclose(found, np.column_stack([RIG.fx * dx, RIG.fy * dy]), atol=1e-4)


def test_it_is_told_in_degrees_with_what_is_not_known():
    told = aligned(math.radians(0.05), math.radians(-0.3), math.radians(0.2), np.radians([0.01, 0.02, 0.3]))
    assert told.describe() == (
        "pitch +0.050 deg (std 0.010), roll -0.300 deg (std 0.020), yaw +0.200 deg (std 0.300)"
    )
    np.testing.assert_allclose(told.std, np.radians([0.01, 0.02, 0.3]))
