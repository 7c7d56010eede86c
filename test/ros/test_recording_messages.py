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

"""Messages that are written without ROS are, read by ROS, those that the node makes of the same values."""

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo
from visualization_msgs.msg import MarkerArray

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.published.markers import result_markers
from stereo_selfcal.published.status import StatusLevel, StatusReport
from stereo_selfcal.published.transforms import camera_transforms
from stereo_selfcal.recording import messages, topics
from stereo_selfcal.ros.markers import markers_message
from stereo_selfcal.ros.messages import (
    camera_info_message,
    extrinsics_message,
    pose_message,
    transform_messages,
)

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))
LANES = (np.array([[5.0, 1.75], [30.0, 1.7]]),)
STAMP_NS = 1_700_000_000_123_456_789
PLACED = place_camera(
    CalibrationResult(
        "calibrated",
        extrinsics=POSE,
        covariance=np.eye(3) * 1e-6,
        n_frames=4,
        travel=Travel(0.02, 0.05, np.eye(2) * 1e-6, 50, 1.3, 30.0),
    ),
    RIG,
    FrameNames(),
    InfoFrames("left", "right"),
)


def read(message, topic, kind):
    """Return a message of rosbags as rclpy reads its bytes."""
    return deserialize_message(bytes(messages.serialize(message, topic.kind)), kind)


def test_markers():
    shapes = result_markers(POSE, LANES, PLACED.camera)
    written = messages.markers_message(shapes, PLACED.parent, STAMP_NS)
    expected = markers_message(POSE, LANES, PLACED.parent, STAMP_NS, PLACED.camera)
    assert read(written, topics.MARKERS, MarkerArray) == read_again(expected)


def read_again(message):
    """Return a message as it is after it was sent: colours have 32 bits."""
    return deserialize_message(serialize_message(message), type(message))


def test_transforms_and_pose():
    written = messages.transforms_message(camera_transforms(PLACED), STAMP_NS)
    kind = "geometry_msgs/msg/TransformStamped"
    found = [
        deserialize_message(bytes(messages.serialize(each, kind)), TransformStamped)
        for each in written.transforms
    ]
    assert len(found) == 2 and found == transform_messages(PLACED, STAMP_NS)
    camera = PLACED.camera
    written = messages.pose_message(camera.transform, camera.covariance, PLACED.parent, STAMP_NS)
    found = read(written, topics.POSE, PoseWithCovarianceStamped)
    expected = read_again(pose_message(PLACED, STAMP_NS))
    assert (found.header, found.pose.pose) == (expected.header, expected.pose.pose)
    np.testing.assert_array_equal(found.pose.covariance, expected.pose.covariance)


def test_parameters():
    values = {"text": "x", "number": 1.5, "count": 3, "yes": True, "list": [1.0, 2.0], "names": ["x"]}
    written = messages.parameters_message("/stereo_selfcal", values, STAMP_NS)
    found = read(written, topics.EXTRINSICS, ParameterEvent)
    assert found == read_again(extrinsics_message("/stereo_selfcal", STAMP_NS, values))


def test_camera_info():
    info = PlainCameraInfo.of_rig(RIG)[1]
    found = read(messages.camera_info_message(info, "right", STAMP_NS), topics.RIGHT_INFO, CameraInfo)
    expected = camera_info_message(info, STAMP_NS)
    assert found.header.stamp == expected.header.stamp and found.header.frame_id == "right"
    for name in ("width", "height", "distortion_model", "binning_x", "roi"):
        assert getattr(found, name) == getattr(expected, name)
    for name in "dkrp":
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_diagnostics():
    report = StatusReport(StatusLevel.ERROR, "/x: frame", "why", {"height_m": "1.4"})
    written = messages.diagnostics_message([report], "camera", STAMP_NS)
    found = read(written, topics.DIAGNOSTICS, DiagnosticArray)
    (status,) = found.status
    assert (status.level, status.name, status.message) == (b"\2", "/x: frame", "why")
    assert (status.hardware_id, status.values[0].key, status.values[0].value) == ("camera", "height_m", "1.4")
