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

"""The published messages: rotation and covariance against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rcl_interfaces.msg import ParameterType

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.geometry.pose import road_from_camera_rotation
from stereo_selfcal.core.geometry.vehicle import RigidTransform
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.ros.messages import extrinsics_message, pose_message, quaternion_message, time_message

RIG = StereoRig(640, 480, 516.6, 500.3, 310.5, 250.25, 0.1481)
COVARIANCE = np.array([[4.0, 0.1, 0.2], [0.1, 5.0, 0.3], [0.2, 0.3, 6.0]])
angles = st.floats(-1.0, 1.0)


def rotation(q):
    """Return the matrix of a unit quaternion (Hamilton convention, as ROS uses it)."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("stamp_ns", [0, 5, -1, -(2**31) * 10**9, 2**31 * 10**9 - 1])
def test_stamp_is_kept_to_the_nanosecond(stamp_ns):
    message = time_message(stamp_ns)
    assert message.sec * 10**9 + message.nanosec == stamp_ns


def test_stamp_beyond_the_last_second_is_no_error():
    message = time_message((2**31 - 1) * 10**9 + 2**32 - 1)
    assert (message.sec, message.nanosec) == (2**31 - 1, 10**9 - 1)


def turned(pitch, roll):
    return RigidTransform(road_from_camera_rotation(pitch, roll), np.zeros(3))


@given(angles, angles)
def test_quaternion_is_the_rotation_of_the_contract(pitch, roll):
    q = quaternion_message(turned(pitch, roll))
    assert math.isclose(q.x**2 + q.y**2 + q.z**2 + q.w**2, 1.0)
    assert q.w > 0
    np.testing.assert_allclose(rotation(q), road_from_camera_rotation(pitch, roll), atol=1e-12)


def test_nose_down_is_positive_pitch_about_left():
    q = quaternion_message(turned(0.1, 0.0))
    forward = rotation(q) @ [1, 0, 0]
    assert forward[2] < 0 < q.y


def test_pose():
    result = CalibrationResult("good", extrinsics=Extrinsics(1.25, 0.1, -0.02), covariance=COVARIANCE)
    placed = place_camera(result, RIG, FrameNames(), InfoFrames())
    pose = pose_message(placed, 1_700_000_000_000_000_001)
    assert pose.header.frame_id == "road"
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == (1_700_000_000, 1)
    position = pose.pose.pose.position
    assert (position.x, position.y, position.z) == (0.0, 0.0, 1.25)
    matrix = np.array(pose.pose.covariance).reshape(6, 6)
    z, rot_x, rot_y = 2, 3, 4
    expected = np.zeros((6, 6))
    # The roll turns about the axis that the pitch has turned down; the road's frame turns with the camera.
    c = math.cos(0.1)
    expected[z, z], expected[rot_y, rot_y], expected[rot_x, rot_x] = 4.0, 5.0, 6.0 * c**2
    expected[z, rot_y] = expected[rot_y, z] = 0.1
    expected[z, rot_x] = expected[rot_x, z] = 0.2 * c
    expected[rot_x, rot_y] = expected[rot_y, rot_x] = 0.3 * c
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-12)


def test_extrinsics_event_holds_every_parameter_with_its_type():
    event = extrinsics_message(
        "/stereo_selfcal", 5, {"extrinsics.height_m": 1.0, "extrinsics.pitch_rad": 0.1}
    )
    assert event.node == "/stereo_selfcal"
    assert event.stamp.nanosec == 5
    assert {p.name: p.value.double_value for p in event.changed_parameters} == {
        "extrinsics.height_m": 1.0,
        "extrinsics.pitch_rad": 0.1,
    }
    assert all(p.value.type == ParameterType.PARAMETER_DOUBLE for p in event.changed_parameters)
