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

"""Rows that are off, the change over a recorded drive, and the rendered worlds of others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stereo_selfcal import Calibrator

from ..frames import READABLE
from ..options import Options
from ..road_pairs import RoadPair, pairs_of
from ..road_verdicts import in_processes
from ..roads import signed
from ..table import Table, numbers
from .angles import AS_IT_IS, Angles, Array
from .cells import COUNTS_HEADER, WRONG_MEANS, angles_cell, counts, every_table
from .drawn import BOTH, RIG_NAMES, Road, roads
from .verdicts import NOTHING, RigVerdict, against_truth, alignment_of, judge
from .warp import turned

# Asked of the rows: so many fewer accepted at most than with none off.
ROWS_PX = (0.0, 0.05, 0.1, 0.2, 0.5)
FEWER = 0.03
# Asked of the drive: the change by these turns to so much.
DRIVE = "kitti_odometry02"
DRIVE_TURNS = (AS_IT_IS, Angles(yaw_deg=0.06), Angles(yaw_deg=-0.06))
DRIVE_OFF_DEG = 0.02
WORLD_KINDS = ("yaw_err", "one_line_yaw_err", "pitch_err", "roll_err", "rect_err")
_TOP_REASONS = 3


def row_tables(options: Options) -> Iterator[Table]:
    """Judge good rendered roads of which the rows of the right image are off, up and down in turn."""
    drawn = roads(options.rig_roads, options.road_step, options.seed, paints=(BOTH,))
    found = list(in_processes(judge_rows, drawn, options.processes))
    table = Table(
        "rig_rows",
        "Rows of the right image off, good rendered roads",
        ["rig", "off (px)", *COUNTS_HEADER, "against none", "refused as"],
        f"Asked: at most {FEWER:.0%} fewer than with none. {WRONG_MEANS}",
    )
    for rig in ("all rigs", *RIG_NAMES):
        own = [each for each in found if rig in ("all rigs", each[0].road.tag.split(",")[0])]
        straight = sum(each[0].road.accepted for each in own)
        for number, off_px in enumerate(ROWS_PX):
            group = [each[number] for each in own]
            accepted = sum(each.road.accepted for each in group)
            reasons = Counter(each.road.reason for each in group if not each.road.accepted)
            told = (
                ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(_TOP_REASONS)) or "-"
            )
            fewer = f"{(accepted - straight) / max(straight, 1):+.1%}"
            table.add(rig, f"{off_px:g}", *counts(group), fewer, told)
    yield table
    yield every_table("rig_rows_every", [verdict for each in found for verdict in each])


def judge_rows(road: Road) -> list[RigVerdict]:
    """Return the verdicts of a road with every offset of the rows; the nearest pitch is the truth."""
    sign = -1 if road.index % 2 else 1
    verdicts = []
    for off_px in ROWS_PX:
        pair = road.pair(row_px=sign * off_px)
        # Content moves up where the nose goes down.
        turn = Angles(pitch_deg=-sign * float(np.degrees(off_px / pair.rig.fy)))
        verdicts.append(against_truth(judge(pair, turn)))
    return verdicts


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What the frames of a recorded drive say together.

    Attributes:
        turn: How its right camera is turned.
        accepted: How many frames were accepted.
        frames: How many there are.
        pose: Estimate [mm, deg, deg]; empty for none.
        alignment: Estimated (pitch, roll, yaw) [deg]; empty for none.
        std: Its standard deviations.
    """

    turn: Angles
    accepted: int
    frames: int
    pose: Array
    alignment: Array
    std: Array


def drive_tables(options: Options) -> Iterator[Table]:
    """Fuse the frames of a drive, as recorded and with a turned right camera."""
    pairs = list(pairs_of((DRIVE,)))
    tasks = [(turn, pairs) for turn in DRIVE_TURNS]
    drives = list(in_processes(fuse, tasks, options.processes))
    table = Table(
        "rig_change",
        f"Turns of the right camera over {len(pairs)} frames of a drive ({DRIVE})",
        [
            "turn (deg)",
            "accepted",
            "pose (mm, deg, deg)",
            "alignment (deg)",
            "std",
            "change of yaw less turn",
            "met",
        ],
        f"Asked: the change of yaw is found to {DRIVE_OFF_DEG:g} deg. Angles: pitch, roll, yaw.",
    )
    recorded = drives[0]
    for each in drives:
        known = bool(len(each.alignment) and len(recorded.alignment))
        off = float(each.alignment[2] - recorded.alignment[2] - each.turn.yaw_deg) if known else np.nan
        table.add(
            each.turn.name,
            f"{each.accepted} of {each.frames}",
            signed(each.pose),
            angles_cell(each.alignment),
            numbers(each.std) if len(each.std) else "-",
            f"{off:+.4f}" if known else "-",
            ("yes" if abs(off) <= DRIVE_OFF_DEG else "**no**"),
        )
    yield table


def fuse(task: tuple[Angles, list[RoadPair]]) -> Drive:
    """Calibrate from all frames of a drive whose right camera is turned in that way."""
    turn, pairs = task
    calibrator = Calibrator(pairs[0].rig)
    accepted = 0
    for index, pair in enumerate(pairs):
        right = pair.right if turn == AS_IT_IS else turned(pair.right, pair.rig, turn)
        accepted += calibrator.add(pair.left, right, index / 10).accepted  # it was recorded at 10 Hz
    estimate = calibrator.estimate
    if estimate is None or estimate.extrinsics is None:
        return Drive(turn, accepted, len(pairs), NOTHING, NOTHING, NOTHING)
    pose = estimate.extrinsics.as_array() * READABLE
    return Drive(turn, accepted, len(pairs), pose, *alignment_of(estimate))


def world_tables(options: Options) -> Iterator[Table]:
    """Judge the rendered worlds of others whose right camera is turned."""
    pairs = [pair for pair in pairs_of(("worlds",)) if pair.name.startswith(WORLD_KINDS)]
    table = Table(
        "rig_worlds",
        "Rendered pairs of others with a turned right camera",
        ["world", "expected", "verdict", "reason", "error (mm, deg, deg)", "std", "alignment (deg)", "std"],
        f"(!): not what is expected. {WRONG_MEANS}",
    )
    verdicts = list(in_processes(judge, pairs, options.processes))
    for each in verdicts:
        road = each.road
        table.add(
            road.name,
            road.expected,
            f"{road.word} (!)" if road.at_fault else road.word,
            road.reason or "-",
            signed(road.error),
            numbers(road.std) if road.accepted else "-",
            angles_cell(each.alignment),
            numbers(each.alignment_std) if len(each.alignment_std) else "-",
        )
    yield table
    yield every_table("rig_worlds_every", verdicts)
