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

"""Calls of one node, as a real process over DDS, that all tests here share: it runs on from call to call."""

from functools import cache
from itertools import count

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from ros_graph import (
    LONG_S,
    PATIENCE_S,
    RESULTS,
    SHORT_S,
    Camera,
    NodeProcess,
    assert_near_truth,
    blank,
    rendered,
    wait_for,
)

from stereo_selfcal import Calibrator, Extrinsics

STAMPS_APART = 10_000


@pytest.fixture(scope="module")
def node(graph, tmp_path_factory):
    """Start the node; it is ended after the last test, cleanly."""
    with NodeProcess(tmp_path_factory.mktemp("node")) as process:
        yield process
        assert process.process.poll() is None, process.output
        assert process.end() == 0, process.output
        assert "Traceback" not in process.output and "xception" not in process.output, process.output


@pytest.fixture(autouse=True)
def defaults(graph, node):
    """Set the parameters back that tests change."""
    yield
    for name, value in (
        ("timeout_s", PATIENCE_S),
        ("frames", 1),
        ("queue_size", 5),
        ("approximate_sync", False),
        ("approximate_sync_tolerance_seconds", 0.01),
    ):
        assert graph.set_parameter(name, value).successful


@pytest.fixture(scope="module")
def camera(graph):
    """Return a function that makes a camera, with later stamps than all before it."""
    numbers = count()

    def camera(*arguments, **settings):
        return Camera(graph, *arguments, first=STAMPS_APART * next(numbers), **settings)

    return camera


@cache
def extrinsics_of_mono8():
    return list(Calibrator(ros_graph.RIG).add(*rendered()).extrinsics.as_array())


@pytest.mark.parametrize("encoding", ["mono16", "bgr8", "rgba8"])
def test_encodings_give_the_numbers_of_mono8(graph, camera, encoding):
    """Grey images in another coat; for the colours' own weights see test_images.py."""
    with camera([rendered()], encoding):
        answer = graph.calibrate()
    assert answer.success, answer.message
    assert graph.parameters(*RESULTS[:3]) == extrinsics_of_mono8()


def test_bayer_images_calibrate(graph, camera):
    with camera([rendered()], "bayer_rggb8"):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_several_frames_are_fused(graph, camera):
    assert graph.set_parameter("frames", 4).successful
    assert graph.set_parameter("queue_size", 50).successful
    with camera([rendered(index=i) for i in range(4)]):
        answer = graph.calibrate()
    assert answer.success and "from 4 frames" in answer.message, answer.message
    assert_near_truth(Extrinsics(*graph.parameters(*RESULTS[:3])))


def refused_for_stamps(graph):
    """Call until no image was lost on the way, as on a busy machine: the answer speaks of that then."""
    for _ in range(5):
        answer = graph.calibrate()
        if "lost on the way" not in answer.message:
            break
    return answer


def test_approximate_pairs(graph, camera):
    assert graph.set_parameter("timeout_s", SHORT_S).successful
    with camera([rendered()], right_late_ns=7_000_000):
        answer = refused_for_stamps(graph)
        assert not answer.success
        assert "the nearest stamps differ by 7.000 ms: set approximate_sync" in answer.message
        assert graph.set_parameter("approximate_sync", True).successful
        assert graph.set_parameter("approximate_sync_tolerance_seconds", 0.006).successful
        answer = refused_for_stamps(graph)
        assert not answer.success
        assert "approximate_sync_tolerance_seconds allows 6.000 ms: raise it" in answer.message
        assert graph.set_parameter("approximate_sync_tolerance_seconds", 0.007).successful
        assert graph.set_parameter("timeout_s", LONG_S).successful
        answer = graph.calibrate()
        assert answer.success, answer.message


def test_missing_camera_is_named_with_rates(graph, camera):
    assert graph.set_parameter("timeout_s", SHORT_S).successful
    with camera([rendered()], sides=["left"]):
        answer = graph.calibrate()
    assert not answer.success
    assert answer.message.startswith("no pair in 4.0 s: left ")
    assert (
        "right 0.0 Hz; nothing arrives on /right/image_rect (0 publishers): start the camera"
        in answer.message
    )


def test_unknown_encoding_is_named(graph, camera):
    assert graph.set_parameter("timeout_s", SHORT_S).successful
    # Small images: one of full size with two bytes per pixel is more than Fast DDS has of shared memory for a
    # sender, and on a busy machine a part of each is lost.
    with camera([(np.full((48, 64), 90, np.uint8),) * 2], "yuv422"):
        answer = graph.calibrate()
    assert not answer.success
    assert "image encoding 'yuv422' is not supported" in answer.message


def test_good_frame_after_bad_ones_is_found(graph, camera):
    assert graph.set_parameter("timeout_s", LONG_S).successful
    with camera([blank(), blank(), blank(), rendered()]):
        answer = graph.calibrate()
    assert answer.success, answer.message


def test_second_call_is_busy_and_parameters_answer_meanwhile(graph, camera):
    assert graph.set_parameter("timeout_s", LONG_S).successful
    first = graph.start_calibrate()
    graph.wait_for_diagnostics(lambda values, _: values["state"] == "calibrating")
    second = graph.calibrate()
    assert not second.success
    assert second.message.startswith("busy: ")
    assert graph.parameters("timeout_s") == [LONG_S]
    assert not first.done()
    with camera([rendered()]):
        answer = wait_for(first)
    assert answer.success, answer.message


def test_output_path_that_forges_lines_is_refused_while_it_runs(graph):
    outcome = graph.set_parameter("output_path", "/tmp/a\nFORGED\x1b[31m")
    assert not outcome.successful
    assert outcome.reason.startswith("output_path is ") and outcome.reason.isprintable()
