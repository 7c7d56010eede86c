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

"""``~/road_pose`` of the node itself, in this process: it comes and goes with listeners and calibrations."""

import pytest

pytest.importorskip("rclpy")

import numpy as np
from node_in_process import NodeInProcess
from result_making import RIG, a_result, write
from ros_graph import NAME, image_message, info_message, wait_until
from std_srvs.srv import Trigger

from stereo_selfcal.ros import road_pose as road_pose_module
from stereo_selfcal.ros.road_pose import NOT_CALIBRATED

SOURCE = "/left/image_rect /right/image_rect"
TOPIC = f"{NAME}/road_pose"


class Tracker:
    """Finds the road in every frame."""

    def __init__(self, rig, config, mount):
        assert rig == RIG

    def follow(self, left, right, stamp_s, stamp_difference_s):
        return a_result()

    def compare(self, cold):
        return True


class Camera:
    """Sends a pair of images, a tenth of a second later each time."""

    def __init__(self, node):
        self.node, self.stamp_ns = node, 10**9

    def sends(self):
        self.stamp_ns += 10**8
        image = np.full((RIG.height, RIG.width), 90, np.uint8)
        for side in ("left", "right"):
            sent = {"image_rect": image_message(image), "camera_info": info_message(side, RIG)}
            for topic, message in sent.items():
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = divmod(self.stamp_ns, 10**9)
                self.node.send(f"/{side}/{topic}", message)


@pytest.fixture
def node(tmp_path, monkeypatch):
    monkeypatch.setattr(road_pose_module, "RoadTracker", Tracker)
    path = tmp_path / "out.yaml"
    write(path, source=SOURCE)
    with NodeInProcess(output_path=str(path)) as node:
        yield node
        node.check()


def listen(node, listeners=1):
    for publisher in node.node.publishers:
        if publisher.topic_name == TOPIC:
            publisher.get_subscription_count = lambda: listeners


def poses(node):
    return [message for topic, message in list(node.sent) if topic == TOPIC]


def until(node, camera, true):
    def sent():
        camera.sends()
        return true()

    wait_until(sent, "it, while images come")


def test_it_comes_and_goes_with_who_listens_and_with_the_calibration(node):
    camera, road = Camera(node), node.selfcal._road_pose
    assert road.described == "nobody listens" and poses(node) == []
    listen(node)
    until(node, camera, lambda: len(poses(node)) >= 3)
    stamps_ns = [each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in poses(node)]
    assert all(stamp % 10**8 == 0 for stamp in stamps_ns) and sorted(set(stamps_ns)) == stamps_ns
    assert road.described.startswith("published")
    assert node.serve("reset", Trigger.Request(), Trigger.Response()).success
    until(node, camera, lambda: road.described == f"nothing is published: {NOT_CALIBRATED}")
    count = len(poses(node))
    until(node, camera, lambda: not node.selfcal._live._open)
    assert len(poses(node)) == count
    listen(node, 0)
    assert road.described == "nobody listens"


def test_why_nothing_comes_is_in_the_diagnostics(node):
    listen(node)
    road = node.selfcal._road_pose
    wait_until(lambda: "nothing arrives" in road.described, "the reason")
    node.report()
    told = [m for topic, m in list(node.sent) if topic == "/diagnostics"][-1].status[0].values
    (value,) = (each.value for each in told if each.key == "road_pose")
    assert value.startswith("nothing is published: ") and "nothing arrives" in value
