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

"""Workers on this machine: processes that hear of their jobs through a pair of sockets without a name.

Nothing listens, on no port and under no path: nobody but this process can give them work. It knows which
worker has which job, so it knows whose worker died, and it ends a worker that gives no sign of life.
"""

from __future__ import annotations

import heapq
import itertools
import multiprocessing
import socket
import struct
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import cv2

from ..core.errors import one_line
from ..offline.pool import end_with_parent, for_workers
from .workers import Died, Job, Workers, WorkersError, internal_error, on_progress, silence

# A job whose worker died is done again by so many others, as somebody may just have killed that one.
_TRIES = 2
# Until a worker can work it imports: a second, on a busy machine and a slow disk many more.
_START_S = 120.0
# So many workers in a row that ended before they could work: another one would, too.
_MOST_STARTS = 5
_BETWEEN_STARTS_S = 0.5  # after one that failed
_BEAT_S = 1.0  # between two signs of life
# A worker that takes no byte of its job, or gives none of its result, for so long is stopped [s].
_STUCK_S = 30.0
# More time between two looks at the workers was not theirs: this process was stopped itself.
_LONGEST_LOOK_S = 1.0
_END_S = 5.0  # for the end of a process that was told to


class _Said(Enum):
    """What a worker says; a result comes with DONE."""

    READY = "ready"
    ALIVE = "alive"
    DONE = "done"


@dataclass(slots=True, eq=False)
class _Worker:
    """A process of this machine.

    Attributes:
        process: The process.
        connection: To it.
        job: What it does, None when nothing.
        ready: Whether it can work.
        silent_s: For how long it has said nothing [s].
    """

    process: BaseProcess
    connection: Connection
    job: Job | None = None
    ready: bool = False
    silent_s: float = 0.0

    @property
    def end(self) -> str:
        """How it ended, in a few words."""
        self.process.join(_END_S)
        code = self.process.exitcode
        if code is None:
            return "lost"
        return f"killed by signal {-code}" if code < 0 else f"ended with status {code}"


class ProcessWorkers(Workers):
    """Processes of this machine. Those that die are replaced.

    Args:
        count: How many at most.
        patience_s: A job that gives no sign of life for so long is given up [s].
    """

    def __init__(self, count: int, patience_s: float) -> None:
        self._count = count
        self._patience_s = patience_s
        self._workers: list[_Worker] = []
        self._jobs: list[tuple[bool, int, Job]] = []  # a heap
        self._order = itertools.count()
        self._results: list[tuple[Job, Any]] = []
        self._deaths: Counter[Job] = Counter()
        self._failed_starts = 0
        self._start_at_s = self._looked_s = time.monotonic()
        with for_workers():  # with an own mask, or starting it later would undo that of a worker
            resource_tracker.ensure_running()

    def __enter__(self) -> ProcessWorkers:
        return self

    def __exit__(self, *_: object) -> None:
        self._jobs.clear()
        for worker in self._workers:
            worker.connection.close()  # which ends one that has nothing to do
            if worker.job is not None or not worker.ready:
                worker.process.kill()
        for worker in self._workers:
            worker.process.join(_END_S)
            if worker.process.exitcode is None:
                worker.process.kill()
        self._workers.clear()

    def submit(self, job: Job) -> None:
        """Have a job done."""
        heapq.heappush(self._jobs, (not job.begun, next(self._order), job))

    def cancel(self) -> None:
        """Forget all jobs, and end the workers that do one."""
        self._jobs.clear()
        for worker in [each for each in self._workers if each.job is not None]:
            self._end(worker)
        self._results.clear()

    def result(self, timeout_s: float) -> tuple[Job, Any] | None:
        """Return a job that is done; see :meth:`Workers.result`."""
        self._start()
        self._hand_out()
        self._look(0.0 if self._results else timeout_s)
        return self._results.pop(0) if self._results else None

    def _start(self) -> None:
        """Start as many workers as there are jobs for."""
        wanted = min(self._count, len(self._jobs) + sum(worker.job is not None for worker in self._workers))
        while len(self._workers) < wanted and time.monotonic() >= self._start_at_s:
            try:
                self._workers.append(_start_worker())
            except OSError as error:  # no more processes, memory or files
                self._start_failed(f"cannot be started: {one_line(error)}")

    def _start_failed(self, how: str) -> None:
        self._failed_starts += 1
        self._start_at_s = time.monotonic() + _BETWEEN_STARTS_S
        if self._failed_starts >= _MOST_STARTS and not any(worker.ready for worker in self._workers):
            raise WorkersError(
                f"no worker is left: {self._failed_starts} in a row ended as they started (the last one "
                f"{how}); see whether there is memory, and what ends processes; the same command goes on "
                "from here"
            )

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._jobs and worker.ready and worker.job is None:
                *_, worker.job = heapq.heappop(self._jobs)
                worker.silent_s = 0.0
                try:
                    worker.connection.send((worker.job.work, worker.job.arguments))
                except OSError:
                    pass  # it has died or is stopped: looking at it finds out
                except Exception as error:  # noqa: BLE001  (whatever pickling a job raises)
                    self._results.append((worker.job, internal_error(error)))
                    worker.job = None

    def _look(self, timeout_s: float) -> None:
        """Hear what workers say; deal with those that have died, and with those that say nothing."""
        if not self._workers:
            time.sleep(timeout_s)
            self._looked_s = time.monotonic()
            return
        ends = [worker.connection for worker in self._workers]
        heard = wait([*ends, *(worker.process.sentinel for worker in self._workers)], timeout_s)
        now_s = time.monotonic()
        since_s = min(now_s - self._looked_s, _LONGEST_LOOK_S)
        self._looked_s = now_s
        for worker in list(self._workers):
            worker.silent_s += since_s
            if worker.connection in heard:
                worker.silent_s = 0.0
                self._hear(worker)
            elif worker.process.sentinel in heard and not worker.connection.poll():
                self._died(worker)
            elif worker.job is not None and worker.silent_s > self._patience_s:
                job, worker.job = worker.job, None
                self._end(worker)
                self._results.append((job, silence(self._patience_s)))
            elif not worker.ready and worker.silent_s > _START_S:
                self._end(worker)
                self._start_failed(f"was not ready after {_START_S:.0f} s")

    def _hear(self, worker: _Worker) -> None:
        try:
            said, result = worker.connection.recv()
        except (EOFError, OSError):
            self._died(worker)
            return
        except Exception as error:  # noqa: BLE001  (whatever unpickling a result raises)
            said, result = _Said.DONE, internal_error(error)
        if said is _Said.READY:
            worker.ready = True
            self._failed_starts = 0
        elif said is _Said.DONE and worker.job is not None:
            self._results.append((worker.job, result))
            del self._deaths[worker.job]
            worker.job = None

    def _died(self, worker: _Worker) -> None:
        """Have the job of a dead worker done by another one, but not for ever."""
        job, worker.job = worker.job, None
        self._end(worker)
        if job is None:
            self._start_failed(worker.end)
            return
        self._deaths[job] += 1
        if self._deaths[job] < _TRIES:
            self.submit(job)
        else:
            del self._deaths[job]
            self._results.append((job, Died(worker.end)))

    def _end(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.process.kill()
        worker.connection.close()


def _start_worker() -> _Worker:
    # Spawned, as a fork of a process with threads may hang.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    with theirs:
        # A worker that somebody has stopped would stop this process as well.
        with socket.socket(fileno=socket.dup(ours.fileno())) as end:
            limit = struct.pack("@ll", int(_STUCK_S), 0)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        process = context.Process(target=_serve, args=(theirs,), daemon=True)
        try:
            with for_workers():
                process.start()
        except BaseException:
            ours.close()
            raise
    return _Worker(process, ours)


def _serve(connection: Connection) -> None:
    """Be a worker: do one job after the other, until nobody asks any more."""
    threading.Thread(target=end_with_parent, daemon=True).start()
    cv2.setNumThreads(1)  # the cores are busy with the other workers
    said_s = time.monotonic()

    def say_alive() -> None:
        nonlocal said_s
        if time.monotonic() - said_s > _BEAT_S:
            said_s = time.monotonic()
            connection.send((_Said.ALIVE, None))

    on_progress(say_alive)
    with suppress(EOFError, OSError):  # the parent is gone
        connection.send((_Said.READY, None))
        while True:
            _return(connection, _next_result(connection))


def _return(connection: Connection, result: Any) -> None:
    try:
        connection.send((_Said.DONE, result))
    except OSError:
        raise
    except Exception as error:  # noqa: BLE001  (whatever pickling a result raises, before a byte is sent)
        connection.send((_Said.DONE, internal_error(error)))


def _next_result(connection: Connection) -> Any:
    """Take the next job, do it, and return what came of it.

    Raises:
        EOFError: There is none any more.
        OSError: The same.
    """
    try:
        work, arguments = connection.recv()
    except (EOFError, OSError):
        raise
    except Exception as error:  # noqa: BLE001  (whatever unpickling a job raises)
        return internal_error(error)
    try:
        return work(*arguments)
    except Exception as error:  # noqa: BLE001  (whatever it is, it is that of this job alone)
        return internal_error(error)
