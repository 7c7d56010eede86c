"""The tasks of a fleet on a Dask cluster: their submission, their results, and their repetition."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed

from .cluster import ClusterError
from .outcome import BagOutcome, Status
from .store import Bag
from .work import (
    Calibrated,
    Failure,
    FleetSettings,
    Stretch,
    Stretches,
    calibrate_bag,
    calibrate_stretch,
    join,
    one_line,
)

# Makes the report of a calibrated recording, on a worker: (path, settings, calibrated recording) -> HTML.
ReportMaker = Callable[[str, FleetSettings, Calibrated], bytes | Failure]

# Priority of the tasks of a recording that is begun. With it, reports arrive continuously, and few
# recordings are half done when a run is interrupted.
_BEGUN = 10
_POLL_S = 0.02
_LOST = "the connection to the scheduler is lost; the same command goes on from here"


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
    """A task in the cluster, and its purpose."""

    bag: Bag
    kind: str  # calibrate, stretch, report: the names in Dask's dashboard
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
    """Calibrates recordings on a cluster.

    A recording at which workers died again and again, or which waited on such workers, is tried once more
    when all others are done, with nothing beside it: only one that kills its workers then is given up.

    Args:
        client: Connection to the cluster.
        settings: How every recording is calibrated.
        stretch_s: Longer recordings are done in stretches of about this length [s]; None for never.
        make_report: Makes the reports, None for no reports.
    """

    def __init__(
        self,
        client: Client,
        settings: FleetSettings,
        stretch_s: float | None = None,
        make_report: ReportMaker | None = None,
    ) -> None:
        self._client = client
        # Settings go to the cluster once, not with each of 10 000 tasks.
        self._settings = settings
        self._stretch_s = stretch_s
        self._make_report = make_report
        self._tasks: dict[Any, tuple[_Task, Future]] = {}  # by the key of the task
        self._completed: Any = None
        # Of this run alone: a cluster may serve many, and be cancelling those of one that has ended.
        # The address of an object may have been that of another.
        self._name = uuid.uuid4().hex[:12]
        self._attempts = 0
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
            ClusterError: The cluster was lost.
        """
        self._on_done, self._on_wait = on_done, on_wait
        self._completed = as_completed()
        try:
            for bag in bags:
                self._calibrate(bag, self._stretch_s)
            self._drain()
            suspects, self._suspects, self._alone = self._suspects, [], True
            for bag in suspects:
                self._calibrate(bag, self._stretch_s)
                self._drain()
        finally:
            self._cancel()

    def _calibrate(self, bag: Bag, stretch_s: float | None) -> None:
        self._submit(
            _Task(bag, "calibrate"), calibrate_bag, str(bag.path), self._settings, stretch_s, priority=0
        )

    def _submit(self, task: _Task, work: Callable[..., Any], *arguments: Any, priority: int = _BEGUN) -> None:
        """Hand a task to the cluster under a name that a person can read in the dashboard."""
        self._attempts += 1  # no name is used twice: that of a failed task would give its failure
        key = (task.kind, task.bag.stem, task.index, f"{self._name}.{self._attempts}")
        future = self._client.submit(work, *arguments, key=key, pure=False, priority=priority)
        self._tasks[future.key] = task, future
        self._completed.add(future)

    def _drain(self) -> None:
        """Take results until all tasks are done."""
        while self._tasks:
            while not self._completed.has_ready():
                self._on_wait()
                if self._client.status != "running":
                    raise ClusterError(_LOST)
                time.sleep(_POLL_S)
            future: Future = next(self._completed)
            task, _ = self._tasks.pop(future.key)
            if future.cancelled():
                raise ClusterError(_LOST)
            try:
                result = future.result()
            except KilledWorker:
                self._killed(task)
            except Exception as error:  # noqa: BLE001  (of Dask: what is no message, what a worker cannot load)
                self._take(task, Failure(f"{type(error).__name__}: {one_line(error)}"))
            else:
                self._take(task, result)
            finally:
                # Else the cluster would do it again, should the worker that has it die.
                future.release()

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
                self._submit(part, calibrate_stretch, str(task.bag.path), self._settings, selection)
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
            task = _Task(bag, "report", calibrated)
            self._submit(task, self._make_report, str(bag.path), self._settings, calibrated)

    def _killed(self, task: _Task) -> None:
        """Deal with a task whose workers died: it, or another task that was there, is the cause."""
        if task.kind == "report":
            assert isinstance(task.work, Calibrated)
            self._done(task.bag, task.work, problem="the workers that made the report died")
        elif task.kind == "stretch":
            self._take(task, Failure("its worker died"))
        elif not self._alone:
            self._suspects.append(task.bag)
        else:
            self._failed(
                task.bag,
                "every worker that calibrated it died, even with nothing beside it: killed, or out of "
                "memory; see how much a worker has",
            )

    def _failed(self, bag: Bag, reason: str) -> None:
        self._on_done(Done(bag, BagOutcome(bag.name, Status.FAILED, reason, reason)))

    def _done(self, bag: Bag, calibrated: Calibrated, report: bytes | None = None, problem: str = "") -> None:
        outcome = BagOutcome.from_replay(bag.name, calibrated.replay, calibrated.topics)
        self._on_done(Done(bag, outcome, calibrated, report, problem))

    def _cancel(self) -> None:
        """Cancel the tasks that are not done."""
        futures = [future for _, future in self._tasks.values()]
        self._tasks.clear()
        if futures and self._client.status == "running":
            self._client.cancel(futures, force=True)
