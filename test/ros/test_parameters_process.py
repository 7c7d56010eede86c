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

"""Parameters of the node over DDS: what it takes, refuses, and what a result is among them."""

import json
import math
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy")

import ros_graph
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.node import Node
from ros_graph import RESULTS, Camera, NodeProcess, rendered

from stereo_selfcal.files.result_file import load_result


def test_result_file_is_a_parameter_file_of_any_node(graph, start, tmp_path):
    path = tmp_path / "out.yaml"
    start({"output_path": path})
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    node = Node(
        "any_node",
        cli_args=["--ros-args", "--params-file", str(path)],
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        saved = load_result(path)
        assert node.get_parameter("extrinsics.height_m").value == saved.extrinsics.height_m
        assert node.get_parameter("extrinsics.roll_std_rad").value == saved.std.roll_rad
        assert node.get_parameter("provenance.source").value == saved.provenance["source"]
        assert node.get_parameter("provenance.rig.width").value == 640
    finally:
        node.destroy_node()


def test_result_file_among_the_nodes_own_parameters_is_no_result(graph, start, tmp_path):
    """Old extrinsics must not be taken for a calibration of this run."""
    path = tmp_path / "old.yaml"
    path.write_text("/**: {ros__parameters: {extrinsics: {height_m: 9.0}, provenance: {schema: 1}}}")
    start(arguments=["--params-file", str(path)])
    assert graph.parameters(*RESULTS) == [None] * 6


def arguments_of(parameters):
    """Return the arguments of the node that set parameters."""
    given = {"output_path": "''", **parameters}
    return ["--ros-args", *(word for name, value in given.items() for word in ("-p", f"{name}:={value}"))]


# How the node ends: started with these parameters, in this line.
WRONG_PARAMETERS = [
    ({"timeout_s": -1.0}, "timeout_s is -1.0: it must lie in 0.1 ... 3600 s"),
    ({"timeout_s": "soon"}, "timeout_s is 'soon': a value of type float is needed"),
    ({"frames": 0}, "frames is 0: it must lie in 1 ... 10000"),
    ({"rig.cx": ".nan"}, "rig.cx is nan: it must lie in"),
    ({"image_transport": "theora"}, "is 'theora': it must be one of raw, compressed; have others republ"),
    ({"rectified": False, "rig.fx": 500.0}, "rig.fx is set, but rectified is false: rig.* describes"),
    ({"road_frame": "''"}, "road_frame is empty"),
    ({"publish_tf": True, "road_frame": "/road"}, "frames of /tf_static do not begin with a slash"),
    ({"search.height_min_m": 6.0}, "the first must be the smaller"),
]
WRONG_ARGUMENTS = [
    (["--params-file", "/nowhere.yaml"], "Couldn't parse params file: '--params-file /nowhere.yaml'"),
    (["-r", "left"], "Couldn't parse remap rule: '-r left'"),
    (["--no-such-flag"], "--no-such-flag"),
]
STARTS = [arguments_of(parameters) for parameters, _ in WRONG_PARAMETERS]
STARTS += [["--ros-args", *arguments] for arguments, _ in WRONG_ARGUMENTS]

# Starts the node with each of some lists of arguments, in a copy of a process that has imported it, and tells
# how it ended.
START_ALL = """
import json, os, sys, tempfile
from stereo_selfcal.ros import node

ends = []
for arguments in json.loads(sys.argv[1]):
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
            sys.exit(node.main(arguments))
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        ends.append((status, said.read().decode()))
print(json.dumps(ends))
"""


@pytest.fixture(scope="module")
def ends():
    """Return how the node ends with each of STARTS: status and output."""
    command = [sys.executable, "-c", START_ALL, json.dumps(STARTS)]
    run = subprocess.run(command, cwd=ros_graph.ROOT, capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


@pytest.mark.parametrize(("parameters", "words"), WRONG_PARAMETERS)
def test_wrong_parameter_at_the_start_is_one_line(ends, parameters, words):
    status, output = ends[STARTS.index(arguments_of(parameters))]
    assert status == 2
    (line,) = [line for line in output.splitlines() if line.startswith("stereo_selfcal: ")]
    assert words in line


def test_wrong_parameter_ends_a_process_of_its_own(start):
    parameters, words = WRONG_PARAMETERS[0]
    process = start(parameters)
    assert process.wait() == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith("stereo_selfcal: ")]
    assert words in line


@pytest.mark.parametrize(("arguments", "words"), WRONG_ARGUMENTS)
def test_wrong_ros_arguments_are_one_line(ends, arguments, words):
    status, output = ends[STARTS.index(["--ros-args", *arguments])]
    assert status == 2
    (line,) = [line for line in output.splitlines() if line.startswith("stereo_selfcal: ")]
    assert "wrong ROS arguments: " in line and words in line


def test_whole_numbers_are_taken_for_floats(graph, start):
    start({"timeout_s": 7})
    assert graph.parameters("timeout_s") == [7.0]
    assert graph.set_parameter("timeout_s", 8).successful
    assert graph.parameters("timeout_s") == [8.0]


def test_wrong_values_are_refused_with_a_reason_and_change_nothing(graph, start):
    start()
    before = graph.parameters("timeout_s", "frames", "seed", "search.height_min_m", "image_transport")
    for name, value, words in (
        ("timeout_s", math.nan, "out of range"),
        ("timeout_s", 0.0, "out of range"),
        ("timeout_s", "soon", "Wrong parameter type"),
        ("frames", 0, "out of range"),
        ("seed", -1, "out of range"),
        ("search.height_min_m", 19.0, "search.height_min_m is 19.0, search.height_max_m is 4.0"),
        ("image_transport", "compressed", "read-only"),
        ("road_frame", "", "road_frame is empty"),
        ("extrinsics.height_m", 1.0, "extrinsics.height_m is a result: it is set by ~/calibrate alone"),
        ("no_such_parameter", 1, "undeclared"),
    ):
        outcome = graph.set_parameter(name, value)
        assert not outcome.successful
        assert words in outcome.reason
    assert graph.parameters("timeout_s", "frames", "seed", "search.height_min_m", "image_transport") == before
    assert graph.parameters("extrinsics.height_m") == [None]


def test_results_cannot_be_deleted(graph, start):
    start()
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
    unset = Parameter(name="extrinsics.height_m", value=ParameterValue(type=ParameterType.PARAMETER_NOT_SET))
    assert not graph.set_parameter("extrinsics.height_m", unset).successful
    assert graph.parameters("extrinsics.height_m") != [None]


def test_malformed_request_does_not_end_the_node(tmp_path, graph):
    with NodeProcess(tmp_path) as process:
        broken = Parameter(name="timeout_s", value=ParameterValue(type=99))
        request = ros_graph.SetParameters.Request(parameters=[broken])
        graph.start(ros_graph.SetParameters, "set_parameters", request)
        deadline = time.monotonic() + ros_graph.PATIENCE_S
        while "99 is not a valid" not in process.output and time.monotonic() < deadline:
            time.sleep(0.1)
        assert graph.parameters("frames") == [1]
        assert process.end() == 0
