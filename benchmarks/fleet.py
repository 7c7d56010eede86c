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

"""A fleet of small recordings: time against one process, a worker killed in the middle, a run interrupted.

Each run is the command as a user types it, in a process of its own; the numbers of every run are compared
with those of `replay`'s own function, in this process.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from stereo_selfcal import ConfigError
from stereo_selfcal.fleet.outcome import BagOutcome
from stereo_selfcal.offline import BagSource, calibrate_recording
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene, random_scene

from .options import Options
from .table import Table

_N_FRAMES = 3
_NOISE = 0.02
_POLL_S = 0.05
_ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True)
class _Run:
    """One run of the command.

    Attributes:
        status: Exit status.
        wall_s: From its start to its end [s].
        cpu_s: Processor time of it and its workers [s]: other work on the machine hardly changes it.
        killed: Workers killed.
        done: Recordings that were finished when it ended.
        wrong: Finished recordings whose row differs from that of `replay`.
    """

    status: int
    wall_s: float
    cpu_s: float
    killed: int
    done: int
    wrong: int


def fleet_table(options: Options) -> Iterator[Table]:
    """Time and outcome of the same recordings done in several ways."""
    table = Table(
        "fleet",
        f"{options.fleet_bags} recordings of {_N_FRAMES} frames (640 x 480) on this machine",
        [
            "run",
            "exit status",
            "finished",
            "rows unlike replay's",
            "processor time [s]",
            "wall time [s]",
            "recordings/s",
        ],
        "'one process': `calibrate_recording`, the function behind `replay`, one recording after the other "
        "in a process that is up. The others are the command `fleet --no-report` from its start to its end. "
        "'1 killed', '2 killed': SIGKILL to one or both of two workers when a third of the recordings is "
        "done; 'killed as they start': to the first two. 'interrupted': SIGINT to the command when half of "
        "them is done, 'SIGKILL': that; and then the same command again. 'with a dashboard': on Dask's "
        f"processes, with TLS. {os.cpu_count()} cores, which other work may have used as well.",
    )
    # Where SIGINT is ignored, as in the background of a shell, so it would be in the runs.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="fleet_bench.") as folder:
        bags = _make_bags(Path(folder) / "bags", options.fleet_bags)
        start_s, cpu_s = time.perf_counter(), time.process_time()
        expected = {bag.name: _row(bag) for bag in bags}
        wall_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
        n = len(bags)
        table.add("one process", "", f"{n}", "", f"{cpu_s:.1f}", f"{wall_s:.1f}", f"{n / wall_s:.2f}")
        fleet = _Fleet(Path(folder), expected)
        _add(table, "2 workers", fleet.run("2 workers", 2), 0)
        with_dashboard = fleet.run("dashboard", 2, more=["--dashboard-port", "0"])
        _add(table, "2 workers, with a dashboard", with_dashboard, 0)
        for count in (1, 2):
            killed = fleet.run(f"killed{count}", 2, _when_done(n // 3, partial(_kill_workers, count)))
            _add(table, f"2 workers, {killed.killed} killed", killed, 0)
        started = fleet.run("started", 2, lambda run, _: _kill_workers(2, run))
        _add(table, f"2 workers, {started.killed} killed as they start", started, 0)
        for name, number in (("interrupted", signal.SIGINT), ("SIGKILL", signal.SIGKILL)):
            first = fleet.run(name, 2, _when_done(n // 2, partial(_send, number)))
            _add(table, f"2 workers, {name}", first, 0)
            _add(table, "the same again", fleet.run(name, 2), first.done)
        _add(table, "and again", fleet.run(name, 2), n)
    yield table


def _add(table: Table, name: str, run: _Run, before: int) -> None:
    finished = f"{run.done} ({before} before)" if before else f"{run.done}"
    rate = f"{(run.done - before) / run.wall_s:.2f}" if run.done > before else ""
    table.add(name, f"{run.status}", finished, f"{run.wrong}", f"{run.cpu_s:.1f}", f"{run.wall_s:.1f}", rate)


def _make_bags(folder: Path, n: int) -> list[Path]:
    """Write recordings of random poses."""
    folder.mkdir()
    paths = []
    for index in range(n):
        scene = random_scene(np.random.default_rng([7, index]), _NOISE)
        made = custom_scene(name=f"drive{index:03d}", n_frames=_N_FRAMES, seed=index, noise_fraction=_NOISE)
        paths.append(folder / made.name)
        write_bag(paths[-1], replace(made, scene=scene))
    return paths


def _row(bag: Path) -> BagOutcome:
    """Return the row of a recording, calibrated here."""
    with BagSource([bag]) as source:
        return BagOutcome.from_replay(
            bag.name, calibrate_recording(source), (source.left_name, source.right_name)
        )


class _Fleet:
    """Runs the command on the recordings of a folder."""

    def __init__(self, folder: Path, expected: dict[str, BagOutcome]) -> None:
        self._folder = folder
        self._expected = expected

    def run(
        self,
        name: str,
        workers: int,
        meddle: Callable[[subprocess.Popen[bytes], Path], int] = lambda run, results: 0,
        more: Sequence[str] = (),
    ) -> _Run:
        """Run it once, and look at what it has left.

        Args:
            name: Name of the output folder.
            workers: Number of workers.
            meddle: Called once it runs, with the process and the folder of its results; returns kills.
            more: Further options.
        """
        output = self._folder / name
        command = [sys.executable, "-m", "stereo_selfcal", "fleet", str(self._folder / "bags")]
        command += ["--output", str(output), "--workers", str(workers), *more]
        command += ["--no-report"]  # as little as the process it is compared with
        start_s, cpu_s = time.perf_counter(), _children_s()
        with subprocess.Popen(
            command, cwd=_ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as run:
            killed = meddle(run, output / "results")
            status = run.wait()
        wall_s, cpu_s = time.perf_counter() - start_s, _children_s() - cpu_s
        # A command that was killed has written no table.
        files = list((output / "results").glob("*.json"))
        wrong = sum(not self._as_expected(file) for file in files)
        return _Run(status, wall_s, cpu_s, killed, len(files), wrong)

    def _as_expected(self, file: Path) -> bool:
        """Whether a result can be read and is that of `replay`, to the last digit."""
        try:
            row = BagOutcome.from_mapping(json.loads(file.read_text(encoding="utf-8"))["outcome"])
        except (ValueError, KeyError, ConfigError):
            return False
        expected = self._expected[Path(row.bag).name]
        return row == replace(expected, bag=row.bag, left=row.left, right=row.right, report=row.report)


def _children_s() -> float:
    """Return the processor time of the processes started here that have ended, and of their own [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _when_done(
    n: int, act: Callable[[subprocess.Popen[bytes]], int]
) -> Callable[[subprocess.Popen[bytes], Path], int]:
    """Return what waits for so many results and then acts; it returns how many were killed."""

    def meddle(run: subprocess.Popen[bytes], results: Path) -> int:
        while run.poll() is None:
            if results.is_dir() and len(list(results.glob("*.json"))) >= n:
                return act(run)
            time.sleep(_POLL_S)
        return 0

    return meddle


def _send(number: signal.Signals, run: subprocess.Popen[bytes]) -> int:
    run.send_signal(number)
    return 0


def _kill_workers(count: int, run: subprocess.Popen[bytes]) -> int:
    """Kill so many of the workers of a run, by their process ids; wait for them. Return how many."""
    killed: set[str] = set()
    while len(killed) < count and run.poll() is None:
        found: list[str] = []
        with suppress(OSError):  # a process may end while it is looked at
            # Those started by threads are children of the thread.
            for task in Path(f"/proc/{run.pid}/task").iterdir():
                found += (task / "children").read_text(encoding="ascii").split()
        for pid in found:
            with suppress(OSError):
                if (
                    len(killed) < count
                    and pid not in killed
                    and b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
                ):
                    os.kill(int(pid), signal.SIGKILL)
                    killed.add(pid)
        time.sleep(_POLL_S)
    return len(killed)
