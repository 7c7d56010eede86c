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

"""Cells and tables that the parts have in common."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..frames import UNITS
from ..road_verdicts import RIGHT_SIGMAS, rms_of, robust_std_of
from ..roads import every_pair, signed
from ..table import Table, numbers
from ..worlds import GROSS, WRONG, WRONG_SIGMAS
from .angles import NAMES, Array
from .verdicts import RigVerdict

Verdicts = Sequence[RigVerdict]

WRONG_MEANS = (
    f"Wrong: an error above {WRONG_SIGMAS:g} standard deviations and above {numbers(WRONG)} "
    f"({', '.join(UNITS)}). Gross: above {numbers(GROSS)}."
)
ANGLES_ARE = f"Angles of the alignment: {', '.join(NAMES)} [deg]."
_ANGLE_DIGITS = (4, 4, 4)


def angles_cell(values: Array) -> str:
    """Return three angles with their signs, "-" for none."""
    return signed(values, _ANGLE_DIGITS)


def counts(verdicts: Verdicts) -> list[str]:
    """Return how many were accepted of how many, how many of these are wrong, and how many gross."""
    accepted = sum(each.road.accepted for each in verdicts)
    wrong, gross = (sum(getattr(each.road, word) for each in verdicts) for word in ("wrong", "gross"))
    return [f"{accepted} of {len(verdicts)}", str(wrong), str(gross)]


COUNTS_HEADER = ["accepted", "wrong", "gross"]


def telling_faults(found: Iterable[list[RigVerdict]]) -> Iterator[RigVerdict]:
    """Yield all verdicts of all pairs, and write at once which of them are wrong or gross."""
    for verdicts in found:
        for each in verdicts:
            if each.faulty:
                road = each.road
                said = f"error {signed(road.error)}, std {numbers(road.std)}"
                sys.stdout.write(f"{road.word}: {road.tag}, {road.name}, {each.turn.name}: {said}\n")
                sys.stdout.flush()
            yield each


def worst(verdicts: Verdicts) -> str:
    """Return the greatest errors of what was accepted over their standard deviations."""
    sigmas = [np.abs(each.road.sigmas) for each in verdicts if each.road.accepted]
    known = [each for each in sigmas if np.isfinite(each).any()]
    return numbers(np.nanmax(known, axis=0), 2) if known else "-"


def ratios(values: Sequence[Array]) -> list[str]:
    """Return number, mean, root mean square and robust standard deviation of errors over their std."""
    if not values:
        return ["0", "-", "-", "-"]
    array = np.array(values)
    mean = " / ".join(f"{value:+.2f}" for value in np.nanmean(array, axis=0))
    return [str(len(values)), mean, numbers(rms_of(array), 2), numbers(robust_std_of(array), 2)]


RATIOS_HEADER = ["n", "mean", "rms", "robust"]


def within(verdicts: Verdicts) -> str:
    """Return how many of the changes are within three standard deviations, by angle."""
    known = [np.abs(each.change / each.change_std) <= RIGHT_SIGMAS for each in verdicts if len(each.change)]
    if not known:
        return "-"
    return f"{' / '.join(f'{share:.1%}' for share in np.mean(known, axis=0))} of {len(known)}"


def faults_table(name: str, title: str, verdicts: Verdicts) -> Table:
    """Return all that was accepted and is wrong or gross."""
    table = Table(
        name,
        title,
        ["set", "pair", "turn (deg)", "verdict", "error (mm, deg, deg)", "std", "alignment", "std", "stage"],
        f"{WRONG_MEANS} {ANGLES_ARE}",
    )
    for each in verdicts:
        if each.faulty:
            road = each.road
            table.add(
                road.source,
                road.name,
                each.turn.name,
                road.word,
                signed(road.error),
                numbers(road.std),
                angles_cell(each.alignment),
                numbers(each.alignment_std) if len(each.alignment_std) else "-",
                road.stage,
            )
    return table


def every_table(name: str, verdicts: Verdicts) -> Table:
    """Return all that is known of every pair, for a file and not for the page."""
    roads = every_pair(name, [each.road for each in verdicts])
    kinds = ("turn", "alignment", "alignment_std", "change", "change_std")
    header = [f"{kind}_{angle}_deg" for kind in kinds for angle in NAMES]
    header += [f"noise_std_{axis}" for axis in ("height_mm", "pitch_deg", "roll_deg")]
    table = Table(name, "Every pair", [*header, *roads.header], shown=False)
    for each, cells in zip(verdicts, roads.rows, strict=True):
        known = [
            each.turn.as_array(),
            each.alignment,
            each.alignment_std,
            each.change,
            each.change_std,
            each.noise_std,
        ]
        values = [cell for array in known for cell in _three(array)]
        table.add(*values, *cells)
    return table


def _three(values: Array) -> list[str]:
    return [f"{value:.5f}" for value in values] if len(values) else [""] * 3
