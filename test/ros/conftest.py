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

"""What the tests of the node share: a graph to talk to it, and the node as a process."""

from pathlib import Path

import pytest
from ros_graph import Graph, NodeProcess

HERE = Path(__file__).parent
SLOW = ("_process", "_demo", "_fuzz", "_faults", "_node_watch", "_inputs_taking")


def pytest_collection_modifyitems(items):
    """Mark as slow what starts the node and waits for it, here or in a process, and what draws inputs."""
    for item in items:
        if item.path.parent == HERE and item.path.stem.endswith(SLOW):
            item.add_marker("slow")


@pytest.fixture(scope="module")
def graph():
    graph = Graph()
    yield graph
    graph.close()


@pytest.fixture
def start(tmp_path):
    """Start the node; it is ended after the test, cleanly."""
    processes = []

    def start(parameters=None, arguments=()):
        processes.append(NodeProcess(tmp_path, parameters, arguments))
        return processes[-1]

    yield start
    for process in processes:
        if process.process.poll() is None:
            assert process.end() == 0, process.output
        assert "Traceback" not in process.output and "xception" not in process.output, process.output
