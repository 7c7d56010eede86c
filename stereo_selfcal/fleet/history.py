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

"""Results of one camera from several drives, compared: which changes are more than their uncertainty.

Each result is compared with the one before it and with the first one, number by number. A difference over
the root of the sum of both variances is normally distributed where nothing has changed. What two drives share
(what the calibration of the cameras has left in the disparities) cancels in their difference but is in both
variances, so that marks are rarer than the rule promises, not more frequent.

With many comparisons some would be large by chance. Holm's rule holds for all comparisons of a history
together, however they depend on each other: a camera in which nothing has changed gets any mark at all with
a probability of at most :data:`FALSE_MARKS`.
(S. Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics, 1979.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist, median

from ..core.geometry.alignment import ALIGNMENT_NAMES
from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, DisplayUnit

# Probability that a history without a change has any mark: the usual 5 %, one page in twenty.
FALSE_MARKS = 0.05
_FEWEST = 2  # drives that can be compared


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that results have.

    Attributes:
        name: Its name in tables, such as ``pitch_rad``.
        heading: What people read, without the unit.
        unit: Unit of the value for people.
        small_unit: Unit of differences for people.
        more: What a positive difference means.
        less: What a negative one means.
        subject: What has changed.
    """

    name: str
    heading: str
    unit: DisplayUnit
    small_unit: DisplayUnit
    more: str
    less: str
    subject: str


_MOUNT, _RIGHT = "the camera", "the right camera against the left one"
_DIRECTIONS = {"height": ("higher", "lower"), "pitch": ("nose down", "nose up")}
_DIRECTIONS |= {"roll": ("right side down", "left side down"), "yaw": ("to the left", "to the right")}


def _quantity(name: str, heading: str, unit: DisplayUnit, small_unit: DisplayUnit, subject: str) -> Quantity:
    word = name.removeprefix("alignment_").rpartition("_")[0]
    return Quantity(name, heading, unit, small_unit, *_DIRECTIONS.get(word, ("more", "less")), subject)


QUANTITIES = (
    *(_quantity(each.name, each.label, each.unit, each.small_unit, _MOUNT) for each in POSE_COMPONENTS),
    _quantity("yaw_rad", "yaw against travel", DEGREES, DEGREES, _MOUNT),
    *(
        _quantity(f"alignment_{name}", f"alignment {name.rpartition('_')[0]}", DEGREES, DEGREES, _RIGHT)
        for name in ALIGNMENT_NAMES
    ),
)


@dataclass(frozen=True, slots=True)
class Known:
    """A number with its standard deviation, both in the SI unit."""

    value: float
    std: float


@dataclass(frozen=True, slots=True)
class DriveResult:
    """What one drive has said of a camera.

    Attributes:
        name: The recording or the result file, printable.
        stamp_s: When it was [s].
        known: The numbers that are known, by name; none of a drive without a calibration.
        said: What it was, in a word or two: ``calibrated``, a refusal.
        report: Its report as an address on the page, "" where there is none.
        moves: How often the camera was moved during it; the numbers are those after the last time.
    """

    name: str
    stamp_s: float | None
    known: Mapping[str, Known] = field(default_factory=dict)
    said: str = "calibrated"
    report: str = ""
    moves: int = 0


@dataclass(frozen=True, slots=True)
class Comparison:
    """One number of a drive beside that of an earlier drive.

    Attributes:
        quantity: The number.
        later: Index of the drive.
        earlier: Index of the earlier one.
        difference: Later minus earlier [SI unit].
        std: Standard deviation of the difference [SI unit].
        is_first: Whether the earlier one is the first that knows the number.
        is_before: Whether it is the last before that knows the number.
        significant: Whether the difference is significant by the rule of the history.
    """

    quantity: Quantity
    later: int
    earlier: int
    difference: float
    std: float
    is_first: bool
    is_before: bool
    significant: bool = False

    @property
    def sigmas(self) -> float:
        """The difference in its standard deviations."""
        return self.difference / self.std

    @property
    def p_value(self) -> float:
        """Probability of a difference as large where nothing has changed."""
        return math.erfc(abs(self.sigmas) / math.sqrt(2.0))

    @property
    def sentence(self) -> str:
        """What has changed, by how much, without a full stop."""
        unit = self.quantity.small_unit
        size = unit.number(abs(self.difference), more=0)
        direction = self.quantity.more if self.difference > 0.0 else self.quantity.less
        return (
            f"{self.quantity.subject} {'sits' if unit != DEGREES else 'is turned'} {size} {unit.symbol} "
            f"{direction} ({self.quantity.heading}, {abs(self.sigmas):.1f} standard deviations)"
        )


@dataclass(frozen=True, slots=True)
class History:
    """The drives of one camera in order of time, and every comparison of them.

    Attributes:
        drives: The drives.
        comparisons: All comparisons, by number and by drive.
        marks: Indexes of drives, each with the name of a number that differs significantly from that of the
            first drive or of the one before.
    """

    drives: tuple[DriveResult, ...]
    comparisons: tuple[Comparison, ...]
    marks: frozenset[tuple[int, str]] = frozenset()

    @property
    def steps(self) -> list[Comparison]:
        """Significant differences from the drive before."""
        return [each for each in self.comparisons if each.significant and each.is_before]

    @property
    def drifts(self) -> list[Comparison]:
        """Significant differences from the first drive that no step explains, each where it begins."""
        explained = {(step.quantity.name, step.later) for step in self.steps}
        found, last = [], set[tuple[str, int]]()
        for each in self.comparisons:
            if not each.is_first:
                continue
            place = each.quantity.name, each.earlier
            if not each.significant:
                last.discard(place)
            elif place not in last:
                last.add(place)
                if (each.quantity.name, each.later) not in explained:
                    found.append(each)
        return found

    @property
    def changes(self) -> list[Comparison]:
        """What is told: steps and drifts, in order of time."""
        return sorted((*self.steps, *self.drifts), key=lambda each: each.later)

    def of(self, quantity: Quantity) -> list[tuple[int, Known]]:
        """Return the drives that know a number, by their index, with the number."""
        told = ((index, drive.known.get(quantity.name)) for index, drive in enumerate(self.drives))
        return [(index, known) for index, known in told if known is not None]


def history_of(drives: Sequence[DriveResult]) -> History:
    """Compare drives of one camera.

    Args:
        drives: In any order; those with a stamp are put in order of time, if all have one.
    """
    stamps = [drive.stamp_s for drive in drives]
    ordered = list(drives)
    if None not in stamps:
        ordered.sort(key=lambda drive: drive.stamp_s or 0.0)
    history = History(tuple(ordered), ())
    comparisons = [each for quantity in QUANTITIES for each in _compare(quantity, history.of(quantity))]
    judged = tuple(_judged(comparisons))
    marks = frozenset((each.later, each.quantity.name) for each in judged if each.significant)
    return History(history.drives, judged, marks)


def _compare(quantity: Quantity, told: Sequence[tuple[int, Known]]) -> list[Comparison]:
    """Return each drive beside the one before and the first one, which are one comparison for the second."""
    found = []
    for place in range(1, len(told)):
        later, known = told[place]
        for other in sorted({0, place - 1}, reverse=True):
            earlier, before = told[other]
            std = math.hypot(known.std, before.std)
            difference = known.value - before.value
            is_before = other == place - 1
            found.append(Comparison(quantity, later, earlier, difference, std, other == 0, is_before))
    return found


def _judged(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Apply Holm's rule to all comparisons."""
    order = sorted(range(len(comparisons)), key=lambda index: comparisons[index].p_value)
    significant = set[int]()
    for rank, index in enumerate(order):
        if comparisons[index].p_value > FALSE_MARKS / (len(order) - rank):
            break
        significant.add(index)
    return [replace(each, significant=index in significant) for index, each in enumerate(comparisons)]


def least_marked(history: History, quantity: Quantity) -> float | None:
    """Return how large a change from one drive to the next has to be to be marked alone [SI unit].

    Of two drives that know the number as well as the median one; None where no two know it.
    """
    stds = sorted(known.std for _, known in history.of(quantity))
    if len(stds) < _FEWEST:
        return None
    level = FALSE_MARKS / len(history.comparisons)
    return NormalDist().inv_cdf(1.0 - level / 2.0) * math.sqrt(2.0) * median(stds)
