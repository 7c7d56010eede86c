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

"""/tf_static: what others say of the same frames is told, and nothing is sent against it."""

from itertools import pairwise

import pytest

pytest.importorskip("rclpy")

import rclpy
from tf2_stand_in import StandInTf2, joint

from stereo_selfcal.ros.tf_tree import Joint, TfTree, find_conflict

CAMERA, ROAD = Joint("base_footprint", "cam"), Joint("base_footprint", "road")
WANTED = [joint(*CAMERA), joint(*ROAD)]


def conflict(wanted, *heard, top=""):
    return find_conflict(wanted, [(topic, Joint(*names)) for topic, *names in heard], top)


def test_tree_of_others_is_no_conflict():
    others = [("/tf_static", "base_footprint", "base_link"), ("/tf", "odom", "base_footprint")]
    assert conflict([CAMERA, ROAD], *others, ("/tf_static", "cam", "imu")) == ""


def test_other_parent_is_told_with_its_topic_and_a_remedy():
    text = conflict([CAMERA], ("/tf_static", "zed_link", "cam"))
    assert "camera_frame 'cam' has the parent 'zed_link' on /tf_static already" in text
    assert "set camera_frame to a name of its own, or remove that joint from the URDF" in text
    assert "'zed_link' on /tf already" in conflict([CAMERA], ("/tf", "zed_link", "cam"))
    # The same joint of somebody else is no better: its numbers are others.
    assert "the parent 'base_footprint'" in conflict([CAMERA], ("/tf_static", "base_footprint", "cam"))


def test_road_with_a_parent_is_told_where_it_would_be_sent():
    others = ("/tf_static", "base_link", "road")
    text = conflict([CAMERA, ROAD], others)
    assert "road_frame 'road' has the parent 'base_link'" in text
    assert "set vehicle_frame to the name of road_frame" in text
    assert conflict([Joint("road", "cam")], others) == ""  # as users of earlier versions have it


@pytest.mark.parametrize("between", [[], ["mast"], ["mast", "body"]])
def test_vehicle_below_the_camera_is_a_loop(between):
    chain = ["cam", *between, "base_footprint"]
    others = [("/tf_static", *pair) for pair in pairwise(chain)]
    text = conflict([CAMERA], *others)
    assert "'base_footprint' is below camera_frame 'cam' on /tf_static" in text and "URDF" in text


@pytest.mark.parametrize("between", [[], ["base_link"]])
def test_vehicle_below_the_road_is_a_loop_of_the_road(between):
    others = [("/tf_static", *pair) for pair in pairwise(["road", *between, "base_footprint"])]
    text = conflict([CAMERA, ROAD], *others)
    assert "'base_footprint' is below road_frame 'road' on /tf_static" in text
    assert "set road_frame to a name of its own, or set vehicle_frame to the name of road_frame" in text
    assert "camera_frame" not in text
    assert conflict([CAMERA], *others) == ""  # without the leaf there is no loop


def test_road_of_another_camera_is_no_parent_while_the_yaw_is_not_known():
    others = ("/tf_static", "base_footprint", "road")
    text = conflict([Joint("road", "rear")], others, top="road")
    assert "road_frame 'road' has the parent 'base_footprint' on /tf_static already" in text
    assert "set road_frame to a name of its own for each camera, or, where you have joined it" in text
    assert "set vehicle_frame to the name of road_frame" in text
    # Another camera in that road, of which nobody knows where it is, is no conflict; nor is a road apart.
    assert conflict([Joint("road", "rear")], ("/tf_static", "road", "front"), top="road") == ""
    assert conflict([Joint("rear_road", "rear")], others, top="rear_road") == ""
    assert conflict([Joint("road", "rear")], ("/tf", "odom", "")) == ""


def test_loop_of_others_ends_the_search():
    assert conflict([CAMERA], ("/tf", "a", "base_footprint"), ("/tf", "base_footprint", "a")) == ""


@pytest.fixture
def tf2(monkeypatch):
    return StandInTf2(monkeypatch)


@pytest.fixture
def node():
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node("tree")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_nothing_is_sent_against_a_parent_that_was_heard_before(tf2, node, topic):
    tf2.others = [(topic, joint("/zed_link", "/cam"))]  # tf2 strips the slashes of earlier versions
    tree = TfTree(node)
    tree.send(WANTED)
    assert tree.conflict == ""  # not known yet
    tf2.listened(node)
    assert tf2.sent == []
    assert f"'zed_link' on {topic} already" in tree.conflict
    assert tree.conflict.endswith("; nothing is sent on /tf_static")
    tf2.others = []  # removed from the URDF
    tf2.listened(node)
    assert tf2.sent == [WANTED] and tree.conflict == ""


def test_parent_that_appears_later_is_told_and_own_transforms_are_not(tf2, node):
    tree = TfTree(node)
    tf2.listened(node)
    tree.send(WANTED)
    tf2.listened(node)  # they come back
    assert (tf2.sent, tree.conflict) == ([WANTED], "")
    tf2.others = [("/tf_static", joint("base_footprint", "cam", x_m=0.1))]
    tf2.listened(node)
    assert "has the parent 'base_footprint' on /tf_static already" in tree.conflict
    assert tree.conflict.endswith("; the transform was sent before that")
    later = [joint("road", "cam")]
    tree.send(later)  # another result
    assert tf2.sent == [WANTED] and tree.conflict.endswith("; nothing is sent on /tf_static")


def test_it_listens_in_bursts(tf2, node):
    tree = TfTree(node)
    listening = []
    for _ in range(30):
        listening.append(bool(tf2.listeners))
        tree.tick()
    assert set(tf2.listeners) <= {"/tf", "/tf_static"}
    assert listening[:3] == [True, True, False] and 0.1 < sum(listening) / len(listening) < 0.25


def test_nothing_wanted_is_nothing_told(tf2, node):
    tf2.others = [("/tf", joint("zed_link", "cam"))]
    tree = TfTree(node)
    tree.send(WANTED)
    tf2.listened(node)
    assert tree.conflict
    tree.send([])
    assert tree.conflict == ""


def test_what_was_sent_and_is_not_wanted_any_more_is_told(tf2, node):
    tree = TfTree(node)
    tree.send(WANTED)
    assert tree.outdated == ""
    tree.send([])  # nothing of it was sent
    assert tree.outdated == ""
    tf2.listened(node)
    tree.send(WANTED)
    assert (tf2.sent, tree.outdated) == ([WANTED], "")
    tree.send([])
    sentence = "what was sent before stands on /tf_static until a restart: "
    assert tree.outdated == f"{sentence}'base_footprint' -> 'cam', 'base_footprint' -> 'road'"
    tree.send([joint("road", "cam")], "road")  # the camera has another parent then, the leaf stands
    assert len(tf2.sent) == 2 and tree.outdated == f"{sentence}'base_footprint' -> 'road'"
    tree.send(WANTED)
    assert (len(tf2.sent), tree.outdated, tree.conflict) == (3, "", "")
