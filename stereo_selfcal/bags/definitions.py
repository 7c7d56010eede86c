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

"""The message types that are read. A recording with other definitions of them would be misread."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from .errors import BagError
from .storage import CDR, MESSAGE_TYPES, Channel

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

# Types within the messages. None has changed since the first ROS 2, nor since ROS 1 but for Header.
_PART_TYPES = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/RegionOfInterest")
_IDL_SEPARATOR = "=" * 80 + "\n"


def deserialize(channel: Channel, data: bytes) -> Any:
    """Return a message.

    Args:
        channel: Of which topic.
        data: Its bytes, unpacked.

    Raises:
        SerdeError: The bytes are no such message.
    """
    if channel.serialization == CDR:
        return _types(Stores.ROS2_JAZZY).deserialize_cdr(data, channel.msgtype)
    return _types(Stores.ROS1_NOETIC).deserialize_ros1(data, channel.msgtype)


def check_definitions(channels: Iterable[Channel]) -> None:
    """Refuse a recording in which a type that is read is defined otherwise than in ROS.

    Older recordings have no definitions; there is nothing to compare.

    Args:
        channels: Topics of the recording.

    Raises:
        BagError: A definition differs.
    """
    for channel in channels:
        if channel.msgtype in MESSAGE_TYPES and channel.definition:
            _check(channel.msgtype, channel.definition, channel.is_idl, channel.serialization == CDR)


@lru_cache(maxsize=64)
def _check(msgtype: str, definition: str, is_idl: bool, is_ros2: bool) -> None:
    theirs: dict[str, Any] = {}
    if is_idl:
        parts = definition.split(_IDL_SEPARATOR)
        # Several are written one after the other, each below a line with its name.
        texts = [part.partition("\n")[2] for part in parts if part.startswith("IDL: ")] or [definition]
        for text in texts:
            theirs |= get_types_from_idl(text)
    else:
        theirs |= get_types_from_msg(definition, msgtype)
    ours = _types(Stores.ROS2_JAZZY if is_ros2 else Stores.ROS1_NOETIC).fielddefs
    if msgtype not in theirs:
        raise BagError(f"its definition of {msgtype} defines something else")
    for name in (msgtype, *_PART_TYPES):
        if name not in theirs:
            continue
        fields, expected = theirs[name][1], ours[name][1]
        for field, kind in expected:
            if (field, kind) not in fields:
                raise BagError(f"its definition of {name} has another field than {field}")
        if len(fields) != len(expected):
            raise BagError(f"its definition of {name} has {len(fields)} fields, {len(expected)} are known")


@lru_cache(maxsize=2)
def _types(store: Stores) -> Typestore:
    return get_typestore(store)
