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
