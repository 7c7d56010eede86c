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

"""Selection of the frames of a recording: a stretch of time, every n-th frame, a most number of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

from .errors import BagError

T = TypeVar("T")

_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Selection:
    """Which frames are used.

    Attributes:
        start_s: Frames recorded this long after the start of the recording, or later [s].
        end_s: Frames recorded earlier than this [s] after the start; None for all to the end.
        every: Every n-th of them, from the first on.
        max_frames: So many of these at most; None for all.

    Raises:
        BagError: Nothing can be selected like that.
    """

    start_s: float = 0.0
    end_s: float | None = None
    every: int = 1
    max_frames: int | None = None

    def __post_init__(self) -> None:
        if self.end_s is not None and not self.start_s < self.end_s:
            raise BagError(
                f"start {self.start_s:g} s and end {self.end_s:g} s: the first must be the smaller"
            )
        if self.every < 1 or (self.max_frames is not None and self.max_frames < 1):
            raise BagError(f"every {self.every}, {self.max_frames} frames: both must be 1 or more")

    @property
    def start_ns(self) -> int:
        """:attr:`start_s` in nanoseconds."""
        return round(self.start_s * _NS_PER_S)

    @property
    def end_ns(self) -> int | None:
        """:attr:`end_s` in nanoseconds."""
        return None if self.end_s is None else round(self.end_s * _NS_PER_S)

    @property
    def whole(self) -> bool:
        """Whether the selection covers the whole recording."""
        return self.start_ns <= 0 and self.end_ns is None

    def choose(self, items: Iterable[T], since_start_ns: Callable[[T], int]) -> Iterator[T]:
        """Yield the selected items, and ask for none after the last of them.

        Args:
            items: Frames in order.
            since_start_ns: When an item was recorded, from the start of the recording [ns].
        """
        start_ns, end_ns = self.start_ns, self.end_ns

        def inside(item: T) -> bool:
            if self.whole:  # whatever its time: the start of a recording may be known badly
                return True
            return start_ns <= since_start_ns(item) and (end_ns is None or since_start_ns(item) < end_ns)

        stop = None if self.max_frames is None else (self.max_frames - 1) * self.every + 1
        return islice(filter(inside, items), 0, stop, self.every)

    def count(self, n_frames: int) -> int | None:
        """Return how many of ``n_frames`` are selected at most, None where that depends on their times."""
        if not self.whole:
            return self.max_frames
        n = -(-n_frames // self.every)
        return n if self.max_frames is None else min(n, self.max_frames)

    def nothing_in(self, name: str, length_s: float) -> str:
        """Return the error text for a recording in which there is no such frame.

        Args:
            name: The recording.
            length_s: How long it is [s].
        """
        end = "its end" if self.end_s is None else f"{self.end_s:g} s"
        return (
            f"{name}: no frame between {self.start_s:g} s and {end} after its start; "
            f"the recording is {length_s:.1f} s long"
        )
