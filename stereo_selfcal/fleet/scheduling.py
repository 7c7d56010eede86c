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

"""The tasks of a fleet: their submission to workers, their results, and their repetition."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..core.errors import printable
from .outcome import BagOutcome, Status
from .store import Bag
from .work import (
    Calibrated,
    FleetSettings,
    Stretch,
    Stretches,
    calibrate_bag,
    calibrate_stretch,
    join,
)
from .workers import Died, Failure, Job, Workers

# Makes the report of a calibrated recording, on a worker: (path, settings, calibrated recording) -> HTML.
ReportMaker = Callable[[str, FleetSettings, Calibrated], bytes | Failure]

_POLL_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """A recording that needs no more work.

    Attributes:
        bag: The recording.
        outcome: Its row, without the name of the report.
        calibrated: Rows and estimate, None where it failed.
        report: The report, None where none was wanted or it could not be made.
        problem: Why there is no report though one was wanted; else empty.
    """

    bag: Bag
    outcome: BagOutcome
    calibrated: Calibrated | None = None
    report: bytes | None = None
    problem: str = ""


@dataclass(slots=True, eq=False)
class _Task:
    """What a worker does, and its purpose."""

    bag: Bag
    kind: str  # calibrate, stretch, report
    work: _Divided | Calibrated | None = None
    index: int = 0


@dataclass(slots=True, eq=False)
class _Divided:
    """A recording that is done in stretches."""

    parts: list[Stretch | None]
    failed: bool = False
    waiting: int = field(init=False)

    def __post_init__(self) -> None:
        self.waiting = len(self.parts)


class FleetRun:
    """Calibrates recordings.

    A recording at which workers died again and again, or which waited on such workers, is tried once more
    when all others are done, with nothing beside it: only one that kills its workers then is given up.

    Args:
        workers: Who does it.
        settings: How every recording is calibrated.
        stretch_s: Longer recordings are done in stretches of about this length [s]; None for never.
        make_report: Makes the reports, None for no reports.
    """

    def __init__(
        self,
        workers: Workers,
        settings: FleetSettings,
        stretch_s: float | None = None,
        make_report: ReportMaker | None = None,
    ) -> None:
        self._workers = workers
        self._settings = settings
        self._stretch_s = stretch_s
        self._make_report = make_report
        self._waiting_for = 0
        self._suspects: list[Bag] = []
        self._alone = False
        self._on_done: Callable[[Done], None] = lambda done: None
        self._on_wait: Callable[[], None] = lambda: None

    def run(
        self,
        bags: Sequence[Bag],
        on_done: Callable[[Done], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Calibrate recordings; what is interrupted leaves no task behind.

        Args:
            bags: The recordings.
            on_done: Called in this thread for each, in the order in which they are done.
            on_wait: Called in this thread now and then while nothing comes in.

        Raises:
            WorkersError: No worker is left.
        """
        self._on_done, self._on_wait = on_done, on_wait
        try:
            for bag in bags:
                self._calibrate(bag, self._stretch_s)
            self._drain()
            suspects, self._suspects, self._alone = self._suspects, [], True
            for bag in suspects:
                self._calibrate(bag, self._stretch_s)
                self._drain()
        finally:
            self._workers.cancel()

    def _calibrate(self, bag: Bag, stretch_s: float | None) -> None:
        self._submit(_Task(bag, "calibrate"), calibrate_bag, stretch_s)

    def _submit(self, task: _Task, work: Callable[..., Any], *arguments: Any) -> None:
        """Have something done with a recording.

        What belongs to one that is begun goes first: reports arrive continuously, and few recordings are half
        done when a run is interrupted.
        """
        name = (task.kind, task.bag.stem, task.index)
        arguments = (str(task.bag.path), self._settings, *arguments)
        self._workers.submit(Job(task, name, work, arguments, begun=task.kind != "calibrate"))
        self._waiting_for += 1

    def _drain(self) -> None:
        """Take results until all tasks are done."""
        while self._waiting_for:
            done = self._workers.result(_POLL_S)
            if done is None:
                self._on_wait()
                continue
            self._waiting_for -= 1
            job, result = done
            if isinstance(result, Died):
                self._died(job.task, result)
            else:
                self._take(job.task, result)

    def _take(self, task: _Task, result: Any) -> None:
        if task.kind == "report":
            assert isinstance(task.work, Calibrated)
            if isinstance(result, Failure):
                self._done(task.bag, task.work, problem=result.reason)
            else:
                self._done(task.bag, task.work, report=result)
        elif task.kind == "stretch":
            assert isinstance(task.work, _Divided)
            task.work.waiting -= 1
            if isinstance(result, Stretch):
                task.work.parts[task.index] = result
            else:
                task.work.failed = True
            if task.work.waiting == 0:
                self._joined(task.bag, task.work)
        elif isinstance(result, Stretches):
            divided = _Divided([None] * len(result.selections))
            for index, selection in enumerate(result.selections):
                part = _Task(task.bag, "stretch", divided, index)
                self._submit(part, calibrate_stretch, selection)
        elif isinstance(result, Calibrated):
            self._report(task.bag, result)
        else:
            self._failed(task.bag, result.reason)

    def _joined(self, bag: Bag, divided: _Divided) -> None:
        """Fuse the stretches in order; where one has failed, do the whole recording as replay does it."""
        parts = [part for part in divided.parts if part is not None]
        if divided.failed or len(parts) < len(divided.parts):
            self._calibrate(bag, None)
            return
        self._report(bag, join(parts, self._settings))

    def _report(self, bag: Bag, calibrated: Calibrated) -> None:
        if self._make_report is None:
            self._done(bag, calibrated)
        else:
            self._submit(_Task(bag, "report", calibrated), self._make_report, calibrated)

    def _died(self, task: _Task, died: Died) -> None:
        """Deal with a task whose workers died: it, or another task that was there, is the cause."""
        if task.kind == "report":
            assert isinstance(task.work, Calibrated)
            self._done(task.bag, task.work, problem=f"the workers that made it died ({died.cause})")
        elif task.kind == "stretch":
            self._take(task, Failure(f"its workers died ({died.cause})"))
        elif not self._alone:
            self._suspects.append(task.bag)
        else:
            self._failed(
                task.bag,
                "every worker that calibrated it died, even with nothing beside it (the last one "
                f"{died.cause}): out of memory, or a fault of a library; see how much memory there is, and "
                "what replay says",
            )

    def _failed(self, bag: Bag, reason: str) -> None:
        # The recording is named beside the reason, which says so again where it is about the whole of it.
        for place in (str(bag.path), printable(str(bag.path))):
            reason = reason.removeprefix(f"{place}: ")
        self._on_done(Done(bag, BagOutcome(bag.name, Status.FAILED, reason, reason)))

    def _done(self, bag: Bag, calibrated: Calibrated, report: bytes | None = None, problem: str = "") -> None:
        outcome = BagOutcome.from_replay(bag.name, calibrated.replay, calibrated.topics)
        self._on_done(Done(bag, outcome, calibrated, report, problem))
