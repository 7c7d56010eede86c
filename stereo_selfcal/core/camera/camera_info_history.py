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

"""CameraInfo as a stream beside the images: which message holds for which image."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

from .camera_info import content_of, is_uncalibrated, used_values
from .pairing import message_stamp_ns


class _ArrivedInfo(NamedTuple):
    stamp_ns: int
    arrived_ns: int
    info: Any


# So many messages in turn that are only two: A, B, A, B. Cameras that were changed do not come back twice.
_ALTERNATING = 4


class CameraInfoHistory:
    """The recent CameraInfo of one camera. Not safe for concurrent use; the caller locks.

    An image has the CameraInfo of its own stamp; without one, the last one before it. Images from before the
    first calibrated CameraInfo have that one: a driver that starts may send zeros at first.

    Args:
        keep_ns: How long a CameraInfo is kept after a newer one has arrived [ns]; longer than an image may
            arrive later than its CameraInfo.
        rectified: Whether the images are rectified; of the CameraInfo of raw ones more is used.
        calibrated: Whether there was a calibrated one before.
    """

    def __init__(self, keep_ns: int, rectified: bool = True, calibrated: bool = False) -> None:
        self._keep_ns, self._rectified = keep_ns, rectified
        self._turns: deque[tuple[tuple[Any, ...] | None, _ArrivedInfo]] = deque(maxlen=_ALTERNATING)
        self._content: bytes | None = None
        self._entries: deque[_ArrivedInfo] = deque()
        self._calibrated = calibrated

    @property
    def last(self) -> Any | None:
        """The message that arrived last, None where none came."""
        return self._entries[-1].info if self._entries else None

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the message that arrived last [ns]."""
        return self._entries[-1].stamp_ns if self._entries else None

    def add(self, info: Any, arrived_ns: int) -> None:
        """Take a message.

        Args:
            info: Anything with the fields of sensor_msgs/CameraInfo.
            arrived_ns: When it arrived or was recorded [ns]; never less than that of the one before.
        """
        if not self._calibrated:
            self._forget_turns()
            self._entries.clear()  # what came before the first calibrated one says nothing
            self._calibrated = not is_uncalibrated(info)
        self._entries.append(_ArrivedInfo(message_stamp_ns(info), arrived_ns, info))
        content = content_of(info)
        if content is None or content != self._content:  # nearly all are equal, which is cheap to see
            self._content = content
            used = used_values(info, self._rectified)
            if not self._turns or self._turns[-1][0] != used:
                self._turns.append((used, self._entries[-1]))
        while len(self._entries) > 1 and self._entries[1].arrived_ns < arrived_ns - self._keep_ns:
            self._entries.popleft()

    @property
    def alternating(self) -> tuple[Any, Any] | None:
        """Two messages that have alternated lately, as those of two publishers on one topic; else None."""
        if len(self._turns) < _ALTERNATING:
            return None
        values = [used for used, _ in self._turns]
        newest = self._turns[-1][1]
        lately = self._turns[0][1].arrived_ns >= self._entries[-1].arrived_ns - self._keep_ns
        if not lately or values[0] != values[2] or values[1] != values[3]:
            return None
        return self._turns[-2][1].info, newest.info

    def has(self, stamp_ns: int) -> bool:
        """Whether there is a message of this stamp."""
        return any(entry.stamp_ns == stamp_ns for entry in self._entries)

    def at(self, stamp_ns: int, arrived_ns: int) -> Any | None:
        """Return the message that holds for an image, None where none has come yet.

        Where all stamps are later than the image's, the clocks differ, and the order of arrival decides.

        Args:
            stamp_ns: Stamp of the image [ns].
            arrived_ns: When it arrived [ns], by the clock of :meth:`add`.
        """
        older = [entry for entry in self._entries if entry.stamp_ns <= stamp_ns]
        if older:
            newest_ns = max(entry.stamp_ns for entry in older)
            older = [entry for entry in older if entry.stamp_ns == newest_ns]
        # Of several with one stamp (or with none that is right) the last one that had arrived.
        found: Any | None = None
        for entry in older or self._entries:
            if found is None or entry.arrived_ns <= arrived_ns:
                found = entry.info
        return found

    def clear(self) -> None:
        """Forget all."""
        self._forget_turns()
        self._entries.clear()
        self._calibrated = False

    def _forget_turns(self) -> None:
        self._turns.clear()
        self._content = None
