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

"""Measure and write benchmarks/results/: one Markdown file of all tables, a CSV each, and plots."""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np

from .options import QUICK, Options
from .rig_errors import PARTS as RIG_PARTS
from .road_pairs import SOURCES
from .table import NothingToMeasureError, Table

# The function that yields the tables of each section. A module is imported when its section is measured: the
# others may need what is not installed.
SECTIONS = {
    "speed": "ratios.speed_table",
    "seeds": "paper.seed_table",
    "noise": "paper.noise_table",
    "limit": "limit.limit_table",
    "many_lines": "many_lines.many_lines_table",
    "bias": "bias.bias_table",
    "peers": "peer_table.peer_table",
    "search": "search.search_table",
    "sizes": "costs.size_table",
    "cost": "costs.cost_tables",
    "false_alarms": "false_alarms.false_alarm_table",
    "structured_noise": "structured_noise.structured_noise_table",
    "roads": "roads.road_tables",
    "strips": "road_strips.strip_table",
    "road_times": "road_times.time_tables",
    "steady": "steady.steady_tables",
    "scales": "scales.scale_tables",
    "second": "second.second_tables",
    "thresholds": "thresholds.threshold_table",
    "worlds": "worlds.world_tables",
    "kills": "kills.kill_table",
    "mutated_files": "mutated_files.mutated_files_table",
    "mutations": "mutations.mutations_table",
    "road_pose": "road_pose.road_pose_tables",
    "idle": "node_cost.cost_table",
    "memory": "idle.memory_table",
    "answers": "idle.answer_table",
    "watch": "watch.watch_tables",
    "soak": "soak.soak_table",
    "fleet": "fleet.fleet_table",
    "fleet_state": "fleet_state.state_table",
    "drives": "drives.drive_table",
    "offline": "offline.offline_tables",
    "rig_errors": "rig_errors.rig_error_tables",
    "mount_frames": "mount_drives.frame_errors.frame_tables",
    "mount_drives": "mount_drives.judged.drive_tables",
    "mount_how_long": "mount_drives.how_long.how_long_tables",
    "mount_rendered": "mount_drives.rendered.rendered_tables",
    "mount_recorded": "mount_drives.recorded.recorded_tables",
    "history": "history.history_table",
    "travel_drives": "travel_drives.judged.drive_tables",
    "travel_recorded": "travel_drives.recorded.recorded_tables",
}
# Drawn by a section, shown below its tables.
PLOTS = {"limit": "limit.png", "peers": "peers.png", "search": "search.png", "sizes": "sizes.png"}


def main(arguments: list[str]) -> int:
    """Run the chosen sections, all of them by default."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"any of: {', '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="few poses, draws and seeds: does it run?")
    parser.add_argument("--poses", type=int, help="random poses per row")
    parser.add_argument("--draws", type=int, help="noise draws of the bias table")
    parser.add_argument("--seeds", type=int, help="runs of every optimiser")
    parser.add_argument("--worlds", type=int, help="random worlds")
    parser.add_argument("--drives", type=int, help="simulated drives of each kind")
    parser.add_argument(
        "--watch-hours", type=int, help="hours the watch is driven without a change, for each ride"
    )
    parser.add_argument("--bumps", type=int, help="drives the watch is driven with each bump, for each ride")
    parser.add_argument(
        "--source",
        action="append",
        dest="sources",
        choices=SOURCES,
        help="one of the sets of stereo pairs (may be repeated); all of them by default",
    )
    parser.add_argument(
        "--road-step", "--every", type=int, dest="road_step", help="one pair out of so many of each set"
    )
    parser.add_argument("--rig-roads", type=int, help="rendered roads of each kind that rig_errors turns")
    parser.add_argument("--rig-worlds", type=int, help="rendered roads of each kind of its drawn rigs")
    parser.add_argument(
        "--part",
        action="append",
        dest="rig_parts",
        choices=RIG_PARTS,
        help="one part of the section rig_errors (may be repeated); all of them by default",
    )
    parser.add_argument("--processes", type=int, help="processes that judge stereo pairs")
    parser.add_argument("--folder", type=Path, help="where tables and plots go")
    parser.add_argument(
        "--seed", type=int, help="seed of the worlds of the second generator, and of rig_errors"
    )
    parser.add_argument("--only", type=int, metavar="INDEX", help="write this one of them as a case")
    parser.add_argument("--kind", help="the only kind of them that is drawn")
    parser.add_argument("--turned", action="store_true", help="draw turned right cameras among them, too")
    chosen = parser.parse_args(arguments)
    unknown = [name for name in chosen.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"there is no section {unknown[0]!r}: they are {', '.join(SECTIONS)}")
    # Every argument but the sections and --quick is one of the options.
    sizes = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in vars(chosen).items()
        if value is not None and value is not False and value != [] and name not in ("sections", "quick")
    }
    if chosen.sources or chosen.road_step or chosen.rig_parts:
        # A part of the pairs does not replace what was measured on all of them.
        sizes.setdefault("folder", QUICK.folder)
    options = replace(QUICK if chosen.quick else Options(), **sizes)
    cv2.setNumThreads(1)
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in chosen.sections or SECTIONS:
        start = time.perf_counter()
        try:
            text = _measure(name, options)
        except NothingToMeasureError as reason:
            text = f"{name}: skipped, {reason}"
        sys.stdout.write(f"\n{text}\n({time.perf_counter() - start:.0f} s)\n")
        sys.stdout.flush()
    _collect(options.folder)
    return 0


def _measure(name: str, options: Options) -> str:
    """Measure one section, write its files, return its Markdown.

    Raises:
        NothingToMeasureError: What it measures is not there; what was measured before is kept.
    """
    tables = list(_section(name)(options))
    if options.only is not None:  # a case was written, nothing was measured
        return ""
    text = "\n".join(table.markdown() for table in tables if table.shown)
    if name in PLOTS:
        text += f"\n![{name}]({PLOTS[name]})\n"
    if tables:
        thin = " on a part: too few runs to be quoted" if options.folder == QUICK.folder else ""
        text = f"*Measured at {_commit()}{thin}.*\n\n{text}"
    for table in tables:
        (options.folder / f"{table.name}.csv").write_text(table.csv(), encoding="utf-8")
    (options.folder / f"{name}.md").write_text(text, encoding="utf-8")
    return text


def _section(name: str) -> Callable[[Options], Iterator[Table]]:
    """Return the function that yields the tables of a section."""
    module, _, function = SECTIONS[name].rpartition(".")
    tables: Callable[[Options], Iterator[Table]] = getattr(import_module(f".{module}", __package__), function)
    return tables


def _collect(folder: Path) -> None:
    """Write all sections there are, measured now or before, to one file."""
    versions = f"Python {platform.python_version()}, NumPy {np.__version__}, OpenCV {cv2.__version__}"
    text = f"# Measured by `make bench`\n\n{versions}, {platform.machine()}.\n"
    for name in SECTIONS:
        path = folder / f"{name}.md"
        if path.is_file():
            text += f"\n{path.read_text(encoding='utf-8')}"
    (folder / "results.md").write_text(text, encoding="utf-8")


def _commit() -> str:
    """Return the commit that is measured: sections may be measured one by one."""
    root = Path(__file__).resolve().parents[1]
    try:
        commit = _git(root, "rev-parse", "--short", "HEAD")
        # What the benchmark itself writes is no change of what it measures.
        changes = _git(root, "diff", "--stat", "HEAD", "--", ".", ":!benchmarks/results")
    except (OSError, subprocess.CalledProcessError):
        return "an unknown commit"
    return f"commit {commit}{' with changes' if changes else ''}"


def _git(root: Path, *arguments: str) -> str:
    run = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    return run.stdout.strip()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
