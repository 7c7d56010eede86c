"""Pairing of the left and right images by their time stamps.

Pairing depends on stamps and arrival order alone, never on a clock, so that the live node and the
replay of a bag form the same pairs. Unlike message_filters it emits nothing from inside a lock,
counts what it drops, tolerates a difference *equal* to the tolerance, waits for the nearest partner
instead of taking the first, and survives a bag that starts over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

from ..errors import ConfigError

T = TypeVar("T")

_NS_PER_S = 1_000_000_000

# A stamp this much older than the newest of its side is a clock that was set back (a bag that
# loops, a simulation that restarts): three periods of a 30 Hz camera. Smaller steps back are
# messages that overtook each other; they need no reset, as the queues evict by order of arrival.
BACKWARD_JUMP_NS = 100_000_000

# What a suggested tolerance allows beyond the least difference seen: stamps jitter by so much.
_SUGGESTED_MARGIN = 1.2
_SUGGESTED_STEP_S = 0.001


def suggest_tolerance_s(nearest_s: float, rate_hz: float) -> float | None:
    """Return a tolerance with which the images of two cameras would pair, None when none makes sense.

    It lies between the least difference of their stamps and half a frame: beyond that, an image would be
    nearer to the one before or after its partner.

    Args:
        nearest_s: Least difference of a left and a right stamp that was seen [s].
        rate_hz: Images per second of the faster camera.

    Returns:
        Whole milliseconds [s].
    """
    if rate_hz <= 0.0:
        return None
    half_frame_s = 0.5 / rate_hz
    if nearest_s > half_frame_s:
        return None
    step_s = math.ceil(_SUGGESTED_MARGIN * nearest_s / _SUGGESTED_STEP_S) * _SUGGESTED_STEP_S
    # Below a millisecond, or near half a frame, there is no whole one between the two.
    return round(step_s, 3) if step_s <= half_frame_s else math.ceil(round(nearest_s * 1e6, 3)) / 1e6


def stamp_to_s(stamp_ns: int) -> float:
    """Return a stamp [ns] in seconds.

    The one conversion of node and replay: equal stamps give equal floats. It is
    ``sec + nanosec * 1e-9`` of the message's own fields.
    """
    sec, nanosec = divmod(stamp_ns, _NS_PER_S)
    return sec + nanosec * 1e-9


def message_stamp_ns(message: Any) -> int:
    """Return the header stamp [ns] of a ROS message, of rclpy or rosbags alike."""
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
    """

    left: T
    right: T
    left_stamp_ns: int
    right_stamp_ns: int

    @property
    def stamp_ns(self) -> int:
        """Stamp of the pair [ns]: that of the left image."""
        return self.left_stamp_ns


@dataclass(frozen=True, slots=True)
class PairCounts:
    """What a pairer has seen so far; two of them and the time between give the rates.

    Attributes:
        left: Left images that arrived.
        right: Right images that arrived.
        pairs: Pairs formed.
        dropped_left: Left images that found no partner.
        dropped_right: Right images that found no partner.
        resets: Times the stamps jumped back.
    """

    left: int = 0
    right: int = 0
    pairs: int = 0
    dropped_left: int = 0
    dropped_right: int = 0
    resets: int = 0

    def since(self, earlier: PairCounts) -> PairCounts:
        """Return the counts added after ``earlier`` was taken."""
        return PairCounts(*(getattr(self, f.name) - getattr(earlier, f.name) for f in fields(self)))


@dataclass(frozen=True)
class _Entry(Generic[T]):
    stamp_ns: int
    arrival: int
    payload: T


class _Side(Generic[T]):
    """Images of one camera that wait for a partner, oldest stamp first."""

    def __init__(self) -> None:
        self.entries: list[_Entry[T]] = []
        self.newest_ns: int | None = None
        self.arrived = 0
        self.dropped = 0

    def insert(self, stamp_ns: int, payload: T) -> None:
        """Store an image; it takes the place of an earlier one with the same stamp."""
        self.keep([entry for entry in self.entries if entry.stamp_ns != stamp_ns])
        self.entries.append(_Entry(stamp_ns, self.arrived, payload))
        self.entries.sort(key=lambda entry: entry.stamp_ns)
        self.arrived += 1
        self.newest_ns = stamp_ns if self.newest_ns is None else max(self.newest_ns, stamp_ns)

    def keep(self, entries: list[_Entry[T]]) -> None:
        """Keep ``entries``, drop and count the others."""
        self.dropped += len(self.entries) - len(entries)
        self.entries = entries

    def evict(self, queue_size: int) -> None:
        """Drop the images that arrived first until at most ``queue_size`` are left.

        By arrival, not by stamp: after a step back in time the leftovers with great stamps must
        go, or they would push out every new image.
        """
        if len(self.entries) > queue_size:
            oldest_kept = sorted(entry.arrival for entry in self.entries)[-queue_size]
            self.keep([entry for entry in self.entries if entry.arrival >= oldest_kept])

    def forget_after(self, stamp_ns: int) -> None:
        """Drop what is newer than ``stamp_ns``: it comes from before the clock was set back."""
        self.keep([entry for entry in self.entries if entry.stamp_ns <= stamp_ns])
        self.newest_ns = self.entries[-1].stamp_ns if self.entries else None

    def take(self, entry: _Entry[T]) -> None:
        """Remove a paired image; the older ones can no longer be paired in order and are dropped."""
        position = self.entries.index(entry)
        self.keep(self.entries[position:])
        self.entries = self.entries[1:]

    def nearest(self, stamp_ns: int) -> _Entry[T] | None:
        """Return the image nearest to ``stamp_ns``; of two equally near the older."""
        return min(self.entries, key=lambda entry: abs(entry.stamp_ns - stamp_ns), default=None)

    def has_passed(self, stamp_ns: int) -> bool:
        """Whether no image nearer to ``stamp_ns`` than those here can still come."""
        return self.newest_ns is not None and self.newest_ns >= stamp_ns


class StampPairer(Generic[T]):
    """Forms pairs of left and right images, exactly or within a tolerance.

    A pair is formed of two images that are each other's nearest, at most the tolerance apart
    (inclusive), as soon as no nearer one can come: equal stamps at once, others when both sides
    have reached the later stamp or the queue is full. Pairs come in the order of their stamps. At
    the end of the input :meth:`flush` forms those that still wait for a nearer partner.

    Not safe for concurrent use: callers lock.

    Args:
        approximate: Whether stamps may differ; False pairs equal stamps only.
        tolerance_s: Greatest difference of the stamps of an approximate pair [s].
        queue_size: Images of each side kept while they wait for a partner.

    Raises:
        ConfigError: The tolerance is negative or not finite, or the queue size below one.
    """

    def __init__(self, approximate: bool = False, tolerance_s: float = 0.0, queue_size: int = 5) -> None:
        self._left: _Side[T] = _Side()
        self._right: _Side[T] = _Side()
        self._pairs = 0
        self._resets = 0
        self._nearest_ns: int | None = None
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

    def add_left(self, stamp_ns: int, payload: T) -> list[StampedPair[T]]:
        """Take a left image and return the pairs that are now certain, oldest first.

        Args:
            stamp_ns: Stamp of the image [ns].
            payload: The image, handed back in the pair.
        """
        return self._add(self._left, self._right, stamp_ns, payload)

    def add_right(self, stamp_ns: int, payload: T) -> list[StampedPair[T]]:
        """Take a right image; see :meth:`add_left`."""
        return self._add(self._right, self._left, stamp_ns, payload)

    def flush(self) -> list[StampedPair[T]]:
        """Return the pairs that wait for a nearer partner: none will come any more."""
        return self._match(final=True)

    def forget_waiting(self) -> None:
        """Forget the images that wait for a partner, uncounted: nobody takes it any more."""
        for side in (self._left, self._right):
            side.entries = []

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
        )

    @property
    def nearest_s(self) -> float | None:
        """Least difference [s] of a left and a right stamp since :meth:`forget_nearest`, if any."""
        return None if self._nearest_ns is None else self._nearest_ns / _NS_PER_S

    def forget_nearest(self) -> None:
        """Start a new measurement of :attr:`nearest_s`."""
        self._nearest_ns = None

    def _add(self, side: _Side[T], other: _Side[T], stamp_ns: int, payload: T) -> list[StampedPair[T]]:
        pairs: list[StampedPair[T]] = []
        if side.newest_ns is not None and stamp_ns < side.newest_ns - BACKWARD_JUMP_NS:
            pairs = self.flush()
            self._resets += 1
            # The other side may have jumped first: its images of the new pass stay.
            for each in (side, other):
                each.forget_after(stamp_ns + BACKWARD_JUMP_NS)
        partner = other.nearest(stamp_ns)
        if partner is not None:
            difference = abs(partner.stamp_ns - stamp_ns)
            self._nearest_ns = difference if self._nearest_ns is None else min(self._nearest_ns, difference)
        side.insert(stamp_ns, payload)
        pairs += self._match()
        if len(side.entries) > self._queue_size:
            # Better a pair that might have found a nearer partner than none.
            pairs += self._match(final=True)
        side.evict(self._queue_size)
        return pairs

    def _match(self, final: bool = False) -> list[StampedPair[T]]:
        """Form every pair that is certain, or every pair there is when ``final``."""
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
                pairs.append(StampedPair(left.payload, right.payload, left.stamp_ns, right.stamp_ns))
                self._left.take(left)
                self._right.take(right)
        self._pairs += len(pairs)
        return pairs
