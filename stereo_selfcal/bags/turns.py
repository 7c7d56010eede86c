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

"""Topics of odometry and of gyroscopes: their messages, between those of the images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..core.drive.turn_topics import TurnMessage
from .errors import BagError
from .part import Message
from .topics import Topic

ODOMETRY, IMU = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"


def find_turn_topics(topics: Sequence[Topic], odometry: str | None, imu: str | None) -> tuple[Topic, ...]:
    """Return the topics that a user named. None is looked for that nobody has asked for.

    Args:
        topics: All topics of the recording.
        odometry: Name of the topic of nav_msgs/Odometry, None for none.
        imu: The same of sensor_msgs/Imu.

    Raises:
        BagError: There is no message on such a topic.
    """
    asked = (("--odometry", odometry, ODOMETRY), ("--imu", imu, IMU))
    return tuple(
        _named_turn_topic(topics, option, name, kind) for option, name, kind in asked if name is not None
    )


def _named_turn_topic(topics: Sequence[Topic], option: str, name: str, kind: str) -> Topic:
    full = f"/{name.strip('/')}"
    of_kind = [topic for topic in topics if topic.msgtype == kind and topic.count]
    for topic in of_kind:
        if topic.name == full:
            return topic
    there = ", ".join(sorted({topic.msgtype for topic in topics if topic.name == full}))
    what = f"it is of {there}, {kind} is read" if there else f"no message on such a topic of {kind}"
    listed = ", ".join(sorted(topic.name for topic in of_kind)) or "none"
    raise BagError(f"{option} {name}: {what}; topics of that type: {listed}")


class TurnsBetweenFrames:
    """Takes the messages of topics with turn rates out of a recording, and keeps them until the next frame.

    Args:
        topics: The topics.
    """

    def __init__(self, topics: Sequence[Topic]) -> None:
        self.topics = tuple(topics)
        self._names = {topic.name for topic in topics}
        self._kept: list[TurnMessage] = []

    def taken_out(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield the other messages, in their order.

        Args:
            messages: Messages of these topics and of others.
        """
        self._kept = []
        for message in messages:
            if message.topic in self._names:
                self._kept.append(TurnMessage.read(message.topic, message.content))
            else:
                yield message

    def take(self) -> tuple[TurnMessage, ...]:
        """Return those that have come since it was asked last."""
        kept, self._kept = tuple(self._kept), []
        return kept
