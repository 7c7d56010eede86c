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

"""Pairing of the left and right images by their time stamps.

Pairing depends on stamps and the order of arrival alone, never on a clock. So the live node and the replay of
a bag form the same pairs. It differs from message_filters in seven points. It emits nothing from inside a
lock. It counts the images that it drops. It accepts a difference *equal* to the tolerance. It waits for the
nearest partner instead of taking the first. It continues after a bag that starts over. An image that arrives
twice counts once, and a pair says when a camera repeats its last image with a new stamp.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

from ..errors import ConfigError
from .frozen import FrozenImage, FrozenImages
from .stamp_pattern import StampPattern, stamp_pattern

T = TypeVar("T")

_NS_PER_S = 1_000_000_000

# A stamp that is older than the newest of its side by more than this shows a clock that was set back: a bag
# loops, or a simulation restarts. The limit is three periods of a 30 Hz camera. A smaller step back occurs
# when messages overtake each other. It needs no reset, because the queues evict by order of arrival.
BACKWARD_JUMP_NS = 100_000_000

# Stamps of each side that are kept to tell why no pair was formed, and which images arrive twice: ten seconds
# of a 30 Hz camera.
_REMEMBERED = 300


def stamp_to_s(stamp_ns: int) -> float:
    """Return a stamp [ns] in seconds.

    Node and replay both use this conversion, so that equal stamps give equal floats. It is
    ``sec + nanosec * 1e-9`` of the fields of the message.
    """
    sec, nanosec = divmod(stamp_ns, _NS_PER_S)
    return sec + nanosec * 1e-9


def message_stamp_ns(message: Any) -> int:
    """Return the header stamp [ns] of a ROS message, either of rclpy or of rosbags."""
    stamp = message.header.stamp
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)


@dataclass(frozen=True)  # no slots: generic, frozen and slotted at once breaks in Python 3.10 and 3.12.1
class StampedPair(Generic[T]):
    """Two images that belong together.

    Attributes:
        left: Payload of the left side.
        right: Payload of the right side.
        left_stamp_ns: Stamp of the left side [ns]; the stamp of the pair.
        right_stamp_ns: Stamp of the right side [ns].
        frozen: Which image is a repeated one, None where both are new or it is not known.
    """

    left: T
    right: T
    left_stamp_ns: int
    right_stamp_ns: int
    frozen: FrozenImage | None = None

    @property
    def stamp_ns(self) -> int:
        """Stamp of the pair [ns]: that of the left image."""
        return self.left_stamp_ns

    @property
    def difference_s(self) -> float:
        """Stamp of the right image minus that of the left one [s]."""
        return (self.right_stamp_ns - self.left_stamp_ns) / _NS_PER_S


@dataclass(frozen=True, slots=True)
class PairCounts:
    """Counts of a pairer so far; the difference of two over the time between them gives the rates.

    Attributes:
        left: Left images that arrived.
        right: Right images that arrived.
        pairs: Pairs formed.
        dropped_left: Left images that found no partner.
        dropped_right: Right images that found no partner.
        resets: Times the stamps jumped back.
        repeated_left: Left images that arrived again, with the same stamp and the same bytes; they count in
            ``left`` and go no further.
        repeated_right: The same of right ones.
    """

    left: int = 0
    right: int = 0
    pairs: int = 0
    dropped_left: int = 0
    dropped_right: int = 0
    resets: int = 0
    repeated_left: int = 0
    repeated_right: int = 0

    def since(self, earlier: PairCounts) -> PairCounts:
        """Return the counts added after ``earlier`` was taken."""
        return PairCounts(*(getattr(self, f.name) - getattr(earlier, f.name) for f in fields(self)))

    @property
    def repeated_remark(self) -> str:
        """A sentence about the images that arrived again, "" where none did."""
        if not (self.repeated_left or self.repeated_right):
            return ""
        return (
            f"{self.repeated_left} left and {self.repeated_right} right images came twice (one stamp and the "
            "same bytes): each counts once"
        )


@dataclass(frozen=True)
class _Entry(Generic[T]):
    stamp_ns: int
    arrival: int
    payload: T
    checksum: int | None


class _Side(Generic[T]):
    """Images of one camera that wait for a partner, oldest stamp first."""

    def __init__(self) -> None:
        self.entries: list[_Entry[T]] = []
        self.newest_ns: int | None = None
        self.unpaired: deque[int] = deque(maxlen=_REMEMBERED)
        self.seen: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)  # stamps and checksums
        self.arrived = 0
        self.dropped = 0
        self.repeated = 0

    def repeats(self, stamp_ns: int, checksum: int | None) -> bool:
        """Whether this very image has arrived before; it is counted then."""
        if checksum is None:
            return False
        if (stamp_ns, checksum) in self.seen:
            self.arrived += 1
            self.repeated += 1
            return True
        self.seen.append((stamp_ns, checksum))
        return False

    def insert(self, stamp_ns: int, payload: T, checksum: int | None) -> None:
        """Store an image; it replaces an earlier one with the same stamp."""
        self.keep([entry for entry in self.entries if entry.stamp_ns != stamp_ns])
        self.entries.append(_Entry(stamp_ns, self.arrived, payload, checksum))
        self.entries.sort(key=lambda entry: entry.stamp_ns)
        self.arrived += 1
        self.unpaired.append(stamp_ns)
        self.newest_ns = stamp_ns if self.newest_ns is None else max(self.newest_ns, stamp_ns)

    def keep(self, entries: list[_Entry[T]]) -> None:
        """Keep ``entries``; drop and count the others."""
        self.dropped += len(self.entries) - len(entries)
        self.entries = entries

    def evict(self, queue_size: int) -> None:
        """Drop the images that arrived first until at most ``queue_size`` remain.

        The order is that of arrival, not of stamps. After a step back in time, the old images have the
        greatest stamps; by stamp, they would displace every new image.
        """
        if len(self.entries) > queue_size:
            oldest_kept = sorted(entry.arrival for entry in self.entries)[-queue_size]
            self.keep([entry for entry in self.entries if entry.arrival >= oldest_kept])

    def forget_after(self, stamp_ns: int) -> None:
        """Drop the images newer than ``stamp_ns``: they arrived before the clock was set back."""
        self.keep([entry for entry in self.entries if entry.stamp_ns <= stamp_ns])
        self.newest_ns = self.entries[-1].stamp_ns if self.entries else None

    def take(self, entry: _Entry[T]) -> None:
        """Remove a paired image, and drop the older ones, which can no longer be paired in order."""
        later = [stamp_ns for stamp_ns in self.unpaired if stamp_ns > entry.stamp_ns]
        self.unpaired = deque(later, maxlen=_REMEMBERED)
        position = self.entries.index(entry)
        self.keep(self.entries[position:])
        self.entries = self.entries[1:]

    def nearest(self, stamp_ns: int) -> _Entry[T] | None:
        """Return the image nearest to ``stamp_ns``; of two equally near ones, the older one."""
        return min(self.entries, key=lambda entry: abs(entry.stamp_ns - stamp_ns), default=None)

    def has_passed(self, stamp_ns: int) -> bool:
        """Whether no image can still arrive that is nearer to ``stamp_ns`` than the waiting ones."""
        return self.newest_ns is not None and self.newest_ns >= stamp_ns


class StampPairer(Generic[T]):
    """Forms pairs of left and right images, with equal stamps or within a tolerance.

    Two images form a pair when they are each other's nearest, and at most the tolerance apart (inclusive).
    The pair is formed as soon as no nearer image can arrive: equal stamps at once, others when both sides
    have reached the later stamp or the queue is full. Pairs are returned in the order of their stamps. At the
    end of the input, :meth:`flush` forms the pairs that still wait for a nearer partner.

    The class is not safe for concurrent use; the caller locks.

    Args:
        approximate: Whether stamps may differ; False pairs equal stamps only.
        tolerance_s: Most difference of the stamps of an approximate pair [s].
        queue_size: Most images of each side that wait for a partner.

    Raises:
        ConfigError: The tolerance is negative or not finite, or the queue size below one.
    """

    def __init__(self, approximate: bool = False, tolerance_s: float = 0.0, queue_size: int = 5) -> None:
        self._left: _Side[T] = _Side()
        self._right: _Side[T] = _Side()
        self._pairs = 0
        self._resets = 0
        self._nearest_ns: int | None = None
        self._equal_before = False
        self._frozen = FrozenImages()
        self.configure(approximate, tolerance_s, queue_size)

    def configure(self, approximate: bool, tolerance_s: float, queue_size: int) -> None:
        """Change the arguments of the constructor; counts and waiting images stay.

        Raises:
            ConfigError: As in the constructor.
        """
        if not (math.isfinite(tolerance_s) and tolerance_s >= 0):
            raise ConfigError(f"tolerance of the pairing is {tolerance_s} s: zero or more is needed")
        if queue_size < 1:
            raise ConfigError(f"queue size of the pairing is {queue_size}: one or more is needed")
        self._tolerance_ns = round(tolerance_s * _NS_PER_S) if approximate else 0
        self._queue_size = queue_size

    def add_left(self, stamp_ns: int, payload: T, checksum: int | None = None) -> list[StampedPair[T]]:
        """Take a left image and return the pairs that are now certain, oldest first.

        Args:
            stamp_ns: Stamp of the image [ns].
            payload: The image; the pair contains it.
            checksum: Of its bytes (:func:`.frozen.checksum`); None: repeated images are not looked for.
        """
        return self._add(self._left, self._right, stamp_ns, payload, checksum)

    def add_right(self, stamp_ns: int, payload: T, checksum: int | None = None) -> list[StampedPair[T]]:
        """Take a right image; see :meth:`add_left`."""
        return self._add(self._right, self._left, stamp_ns, payload, checksum)

    def flush(self) -> list[StampedPair[T]]:
        """Return the pairs that wait for a nearer partner, because no more images will arrive."""
        return self._match(final=True)

    def forget_waiting(self) -> None:
        """Remove the images that wait for a partner without counting them as dropped."""
        for side in (self._left, self._right):
            side.entries = []
            side.unpaired.clear()

    @property
    def counts(self) -> PairCounts:
        """Images, pairs, drops and resets so far."""
        return PairCounts(
            self._left.arrived,
            self._right.arrived,
            self._pairs,
            self._left.dropped,
            self._right.dropped,
            self._resets,
            self._left.repeated,
            self._right.repeated,
        )

    @property
    def nearest_s(self) -> float | None:
        """Least difference of a left and a right stamp since :meth:`forget_nearest` [s]; None without one."""
        return None if self._nearest_ns is None else self._nearest_ns / _NS_PER_S

    @property
    def pattern(self) -> StampPattern:
        """Why the images since the last pair, or since :meth:`forget_nearest`, formed none."""
        return stamp_pattern(
            self._left.unpaired, self._right.unpaired, self._tolerance_ns / _NS_PER_S, self._equal_before
        )

    def forget_nearest(self) -> None:
        """Start a new measurement of :attr:`nearest_s` and :attr:`pattern`; every image is a new one."""
        self._nearest_ns = None
        for side in (self._left, self._right):
            side.unpaired.clear()
            side.seen.clear()

    def _add(
        self, side: _Side[T], other: _Side[T], stamp_ns: int, payload: T, checksum: int | None
    ) -> list[StampedPair[T]]:
        pairs: list[StampedPair[T]] = []
        if side.newest_ns is not None and stamp_ns < side.newest_ns - BACKWARD_JUMP_NS:
            pairs = self.flush()
            self._resets += 1
            # The other side may have jumped first; its images from after the jump are kept.
            for each in (side, other):
                each.unpaired.clear()
                each.seen.clear()
                each.forget_after(stamp_ns + BACKWARD_JUMP_NS)
        if side.repeats(stamp_ns, checksum):
            return pairs
        partner = other.nearest(stamp_ns)
        if partner is not None:
            difference = abs(partner.stamp_ns - stamp_ns)
            self._nearest_ns = difference if self._nearest_ns is None else min(self._nearest_ns, difference)
        side.insert(stamp_ns, payload, checksum)
        pairs += self._match()
        if len(side.entries) > self._queue_size:
            # A full queue forms its pairs at once, although a nearer partner might still arrive.
            pairs += self._match(final=True)
        side.evict(self._queue_size)
        return pairs

    def _match(self, final: bool = False) -> list[StampedPair[T]]:
        """Form every pair that is certain, or every possible pair when ``final``."""
        pairs: list[StampedPair[T]] = []
        for left in tuple(self._left.entries):
            right = self._right.nearest(left.stamp_ns)
            if right is None:
                break
            if abs(left.stamp_ns - right.stamp_ns) > self._tolerance_ns:
                continue
            if self._left.nearest(right.stamp_ns) is not left:
                continue
            certain = self._left.has_passed(right.stamp_ns) and self._right.has_passed(left.stamp_ns)
            if final or certain:
                pairs.append(self._paired(left, right))
                self._equal_before |= left.stamp_ns == right.stamp_ns
                self._left.take(left)
                self._right.take(right)
        self._pairs += len(pairs)
        return pairs

    def _paired(self, left: _Entry[T], right: _Entry[T]) -> StampedPair[T]:
        frozen = None
        if left.checksum is not None and right.checksum is not None:
            frozen = self._frozen.follow((left.checksum, right.checksum), left.stamp_ns)
        return StampedPair(left.payload, right.payload, left.stamp_ns, right.stamp_ns, frozen)
