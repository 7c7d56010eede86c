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

"""Messages are taken in a thread of their own: all that came, by turns, and whatever a callback raises."""

import itertools
import threading

import pytest

pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_graph import wait_until
from std_msgs.msg import Int32

from stereo_selfcal.ros.taking import MessageTaker, TakenElsewhere

NAMES = itertools.count()
SIDES = ("left", "right")


class Taken:
    """Two subscriptions whose messages a taker takes while ``wanted``; the graph's node publishes them."""

    def __init__(self, graph):
        self.node, self.heard, self.wanted = Node(f"taken_{next(NAMES)}"), [], True
        self.graph = graph
        topics = [f"/{self.node.get_name()}/{side}" for side in SIDES]
        self.publishers = [graph.node.create_publisher(Int32, topic, 10) for topic in topics]
        self.subscriptions = [
            self.node.create_subscription(Int32, topic, self.received, 10, callback_group=TakenElsewhere())
            for topic in topics
        ]
        self.taker = MessageTaker(self.node, lambda: self.subscriptions if self.wanted else [])
        # One that spins the node as well, as in the process.
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.spinning = threading.Thread(target=self.executor.spin, daemon=True)

    def received(self, message):
        self.heard.append((message.data, threading.current_thread().name))
        if message.data < 0:
            raise ValueError("a callback that fails")

    def __enter__(self):
        self.spinning.start()
        wait_until(
            lambda: all(publisher.get_subscription_count() for publisher in self.publishers), "subscriptions"
        )
        return self

    def __exit__(self, *_):
        self.taker.stop()
        self.executor.shutdown()
        self.spinning.join()
        self.graph.destroy(self.graph.node.destroy_publisher, *self.publishers)
        self.node.destroy_node()

    def send(self, side, *values):
        for value in values:
            self.publishers[side].publish(Int32(data=value))

    def wait_for(self, *values):
        wait_until(lambda: len(self.heard) >= len(values), f"{values}")
        assert tuple(value for value, _ in self.heard) == values

    def kept(self):
        """Wait until DDS has what was sent; within a process it is handed over at once."""
        threading.Event().wait(0.3)


def test_messages_are_taken_by_turns_and_by_no_executor(graph):
    with Taken(graph) as taken:
        taken.send(0, 1, 3, 5)
        taken.send(1, 2, 4)
        taken.kept()
        assert not taken.heard
        taken.taker.start()
        taken.wait_for(1, 2, 3, 4, 5)
        assert {thread for _, thread in taken.heard} == {"images"}


def test_what_is_wanted_later_is_taken_from_then_on(graph):
    with Taken(graph) as taken:
        taken.wanted = False
        taken.taker.start()
        taken.send(0, 1)
        taken.kept()
        assert not taken.heard
        taken.wanted = True
        taken.taker.wake()
        taken.wait_for(1)


def test_a_callback_that_fails_does_not_end_it(graph, capfd):
    with Taken(graph) as taken:
        taken.taker.start()
        taken.send(0, -1)
        taken.wait_for(-1)
        taken.send(1, 2)
        taken.wait_for(-1, 2)
    assert "a callback that fails" in capfd.readouterr().err


def test_a_subscription_may_be_destroyed_while_it_is_waited_for(graph):
    with Taken(graph) as taken:
        taken.taker.start()
        taken.send(0, 1)
        taken.wait_for(1)
        gone = taken.subscriptions.pop(0)
        taken.node.destroy_subscription(gone)
        taken.taker.wake()
        taken.send(0, 2)
        taken.send(1, 3)
        taken.wait_for(1, 3)


def test_one_that_is_stopped_takes_nothing_more(graph):
    with Taken(graph) as taken:
        taken.taker.start()
        taken.taker.stop()
        taken.taker.stop()  # nor does it mind
        taken.taker.wake()
        taken.send(0, 1)
        taken.kept()
        assert not taken.heard


def test_one_that_was_never_started_stops(graph):
    with Taken(graph):
        pass
