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

"""Images are taken while they are wanted and not in between, though the subscriptions stay."""

import threading
import time

import pytest

pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_graph import PATIENCE_S, Camera, rendered, stamp_of, wait_until

from stereo_selfcal.ros import memory
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.inputs import StereoInput

CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})
OVERRIDE = "qos_overrides./left/image_rect.subscription.history"


class Input:
    """An input on a node of its own, spun in a thread; nobody calls its tick() but the test."""

    def __init__(self, **overrides):
        self.node = Node(
            "taker", parameter_overrides=[Parameter(name, value=value) for name, value in overrides.items()]
        )
        self.source = StereoInput(self.node, CONFIG)
        self.source.start()
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.source.stop()
        self.executor.shutdown()
        self.thread.join()
        self.node.destroy_node()

    def finish_probe(self):
        """Wait for the end of the probe at the start."""

        def over():
            self.source.tick()
            return self.source.window is None

        wait_until(lambda: self.arrived, "images")
        wait_until(over, "the end of a probe")

    @property
    def arrived(self):
        counts = self.source.state.counts
        return counts.left + counts.right

    def pair(self):
        """Take one pair, as the watch does."""
        self.source.begin()
        try:
            return self.source.next_pair(PATIENCE_S)
        finally:
            self.source.end()


class Counted(Camera):
    """Remembers how many images it has published."""

    published = 0

    def _publish(self, publisher, message, stamp_ns):
        super()._publish(publisher, message, stamp_ns)
        self.published += publisher in self.images.values()
        self.stamp_ns = stamp_ns


def wait_for_more(camera, n):
    last = camera.published + n
    wait_until(lambda: camera.published >= last, f"{n} images more")


def test_nothing_is_taken_between_two_moments_and_then_nothing_old(graph):
    with Counted(graph, [rendered()]) as camera, Input() as taker:
        taker.finish_probe()
        assert taker.pair() is not None
        wait_for_more(camera, 2)  # one may have been in a callback
        before = taker.arrived
        wait_for_more(camera, 20)
        assert taker.arrived == before
        assert all(publisher.get_subscription_count() == 1 for publisher in camera.images.values())
        newest_ns, two_periods_ns = camera.stamp_ns, stamp_of(2) - stamp_of(0)
        # DDS keeps five, and gives the oldest first; some time on the way is allowed.
        assert taker.pair().stamp_ns >= newest_ns - two_periods_ns


def test_who_asks_dds_to_keep_all_images_has_them_all_taken(graph):
    """They would wait there without end."""
    with Counted(graph, [rendered()]) as camera, Input(**{OVERRIDE: "keep_all"}) as taker:
        taker.finish_probe()
        assert taker.pair() is not None
        before = taker.arrived
        wait_for_more(camera, 8)
        wait_until(lambda: taker.arrived > before + 2, "images that nobody wants")


def test_heap_is_trimmed_once_after_a_probe(graph, monkeypatch):
    trimmed = []
    monkeypatch.setattr(memory, "trim_heap", lambda: trimmed.append(time.monotonic()))
    with Camera(graph, [rendered()]), Input() as taker:
        taker.finish_probe()
        assert not trimmed, "an image may still be in a callback"
        for _ in range(5):
            taker.source.tick()
        assert len(trimmed) == 1
