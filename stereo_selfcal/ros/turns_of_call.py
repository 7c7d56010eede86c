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

"""Odometry and a gyroscope, as a call of ``~/calibrate`` hears them. Needs no ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

from ..core.calibrator import Calibrator
from ..core.drive.turn_topics import TurnMessage, TurnTopics

# Messages that wait for the next pair of images: those of a gyroscope of 400 Hz in half a minute.
_MOST_WAITING = 12_000


class TurnsOfCall:
    """Keeps what has come until the next frame, and what each topic has said so far.

    Args:
        topics: Full names of the topics.
    """

    def __init__(self, topics: Sequence[str] = ()) -> None:
        self._topics = TurnTopics(topics)
        self._named = bool(topics)
        self._waiting: deque[TurnMessage] = deque(maxlen=_MOST_WAITING)

    def hear(self, message: TurnMessage) -> None:
        """Take a message; any thread may give one."""
        self._waiting.append(message)

    def pass_on(self, calibrator: Calibrator) -> None:
        """Give a calibrator what has come since the frame before; to be called before the next one."""
        for message in self._come():
            if message.rate is not None:
                calibrator.note_turn_rate(message.rate)

    def doubts(self, calibrator: Calibrator | None) -> tuple[str, ...]:
        """Return sentences on what is wrong with a topic, as far as the frames of a calibrator show it."""
        if not self._named:
            return ()
        deque(self._come(), maxlen=0)  # what has come after the last frame
        return self._topics.doubts(() if calibrator is None else calibrator.travel_steps)

    def _come(self) -> Iterator[TurnMessage]:
        while self._waiting:
            message = self._waiting.popleft()
            self._topics.note(message)
            yield message
