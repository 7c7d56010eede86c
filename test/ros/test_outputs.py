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

"""Markers and /tf_static: where the geometry says, in the direction the frames say."""

import math
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
import ros_graph
from independent_camera import ideal_pattern, turn
from rclpy.parameter import Parameter
from tf2_stand_in import StandInTf2
from visualization_msgs.msg import Marker

from stereo_selfcal import CalibrationResult, ConfigError, Extrinsics
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.published.markers import lanes_on_road
from stereo_selfcal.ros.markers import markers_message
from stereo_selfcal.ros.messages import image_message, transform_messages
from stereo_selfcal.ros.outputs import Publication
from stereo_selfcal.ros.selfcal import SelfcalNode

POSE = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))
RESULT = CalibrationResult("good", extrinsics=POSE, covariance=np.eye(3) * 1e-6, n_frames=1)
LANES = (np.array([[5.0, 1.75], [30.0, 1.7]]), np.array([[5.0, -1.75], [30.0, -1.8]]))
STAMP_NS = 1_700_000_000_000_000_001


def rotated(q, vector):
    """Rotate by a quaternion with the sandwich product."""
    w, u = q.w, np.array([q.x, q.y, q.z])
    return vector + 2 * np.cross(u, np.cross(u, vector) + w * vector)


def test_lanes_lie_where_the_lines_were_painted():
    pattern = ideal_pattern(ros_graph.RIG, POSE, positions_m=(1.9, -1.6))
    lanes = lanes_on_road(pattern, ros_graph.RIG, POSE)
    for lane, y_m in zip(lanes, (1.9, -1.6), strict=True):
        assert len(lane) > 2
        np.testing.assert_allclose(lane[:, 1], y_m, atol=1e-6)
        assert (np.diff(lane[:, 0]) > 0).all() and lane[0, 0] > 0 and lane[-1, 0] < 60


def test_lanes_of_a_pose_that_sees_no_road_are_empty():
    pattern = ideal_pattern(ros_graph.RIG, POSE)
    lanes = lanes_on_road(pattern, ros_graph.RIG, Extrinsics(1.4, math.radians(-80.0), 0.0))
    assert all(np.isfinite(lane).all() for lane in lanes)
    assert {m.ns for m in markers_message(POSE, lanes, "road", 0).markers} >= {"road", "camera", "lane_lines"}


def test_markers():
    message = markers_message(POSE, LANES, "asphalt", STAMP_NS)
    markers = {(m.ns, m.id): m for m in message.markers if m.action != Marker.DELETE}
    assert len(markers) == 5
    for marker in markers.values():
        assert marker.header.frame_id == "asphalt"
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (1_700_000_000, 1)
        assert marker.action == Marker.ADD and marker.color.a > 0
        assert marker.lifetime.sec == marker.lifetime.nanosec == 0
    road = markers[("road", 0)]
    assert road.pose.position.z + road.scale.z / 2 == pytest.approx(0.0)  # its top is the road
    arrow = markers[("camera", 0)]
    assert arrow.pose.position.z == 1.4
    ahead = rotated(arrow.pose.orientation, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(ahead, [math.cos(POSE.pitch_rad), 0.0, -math.sin(POSE.pitch_rad)], atol=1e-12)
    assert markers[("camera", 1)].text == "1.400 m, pitch +3.00 deg, roll +0.80 deg"
    assert [(p.x, p.y) for p in markers[("lane_lines", 1)].points] == [(5.0, -1.75), (30.0, -1.8)]


def test_lanes_of_an_earlier_result_are_deleted():
    for lanes in ((), (LANES[0][:1], LANES[1][:0])):
        lines = [m for m in markers_message(POSE, lanes, "road", 0).markers if m.ns == "lane_lines"]
        assert [(m.id, m.action) for m in lines] == [(0, Marker.DELETE), (1, Marker.DELETE)]


def placed(names, result=RESULT):
    return place_camera(result, ros_graph.RIG, names, InfoFrames())


def test_transform_takes_camera_points_to_the_road():
    (message,) = transform_messages(placed(FrameNames()), STAMP_NS)
    assert (message.header.frame_id, message.child_frame_id) == ("road", "stereo_camera")
    point = np.array([10.0, 2.0, -1.0])
    expected = turn("y", POSE.pitch_rad) @ turn("x", POSE.roll_rad) @ point + [0, 0, 1.4]
    shift = message.transform.translation
    found = rotated(message.transform.rotation, point) + np.array([shift.x, shift.y, shift.z])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_picture_keeps_its_pixels():
    picture = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    message = image_message(picture, "stereo_camera", STAMP_NS)
    assert (message.height, message.width, message.step, message.encoding) == (2, 3, 9, "bgr8")
    np.testing.assert_array_equal(np.array(message.data).reshape(2, 3, 3), picture)


@pytest.fixture
def start():
    """Start the node in this process, without an executor."""
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    started = []

    def start(**parameters):
        values = {"output_path": "", **parameters}  # without a path nothing is restored
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        started.append(SelfcalNode(parameter_overrides=overrides))
        return started[-1]

    yield start
    for selfcal in started:
        selfcal.stop()
        selfcal.node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def tf2(monkeypatch):
    return StandInTf2(monkeypatch)


def publish(selfcal, result=RESULT):
    config = selfcal._parameters.config
    camera = placed(config.frame_names, result)
    selfcal._outputs.publish_now(Publication(result, config, STAMP_NS, placed=camera))
    return camera


def test_transform_goes_through_tf2(start, tf2):
    selfcal = start(publish_tf=True, road_frame="asphalt", camera_frame="zed")
    tf2.listened(selfcal.node)
    assert tf2.sent == []  # no result, no transform
    camera = publish(selfcal)
    assert tf2.sent == [transform_messages(camera, STAMP_NS)]
    (message,) = tf2.sent[0]
    assert (message.header.frame_id, message.child_frame_id) == ("asphalt", "zed")


def test_transform_waits_until_the_tree_is_known(start, tf2):
    selfcal = start(publish_tf=True)
    camera = publish(selfcal)
    assert tf2.sent == []
    tf2.listened(selfcal.node)
    assert tf2.sent == [transform_messages(camera, STAMP_NS)]


def test_transform_is_off_by_default(start, tf2):
    publish(start())
    assert tf2.made == [] and tf2.listeners == {}


def test_result_that_is_not_finite_goes_nowhere(start, tf2):
    selfcal = start(publish_tf=True)
    broken = CalibrationResult("bad", extrinsics=Extrinsics(math.nan, 0.0, 0.0), covariance=np.eye(3))
    with pytest.raises(Exception, match="not finite"):
        publish(selfcal, broken)
    tf2.listened(selfcal.node)
    assert tf2.sent == []


def test_shutdown_ends_the_waiting_for_a_publication(start):
    """Nobody spins the node any more then."""
    selfcal = start()
    publication = Publication(RESULT, selfcal._parameters.config, STAMP_NS)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(selfcal._outputs.publish, publication)
        ros_graph.wait_until(lambda: selfcal._outputs._request is not None, "the publication")
        selfcal.stop()
        for attempt in (waiting, pool.submit(selfcal._outputs.publish, publication)):
            with pytest.raises(OutputError, match="the node shuts down"):
                attempt.result()


@pytest.mark.parametrize("module", ["tf2_ros", "tf2_msgs.msg"])
def test_missing_tf2_is_said_at_the_start(start, tf2, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match="install tf2_ros_py and tf2_msgs, or set publish_tf to false"):
        start(publish_tf=True)
    watcher = rclpy.create_node("watcher")
    assert "stereo_selfcal" not in watcher.get_node_names()  # nor does half a node stay
    watcher.destroy_node()


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ({"camera_frame": "/cam"}, "camera_frame is '/cam': frames of /tf_static"),
        ({"vehicle_frame": "/base_link"}, "vehicle_frame is '/base_link': frames of /tf_static"),
    ],
)
def test_frames_that_tf_cannot_take(start, tf2, frames, words):
    with pytest.raises(ConfigError, match=words):
        start(publish_tf=True, **frames)
    start(**frames)  # what tf does not get may have any name


def test_camera_that_is_the_road_is_refused_without_tf_too(start):
    with pytest.raises(ConfigError, match="must differ"):
        start(road_frame="x", camera_frame="x")
