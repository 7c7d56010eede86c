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

"""The images between their arrival and whoever wants them: pairing, waiting, statistics. Needs no ROS."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ..core.camera.frozen import checksum
from ..core.camera.pairing import PairCounts, StampedPair, StampPairer, message_stamp_ns
from ..core.camera.stamp_pattern import StampPattern
from ..core.geometry.homography import Side
from .config import NodeConfig
from .pair_source import InputState
from .subscription_schedule import SubscriptionSchedule

_MAX_ENCODING_LENGTH = 80  # of what is reported once a second; a message may hold any text


@dataclass(frozen=True, slots=True)
class IntakeWindow:
    """A span of time in which images are taken without a pause; rates are measured within one.

    It begins with the first image that arrives. Until there is one, it begins when images were to be taken.

    Attributes:
        counts: Images and pairs up to its beginning.
        since_s: Steady time of its beginning [s].
    """

    counts: PairCounts
    since_s: float


@dataclass(frozen=True, slots=True)
class ImageFormat:
    """How an image arrives.

    Attributes:
        width: Width [px], 0 for a compressed image.
        height: Height [px], 0 for a compressed image.
        encoding: Encoding of a raw image, format of a compressed one.
        frame_id: Frame of the camera, as the image has it.
    """

    width: int
    height: int
    encoding: str
    frame_id: str = ""

    @classmethod
    def of(cls, message: Any) -> ImageFormat:
        """Return the format of a sensor_msgs/Image or CompressedImage."""
        frame = str(message.header.frame_id)
        if hasattr(message, "format"):
            return cls(0, 0, str(message.format)[:_MAX_ENCODING_LENGTH], frame)
        encoding = str(message.encoding)[:_MAX_ENCODING_LENGTH]
        return cls(int(message.width), int(message.height), encoding, frame)

    @property
    def is_raw(self) -> bool:
        """Whether the size is known, as it is of raw images."""
        return self.width > 0

    def __str__(self) -> str:
        return f"{self.width} x {self.height} {self.encoding}" if self.is_raw else self.encoding


class PairQueue:
    """Hands pairs from the thread that receives them to the thread that waits for them.

    When it is full, the oldest pairs are dropped: the calibrator is slower than the camera then.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._pairs: deque[StampedPair[Any]] = deque()
        self._closed = self._interrupted = False

    @property
    def closed(self) -> bool:
        """Whether :meth:`close` was called."""
        return self._closed

    def resize(self, size: int) -> None:
        """Set how many pairs are kept."""
        with self._changed:
            self._pairs = deque(self._pairs, maxlen=size)

    def put(self, pairs: Iterable[StampedPair[Any]]) -> None:
        """Add pairs and wake whoever waits."""
        with self._changed:
            self._pairs.extend(pairs)
            self._changed.notify_all()

    def get(self, timeout_s: float) -> StampedPair[Any] | None:
        """Wait for the oldest pair; None when none came in time, or nobody is to wait any more.

        Args:
            timeout_s: How long to wait [s]; 0 returns at once.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._pairs or self._closed or self._interrupted, timeout_s)
            return self._pairs.popleft() if self._pairs and not (self._closed or self._interrupted) else None

    def clear(self) -> None:
        """Drop all pairs, and hand over those to come, though it was interrupted."""
        with self._changed:
            self._pairs.clear()
            self._interrupted = False

    def interrupt(self) -> None:
        """Wake whoever waits; no pair is handed over until :meth:`clear`."""
        with self._changed:
            self._interrupted = True
            self._changed.notify_all()

    def close(self) -> None:
        """Wake whoever waits; no pair is handed over any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class ImageIntake:
    """Pairs the images that arrive and keeps account of them; safe to be used by several threads.

    Pairs are kept only between :meth:`begin` and :meth:`end`.

    Args:
        config: Parameters of the node.
        clock: Steady time [s], for tests.
    """

    def __init__(self, config: NodeConfig, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._pairer: StampPairer[Any] = StampPairer()
        self._queue = PairQueue()
        self._schedule = SubscriptionSchedule()
        self._window: IntakeWindow | None = None
        self._formats: dict[Side, ImageFormat] = {}
        self.configure(config)

    @property
    def state(self) -> InputState:
        """Counts so far."""
        with self._lock:
            return InputState(self._pairer.counts, self._pairer.nearest_s)

    @property
    def pattern(self) -> StampPattern:
        """Why the images since the last pair, or since :meth:`begin`, formed none."""
        with self._lock:
            return self._pairer.pattern

    @property
    def window(self) -> IntakeWindow | None:
        """The span in which images are taken now, None while they are not taken."""
        return self._window

    @property
    def is_open(self) -> bool:
        """Whether images are taken now."""
        return self._window is not None

    @property
    def formats(self) -> dict[Side, ImageFormat]:
        """Format of the last image of each side."""
        with self._lock:
            return dict(self._formats)

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._queue.closed

    def configure(self, config: NodeConfig) -> None:
        """Take over changed parameters."""
        with self._lock:
            self._pairer.configure(
                config.approximate_sync, config.approximate_sync_tolerance_seconds, config.queue_size
            )
            self._queue.resize(config.queue_size)

    def begin(self) -> None:
        """Keep pairs from now on, and forget those from before."""
        with self._lock:
            self._pairer.flush()
            self._pairer.forget_nearest()
            self._queue.clear()
            self._schedule.want()

    def end(self) -> None:
        """Keep no more pairs."""
        with self._lock:
            self._schedule.release(self._clock())
            self._queue.clear()
            self._open_or_close(self.is_open)

    def update_schedule(self, publishers: tuple[int, ...]) -> tuple[bool, bool]:
        """Return whether to be subscribed, and whether to take images from now on.

        Args:
            publishers: Number of publishers of each topic of images.
        """
        with self._lock:
            subscribe = self._schedule.update(self._clock(), publishers)
            return subscribe, self._schedule.taking

    def open_or_close(self, take: bool) -> None:
        """Begin or end taking images, as :meth:`update_schedule` said.

        Args:
            take: Whether to take them. They are not taken if nobody wants them any more meanwhile.
        """
        with self._lock:
            self._open_or_close(take)

    def add(self, side: Side, message: Any) -> None:
        """Take an image message: pair it, count it, and hand over the pairs if they are wanted."""
        with self._lock:
            add = self._pairer.add_left if side == "left" else self._pairer.add_right
            pairs = add(message_stamp_ns(message), message, checksum(message))
            self._formats[side] = ImageFormat.of(message)
            now_s = self._clock()
            if self._schedule.image_arrived(now_s, bool(pairs)) and self._window is not None:
                self._window = IntakeWindow(self._pairer.counts, now_s)
            if self._schedule.wanted and pairs:
                self._queue.put(pairs)

    def next_pair(self, timeout_s: float) -> StampedPair[Any] | None:
        """Wait for the next pair; None when none came in time, or nobody is to wait any more.

        Args:
            timeout_s: How long to wait [s]; 0 returns at once.
        """
        pair = self._queue.get(timeout_s)
        if pair is not None:
            return pair
        # A pair may be waiting for a nearer partner that will not come.
        with self._lock:
            self._queue.put(self._pairer.flush())
        return self._queue.get(0.0)

    def interrupt(self) -> None:
        """Wake whoever waits for a pair; there is none until :meth:`begin`."""
        self._queue.interrupt()

    def stop(self) -> None:
        """Wake whoever waits for a pair: the node shuts down."""
        self._queue.close()

    def _open_or_close(self, take: bool) -> None:
        """Do what :meth:`open_or_close` says; callers lock."""
        if not (take and self._schedule.taking):
            self._window = None
            self._pairer.forget_waiting()
        elif self._window is None:
            self._window = IntakeWindow(self._pairer.counts, self._clock())
