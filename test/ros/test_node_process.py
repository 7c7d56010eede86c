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

"""The node as a real process over DDS: what it publishes and saves, and how it ends."""

import signal
import threading

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterEvent
from ros_graph import LONG_S, RESULTS, SHORT_S, Camera, assert_near_truth, blank, rendered, stamp_of

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.camera.pairing import stamp_to_s
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros import node as node_program


def test_result_is_the_same_in_every_place(graph, start, tmp_path):
    """Parameters, latched messages and file hold the numbers the Python API gives for that frame."""
    path = tmp_path / "out.yaml"
    start({"output_path": path, "road_frame": "asphalt", "seed": 3})
    assert graph.parameters(*RESULTS) == [None] * 6
    with Camera(graph, [rendered()]):
        answer = graph.calibrate()
    assert answer.success, answer.message
    assert "; the yaw is not known" in answer.message and answer.message.endswith(f"; saved to {path}")

    saved = load_result(path)
    assert_near_truth(saved.extrinsics)
    assert saved.provenance["source"] == "/left/image_rect /right/image_rect"
    assert (saved.provenance["frames"], saved.provenance["seed"]) == (1, 3)
    stamp_s = saved.provenance["stamp"]
    index = next(i for i in range(10_000) if stamp_to_s(stamp_of(i)) == stamp_s)
    calibrator = Calibrator(ros_graph.RIG, CalibratorConfig(seed=3))
    calibrator.add(*rendered(), stamp_s)
    expected = calibrator.estimate  # of the mount, which one frame of a moving car knows to 0.2 deg
    assert saved.extrinsics == expected.extrinsics
    assert saved.std == expected.std
    assert saved.rig == ros_graph.RIG

    values = [*expected.extrinsics.as_array(), *expected.std.as_array()]
    assert graph.parameters(*RESULTS) == values
    event = graph.latest(ParameterEvent, "extrinsics")
    assert event.node == "/stereo_selfcal"
    assert {p.name: p.value.double_value for p in event.changed_parameters[:6]} == dict(
        zip(RESULTS, values, strict=True)
    )
    assert all(p.name.startswith("provenance.") for p in event.changed_parameters[6:])
    pose = graph.latest(PoseWithCovarianceStamped, "pose")
    assert pose.header.frame_id == "asphalt"
    assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == stamp_of(index)
    assert pose.pose.pose.position.z == expected.extrinsics.height_m
    covariance = np.array(pose.pose.covariance).reshape(6, 6)
    # The roll turns about an axis that the pitch has turned down a little.
    np.testing.assert_allclose(covariance[np.ix_([2, 4, 3], [2, 4, 3])], expected.covariance, rtol=3e-3)


def test_compressed_images_give_the_numbers_of_mono8(graph, start):
    start({"image_transport": "compressed"})
    with Camera(graph, [rendered()], "png"):
        answer = graph.calibrate()
    assert answer.success, answer.message
    expected = Calibrator(ros_graph.RIG).add(*rendered())
    assert graph.parameters(*RESULTS[:3]) == list(expected.extrinsics.as_array())


def test_missing_camera_info_is_named_and_parameters_replace_it(graph, start):
    start({"timeout_s": SHORT_S})
    with Camera(graph, [rendered()], infos=["left"]):
        answer = graph.calibrate()
        assert not answer.success
        assert "no CameraInfo on /right/camera_info (0 publishers)" in answer.message
        for name, value in ros_graph.RIG.to_mapping().items():
            assert graph.set_parameter(f"rig.{name}", value).successful
        assert graph.set_parameter("timeout_s", LONG_S).successful
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_refusal_changes_nothing(graph, start, tmp_path):
    """The last good result stays latched, set and on disk; the next call works again."""
    path = tmp_path / "out.yaml"
    start({"timeout_s": SHORT_S, "output_path": path})
    with Camera(graph, [blank()]):
        answer = graph.calibrate()
    assert not answer.success and answer.message.startswith("no frame accepted, ")
    assert graph.parameters(*RESULTS) == [None] * 6
    assert graph.latest(ParameterEvent, "extrinsics") is None
    assert not path.exists()
    assert graph.set_parameter("timeout_s", LONG_S).successful
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    assert graph.set_parameter("timeout_s", SHORT_S).successful
    before, content = graph.parameters(*RESULTS), path.read_bytes()
    with Camera(graph, [blank()]):
        assert not graph.calibrate().success
    assert graph.parameters(*RESULTS) == before
    assert path.read_bytes() == content
    assert graph.latest(ParameterEvent, "extrinsics").changed_parameters[0].value.double_value == before[0]


def test_unwritable_file_does_not_undo_the_calibration(graph, start, tmp_path):
    path = tmp_path / "missing" / "out.yaml"
    path.parent.mkdir()
    start({"output_path": path})
    graph.parameters("output_path")  # it is up, and could write there
    path.parent.rmdir()
    with Camera(graph, [rendered()]):
        answer = graph.calibrate()
    assert answer.success
    assert f"in effect, but not saved: {path} cannot be written: no such file or directory" in answer.message
    assert None not in graph.parameters(*RESULTS)


def test_nobody_ever_sees_half_a_result(graph, start):
    """Two frames calibrated in turns, parameters read all the time: one result or the other, no mix."""
    start()
    seen, known, ended = set(), {(None,) * 6}, threading.Event()

    def read():
        while not ended.is_set():
            seen.add(tuple(graph.parameters(*RESULTS)))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for camera, index in enumerate((0, 5, 0, 5)):
            with Camera(graph, [rendered(index=index)], first=10_000 * camera):
                assert graph.calibrate().success
            known.add(tuple(graph.parameters(*RESULTS)))
    finally:
        ended.set()
        reader.join()
    assert len(known) == 3
    assert seen <= known


def test_images_from_before_the_call_are_not_used(graph, start):
    start({"timeout_s": 1.0})
    with Camera(graph, [rendered()]):
        graph.wait_for_diagnostics(lambda values, _: int(values["pairs"]) > 3)
    answer = graph.calibrate()
    assert not answer.success
    assert answer.message.startswith("no pair in 1.0 s: left 0.0 Hz, right 0.0 Hz")


def test_bag_that_starts_over_keeps_pairing(graph, start):
    """Stamps jump back with every pass; every pass must pair (message_filters gets stuck)."""
    start()
    # Minutes earlier each time: the node takes images only when it probes, and sees no jump back to stamps
    # that the pass before had not come to yet.
    for first in (2000, 1000, 0):
        with Camera(graph, [rendered()], first=first):
            graph.wait_for_diagnostics(lambda values, _: float(values["pair_rate_hz"]) > 2)
            assert graph.calibrate().success
    graph.wait_for_diagnostics(lambda values, _: int(values["resets"]) >= 2)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("calling", [False, True])
def test_signal_ends_it_cleanly(graph, start, how, calling):
    process = start({"timeout_s": 3000.0})
    graph.parameters("timeout_s")  # it is up
    if calling:
        graph.start_calibrate()
        graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrating")
    assert process.end(how) == 0
    assert "Traceback" not in process.output and "rror" not in process.output, process.output


def test_signal_while_images_stream_ends_it_cleanly(graph, start):
    """Callbacks in flight must end before the node is taken apart."""
    process = start({"timeout_s": 3000.0})
    with Camera(graph, [blank()]):
        graph.start_calibrate()
        graph.wait_for_diagnostics(lambda values, _: int(values["pairs"]) > 5)
        assert process.end() == 0
    assert "xception" not in process.output, process.output


def test_output_path_that_cannot_be_written_ends_the_start_with_status_2_and_one_line(start, tmp_path):
    process = start({"output_path": tmp_path / "missing" / "out.yaml"})
    assert process.wait() == 2
    (line,) = process.output.strip().splitlines()
    assert line.startswith("stereo_selfcal: output_path: ") and "choose a writable folder" in line


def test_arguments_that_forge_lines_are_told_in_one_printable_line(capsys):
    assert node_program.main(["x\x1b[31mX\nFORGED"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("stereo_selfcal: ")
    assert err.count("\n") == 1 and err.rstrip("\n").isprintable()
