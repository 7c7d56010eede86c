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

"""What the node shows over DDS besides its numbers: diagnostics, pictures, markers."""

import pytest

pytest.importorskip("rclpy")

import ros_graph
from geometry_msgs.msg import PoseWithCovarianceStamped
from ros_graph import LONG_S, Camera, blank, rendered
from sensor_msgs.msg import Image
from visualization_msgs.msg import MarkerArray

from stereo_selfcal.pictures.canvas import GREEN, SKY_BLUE, VERMILION, YELLOW


def values_of(status):
    return {pair.key: pair.value for pair in status.values}


def test_diagnostics_say_why_nothing_happens_and_what_is_found(graph, start, tmp_path):
    path = tmp_path / "missing" / "out.yaml"
    path.parent.mkdir()
    start({"timeout_s": LONG_S, "output_path": path})
    graph.parameters("output_path")  # it is up, and could write there
    path.parent.rmdir()
    by_topic = {
        topic: graph.wait_for_diagnostics(lambda _, s, topic=topic: s.name == f"/stereo_selfcal: {topic}")
        for topic in ("calibration", "images", "camera info")
    }
    assert {status.hardware_id for status in by_topic.values()} == {"stereo_camera"}
    assert {status.level for status in by_topic.values()} == {b"\1"}
    assert by_topic["calibration"].message.startswith("uncalibrated: call ~/calibrate")
    assert "nothing arrives on /left/image_rect (0 publishers)" in by_topic["images"].message
    assert by_topic["camera info"].message.startswith("no CameraInfo on /left/camera_info (publishers: 0)")
    with Camera(graph, [blank(), rendered()]):
        graph.wait_for_diagnostics(lambda v, s: float(v["pair_rate_hz"]) > 1 and s.level == b"\0")
        info = graph.wait_for_diagnostics(lambda v, s: v.get("baseline_m") == "0.1481" and s.level == b"\0")
        assert info.message == "640 x 480 px, baseline 0.1481 m, from CameraInfo"
        while int(values_of(graph.wait_for_diagnostics(lambda v, _: v["state"]))["frames_rejected"]) == 0:
            assert graph.calibrate().success  # with one of the frames that are bare at times
    status = graph.wait_for_diagnostics(lambda v, _: v["state"] == "calibrated")
    values = values_of(status)
    assert status.level == b"\1" and f"in effect, but not saved: {path}" in status.message
    assert abs(float(values["height_m"]) - 1.4) < 0.01 and 0.0 < float(values["height_std_m"]) < 0.1
    assert values["last_rejection"] == "road_not_seen"
    assert values["rejected_road_not_seen"] == values["frames_rejected"]
    assert 0.0 < float(values["time_per_frame_s"]) <= float(values["time_per_frame_longest_s"])


def test_pictures_are_drawn_while_somebody_looks(graph, start):
    """Why there is nothing to see, then the current image, then what a call made of its frame."""
    start({"timeout_s": LONG_S})
    pictures = {"debug_image": [], "birds_eye": []}
    subscriptions = [
        graph.node.create_subscription(Image, f"{ros_graph.NAME}/{name}", received.append, 1)
        for name, received in pictures.items()
    ]
    shown, above = pictures["debug_image"], pictures["birds_eye"]

    def bar(messages):
        """Return the colour of the verdict of the last picture."""
        return tuple(messages[-1].data[3 * 2 : 3 * 2 + 3]) if messages else None

    try:
        ros_graph.wait_until(lambda: bar(shown) == VERMILION, "a notice that nothing arrives")
        with Camera(graph, [rendered()]):
            ros_graph.wait_until(lambda: bar(shown) == YELLOW, "the image, not calibrated")
            assert graph.calibrate().success
            ros_graph.wait_until(lambda: bar(shown) == bar(above) == GREEN, "the calibrated frame")
            calibrated = shown[-1]
            ros_graph.wait_until(lambda: bar(shown) == SKY_BLUE, "the calibration in force")
        pose = graph.latest(PoseWithCovarianceStamped, "pose")
    finally:
        graph.destroy(graph.node.destroy_subscription, *subscriptions)
    assert calibrated.header.stamp == pose.header.stamp
    assert calibrated.header.frame_id == "stereo_camera"
    assert (calibrated.encoding, calibrated.width) == ("bgr8", 960)
    assert len(calibrated.data) == calibrated.step * calibrated.height


def test_markers_wait_for_late_listeners(graph, start):
    start({"road_frame": "asphalt"})
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    markers = graph.latest(MarkerArray, "markers").markers
    pose = graph.latest(PoseWithCovarianceStamped, "pose")
    assert {m.header.frame_id for m in markers} == {"asphalt"}
    assert all(m.header.stamp == pose.header.stamp for m in markers)
    assert [len(m.points) > 10 for m in markers if m.ns == "lane_lines"] == [True, True]
