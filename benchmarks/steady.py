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

"""Steady verdicts: a real pair that is accepted is accepted in harmless copies too, with the same pose.

A threshold that fits single frames by chance, or that a verdict hangs on by a hair, shows here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .frames import Array
from .harmless import COPIES, Copy
from .options import Options
from .road_pairs import RoadPair, pairs_of
from .road_verdicts import RoadVerdict, in_processes, judge
from .roads import every_pair, signed
from .table import Table, numbers

# The real frames that are no recording of one road.
STEADY_SOURCES = ("kitti_frames", "kitti_odometry07", "roads")
LEAST_SHARE = 0.95
SAME_SIGMAS = 3.0
_TOP_REASONS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One copy of one accepted pair.

    Attributes:
        copy: How it was made.
        original: Verdict of the pair as it is, accepted.
        verdict: Verdict of the copy.
    """

    copy: Copy
    original: RoadVerdict
    verdict: RoadVerdict

    @property
    def difference(self) -> Array:
        """Pose of the copy less that of the original; empty when the copy is refused."""
        if not self.verdict.accepted:
            return np.empty(0)
        difference: Array = self.verdict.pose - self.original.pose * self.copy.signs
        return difference

    @property
    def sigmas(self) -> Array:
        """The difference over the greater standard deviation of both; empty when the copy is refused."""
        if not self.verdict.accepted:
            return np.empty(0)
        sigmas: Array = self.difference / np.maximum(self.verdict.std, self.original.std)
        return sigmas

    @property
    def same(self) -> bool:
        """Whether the copy is accepted, with the pose of the original."""
        return self.verdict.accepted and bool(np.all(np.abs(self.sigmas) <= SAME_SIGMAS))


def steady_tables(options: Options) -> Iterator[Table]:
    """Judge the copies of every accepted pair: by copy, by set, and what is not as it should be."""
    pairs = pairs_of(options.sources or STEADY_SOURCES, options.road_step)
    judged = [each for copies in in_processes(judge_copies, pairs, options.processes) for each in copies]
    harmless = [each for each in judged if each.copy.harmless]
    yield _by_copy(judged, harmless)
    yield _by_source(harmless)
    yield _exceptions(harmless)
    yield _every(judged)


def judge_copies(pair: RoadPair) -> list[Judged]:
    """Return the copies of a pair with their verdicts; none of a pair that is refused as it is."""
    original = judge(pair, with_peer=False)
    if not original.accepted:
        return []
    return [Judged(copy, original, judge(copy.make(pair), with_peer=False)) for copy in COPIES]


_COLUMNS = [
    "accepted",
    "of these, same pose",
    "greatest difference / std",
    "90 %",
    "median of |difference| (mm, deg, deg)",
    "wrong or gross",
    "refused as",
]


def _by_copy(judged: Sequence[Judged], harmless: Sequence[Judged]) -> Table:
    n_pairs = len({(each.original.source, each.original.name) for each in judged})
    table = Table(
        "steady",
        f"Harmless copies of {n_pairs} real pairs that are accepted",
        ["copy", *_COLUMNS],
        f"Asked: {LEAST_SHARE:.0%} of the harmless copies accepted, and poses within {SAME_SIGMAS:g} "
        "standard deviations of each other in each of height, pitch and roll. The standard deviation is the "
        "greater of both: most of what is uncertain is the same in both. The copies in italics show less of "
        "the road, or show it worse: nothing is asked of them.",
    )
    table.add("**all harmless ones**", *_cells(harmless))
    for copy in COPIES:
        name = copy.name if copy.harmless else f"*{copy.name}*"
        table.add(name, *_cells([each for each in judged if each.copy.name == copy.name]))
    return table


def _by_source(harmless: Sequence[Judged]) -> Table:
    table = Table("steady_sets", "The harmless copies by set", ["set", "pairs", *_COLUMNS])
    for source in dict.fromkeys(each.original.source for each in harmless):
        group = [each for each in harmless if each.original.source == source]
        table.add(source, str(len({each.original.name for each in group})), *_cells(group))
    return table


def _cells(group: Sequence[Judged]) -> list[str]:
    accepted = [each for each in group if each.verdict.accepted]
    reasons = Counter(each.verdict.reason for each in group if not each.verdict.accepted)
    told = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(_TOP_REASONS)) or "-"
    if not accepted:
        return [_share(0, len(group)), *["-"] * 5, told]
    sigmas = np.abs([each.sigmas for each in accepted])
    differences = np.abs([each.difference for each in accepted])
    return [
        _share(len(accepted), len(group)),
        _share(sum(each.same for each in accepted), len(accepted)),
        numbers(sigmas.max(axis=0), 2),
        numbers(np.quantile(sigmas, 0.9, axis=0), 2),
        numbers(np.median(differences, axis=0)),
        str(sum(each.verdict.wrong or each.verdict.gross for each in accepted)),
        told,
    ]


def _share(some: int, of_them: int) -> str:
    return f"{some} of {of_them}: {some / of_them:.1%}" if of_them else "0 of 0"


def _exceptions(harmless: Sequence[Judged]) -> Table:
    """Return the harmless copies that are refused, or have another pose."""
    table = Table(
        "steady_exceptions",
        "The harmless copies that are refused, or have another pose",
        ["set", "pair", "copy", "reason", "difference (mm, deg, deg)", "std, original", "std, copy"],
    )
    for each in harmless:
        if not each.same:
            std = numbers(each.verdict.std) if each.verdict.accepted else "-"
            table.add(
                each.original.source,
                each.original.name,
                each.copy.name,
                each.verdict.reason or "another pose",
                signed(each.difference),
                numbers(each.original.std),
                std,
            )
    return table


def _every(judged: Sequence[Judged]) -> Table:
    """Return all that is known of every copy, for a file and not for the page."""
    verdicts = every_pair("steady_every", [each.verdict for each in judged])
    axes = ("height_mm", "pitch_deg", "roll_deg")
    header = ["copy", "same", *(f"{what}_{axis}" for what in ("original", "original_std") for axis in axes)]
    table = Table("steady_every", "Every copy", [*header, *verdicts.header], shown=False)
    for each, cells in zip(judged, verdicts.rows, strict=True):
        original = [*each.original.pose * each.copy.signs, *each.original.std]
        table.add(each.copy.name, str(each.same), *(f"{value:.4f}" for value in original), *cells)
    return table
