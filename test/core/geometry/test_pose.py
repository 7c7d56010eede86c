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

"""Signs and axes of a pose: the one place where they are defined, checked in words and against Rodrigues."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from independent_camera import OPTICAL_FROM_BODY, turn

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.geometry.pose import BODY_FROM_OPTICAL, road_from_camera_rotation

angles = st.floats(-math.pi, math.pi)
# Products of a dozen numbers up to 1 in double precision.
ROUNDING = 1e-14


@given(pitch=angles, roll=angles, yaw=angles)
def test_rotation_is_the_product_of_turns_about_z_y_x(pitch, roll, yaw):
    expected = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
    np.testing.assert_allclose(road_from_camera_rotation(pitch, roll, yaw), expected, atol=ROUNDING)


def test_positive_pitch_is_nose_down():
    forward = road_from_camera_rotation(0.1, 0.0) @ [1, 0, 0]
    assert forward[2] < 0


def test_positive_roll_is_right_side_down():
    right = road_from_camera_rotation(0.0, 0.1) @ [0, -1, 0]
    assert right[2] < 0


def test_positive_yaw_points_left():
    forward = road_from_camera_rotation(0.0, 0.0, 0.1) @ [1, 0, 0]
    assert forward[1] > 0


def test_body_from_optical_is_a_proper_rotation():
    np.testing.assert_array_equal(BODY_FROM_OPTICAL @ BODY_FROM_OPTICAL.T, np.eye(3))
    assert np.linalg.det(BODY_FROM_OPTICAL) == pytest.approx(1.0)
    np.testing.assert_array_equal(BODY_FROM_OPTICAL, OPTICAL_FROM_BODY.T)


@pytest.mark.parametrize(
    ("optical", "body"), [((1, 0, 0), (0, -1, 0)), ((0, 1, 0), (0, 0, -1)), ((0, 0, 1), (1, 0, 0))]
)
def test_right_down_forward_in_body_axes(optical, body):
    np.testing.assert_array_equal(BODY_FROM_OPTICAL @ optical, body)


def test_the_paper_has_the_opposite_pitch_and_the_same_roll():
    pose = Extrinsics.from_paper(1.4, 0.05, 0.01)
    assert pose == Extrinsics(1.4, -0.05, 0.01)
    assert pose.to_paper() == (1.4, 0.05, 0.01)


def test_array_there_and_back():
    pose = Extrinsics(1.4, 0.05, -0.01)
    np.testing.assert_array_equal(pose.as_array(), [1.4, 0.05, -0.01])
    assert Extrinsics.from_array(pose.as_array()) == pose
    assert type(Extrinsics.from_array(np.float32([1, 2, 3])).height_m) is float


@pytest.mark.parametrize("values", [[1.0, 2.0], [1.0, 2.0, 3.0, 4.0]])
def test_array_of_another_length_is_refused(values):
    with pytest.raises(ValueError, match="array of shape"):
        Extrinsics.from_array(values)


def test_describe_speaks_metres_and_degrees():
    pose = Extrinsics(1.4, math.radians(3), math.radians(-0.8))
    assert pose.describe() == "height 1.4000 m, pitch +3.000 deg, roll -0.800 deg"


def test_describe_with_standard_deviations_speaks_metres_millimetres_and_degrees():
    pose = Extrinsics(1.4, math.radians(3), math.radians(-0.8))
    std = Extrinsics(0.0012, math.radians(0.005), math.radians(0.05))
    assert pose.describe(std) == (
        "height 1.4000 m (std 1.2 mm), pitch +3.0000 deg (std 0.0050), roll -0.8000 deg (std 0.0500)"
    )
