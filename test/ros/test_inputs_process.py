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

"""Inputs as cameras really are, over DDS: raw images, another QoS or type, a clock that stands still."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

import cv2
import ros_graph
from independent_lens import raw_image
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from ros_graph import RESULTS, Camera, info_message, rendered
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from stereo_selfcal import Calibrator
from stereo_selfcal.core.camera.rectifier import StereoRectifier


@pytest.fixture
def own(graph):
    """Make publishers of the test that are destroyed after it."""
    made = []

    def publisher(kind, topic, qos=10):
        made.append(graph.node.create_publisher(kind, topic, qos))
        return made[-1]

    yield publisher
    graph.destroy(graph.node.destroy_publisher, *made)


def raw_info(side):
    """Return the CameraInfo of a raw camera that is turned about its axis and distorts a little."""
    info = info_message(side)
    turn = 0.01 if side == "left" else -0.006
    info.distortion_model, info.d = "plumb_bob", [-0.05, 0.01, 0.0002, -0.0003, 0.0]
    info.r = cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0].ravel()
    return info


class RawCamera(Camera):
    """Publishes on image_raw, with the CameraInfo of raw cameras."""

    def __init__(self, graph, frames):
        super().__init__(graph, frames, sides=(), infos=())
        node, self.sides = graph.node, ros_graph.SIDES
        self.images = {s: node.create_publisher(Image, f"/{s}/image_raw", 10) for s in self.sides}
        self.infos = {s: node.create_publisher(CameraInfo, f"/{s}/camera_info", 10) for s in self.sides}

    def _publish(self, publisher, message, stamp_ns):
        if isinstance(message, CameraInfo):
            message = raw_info("left" if message.p[3] == 0.0 else "right")
        super()._publish(publisher, message, stamp_ns)


def test_raw_images_give_the_numbers_of_the_rectifier(graph, start):
    start({"rectified": False, "timeout_s": 60.0})
    infos = [raw_info(side) for side in ros_graph.SIDES]
    raw = tuple(raw_image(info, image) for info, image in zip(infos, rendered(), strict=True))
    with RawCamera(graph, [raw]):
        answer = graph.calibrate()
    assert answer.success, answer.message
    rectifier = StereoRectifier.from_camera_info(*infos, rectified=False)
    expected = Calibrator(rectifier.rig).add(*rectifier.apply(*raw))
    assert graph.parameters(*RESULTS[:3]) == list(expected.extrinsics.as_array())


def test_raw_topics_can_be_remapped_and_are_named(graph, start):
    start({"rectified": False, "timeout_s": 0.5}, ["-r", "left/image_raw:=/cam/l", "-r", "__ns:=/car"])
    ros_graph.wait_until(graph.node.get_service_names_and_types, "the graph")
    name = ros_graph.NAME
    try:
        ros_graph.NAME = "/car/stereo_selfcal"
        graph.clients.clear()
        answer = graph.calibrate()
    finally:
        ros_graph.NAME = name
        graph.clients.clear()
    assert "nothing arrives on /cam/l (0 publishers) and /car/right/image_raw (0 pub" in answer.message


def test_publisher_with_another_type_is_named(graph, start, own):
    """The commonest of all: the topic of the compressed images without its suffix, or the other way round."""
    start({"timeout_s": 1.0})
    for side in ros_graph.SIDES:
        own(CompressedImage, f"/{side}/image_rect")
    # A publisher may be discovered before its node is, and has no name until then.
    status = graph.wait_for_diagnostics(lambda v, s: v["incompatible_qos"].count("/tester publishes") == 2)
    assert status.level == b"\2"
    words = (
        "/tester publishes sensor_msgs/msg/CompressedImage on /left/image_rect, sensor_msgs/msg/Image is read"
    )
    assert words in status.message
    assert words in graph.calibrate().message


def test_publisher_with_another_qos_is_named_with_both_policies(graph, start, own):
    qos = {
        f"qos_overrides./{side}/image_rect.subscription.reliability": "reliable" for side in ros_graph.SIDES
    }
    start({"timeout_s": 1.0, **qos})
    best_effort = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    for side in ros_graph.SIDES:
        own(Image, f"/{side}/image_rect", best_effort)
    status = graph.wait_for_diagnostics(lambda v, s: v["incompatible_qos"].count("/tester publishes") == 2)
    assert status.level == b"\2"
    message = graph.calibrate().message
    for words in (
        "/tester publishes /left/image_rect with a QoS that does not match",
        "est effort",
        "eliable",
    ):
        assert words in status.message and words in message


def test_simulated_time_that_stands_still(graph, start):
    """Nobody publishes /clock: waiting, diagnostics and timeouts must not depend on it."""
    start({"use_sim_time": True, "timeout_s": 1.0})
    answer = graph.calibrate()
    assert answer.message.startswith("no pair in 1.0 s: ")
    assert graph.set_parameter("timeout_s", 60.0).successful
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
        graph.wait_for_diagnostics(lambda v, s: float(v["pair_rate_hz"]) > 1)
    graph.wait_for_diagnostics(lambda v, s: v["state"] == "calibrated")


def test_listens_only_while_images_are_wanted(graph, start):
    start()
    with Camera(graph, [rendered()]) as camera:
        status = graph.wait_for_diagnostics(lambda v, s: float(v["rates_age_s"]) > 0.0)
        assert status.level == b"\0", status.message
        assert "pairs per second" in status.message and "as nobody wants images" in status.message
        topics = [*camera.images.values(), *camera.infos.values()]
        ros_graph.wait_until(
            lambda: not any(publisher.get_subscription_count() for publisher in topics), "no subscription"
        )
        assert graph.calibrate().success
        values = {pair.key: pair.value for pair in status.values}
        for side in ros_graph.SIDES:
            assert (values[f"{side}_width_px"], values[f"{side}_height_px"]) == ("640", "480")
            assert values[f"{side}_encoding"] == "mono8"


def test_size_of_camera_info_is_a_fault_of_it(graph, start, own):
    start()
    half = [image[::2, ::2] for image in rendered()]
    with Camera(graph, [half]):
        status = graph.wait_for_diagnostics(lambda v, s: v["faults"] != "none")
    assert status.level == b"\2"
    assert "image_size: the left image is 320 x 240, its CameraInfo is for 640 x 480" in status.message


LATCHED_INFO = QoSProfile(
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)


def send_infos(own, qos):
    """Publish the CameraInfo of both cameras once, and never again."""
    for side in ros_graph.SIDES:
        own(CameraInfo, f"/{side}/camera_info", qos).publish(info_message(side))


def test_camera_info_sent_once_and_latched_before_the_node_starts_is_received(graph, start, own):
    send_infos(own, LATCHED_INFO)
    start({"timeout_s": 60.0})
    with Camera(graph, [rendered()], infos=()):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_override_of_durability_receives_a_latched_camera_info_too(graph, start, own):
    send_infos(own, LATCHED_INFO)
    name = "qos_overrides./{}/camera_info.subscription.durability"
    start({"timeout_s": 60.0, **{name.format(side): "transient_local" for side in ros_graph.SIDES}})
    with Camera(graph, [rendered()], infos=()):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_camera_info_that_was_latched_but_best_effort_is_named(graph, start, own):
    """DDS gives it to nobody who comes later."""
    qos = QoSProfile(
        depth=1,
        reliability=QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
    )
    send_infos(own, qos)
    start({"timeout_s": ros_graph.SHORT_S})
    with Camera(graph, [rendered()], infos=()):
        answer = graph.calibrate()
    assert not answer.success
    assert "/tester publishes /left/camera_info transient local, but best effort" in answer.message


def test_override_of_durability_that_keeps_camera_info_out_is_named(graph, start):
    name = "qos_overrides./{}/camera_info.subscription.durability"
    overrides = {name.format(side): "transient_local" for side in ros_graph.SIDES}
    start({"timeout_s": ros_graph.SHORT_S, **overrides})
    with Camera(graph, [rendered()]):  # volatile
        answer = graph.calibrate()
    assert not answer.success
    assert "/tester publishes /left/camera_info with a QoS that does not match" in answer.message
    assert "olatile publisher and transient local subscription" in answer.message
