"""What the tests of the node share: a graph to talk to it, and the node as a process."""

import pytest
from ros_graph import Graph, NodeProcess


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
