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

"""Plays the stereo camera of a recording on ROS topics, in a loop, with unchanged messages."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from ..bags import StereoBag
from ..bags.topics import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, StereoTopics
from .shutdown import silent_after_shutdown

_TYPES = {IMAGE: Image, COMPRESSED_IMAGE: CompressedImage, CAMERA_INFO: CameraInfo}
_NS_PER_S = 1_000_000_000
_QUEUE = 10
# Pause between two passes, about one frame of a slow camera.
_PAUSE_S = 0.1


class BagPlayer:
    """Publishes images and CameraInfo of a rosbag2 recording under their recorded names.

    Messages are sent as they were recorded, at the pace of the recording. Their stamps are not changed, so
    they jump back with every pass, as with ``ros2 bag play --loop``.

    Args:
        node: Node to publish from.
        path: A rosbag2 recording.

    Raises:
        BagError: The recording cannot be read or has no stereo pair.
    """

    def __init__(self, node: Node, path: Path) -> None:
        self._path = path
        self._context = node.context
        with StereoBag(path) as bag:
            self.topics: StereoTopics = bag.topics
        sides = (self.topics.left, self.topics.right)
        kinds = {side.name: side.msgtype for side in sides} | {
            side.camera_info: CAMERA_INFO for side in sides
        }
        self._publishers: dict[str, Publisher] = {
            topic: node.create_publisher(_TYPES[kind], topic, _QUEUE) for topic, kind in kinds.items()
        }
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bag player", daemon=True)

    @property
    def is_heard(self) -> bool:
        """Whether somebody listens to every image."""
        images = (self._publishers[side.name] for side in (self.topics.left, self.topics.right))
        return all(publisher.get_subscription_count() for publisher in images)

    def start(self) -> None:
        """Play until :meth:`stop`, in a thread of its own."""
        self._thread.start()

    def stop(self) -> None:
        """End playing and wait for the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def play_once(self) -> None:
        """Publish every message once; returns early when stopped."""
        previous_ns: int | None = None
        for topic, stamp_ns, data in self._messages():
            pause_s = 0.0 if previous_ns is None else max(0, stamp_ns - previous_ns) / _NS_PER_S
            previous_ns = stamp_ns
            if self._stop.wait(pause_s):
                return
            self._publishers[topic].publish(data)

    def _run(self) -> None:
        with silent_after_shutdown(self._context):
            while not self._stop.wait(_PAUSE_S):
                self.play_once()

    def _messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Yield (topic, time of the recording [ns], serialized message)."""
        with AnyReader([self._path]) as reader:
            connections = [c for c in reader.connections if c.topic in self._publishers]
            for connection, stamp_ns, data in reader.messages(connections=connections):
                yield connection.topic, stamp_ns, bytes(data)
