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
