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

"""The topics of several bags, their messages in order, and which pairs of cameras have a baseline."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cache
from heapq import merge
from itertools import islice

from ..core.camera.camera_info import CameraModel, is_uncalibrated
from ..core.errors import RigError
from .errors import BagError
from .part import Message, Part
from .topics import HasBaseline, StereoTopics, Topic, find_camera_info

_LOOKED_AT = 20  # CameraInfo of a camera, until one is calibrated


def in_order(
    parts: Iterable[Part], topics: Collection[Topic], start_ns: int | None, stop_ns: int | None
) -> Iterator[Message]:
    """Yield messages in the order of the recording; of two at one time that of the earlier bag first."""
    streams = (part.messages(topics, start_ns, stop_ns) for part in parts)
    return merge(*streams, key=lambda message: message.recorded_ns)


def topics_of(parts: Iterable[Part]) -> list[Topic]:
    """Return the topics of bags, each once, with all of its messages."""
    counts: dict[tuple[str, str], int] = {}
    for connection in (c for part in parts for c in part.connections):  # a topic may have several publishers
        key = (connection.topic, connection.msgtype)
        counts[key] = counts.get(key, 0) + connection.msgcount
    return [Topic(*key, count) for key, count in counts.items()]


def baseline_reader(parts: Sequence[Part]) -> HasBaseline:
    """Return what says whether the CameraInfo of a pair has a baseline, None where it does not say."""

    @cache
    def shift_px_m(topic: Topic) -> float | None:
        for message in islice(in_order(parts, [topic], None, None), _LOOKED_AT):
            if not is_uncalibrated(message.content):
                return CameraModel.read(message.content, "left").p[3]
        return None

    def has_baseline(pair: StereoTopics) -> bool | None:
        try:
            left, right = map(shift_px_m, find_camera_info(topics_of(parts), pair))
        except (BagError, RigError):  # told where they are used
            return None
        return None if left is None or right is None else left != right

    return has_baseline
