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

"""Turns of the right camera on recorded and rendered roads: nothing that is accepted may be wrong.

Recorded frames are warped (:mod:`.warp`). Rendered ones are rendered with the turned camera itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..options import Options
from ..road_pairs import RoadPair, pairs_of
from ..road_verdicts import in_processes
from ..table import NothingToMeasureError, Table
from .angles import AS_IT_IS, TURNS
from .cells import (
    ANGLES_ARE,
    COUNTS_HEADER,
    RATIOS_HEADER,
    WRONG_MEANS,
    Verdicts,
    counts,
    every_table,
    faults_table,
    ratios,
    telling_faults,
    within,
    worst,
)
from .drawn import Road, roads
from .verdicts import RigVerdict, against_recorded, against_truth, judge
from .warp import turned

RECORDED = "kitti_frames"
_SETS = {True: f"recorded ({RECORDED}), warped", False: "rendered with the turned camera"}


def turn_tables(options: Options) -> Iterator[Table]:
    """Judge every turn: by set and turn, by kind of road, what is wrong, and everything."""
    verdicts = list(recorded_verdicts(options)) + list(rendered_verdicts(options))
    yield _by_turn(verdicts)
    yield _by_group(verdicts)
    yield faults_table("rig_turns_faults", "Turned right cameras: accepted and wrong", verdicts)
    yield every_table("rig_turns_every", verdicts)


def recorded_verdicts(options: Options) -> Iterator[RigVerdict]:
    """Yield the verdicts of recorded frames, as recorded and with every turn, where there are frames."""
    try:
        pairs = list(pairs_of((RECORDED,), options.road_step))
    except NothingToMeasureError:
        return
    yield from telling_faults(in_processes(judge_recorded, pairs, options.processes))


def rendered_verdicts(options: Options) -> Iterator[RigVerdict]:
    """Yield the verdicts of rendered roads, of a perfect rig and with every turn."""
    drawn = roads(options.rig_roads, options.road_step, options.seed)
    yield from telling_faults(in_processes(judge_rendered, drawn, options.processes))


def judge_recorded(pair: RoadPair) -> list[RigVerdict]:
    """Return the verdicts of a recorded pair: as it was recorded first, and with every turn."""
    recorded = judge(pair)
    return [
        recorded,
        *(
            against_recorded(judge(replace(pair, right=turned(pair.right, pair.rig, turn)), turn), recorded)
            for turn in TURNS
        ),
    ]


def judge_rendered(road: Road) -> list[RigVerdict]:
    """Return the verdicts of a rendered road: of a perfect rig first, and with every turn."""
    return [against_truth(judge(road.pair(turn), turn)) for turn in (AS_IT_IS, *TURNS)]


def _is_recorded(verdict: RigVerdict) -> bool:
    return verdict.road.source == RECORDED


def _accepted_before(verdicts: Verdicts) -> set[tuple[str, str]]:
    """Return which pairs are accepted without a turn."""
    as_they_are = [each.road for each in verdicts if each.turn == AS_IT_IS and each.road.accepted]
    return {(each.source, each.name) for each in as_they_are}


_HEADER = [*COUNTS_HEADER, "of those accepted without", "greatest error / std", "change within 3 std"]


def _cells(group: Sequence[RigVerdict], before: set[tuple[str, str]]) -> list[str]:
    same = [each for each in group if (each.road.source, each.road.name) in before]
    return [
        *counts(group),
        f"{sum(each.road.accepted for each in same)} of {len(same)}",
        worst(group),
        within(group),
    ]


def _by_turn(verdicts: Verdicts) -> Table:
    table = Table(
        "rig_turns",
        "Turns of the right camera",
        ["set", "turn (deg)", *_HEADER, *(f"change / std, {name}" for name in RATIOS_HEADER)],
        f"{WRONG_MEANS} {ANGLES_ARE} Recorded pairs: change of the alignment against the pair as recorded, "
        "less the turn, over the greater standard deviation of both. Rendered ones: alignment less truth.",
    )
    before = _accepted_before(verdicts)
    for recorded, title in _SETS.items():
        own = [each for each in verdicts if _is_recorded(each) == recorded]
        if not own:
            continue
        moved = [each for each in own if each.turn != AS_IT_IS]
        groups = [("**every turn**", moved)]
        groups += [(turn.name, [each for each in own if each.turn == turn]) for turn in (AS_IT_IS, *TURNS)]
        for name, group in groups:
            changes = [each.change / each.change_std for each in group if len(each.change)]
            table.add(title, name, *_cells(group, before), *ratios(changes))
    return table


def _by_group(verdicts: Verdicts) -> Table:
    table = Table(
        "rig_turns_roads",
        "Turns of the right camera by kind of road",
        ["road", "accepted without a turn", *_HEADER],
        "Tags of the recorded frames; rig, surface and paint of the rendered ones. All turns together.",
    )
    before = _accepted_before(verdicts)
    for tag in dict.fromkeys(each.road.tag for each in verdicts):
        own = [each for each in verdicts if each.road.tag == tag]
        as_it_is = [each for each in own if each.turn == AS_IT_IS]
        moved = [each for each in own if each.turn != AS_IT_IS]
        table.add(tag, counts(as_it_is)[0], *_cells(moved, before))
    return table
