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

"""The node publishes and exports the CameraInfo of the pair, and takes it: corrected, and as it was."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from independent_camera import OPTICAL_FROM_BODY, turn
from independent_lens import raw_image
from node_in_process import NodeInProcess
from ros_graph import NAME, RIG, image_message, info_message, rendered, stamp_of

from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.camera_info_repair import repaired_pairs
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.files.camera_info_file import read_camera_info_file
from stereo_selfcal.ros import calibration_keeper
from stereo_selfcal.ros.messages import camera_info_message

PITCH, ROLL, YAW = np.radians([0.1, 0.2, 0.1])
TURNED = Alignment(PITCH, ROLL, YAW, np.diag(np.radians([0.005, 0.01, 0.01]) ** 2))
TOPICS = [f"{NAME}/{side}/camera_info" for side in SIDES]


def turned_back():
    """Return the rotation from the turned right camera to the left one, by turns about single axes."""
    body = turn("z", YAW) @ turn("y", PITCH) @ turn("x", ROLL)
    return OPTICAL_FROM_BODY @ body @ OPTICAL_FROM_BODY.T


@pytest.fixture
def measured(monkeypatch):
    """Let the node publish as if that alignment had been measured."""
    monkeypatch.setattr(
        calibration_keeper, "repaired_pairs", lambda cameras, _: repaired_pairs(cameras, TURNED)
    )


@pytest.fixture
def start():
    nodes = []

    def start(**parameters):
        nodes.append(NodeInProcess(timeout_s=60.0, **parameters).__enter__())
        return nodes[-1]

    yield start
    for node in nodes:
        node.check()
        node.__exit__()


def frame(images, number=0):
    messages = []
    for side, image in zip(SIDES, images, strict=True):
        message = image_message(image)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_of(number), 10**9)
        messages.append((f"/{side}/image_rect", message))
    return messages


def infos(rig=RIG):
    return [(f"/{side}/camera_info", info_message(side, rig)) for side in SIDES]


def published(node):
    """Return the newest message on each topic of CameraInfo."""
    return [next((m for t, m in reversed(node.sent) if t == topic), None) for topic in TOPICS]


def test_by_default_no_camera_info_is_published(start):
    node = start()
    assert not {publisher.topic_name for publisher in node.node.publishers} & set(TOPICS)
    assert node.calibrate([*infos(), *frame(rendered())]).success


def test_corrected_camera_info_is_published_and_taken(start, measured):
    node = start(publish_camera_info=True)
    assert published(node) == [None, None]
    given = infos()
    for side, (_, message) in zip(SIDES, given, strict=True):
        message.header.frame_id = f"{side}_optical"
    assert node.calibrate([*given, *frame(rendered())]).success
    left, right = published(node)
    stamp = left.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == stamp_of(0)
    assert (left.header.frame_id, right.header.frame_id) == ("left_optical", "right_optical")
    assert (right.width, right.height) == (RIG.width, RIG.height)
    np.testing.assert_allclose(right.r.reshape(3, 3), turned_back(), atol=1e-12)
    np.testing.assert_array_equal(left.r.reshape(3, 3), np.eye(3))
    np.testing.assert_array_equal(right.k.reshape(3, 3), right.p.reshape(3, 4)[:, :3])
    assert not any(right.d)
    expected = node.node.get_parameter("extrinsics.pitch_rad").value

    info = PlainCameraInfo.of_rig(RIG)[1].rectified(turned_back())
    left_image, right_image = rendered(index=1)
    images = frame((left_image, raw_image(info, right_image)), 10)
    answer = node.calibrate([("/left/camera_info", left), ("/right/camera_info", right), *images])
    assert answer.success, answer.message
    found = node.node.get_parameter("extrinsics.pitch_rad").value
    assert found == pytest.approx(expected, abs=np.radians(0.02))
    source = node.selfcal._reporter.snapshot().camera_info.source
    assert source == "CameraInfo, R turns the right images by 0.245 deg"


def test_without_a_correction_camera_info_is_published_as_it_came(start, monkeypatch):
    monkeypatch.setattr(
        calibration_keeper, "repaired_pairs", lambda cameras, _: repaired_pairs(cameras, None)
    )
    node = start(publish_camera_info=True)
    given = infos()
    for _, message in given:  # that of the raw camera, as image_proc sends it along
        message.d = [-0.2, 0.05, 0.001, -0.001, 0.0]
    assert node.calibrate([*given, *frame(rendered())]).success
    for message, (_, original) in zip(published(node), given, strict=True):
        for name in ("d", "k", "r", "p"):
            np.testing.assert_array_equal(getattr(message, name), getattr(original, name))


def test_a_calibration_that_is_taken_back_leaves_uncalibrated_camera_info(start, measured):
    node = start(publish_camera_info=True)
    assert node.calibrate([*infos(), *frame(rendered())]).success
    node.selfcal._outputs.withdraw()
    for message in published(node):
        assert not message.k.any() and not message.p.any()


def test_camera_info_is_exported_beside_the_result(start, measured, tmp_path):
    node = start(output_path=str(tmp_path / "out.yaml"), exports="camera_info")
    answer = node.calibrate([*infos(), *frame(rendered())])
    assert answer.success and answer.message.endswith("and exported as camera_info")
    right = read_camera_info_file(tmp_path / "out.right.yaml")
    np.testing.assert_allclose(right.rotation, turned_back(), atol=1e-12)
    original = read_camera_info_file(tmp_path / "out.right_original.yaml")
    np.testing.assert_array_equal(original.rotation, np.eye(3))


def test_a_message_keeps_every_field():
    left, _ = PlainCameraInfo.of_rig(RIG)
    message = camera_info_message(left, 5)
    again = PlainCameraInfo.of(message)
    for name in ("width", "height", "distortion_model", "binning_x", "binning_y", "roi", "frame_id"):
        assert getattr(again, name) == getattr(left, name)
    for name in ("d", "k", "r", "p"):
        np.testing.assert_array_equal(getattr(again, name), getattr(left, name))
