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

"""Worlds of the second generator: what is accepted, what of it is wrong, and which good roads are refused."""

from __future__ import annotations

import argparse
import csv
import json
import math
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import calibrate

from .options import Options
from .second_worlds import World, draw
from .table import Table, number

# Errors that count [m, deg, deg]: as wrong beyond so many standard deviations of its own, and as gross.
WRONG = (0.03, 0.3, 0.8)
WRONG_STDS = 5.0
GROSS = (0.06, 0.5, 1.2)
_EVERY = 50  # worlds between two lines of progress
_LOW = "low_rig"


@dataclass(frozen=True)
class Judged:
    """One world and what became of it. Errors are estimate minus truth; empty where it was refused.

    Attributes:
        index: Number within the series.
        kind: Its kind.
        rig: Its rig.
        tags: Words about it.
        good: Whether a calibration must answer.
        accepted: Whether it did.
        reason: Why not.
        error_mm, error_pitch_deg, error_roll_deg: Errors.
        std_mm, std_pitch_deg, std_roll_deg: Reported standard deviations.
        height_m, pitch_deg, roll_deg: The truth.
        rows_left, rows_right: Rows of both images with paint of that side.
        wrong: Whether the result is wrong by its own standard deviations.
        gross: Whether the result is wrong by any.
        seconds: Time of the calibration.
    """

    index: int
    kind: str
    rig: str
    tags: str
    good: bool
    accepted: bool
    reason: str
    error_mm: float | None
    error_pitch_deg: float | None
    error_roll_deg: float | None
    std_mm: float | None
    std_pitch_deg: float | None
    std_roll_deg: float | None
    height_m: float
    pitch_deg: float
    roll_deg: float
    rows_left: int
    rows_right: int
    wrong: bool
    gross: bool
    seconds: float


def main(arguments: list[str]) -> int:
    """Judge worlds without the other benchmarks and what they need."""
    usual = Options()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.second", description=__doc__)
    parser.add_argument("--worlds", type=int, default=usual.worlds, help="how many")
    parser.add_argument("--seed", type=int, default=usual.seed, help="seed of the series")
    parser.add_argument("--processes", type=int, default=usual.processes, help="processes that judge them")
    parser.add_argument("--only", type=int, metavar="INDEX", help="write this one as a case")
    parser.add_argument("--kind", help="the only kind that is drawn")
    parser.add_argument("--turned", action="store_true", help="draw turned right cameras among them, too")
    parser.add_argument("--folder", type=Path, default=usual.folder, help="where the tables go")
    options = replace(usual, **vars(parser.parse_args(arguments)))
    cv2.setNumThreads(1)
    options.folder.mkdir(parents=True, exist_ok=True)
    for table in second_tables(options):
        (options.folder / f"{table.name}.csv").write_text(table.csv(), encoding="utf-8")
        sys.stdout.write(f"\n{table.markdown()}")
    return 0


def second_tables(options: Options) -> Iterator[Table]:
    """Judge worlds, and write each to a file as soon as it is known; or show a single one."""
    if options.only is not None:
        world = draw(options.seed, options.only, turned=options.turned, kind=options.kind)
        write_case(world, options.folder / "second_cases")
        return
    judged = list(_judged(options))
    yield summary(judged, options)
    yield by_kind(judged)
    yield faults(judged)


def _judged(options: Options) -> Iterator[Judged]:
    start = time.perf_counter()
    judge = partial(judge_world, options.seed, options.turned, options.kind)
    with (options.folder / "second_worlds.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Judged)], lineterminator="\n")
        writer.writeheader()
        tally: Counter[str] = Counter()
        for count, world in enumerate(_map(judge, range(options.worlds), options.processes), start=1):
            writer.writerow({name: _cell(value) for name, value in asdict(world).items()})
            file.flush()
            tally.update(name for name in ("good", "accepted", "wrong", "gross") if getattr(world, name))
            tally["both"] += world.good and world.accepted
            if count % _EVERY == 0 or world.wrong or world.gross:
                sys.stdout.write(
                    f"{count} of {options.worlds}: {tally['accepted']} accepted, {tally['both']} of "
                    f"{tally['good']} good ones, {tally['wrong']} wrong, {tally['gross']} gross "
                    f"({time.perf_counter() - start:.0f} s)"
                    + (f"; {world.kind} {world.index}\n" if world.wrong or world.gross else "\n")
                )
                sys.stdout.flush()
            yield world


def _map(judge: partial[Judged], indices: Iterable[int], processes: int) -> Iterator[Judged]:
    if processes <= 1:
        yield from map(judge, indices)
        return
    with multiprocessing.get_context("spawn").Pool(processes, initializer=_one_thread) as pool:
        yield from pool.imap(judge, indices, chunksize=2)


def _one_thread() -> None:
    cv2.setNumThreads(1)


def judge_world(seed: int, turned: bool, kind: str | None, index: int) -> Judged:
    """Render one world, calibrate it, and compare."""
    world = draw(seed, index, turned=turned, kind=kind)
    left, right = world.render()
    start = time.perf_counter()
    result = calibrate(left, right, world.rig)
    seconds = time.perf_counter() - start
    error: tuple[float | None, ...] = (None, None, None)
    std: tuple[float | None, ...] = (None, None, None)
    wrong = gross = False
    if result.accepted and result.extrinsics is not None and result.covariance is not None:
        scale = np.array([1.0, math.degrees(1), math.degrees(1)])
        off = (result.extrinsics.as_array() - world.truth.as_array()) * scale
        spread = np.sqrt(np.diag(result.covariance)) * scale
        gross = bool((np.abs(off) > GROSS).any())
        wrong = bool(((np.abs(off) > WRONG) & (np.abs(off) > WRONG_STDS * spread)).any())
        readable = np.array([1e3, 1.0, 1.0])
        error, std = tuple(off * readable), tuple(spread * readable)
    truth, rows = world.truth, world.paint_rows
    return Judged(
        index,
        world.kind,
        world.rig_name,
        " ".join(sorted(world.tags)),
        world.good,
        result.accepted,
        "" if result.reason is None else str(result.reason),
        error[0],
        error[1],
        error[2],
        std[0],
        std[1],
        std[2],
        truth.height_m,
        math.degrees(truth.pitch_rad),
        math.degrees(truth.roll_rad),
        rows["left"],
        rows["right"],
        wrong,
        gross,
        seconds,
    )


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.4f}"
    return "" if value is None else str(value)


def write_case(world: World, folder: Path) -> Path:
    """Write a world's images and numbers into a folder of its own, and return that."""
    case = folder / f"{world.kind}_{world.rig_name}_{world.seed}_{world.index}"
    case.mkdir(parents=True, exist_ok=True)
    for name, image in zip(("left", "right"), world.render(), strict=True):
        cv2.imwrite(str(case / f"{name}.png"), image)
    truth = world.truth
    numbers = {
        "kind": world.kind,
        "seed": world.seed,
        "index": world.index,
        "expected": "accept" if world.good else "refuse, or be right within what is reported",
        "tags": sorted(world.tags),
        "rig": world.rig.to_mapping(),
        "truth": {
            "height_m": truth.height_m,
            "pitch_deg": math.degrees(truth.pitch_rad),
            "roll_deg": math.degrees(truth.roll_rad),
        },
        "unevenness_m": world.unevenness_m,
        "paint_rows": world.paint_rows,
    }
    (case / "case.json").write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    sys.stdout.write(f"{case}\n")
    return case


def summary(judged: list[Judged], options: Options) -> Table:
    """Return the numbers of all worlds."""
    table = Table(
        "second",
        "Worlds of the second generator",
        ["worlds", "accepted", "wrong", "gross", "good", "good accepted", "good, low rig", "error / std"],
        f"{options.worlds} worlds, seed {options.seed}. Wrong: beyond {WRONG_STDS:g} reported standard "
        f"deviations and {_triple(WRONG)}; gross: beyond {_triple(GROSS)}. Good: a fair road with paint of "
        "the own lane on 60 rows; the low rigs have a column of their own. Error over standard deviation: "
        "root mean square of height, pitch and roll of the good ones.",
    )
    good = [world for world in judged if world.good]
    low = [world for world in good if _LOW in world.tags.split()]
    table.add(
        str(len(judged)),
        str(sum(world.accepted for world in judged)),
        str(sum(world.wrong for world in judged)),
        str(sum(world.gross for world in judged)),
        str(len(good)),
        _share([world for world in good if world not in low]),
        _share(low),
        " / ".join(number(value, 2) for value in _ratios(good)),
    )
    return table


def _triple(limits: tuple[float, float, float]) -> str:
    return f"{limits[0] * 1e3:g} mm, {limits[1]:g} deg of pitch or {limits[2]:g} deg of roll"


def _share(worlds: list[Judged]) -> str:
    accepted = sum(world.accepted for world in worlds)
    return f"{accepted} of {len(worlds)} ({accepted / max(len(worlds), 1):.1%})"


def _ratios(worlds: list[Judged]) -> list[float]:
    """Return the root mean squares of error over standard deviation."""
    answers = [world for world in worlds if world.accepted]
    if not answers:
        return []
    errors = np.array([(each.error_mm, each.error_pitch_deg, each.error_roll_deg) for each in answers], float)
    stds = np.array([(each.std_mm, each.std_pitch_deg, each.std_roll_deg) for each in answers], float)
    return [float(value) for value in np.sqrt(np.mean((errors / stds) ** 2, axis=0))]


def by_kind(judged: list[Judged]) -> Table:
    """Return the numbers of each kind."""
    header = [
        "kind",
        "worlds",
        "accepted",
        "wrong",
        "gross",
        "good",
        "good accepted",
        "why good ones were refused",
    ]
    table = Table("second_kinds", "By kind", header)
    for kind in sorted({world.kind for world in judged}):
        own = [world for world in judged if world.kind == kind]
        good = [world for world in own if world.good]
        reasons = Counter(world.reason for world in good if not world.accepted)
        table.add(
            kind,
            str(len(own)),
            str(sum(world.accepted for world in own)),
            str(sum(world.wrong for world in own)),
            str(sum(world.gross for world in own)),
            str(len(good)),
            str(sum(world.accepted for world in good)),
            ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(3)),
        )
    return table


def faults(judged: list[Judged]) -> Table:
    """Return the results that are wrong or gross."""
    header = ["index", "kind", "rig", "tags", "wrong", "error [mm, deg, deg]", "std [mm, deg, deg]"]
    table = Table("second_faults", "Wrong and gross results", header)
    for world in judged:
        if world.wrong or world.gross:
            errors = (world.error_mm, world.error_pitch_deg, world.error_roll_deg)
            stds = (world.std_mm, world.std_pitch_deg, world.std_roll_deg)
            table.add(
                str(world.index),
                world.kind,
                world.rig,
                world.tags,
                "wrong" if world.wrong else "gross",
                " / ".join(f"{value:+.3g}" for value in errors if value is not None),
                " / ".join(f"{value:.2g}" for value in stds if value is not None),
            )
    return table


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
