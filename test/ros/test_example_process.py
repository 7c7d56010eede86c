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

"""examples/call_node.py: a client of the node that knows nothing of this package."""

import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

import ros_graph
from ros_graph import PATIENCE_S, Camera, rendered


def call_node():
    return subprocess.run(
        [sys.executable, str(ros_graph.ROOT / "examples" / "call_node.py")],
        capture_output=True,
        text=True,
        timeout=2 * PATIENCE_S,
        check=False,
    )


def test_the_client_of_the_node_prints_its_answer_and_the_pose(graph, start):
    start()
    with Camera(graph, [rendered()]):
        run = call_node()
    assert run.returncode == 0, run.stderr
    answer, place, std = run.stdout.splitlines()
    assert answer.startswith("calibrated from 1 frame: height 1.4")
    assert place.startswith("in road: x 0.000 m, y 0.000 m, z 1.4")
    assert std.startswith("std: z 0.0")


def test_the_client_of_the_node_prints_why_there_is_none(graph, start):
    start({"timeout_s": 1.0})
    run = call_node()
    assert run.returncode == 1, run.stderr
    assert "no pair in 1.0 s" in run.stdout
