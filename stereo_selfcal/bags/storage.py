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

"""What every kind of storage file gives: its topics, and their messages as bytes."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple, Protocol

from .errors import BagError
from .limits import MOST_DEFINITION_BYTES, size_text
from .topics import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE

# Types of the messages that are read.
MESSAGE_TYPES = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO)

CDR = "cdr"
ROS1 = "ros1"


class Channel(NamedTuple):
    """A recorded topic.

    Attributes:
        key: What the storage knows it by.
        topic: Its name.
        msgtype: Its type, in ROS 2's spelling.
        msgcount: Number of messages.
        serialization: ``cdr`` or ``ros1``; others cannot be read.
        definition: Text of the type's definition, "" where the storage has none.
        is_idl: Whether the definition is IDL.
    """

    key: int
    topic: str
    msgtype: str
    msgcount: int
    serialization: str = CDR
    definition: str = ""
    is_idl: bool = False


class RawMessage(NamedTuple):
    """A message as it was recorded.

    Attributes:
        recorded_ns: When [ns].
        channel: Of which topic.
        data: Its bytes.
    """

    recorded_ns: int
    channel: Channel
    data: bytes


class Storage(Protocol):
    """A storage file, open.

    Attributes:
        channels: Its topics.
        start_ns: When its first message was recorded [ns].
        end_ns: A nanosecond after the last one [ns]; less than the start where there is none.
    """

    channels: list[Channel]
    start_ns: int
    end_ns: int

    def messages(
        self, channels: Collection[Channel], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        """Yield the messages of channels from ``start_ns`` to before ``stop_ns``, in the order of time."""

    def close(self) -> None:
        """Close the file."""


def checked_definition(msgtype: str, definition: str) -> str:
    """Return the definition of a type where it is needed, "" otherwise.

    Args:
        msgtype: The type.
        definition: Its text.

    Raises:
        BagError: It is longer than any.
    """
    if msgtype not in MESSAGE_TYPES:
        return ""
    if len(definition) > MOST_DEFINITION_BYTES:
        raise BagError(
            f"its definition of {msgtype} has {size_text(len(definition))}, at most "
            f"{size_text(MOST_DEFINITION_BYTES)} are read"
        )
    return definition
