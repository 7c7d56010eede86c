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

"""Time stamps in the names of images, and the order of images by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from itertools import pairwise

from ..bags import BagError
from ..bags.order import natural_key
from ..core.drive.drive import FIRST_CLOCK_S
from ..core.errors import printable

_NS_PER_S = 1_000_000_000
# Header stamps of ROS count seconds in 32 bits: to February 2106. Numbers of frames with as many digits as a
# stamp are filled up with zeros, and far below FIRST_CLOCK_S.
_LAST_CLOCK_S = 2**32
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)

_SECONDS, _DATES = "seconds", "dates"
# Units of whole numbers by their digits, with their nanoseconds: seconds since 1970 have had 10 since 2001.
_UNITS = {
    10: (_SECONDS, _NS_PER_S),
    13: ("milliseconds", 1_000_000),
    16: ("microseconds", 1000),
    19: ("nanoseconds", 1),
}
# What the name of a camera adds behind a stamp ("_left"). A number there is taken for that of a frame.
_TAIL = re.compile(r"[^0-9]+\Z")
_WHOLE = re.compile(r"(?<![0-9])(?<![0-9]\.)([0-9]{10}|[0-9]{13}|[0-9]{16}|[0-9]{19})\Z")
# A fraction of a second; or, as ROS prints a stamp in two numbers, all nine digits of its nanoseconds.
_FRACTION = re.compile(r"(?<![0-9])([0-9]{10})(?:\.([0-9]+)|[_-]([0-9]{9}))\Z")
# 2026-11-30_12-00-00.5, 20261130T120000, ... without a number behind, which may count frames.
_CALENDAR = re.compile(
    r"(?<![0-9])([0-9]{4})[-_.]?([0-9]{2})[-_.]?([0-9]{2})[-_.T ]?"
    r"([0-9]{2})[-_.:]?([0-9]{2})[-_.:]?([0-9]{2})(?:[.,]([0-9]+))?\Z"
)
# Seconds of a clock that starts with the recording: a whole name, and a point in at least one of them.
_SHORT = re.compile(r"([0-9]{1,10})(?:\.([0-9]+))?")


# Between images without stamps. Cameras of cars take ten images a second and more, and a longer time would
# give credit for motion that has averaged out.
_COUNTED_NS = _NS_PER_S // 10


@dataclass(frozen=True, slots=True)
class ImageStamps:
    """The stamps of images.

    Attributes:
        names: The names, in the order of time.
        stamps_ns: The stamp of each [ns].
        counted: Whether these are no times but places in the order of the names, 0.1 s each.
        note: One sentence: where they come from.
    """

    names: tuple[str, ...]
    stamps_ns: tuple[int, ...]
    counted: bool
    note: str


def image_stamps(names: Sequence[str]) -> ImageStamps:
    """Return the order and the stamps of images by their names.

    Where every name is a time stamp or ends in one, these are the stamps. Else the images are in the
    natural order of their names (2 before 10), and as far apart as those of a usual camera.

    Args:
        names: Names without suffix, each once; at least one.

    Raises:
        BagError: The stamps have different units, or two images have the same one, or it is not certain
            how they are to be read.
    """
    read = {name: _short_seconds(name) if _have_points(names) else _stamp(name) for name in names}
    stamped = {name: stamp for name, stamp in read.items() if stamp is not None}
    examples: dict[str, str] = {}
    for name, (unit, _) in stamped.items():
        examples.setdefault(unit, name)
    if len(examples) > 1:
        (one, first), (other, second) = list(examples.items())[:2]
        raise BagError(
            f"the names of the images are time stamps in {one} ({printable(first)}) and in {other} "
            f"({printable(second)}): give all of them one form"
        )
    natural = tuple(sorted(names, key=natural_key))
    if len(stamped) < len(names):
        none = next(name for name in natural if name not in stamped)
        which = "the names of the images are no stamps"
        if stamped:
            count = f"{len(names) - len(stamped)} of {len(names)}"
            which = f"{count} names of images are no stamps ({printable(none)})"
        stamps_ns = tuple(index * _COUNTED_NS for index in range(len(names)))
        note = (
            f"{which}: they are taken for {_COUNTED_NS / _NS_PER_S:g} s apart, in the order of the numbers "
            "in the names; the standard deviation of the mount rests on that"
        )
        return ImageStamps(natural, stamps_ns, True, note)
    times_ns = {name: stamp_ns for name, (_, stamp_ns) in stamped.items()}
    ordered = tuple(sorted(natural, key=lambda name: times_ns[name]))
    _check_distinct(ordered, times_ns)
    first_s = times_ns[ordered[0]] // _NS_PER_S
    if first_s < FIRST_CLOCK_S and ordered != natural:
        one, other = next(pair for pair in zip(ordered, natural, strict=True) if pair[0] != pair[1])
        raise BagError(
            f"the names of the images {printable(one)} and {printable(other)} can be seconds or two numbers "
            "each, which come in another order: write all with the same number of digits behind the point"
        )
    since = (
        f", from {_EPOCH + timedelta(seconds=first_s):%Y-%m-%d %H:%M:%S} on"
        if first_s >= FIRST_CLOCK_S
        else ""
    )
    note = f"stamps are in the names of the images ({next(iter(examples))}{since})"
    return ImageStamps(ordered, tuple(times_ns[name] for name in ordered), False, note)


def _check_distinct(ordered: Sequence[str], times_ns: dict[str, int]) -> None:
    for one, other in pairwise(ordered):
        if times_ns[one] == times_ns[other]:
            raise BagError(
                f"the images {printable(one)} and {printable(other)} have the same time stamp: "
                "give every image of a camera its own"
            )


def _stamp(name: str) -> tuple[str, int] | None:
    """Return unit and value [ns] of the time stamp that a name is or ends in, None where there is none."""
    name = _TAIL.sub("", name)
    if match := _FRACTION.search(name):
        unit, stamp_ns = _SECONDS, _nanoseconds(match[1], match[2] or match[3])
    elif match := _WHOLE.search(name):
        unit, ns = _UNITS[len(match[1])]
        stamp_ns = int(match[1]) * ns
    elif match := _CALENDAR.search(name):
        try:
            moment = datetime(*map(int, match.groups()[:6]), tzinfo=timezone.utc)  # type: ignore[misc,arg-type]
        except ValueError:  # no date: a 13th month
            return None
        unit, stamp_ns = _DATES, _nanoseconds(str((moment - _EPOCH) // timedelta(seconds=1)), match[7])
    else:
        return None
    return (unit, stamp_ns) if FIRST_CLOCK_S <= stamp_ns // _NS_PER_S < _LAST_CLOCK_S else None


def _have_points(names: Sequence[str]) -> bool:
    """Whether the names are seconds of a clock that starts with the recording."""
    matches = [_SHORT.fullmatch(name) for name in names]
    return all(matches) and any(match[2] for match in matches if match)


def _short_seconds(name: str) -> tuple[str, int] | None:
    match = _SHORT.fullmatch(name)
    return match and (_SECONDS, _nanoseconds(match[1], match[2]))


def _nanoseconds(seconds: str, fraction: str | None) -> int:
    return int(seconds) * _NS_PER_S + int((fraction or "")[:9].ljust(9, "0"))
