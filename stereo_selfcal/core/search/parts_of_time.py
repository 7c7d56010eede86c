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

"""Which frames of a recording are followed from an accepted one, and which are looked at cold."""

from __future__ import annotations

import math

from .known import KnownCamera


class PartsOfTime:
    """Which frames of a recording are followed, and which are looked at cold.

    Time is divided into parts of equal length, counted from 0. The first frame of each part is looked at
    cold: so the result of a frame depends on those of its part alone, wherever a recording is cut in two. The
    frames after an accepted cold one are followed from it; one that is not confirmed is cold.
    """

    def __init__(self, cold_every_s: float) -> None:
        self._cold_every_s = cold_every_s
        self._known: KnownCamera | None = None
        self._part: int | None = None
        self._stamp_s = -math.inf

    def of_next(self, stamp_s: float) -> KnownCamera | None:
        """Return what the next frame is followed from; None to look at it cold.

        Args:
            stamp_s: Its time stamp [s].
        """
        part = part_of(stamp_s, self._cold_every_s)
        goes_on = part is not None and part == self._part and stamp_s > self._stamp_s
        self._part, self._stamp_s = part, stamp_s
        known, self._known = self._known, None
        return known if goes_on else None

    def note(self, known: KnownCamera | None) -> None:
        """Take what a frame tells of the next one.

        Args:
            known: It; None where the next frame is to be looked at cold.
        """
        self._known = known


def part_of(stamp_s: float, cold_every_s: float) -> int | None:
    """Return the part of the time in which a frame lies; None where every frame is a part of its own.

    Args:
        stamp_s: Time stamp of the frame [s].
        cold_every_s: Length of the parts [s]; 0 for none.
    """
    return None if cold_every_s <= 0.0 else math.floor(stamp_s / cold_every_s)
