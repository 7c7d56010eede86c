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

"""Calls with targets, and resets, of one node as a real process over DDS: it runs on from test to test."""

import math
import re
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

pytest.importorskip("rclpy")

from rcl_interfaces.msg import ParameterEvent
from ros_graph import (
    LONG_S,
    RESULTS,
    TRUTH,
    Camera,
    NodeProcess,
    assert_near_truth,
    blank,
    rendered,
    wait_for,
)
from std_srvs.srv import Trigger

from stereo_selfcal import Extrinsics
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import named_scene

STAMPS_APART = 10_000
# What a few frames of the scene reach, and what none ever does.
WIDE = {
    "target_height_std_m": 0.04,
    "target_pitch_std_rad": math.radians(0.5),
    "target_roll_std_rad": math.radians(1.2),
}
NARROW = {"target_height_std_m": 1e-5}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("node") / "out.yaml"


@pytest.fixture(scope="module", autouse=True)
def node(graph, path):
    """Start the node; it is ended after the last test, cleanly."""
    with NodeProcess(path.parent, {"output_path": path, "monitor_period_s": 0.0}) as process:
        yield process
        assert process.process.poll() is None, process.output
        assert process.end() == 0, process.output
        assert "Traceback" not in process.output and "xception" not in process.output, process.output


@pytest.fixture(scope="module")
def camera(graph):
    """Return a function that makes a camera, with later stamps than all before it."""
    numbers = count()
    return lambda frames: Camera(graph, frames, first=STAMPS_APART * next(numbers))


@pytest.fixture(autouse=True)
def uncalibrated(graph, node, path):
    """Take back what the test before has left."""
    assert reset(graph).success
    path.with_name(f"{path.name}.rejected").unlink(missing_ok=True)
    set_parameters(graph, frames=1)


def set_parameters(graph, **values):
    for name, value in values.items():
        assert graph.set_parameter(name, value).successful


def reset(graph):
    return wait_for(graph.start(Trigger, "reset", Trigger.Request()))


def test_a_call_ends_when_it_is_good_and_a_reset_takes_it_back(graph, camera, path):
    set_parameters(graph, timeout_s=LONG_S, frames=2, **WIDE)
    with camera([rendered(index=i) for i in range(4)]):
        answer = graph.calibrate()
    assert answer.success, answer.message
    assert "; targets reached with " in answer.message and "(asked 40 mm, 0.5, 1.2 deg)" in answer.message
    assert answer.message.endswith(f"; saved to {path}")
    assert_near_truth(Extrinsics(*graph.parameters(*RESULTS[:3])))
    stds = graph.parameters(*RESULTS[3:])
    assert all(std <= asked for std, asked in zip(stds, WIDE.values(), strict=True))
    saved = load_result(path).extrinsics

    answer = reset(graph)
    assert answer.success
    assert answer.message == f"the calibration is taken back; its file is kept as {path}.rejected"
    assert graph.parameters(*RESULTS) == [None] * 6
    assert {p.name for p in graph.latest(ParameterEvent, "extrinsics").deleted_parameters} >= set(RESULTS)
    assert load_result(f"{path}.rejected").extrinsics == saved
    graph.wait_for_diagnostics(lambda values, _: values["state"] == "uncalibrated")
    assert reset(graph).message == "there was no active calibration"


def test_a_call_that_misses_its_targets_is_in_force_where_none_was_and_the_next_one_is_not(graph, camera):
    set_parameters(graph, timeout_s=4.0, **WIDE | NARROW)
    with camera([rendered()]):
        first = graph.calibrate()
        assert first.success, first.message
        assert "; targets not reached with " in first.message
        assert ": the height has a std of " in first.message and "asked 0.01 mm: " in first.message
        assert "; activated all the same, as there was none; " in first.message
        assert "; saved to " in first.message
        before = graph.parameters(*RESULTS)
        set_parameters(graph, timeout_s=2.0)
        second = graph.calibrate()
    assert not second.success
    assert second.message.startswith("not activated, as the active one is no less certain (std ")
    assert graph.parameters(*RESULTS) == before


def test_a_call_that_runs_tells_how_far_it_is_and_ends_by_a_reset(graph, camera, node):
    set_parameters(graph, timeout_s=3000.0, **WIDE | NARROW)
    with camera([rendered()]):
        call = graph.start_calibrate()
        status = graph.wait_for_diagnostics(lambda values, _: int(values["call_frames_accepted"]) >= 2)
        values = {pair.key: pair.value for pair in status.values}
        assert status.message == f"calibrating: {values['call']}"
        assert values["call"].endswith("; asked 0.01 mm, 0.5, 1.2 deg")
        assert float(values["call_target_height_std_m"]) == 1e-5 < float(values["call_height_std_m"])
        answer = reset(graph)
        ended = wait_for(call)
    assert (ended.success, answer.success) == (False, True)
    assert ended.message.startswith("ended by ~/reset")
    assert answer.message == "the running call is ended; there was no active calibration"
    assert graph.parameters(*RESULTS) == [None] * 6
    assert " frames in 2 s; std " in node.output or " frames in 1 s; std " in node.output


def test_a_car_that_stands_may_be_good_enough(graph, camera):
    """One view of one road, with another noise of the pixels each time; texture shows that nothing moves."""
    scene, rng = named_scene("straight_road").scene, np.random.default_rng(4)
    grainy = replace(scene, road=replace(scene.road, texture_amplitude=30.0))
    once = render(grainy, rng)
    seen = [
        tuple(np.clip(image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8) for image in once)
        for _ in range(30)
    ]
    # Followed frames have landmarks every 0.3 s: a shorter call is over before they are compared.
    set_parameters(graph, timeout_s=LONG_S, frames=8, **WIDE)
    with camera(seen):
        answer = graph.calibrate()
    # Chance may set one of its frames aside as an outlier, so that one more is needed.
    reached = r" frames in [\d.]+ s of a standing car\b.*; targets reached with \d+ of "
    assert answer.success and re.search(reached, answer.message), answer.message
    assert "of a standing car" in answer.message
    values = np.array(graph.parameters(*RESULTS))
    assert np.all(np.abs(values[:3] - TRUTH.as_array()) < 3.0 * values[3:]), answer.message


def test_a_call_with_nothing_to_see_says_so(graph, camera):
    set_parameters(graph, timeout_s=2.0)
    with camera([blank()]):
        answer = graph.calibrate()
    assert not answer.success
    assert answer.message.startswith("no frame accepted, ") and "; last refusal: " in answer.message
    assert graph.parameters(*RESULTS) == [None] * 6
    answer = graph.calibrate()
    assert not answer.success and answer.message.startswith("no pair in 2.0 s: left 0.0 Hz, right 0.0 Hz")
