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

"""``fleet``: calibrate many recordings on many processes, as ``replay`` calibrates each."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from ..core.errors import printable
from ..files.atomic_file import write_atomically
from ..files.parameter_file import chosen_config
from ..files.rig_file import read_rig_file
from ..files.safe_yaml import read_content
from ..fleet.bags import find_bags
from ..fleet.index import index_page
from ..fleet.outcome import BagOutcome, Status
from ..fleet.processes import ProcessWorkers
from ..fleet.scheduling import Done, FleetRun
from ..fleet.store import Bag, Store
from ..fleet.table import check_table, write_table
from ..fleet.work import FleetSettings, make_report, versions
from ..fleet.workers import PATIENCE_S, Workers, internal_error
from ..offline import Selection, default_jobs
from .console import (
    EXIT_NOT_ACCEPTED,
    EXIT_OK,
    OTHER_STATUSES,
    Parser,
    Progress,
    UsageError,
    run,
)
from .outputs import File, check_outputs, recording_files
from .replay_options import add_camera_options, add_selection_options, positive_int, time_s
from .report import as_dict

_DESCRIPTION = """\
Calibrate many recordings, one task each, on the cores of this machine or on a Dask cluster.

BAG is what 'replay' takes, or a folder of such; @FILE is a file with one BAG a line. OUTPUT gets
table.csv, index.html, and for each recording results/*.json and reports/*.html. A run that was
interrupted goes on where it was; what has changed since is done again.
"""
_EPILOG = f"""\
exit status: 0 all are calibrated; 1 some are not (refused, damaged); 2 bad usage, or no cluster;
{OTHER_STATUSES}
Numbers are those of 'replay', to the last digit, on any number of workers.
"""
_DEFAULT_OUTPUT = Path("fleet")
_TABLE, _INDEX = "table.csv", "index.html"
# Longer recordings are done in stretches: at 10 Hz about a minute of work.
_STRETCH_S = 120.0
# Loggers of Dask's that repeat in many lines what is said here in one; the nanny's, which says that a worker
# died and is replaced, is none of them.
_CHATTY = ("client", "comm", "core", "scheduler", "worker")
_LAST_PORT = 65535
_LONGEST_LIST = 2**24  # bytes: 100 000 recordings with long paths
_TICK_S = 0.5  # between two looks of the progress bar at the clock


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status of docs/fleet.md."""
    return run("fleet", _fleet, argv)


def _fleet(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    _check_cluster(arguments)
    settings = _settings(arguments)
    if arguments.table is not None:
        check_table(arguments.table)
    if arguments.reports and find_spec("jinja2") is None:
        raise UsageError("reports need the Python module jinja2, which is not installed; or give --no-report")
    paths = find_bags(list(listed(arguments.bags)))
    if not paths:
        raise UsageError("the list names no recording")
    _check_outputs(arguments, paths)
    bags = [Bag.of(path, settings) for path in paths]
    try:
        store = Store(arguments.output, arguments.reports)
    except OSError as error:
        raise UsageError(
            f"--output {arguments.output}: {error.strerror}; choose a writable folder"
        ) from error
    outcomes = _Outcomes(bags, store, arguments.table)
    waiting = outcomes.resume()
    try:
        if waiting:
            _run(waiting, settings, outcomes, arguments)
    finally:
        # Interrupted or not: what is done is in the table, and what is not is said to be so.
        outcomes.write()
    sys.stdout.write(outcomes.summary())
    return EXIT_OK if outcomes.all_calibrated else EXIT_NOT_ACCEPTED


class _Outcomes:
    """The outcome of each recording, in memory and in the output folder."""

    def __init__(self, bags: Sequence[Bag], store: Store, table: Path | None) -> None:
        self._store = store
        self._table = table
        self._bags = bags
        self._rows = {bag.path: BagOutcome(bag.name, Status.NOT_DONE) for bag in bags}
        self._resumed = 0

    def resume(self) -> list[Bag]:
        """Take over the outcomes of a former run; return the recordings without one."""
        self._look()
        waiting = [bag for bag in self._bags if self._rows[bag.path].status is Status.NOT_DONE]
        self._resumed = len(self._bags) - len(waiting)
        for bag in waiting:
            self._store.check(bag)
        return waiting

    def _look(self) -> None:
        """Take over what is in the folder."""
        for bag in self._bags:
            if self._rows[bag.path].status is Status.NOT_DONE:
                found = self._store.finished(bag)
                self._rows[bag.path] = self._rows[bag.path] if found is None else found

    def take(self, done: Done) -> BagOutcome:
        """Keep a recording that is done."""
        report = "" if done.report is None else self._store.save_report(done.bag, done.report)
        outcome: BagOutcome = done.outcome.named(done.bag.name, report)
        replay = None if done.calibrated is None else as_dict(done.calibrated.replay)
        try:
            self._store.save(done.bag, outcome, replay)
        except ValueError as error:  # a number that is none, which is a fault of ours
            outcome = BagOutcome(done.bag.name, Status.FAILED, internal_error(error).reason)
            self._store.save(done.bag, outcome, None)
        self._rows[done.bag.path] = outcome
        return outcome

    @property
    def counts(self) -> Counter[Status]:
        """How many recordings have which status."""
        return Counter(row.status for row in self._rows.values())

    @property
    def all_calibrated(self) -> bool:
        """Whether there is nothing to complain about."""
        return set(self.counts) == {Status.CALIBRATED}

    def write(self) -> None:
        """Write the tables and the index page."""
        self._look()  # Ctrl-C may have come between a result and the note of it
        rows = list(self._rows.values())
        write_table(self._store.folder / _TABLE, rows)
        if self._table is not None:
            write_table(self._table, rows)
        about = "Made by " + ", ".join(f"{name} {version}" for name, version in versions().items()) + "."
        write_atomically(self._store.folder / _INDEX, index_page(rows, about).encode())

    def summary(self) -> str:
        """Return what is said at the end."""
        counts = self.counts
        parts = [f"{counts[status]} {status}" for status in Status if counts[status]]
        before = f" ({self._resumed} of them before)" if self._resumed else ""
        reserved = sum(row.with_reservations for row in self._rows.values())
        parts[-1] += f"; {reserved} with reservations" if reserved else ""
        text = f"{len(self._bags)} recordings{before}: {', '.join(parts)}\n"
        reasons = Counter(row.reason for row in self._rows.values() if row.status is Status.REFUSED)
        text += "".join(f"  {count} x {reason}\n" for reason, count in reasons.most_common())
        for row in self._rows.values():
            if row.status in (Status.FAILED, Status.DAMAGED):
                text += f"  {row.bag}: {row.reason}\n"
        return f"{text}{printable(str(self._store.folder / _INDEX))}\n"


def _run(
    waiting: Sequence[Bag], settings: FleetSettings, outcomes: _Outcomes, arguments: argparse.Namespace
) -> None:
    """Calibrate the waiting recordings, with a progress bar."""
    progress = Progress(len(waiting))
    start_s = shown_s = time.monotonic()
    done_count = 0

    def show() -> None:
        nonlocal shown_s
        shown_s = time.monotonic()
        progress.show(done_count, _note(outcomes.counts, done_count, len(waiting), shown_s - start_s))

    def on_done(done: Done) -> None:
        nonlocal done_count
        done_count += 1
        outcome = outcomes.take(done)
        if outcome.status in (Status.FAILED, Status.DAMAGED) or done.problem:
            progress.clear()
            problem = outcome.reason or f"no report: {done.problem}"
            sys.stderr.write(f"fleet: {outcome.bag}: {problem}\n")
        show()

    def on_wait() -> None:
        if time.monotonic() - shown_s > _TICK_S:
            show()

    sys.stderr.write(f"{len(waiting)} recordings to do\n")
    with _workers(arguments) as workers:
        show()
        try:
            report = make_report if arguments.reports else None
            FleetRun(workers, settings, arguments.stretch_s, report).run(waiting, on_done, on_wait)
        except KeyboardInterrupt:
            progress.clear()
            sys.stderr.write(
                f"fleet: {done_count} of {len(waiting)} done; the same command goes on from here\n"
            )
            raise
        finally:
            progress.clear()


def _note(counts: Counter[Status], done: int, total: int, elapsed_s: float) -> str:
    """Return what stands behind the bar."""
    parts = [
        f"{counts[status]} {status}"
        for status in (Status.REFUSED, Status.DAMAGED, Status.FAILED)
        if counts[status]
    ]
    if done:
        left_s = elapsed_s / done * (total - done)
        parts.append(f"{left_s / 60:.0f} min left" if left_s > 90 else f"{left_s:.0f} s left")
    return ", ".join(parts)


@contextmanager
def _workers(arguments: argparse.Namespace) -> Iterator[Workers]:
    count = arguments.workers or default_jobs()
    if arguments.scheduler is None and arguments.dashboard_port is None:
        with ProcessWorkers(count, arguments.patience_s) as workers:
            yield workers
        return
    from ..fleet import cluster  # noqa: PLC0415  (needs Dask)

    for name in _CHATTY:
        logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
    if arguments.scheduler is not None:
        connected = cluster.existing_cluster(arguments.scheduler)
    else:
        connected = cluster.local_cluster(count, arguments.dashboard_port, arguments.output)
    with connected as client:
        sys.stderr.write(f"dashboard {client.dashboard_link}\n")
        yield cluster.DaskWorkers(client, arguments.patience_s)


def _check_cluster(arguments: argparse.Namespace) -> None:
    """Refuse what does not go together, and miss Dask before any work is done for it."""
    if arguments.scheduler is None and arguments.dashboard_port is None:
        return
    if arguments.scheduler is not None:
        for name in ("workers", "dashboard_port"):
            if getattr(arguments, name) is not None:
                option = f"--{name.replace('_', '-')}"
                raise UsageError(f"{option} is of processes on this machine, --scheduler of another cluster")
    needed = ("distributed",) if arguments.scheduler is not None else ("distributed", "cryptography")
    for name in needed:
        if find_spec(name) is None:
            raise UsageError(
                f"Dask is not installed ({name} is missing): pip install 'distributed>=2024.8' cryptography, "
                "or leave out --scheduler and --dashboard-port to use processes of this machine"
            )


def listed(given: Sequence[Path]) -> Iterator[Path]:
    """Yield the paths that are given, with those of its lines in place of a list.

    A line is a path, whatever its first letter is: no list is looked for in a list.

    Raises:
        ConfigError: A list cannot be read.
    """
    for path in given:
        file = _list_file(path)
        if file is None:
            yield path
        else:
            lines = os.fsdecode(read_content(file, _LONGEST_LIST, "list of recordings")).split("\n")
            yield from (Path(line) for line in (each.rstrip("\r") for each in lines) if line)


def _list_file(path: Path) -> Path | None:
    """Return the list that an argument names, None where it is a path itself."""
    return Path(str(path)[1:]) if str(path).startswith("@") else None


def _check_outputs(arguments: argparse.Namespace, bags: Sequence[Path]) -> None:
    """Refuse files that cannot be written or are in the place of others, before any work is done for them."""
    given = (("--config", arguments.config), ("--rig", arguments.rig))
    inputs = [File(option, path) for option, path in given if path is not None]
    inputs += [File("the list", path) for path in map(_list_file, arguments.bags) if path is not None]
    inputs += recording_files(bags, arguments.left, arguments.right)
    outputs = [File("--output", arguments.output / name) for name in (_TABLE, _INDEX)]
    outputs = outputs if arguments.output.is_dir() else []
    if arguments.table is not None:
        outputs.append(File("--table", arguments.table))
    check_outputs(outputs, inputs)


def _settings(arguments: argparse.Namespace) -> FleetSettings:
    return FleetSettings(
        chosen_config(arguments.config, arguments.seed),
        arguments.left,
        arguments.right,
        arguments.tolerance_s,
        None if arguments.rig is None else read_rig_file(arguments.rig),
        Selection(arguments.start, arguments.end, arguments.every, arguments.max_frames),
        arguments.raw,
        arguments.left_info,
        arguments.right_info,
        arguments.rectified,
    )


def _stretch_s(text: str) -> float | None:
    return time_s(text) or None


def _patience_s(text: str) -> float:
    if time_s(text) == 0.0:
        raise argparse.ArgumentTypeError("0 is no time")
    return time_s(text)


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > _LAST_PORT:
        raise argparse.ArgumentTypeError(f"{text} is no port, 0 to {_LAST_PORT}")
    return int(text)


def _parser() -> Parser:
    parser = Parser(
        prog="fleet",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("bags", metavar="BAG", nargs="+", type=Path, help="a recording, or a folder of recordings")
    add(
        "--output",
        metavar="DIR",
        type=Path,
        default=_DEFAULT_OUTPUT,
        help="folder of results (default: fleet)",
    )
    add("--table", metavar="FILE", type=Path, help="write the table here as well, .csv or .parquet")
    add(
        "--no-report",
        dest="reports",
        action="store_false",
        help="make no reports, which cost three frames each",
    )
    add("--workers", metavar="N", type=positive_int, help="processes on this machine (default: one a core)")
    add(
        "--scheduler",
        metavar="ADDRESS",
        help="an existing Dask cluster, tls://HOST:PORT or tcp://HOST:PORT (default: this machine)",
    )
    add(
        "--dashboard-port",
        metavar="PORT",
        type=_port,
        help="have Dask start the processes on this machine, with its dashboard on this port of the loopback "
        "interface, which all users of the machine can read (default: none)",
    )
    add(
        "--patience",
        dest="patience_s",
        metavar="S",
        type=_patience_s,
        default=PATIENCE_S,
        help="give up a recording that has given no frame for S seconds (default: %(default)g)",
    )
    add(
        "--stretch",
        dest="stretch_s",
        metavar="S",
        type=_stretch_s,
        default=_STRETCH_S,
        help="divide recordings that are longer into stretches of about S seconds, 0: never (default: 120)",
    )
    add_camera_options(parser)
    add_selection_options(parser)
    return parser
