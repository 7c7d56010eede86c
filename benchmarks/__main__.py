"""Measure and write benchmarks/results/: one Markdown file of all tables, a CSV each, and plots."""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from .bias import bias_table
from .drives import drive_table
from .false_alarms import false_alarm_table
from .fleet import fleet_table
from .fleet_state import state_table
from .idle import answer_table, idle_table
from .kills import kill_table
from .limit import limit_table
from .many_lines import many_lines_table
from .mutated_files import mutated_files_table
from .mutations import mutations_table
from .offline import offline_tables
from .options import QUICK, RESULTS, Options
from .paper import noise_table, seed_table
from .peer_table import peer_table
from .recorded import recorded_table
from .search import search_table
from .second import second_tables
from .soak import soak_table
from .speed import cost_tables, ratio_table, size_table
from .structured_noise import structured_noise_table
from .table import Table
from .thresholds import threshold_table
from .variants import variant_tables
from .watch import watch_tables
from .worlds import world_tables

SECTIONS: dict[str, Callable[[Options], Iterator[Table]]] = {
    "ratio": ratio_table,
    "seeds": seed_table,
    "noise": noise_table,
    "limit": limit_table,
    "many_lines": many_lines_table,
    "bias": bias_table,
    "peers": peer_table,
    "search": search_table,
    "sizes": size_table,
    "cost": cost_tables,
    "false_alarms": false_alarm_table,
    "structured_noise": structured_noise_table,
    "recorded": recorded_table,
    "variants": variant_tables,
    "thresholds": threshold_table,
    "worlds": world_tables,
    "second": second_tables,
    "kills": kill_table,
    "mutated_files": mutated_files_table,
    "mutations": mutations_table,
    "idle": idle_table,
    "answers": answer_table,
    "watch": watch_tables,
    "soak": soak_table,
    "fleet": fleet_table,
    "fleet_state": state_table,
    "drives": drive_table,
    "offline": offline_tables,
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
    parser.add_argument("--seed", type=int, help="seed of the worlds of the second generator")
    parser.add_argument("--processes", type=int, help="processes that judge them")
    parser.add_argument("--only", type=int, metavar="INDEX", help="write this one of them as a case")
    parser.add_argument("--turned", action="store_true", help="draw turned right cameras among them, too")
    chosen = parser.parse_args(arguments)
    unknown = [name for name in chosen.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"there is no section {unknown[0]!r}: they are {', '.join(SECTIONS)}")
    names = ("poses", "draws", "seeds", "worlds", "drives", "watch_hours", "bumps")
    sizes = {name: getattr(chosen, name) for name in names if getattr(chosen, name)}
    of_second = ("seed", "processes", "only", "turned")
    sizes |= {name: getattr(chosen, name) for name in of_second if getattr(chosen, name) is not None}
    options = replace(QUICK if chosen.quick else Options(), **sizes)
    cv2.setNumThreads(1)
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in chosen.sections or SECTIONS:
        start = time.perf_counter()
        text = _measure(name, options)
        sys.stdout.write(f"\n{text}\n({time.perf_counter() - start:.0f} s)\n")
        sys.stdout.flush()
    _collect(options.folder)
    return 0


def _measure(name: str, options: Options) -> str:
    """Measure one section, write its files, return its Markdown."""
    tables = list(SECTIONS[name](options))
    if options.only is not None:  # a case was written, nothing was measured
        return ""
    text = "\n".join(table.markdown() for table in tables)
    if name in PLOTS:
        text += f"\n![{name}]({PLOTS[name]})\n"
    if tables:
        thin = " with --quick: too few runs to be quoted" if options.folder != RESULTS else ""
        text = f"*Measured at {_commit()}{thin}.*\n\n{text}"
    for table in tables:
        (options.folder / f"{table.name}.csv").write_text(table.csv(), encoding="utf-8")
    (options.folder / f"{name}.md").write_text(text, encoding="utf-8")
    return text


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
