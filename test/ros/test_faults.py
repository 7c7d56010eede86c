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

"""What goes wrong on a vehicle: cameras that stop or change in the middle, many callers, huge images."""

import array
import dataclasses
import re

import cv2
import pytest

pytest.importorskip("rclpy")

import ros_graph
from node_in_process import NodeInProcess
from rcl_interfaces.msg import Parameter, ParameterValue
from rclpy.qos import qos_profile_parameters
from ros_graph import (
    NAME,
    RIG,
    SIDES,
    Camera,
    NodeProcess,
    image_message,
    info_message,
    rendered,
    stamp_of,
    wait_for,
    wait_until,
)
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from stereo_selfcal.files.exports import EXPORTS
from stereo_selfcal.ros import calibration

CLIENTS = 20


@pytest.fixture
def start():
    """Start the node in this process."""
    nodes = []

    def start(**parameters):
        nodes.append(NodeInProcess(**parameters).__enter__())
        return nodes[-1]

    yield start
    for node in nodes:
        node.check()
        node.__exit__()


def infos(rig=RIG):
    return [(f"/{side}/camera_info", info_message(side, rig)) for side in SIDES]


def frame(number, pixels=None, sides=SIDES):
    """Return the messages of one frame."""
    messages = []
    for side, image in zip(SIDES, pixels or rendered(), strict=True):
        message = image_message(image)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_of(number), 10**9)
        if side in sides:
            messages.append((f"/{side}/image_rect", message))
    return messages


@pytest.mark.parametrize(("left_over", "silent"), [((), SIDES), (("left",), ("right",))])
def test_camera_that_stops_in_the_middle_is_named(start, monkeypatch, left_over, silent):
    monkeypatch.setattr(calibration, "_SILENCE_S", 0.3)
    node = start(frames=1000, timeout_s=4.0)

    def messages(number):
        return frame(number, sides=left_over) if node.calibrated_frames else [*infos(), *frame(number)]

    answer = node.calibrate(messages)
    assert not answer.success
    assert " of 1000 frames accepted, " in answer.message
    assert "; since then no pair in " in answer.message
    named = " and ".join(f"/{side}/image_rect (0 publishers)" for side in silent)
    assert f"nothing arrives on {named}: start the camera" in answer.message


def test_camera_that_changes_its_resolution_in_the_middle_calibrates(start):
    half = dataclasses.replace(
        RIG, width=320, height=240, fx=RIG.fx / 2, fy=RIG.fy / 2, cx=(RIG.cx - 0.5) / 2, cy=(RIG.cy - 0.5) / 2
    )
    small = [cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA) for image in rendered()]
    node = start(frames=3, timeout_s=60.0)

    def messages(number):
        if node.calibrated_frames:
            return [*infos(half), *frame(number, small)]
        return [*infos(), *frame(number)]

    answer = node.calibrate(messages)
    assert answer.success, answer.message
    assert answer.message.startswith("calibrated from 3 frames in "), answer.message
    # Whether the car is seen to stand depends on how far apart the three stamps are.
    assert ": height 1.4" in answer.message, answer.message


def test_images_of_another_size_than_camera_info_are_refused_with_both_sizes(start):
    small = [cv2.resize(image, (320, 240)) for image in rendered()]
    answer = start(timeout_s=1.0).calibrate([*infos(), *frame(0, small)])
    assert not answer.success
    assert "320 x 240" in answer.message and "640 x 480" in answer.message


def test_frames_of_two_camera_infos_are_never_fused(start):
    """The height is proportional to the baseline: a mixture would lie in between."""
    wide = dataclasses.replace(RIG, baseline_m=2 * RIG.baseline_m)
    node = start(frames=3, timeout_s=60.0)

    def messages(number):
        return [*infos(wide if node.calibrated_frames else RIG), *frame(number)]

    answer = node.calibrate(messages)
    assert answer.success
    assert answer.message.startswith("calibrated from 3 frames in "), answer.message
    assert " of a standing car: height 2.80" in answer.message, answer.message  # one image, again and again


def test_camera_info_that_never_stays_the_same_is_named(start):
    node = start(frames=1000, timeout_s=1.0)

    def messages(number):
        rig = dataclasses.replace(RIG, baseline_m=RIG.baseline_m * (1 + number / 1000))
        return [*infos(rig), *frame(number)]

    answer = node.calibrate(messages)
    assert not answer.success
    assert re.search(r", CameraInfo changed (once|\d+ times) meanwhile", answer.message), answer.message


def test_duplicates_and_stamps_that_run_backwards_still_pair(start):
    node = start(frames=3, timeout_s=60.0)
    answer = node.calibrate(lambda number: [*infos(), *(2 * frame(100 - number))])
    assert answer.success, answer.message


@pytest.mark.parametrize("encoding", ["mono8", "rgba8"])
def test_images_of_100_megabytes_are_answered(start, encoding):
    """The first are of another size than CameraInfo says, the second are searched for lines.

    Of the second, the driver sends more behind each row than there is in it: the search takes its time.
    """
    width, height, channels = (12_500, 8_000, 1) if encoding == "mono8" else (2_000, 4_000, 4)
    huge = Image(width=width, height=height, step=100_000_000 // height, encoding=encoding)
    assert huge.step >= width * channels
    huge.data = array.array("B", bytes([90])) * (huge.step * height)
    rig = RIG if encoding == "mono8" else dataclasses.replace(RIG, width=width, height=height)
    node = start(timeout_s=0.5)
    answer = node.calibrate([*infos(rig), *((f"/{side}/image_rect", huge) for side in SIDES)])
    assert not answer.success
    assert "no frame accepted, " in answer.message


def test_call_while_the_node_shuts_down_is_answered(start):
    node = start(timeout_s=3000.0)
    node.selfcal.stop()
    answer = node.calibrate()
    assert (answer.success, answer.message) == (False, "interrupted: the node shuts down")


def test_exports_are_written_with_the_result(start, tmp_path):
    path = tmp_path / "out.yaml"
    node = start(timeout_s=60.0, output_path=str(path), exports="urdf,homographies", road_frame="asphalt")
    answer = node.calibrate([*infos(), *frame(0)])
    assert answer.success
    assert answer.message.endswith(f"; saved to {path} and exported as urdf, homographies")
    written = {f"out{EXPORTS[name].suffix}" for name in ("urdf", "homographies")}
    assert {file.name for file in tmp_path.iterdir()} == {"out.yaml", *written}
    assert '<parent link="asphalt"/>' in (tmp_path / "out.urdf.xml").read_text()


def test_export_that_cannot_be_written_costs_neither_result_nor_file(start, tmp_path):
    path = tmp_path / "out.yaml"
    (tmp_path / "out.urdf.xml").mkdir()
    node = start(timeout_s=60.0, output_path=str(path), exports="urdf")
    answer = node.calibrate([*infos(), *frame(0)])
    assert answer.success
    assert f"saved to {path}, but not exported: " in answer.message
    assert path.is_file()


def test_of_twenty_clients_at_once_one_calibrates_and_the_others_are_told(graph, tmp_path):
    """The node has four threads: five calls at once must not take them all."""
    # Each client gets the answers to all of them, and has to queue them: all are in one process here.
    clients = [
        graph.node.create_client(Trigger, f"{NAME}/calibrate", qos_profile=qos_profile_parameters)
        for _ in range(CLIENTS)
    ]
    with NodeProcess(tmp_path) as process:
        for client in clients:
            assert client.wait_for_service(ros_graph.PATIENCE_S)
        graph.parameters("frames")  # discovery is over
        futures = [client.call_async(Trigger.Request()) for client in clients]
        wait_until(lambda: sum(future.done() for future in futures) == CLIENTS - 1, "all answers but one")
        assert graph.parameters("frames") == [1]  # while the last one waits for images
        assert graph.set_parameter("frames", 1).successful
        with Camera(graph, [rendered()]):
            answers = [wait_for(future) for future in futures]
        assert sum(answer.success for answer in answers) == 1
        refused = [answer.message for answer in answers if not answer.success]
        assert all(message.startswith("busy: ") for message in refused)
        assert process.end() == 0
    graph.destroy(graph.node.destroy_client, *clients)


def test_requests_without_end_do_not_fill_the_log(graph, tmp_path):
    """Requests that rclpy itself cannot read get no answer, and one line in a while."""
    requests = 100
    with NodeProcess(tmp_path) as process:
        broken = Parameter(name="timeout_s", value=ParameterValue(type=99))
        request = ros_graph.SetParameters.Request(parameters=[broken])
        for _ in range(requests):
            graph.start(ros_graph.SetParameters, "set_parameters", request)
        wait_until(lambda: "99 is not a valid" in process.output, "a line in the log")
        assert graph.set_parameter("frames", 2).successful  # the last of the queue
        assert graph.parameters("frames") == [2]
        assert process.end() == 0
        assert 1 <= process.output.count("a callback failed") < requests / 4
