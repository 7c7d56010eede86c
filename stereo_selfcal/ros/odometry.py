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

"""Subscriptions to odometry and to a gyroscope, where the parameters name them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import Imu

from ..core.drive.turn_topics import TurnMessage
from ..core.errors import ConfigError, one_line
from .config import NodeConfig

_QUEUE = 50  # of a gyroscope of 400 Hz, for an eighth of a second
_QOS = QoSProfile(depth=_QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT)


class TurnInput:
    """Hears of the turns of the car while somebody wants it: a gyroscope sends hundreds of messages a second.

    Args:
        node: The node.
        config: Its configuration at the start.

    Raises:
        ConfigError: The name of a topic cannot be one.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._node = node
        asked = (
            ("odometry_topic", config.odometry_topic, Odometry),
            ("imu_topic", config.imu_topic, Imu),
        )
        self._streams = [
            (name.strip(), _full_name(node, parameter, name.strip()), message_type)
            for parameter, name, message_type in asked
            if name.strip()
        ]

    @property
    def topics(self) -> tuple[str, ...]:
        """Full names of the topics."""
        return tuple(topic for _, topic, _ in self._streams)

    @contextmanager
    def heard_by(self, hear: Callable[[TurnMessage], None]) -> Iterator[None]:
        """Subscribe as long as the context lasts.

        Args:
            hear: Called with each message, by the threads of the executor, one at a time.
        """
        group = MutuallyExclusiveCallbackGroup()

        def received(topic: str, message: Any) -> None:
            hear(TurnMessage.read(topic, message))

        with ExitStack() as subscribed:
            for name, topic, message_type in self._streams:
                subscription = self._node.create_subscription(
                    message_type, name, partial(received, topic), _QOS, callback_group=group
                )
                subscribed.callback(self._node.destroy_subscription, subscription)
            yield


def _full_name(node: Node, parameter: str, name: str) -> str:
    """Return the full name of a topic, remapped.

    Raises:
        ConfigError: It cannot be one.
    """
    try:
        return str(node.resolve_topic_name(name))
    except (InvalidTopicNameException, RuntimeError) as error:  # the base class of those of rcl
        why, _, _ = one_line(error).partition(", at ")
        raise ConfigError(
            f"{parameter} is {name!r}: {why}; give the name of a topic, or leave it empty"
        ) from error
