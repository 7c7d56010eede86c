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

"""Workers of a Dask cluster: one that is running, or one of this machine that has Dask's dashboard."""

from __future__ import annotations

import fcntl
import os
import queue
import shutil
import signal
import tempfile
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed
from distributed.security import Security

from ..core.errors import one_line
from .work import versions
from .workers import (
    PATIENCE_S,
    Died,
    Job,
    Workers,
    WorkersError,
    internal_error,
    on_progress,
    silence,
)

LOOPBACK = "127.0.0.1"
_CONNECT_S = 10.0
_MAX_TRIES, _PAUSE_S = 5, 0.2  # messages of one cancellation are sent within milliseconds
# Workers that die are replaced, and their task tried again: Dask's own default.
_ALLOWED_FAILURES = 3
# Variables of libraries that would start threads of their own in every worker.
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Our workers log nothing: one whose heartbeat meets the end of an interrupted run makes an error of that,
# with a traceback. What a task raises comes back as its result; that a worker died is said by its nanny.
_QUIET = {"DASK_LOGGING__DISTRIBUTED": "critical"}
_SCRATCH = ".stereo_selfcal_fleet."
_BEGUN = 10  # priority of the jobs of a recording that is begun
_COUNT_S = 2.0  # between two looks at how many workers there are
_LOST = "the connection to the scheduler is lost; the same command goes on from here"


class DaskWorkers(Workers):
    """The workers of a Dask cluster.

    Args:
        client: Connection to the cluster.
        patience_s: A job that gives no sign of life for so long is given up; with no worker for so long, or
            no answer of the scheduler, all are [s].
    """

    def __init__(self, client: Client, patience_s: float = PATIENCE_S) -> None:
        self._client = client
        self._patience_s = patience_s
        self._jobs: dict[Any, tuple[Job, Future]] = {}  # by the key of the task
        self._completed: Any = None
        # Of this run alone: a cluster may serve many, and be cancelling those of one that has ended.
        # The address of an object may have been that of another.
        self._name = uuid.uuid4().hex[:12]
        self._attempts = 0
        self._counted_s = self._seen_s = time.monotonic()

    def submit(self, job: Job) -> None:
        """Hand a job to the cluster under a name that a person can read in the dashboard."""
        self._attempts += 1  # no name is used twice: that of a failed task would give its failure
        key = (*job.name, f"{self._name}.{self._attempts}")
        future = self._client.submit(
            watched,
            self._patience_s,
            job.work,
            *job.arguments,
            key=key,
            pure=False,
            priority=_BEGUN if job.begun else 0,
        )
        if self._completed is None:
            self._completed = as_completed()
        self._jobs[future.key] = job, future
        self._completed.add(future)

    def result(self, timeout_s: float) -> tuple[Job, Any] | None:
        """Return a job that is done; see :meth:`Workers.result`."""
        if not self._jobs or not self._completed.has_ready():
            self._look()
            time.sleep(timeout_s)
            return None
        self._seen_s = time.monotonic()
        future: Future = next(self._completed)
        job, _ = self._jobs.pop(future.key)
        if future.cancelled():
            raise WorkersError(_LOST)
        try:
            return job, future.result()
        except KilledWorker:
            return job, Died("lost by the cluster")
        except Exception as error:  # noqa: BLE001  (of Dask: what is no message, what a worker cannot load)
            return job, internal_error(error)
        finally:
            # Else the cluster would do it again, should the worker that has it die.
            future.release()

    def cancel(self) -> None:
        """Cancel the jobs that are not done."""
        futures = [future for _, future in self._jobs.values()]
        self._jobs.clear()
        if futures and self._client.status == "running":
            self._client.cancel(futures, force=True)

    def _look(self) -> None:
        """Find out whether anybody is there.

        Raises:
            WorkersError: Nobody, for longer than one has patience.
        """
        if self._client.status != "running":
            raise WorkersError(_LOST)
        now_s = time.monotonic()
        if now_s - self._counted_s < _COUNT_S:
            return
        self._counted_s = now_s
        try:
            count = len(self._client.sync(self._client.scheduler.ncores, callback_timeout=_CONNECT_S))
        except (OSError, TimeoutError):
            count = None
        if count:
            self._seen_s = time.monotonic()
        elif time.monotonic() - self._seen_s > self._patience_s:
            who = "the scheduler has not answered" if count is None else "the cluster has had no worker"
            raise WorkersError(
                f"{who} for {self._patience_s:g} s; start workers ('dask worker ADDRESS'), or wait longer "
                "with --patience; the same command goes on from here"
            )


def watched(patience_s: float, work: Callable[..., Any], *arguments: Any) -> Any:
    """Do a job on a worker of Dask, in a thread that is left behind where it gives no sign of life.

    Args:
        patience_s: For how long it may give none [s].
        work: The function.
        arguments: Its arguments.

    Returns:
        What the function returns; a :class:`.Failure` where it is given up.
    """
    said: queue.SimpleQueue[tuple[Any] | None] = queue.SimpleQueue()

    def do() -> None:
        on_progress(lambda: said.put(None))
        try:
            said.put((work(*arguments),))
        except Exception as error:  # noqa: BLE001  (whatever it is, it is that of this job alone)
            said.put((internal_error(error),))

    # Dask's own threads cannot be left.
    threading.Thread(target=do, daemon=True).start()
    while True:
        try:
            result = said.get(timeout=patience_s)
        except queue.Empty:
            return silence(patience_s)
        if result is not None:
            return result[0]


@contextmanager
def local_cluster(
    workers: int, dashboard_port: int, folder: Path, allowed_failures: int = _ALLOWED_FAILURES
) -> Iterator[Client]:
    """Start processes on this machine that speak to each other only, and end them.

    Their ports are on the loopback interface, which all users of the machine reach. Whoever speaks to them
    shows a certificate that is made here and is in the memory of these processes only. The dashboard asks for
    none.

    Args:
        workers: How many.
        dashboard_port: Of Dask's dashboard; where it is taken, a free one.
        folder: Of this user alone, for what Dask leaves in files; a later cluster there removes what one that
            was killed has left.
        allowed_failures: Workers that may die at a task before it is suspected to be the cause.

    Raises:
        WorkersError: They do not start.
    """
    settings = {
        "distributed.scheduler.allowed-failures": allowed_failures,
        # One task a worker, and no other waiting there: who dies with a worker was its cause.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": _CONNECT_S,
        # Workers have a port for HTTP, and nothing to say there.
        "distributed.worker.http.routes": [],
        # Dask's own has MALLOC_TRIM_THRESHOLD_ besides, with which every image is mapped and unmapped anew:
        # a frame then takes 1.6 times as long.
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(_ONE_THREAD, 1) | _QUIET,
    }
    with (
        _scratch(folder) as scratch,
        dask.config.set(settings),
        # A Ctrl-C goes to all processes of a terminal; ending the workers is our business. Those that take
        # the place of dead ones inherit it as well.
        _without_ctrl_c(),
        _free_port_if_taken(),
        ExitStack() as stack,
    ):
        security = Security.temporary()
        try:
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host=LOOPBACK,
                    dashboard_address=f"{LOOPBACK}:{dashboard_port}",
                    local_directory=str(scratch),
                    security=security,
                )
            )
            client = stack.enter_context(Client(cluster, security=security))
        except Exception as error:  # whatever Dask makes of a worker that ends as it starts
            raise WorkersError(
                f"Dask's workers do not start ({one_line(error)}); see what ends them, or leave out "
                "--dashboard-port to do without Dask"
            ) from error
        with _with_ctrl_c():
            yield client


@contextmanager
def _scratch(folder: Path) -> Iterator[Path]:
    """Make a folder in another one, locked, and remove it; and those that nobody has locked any more."""
    for left in folder.glob(f"{_SCRATCH}*"):
        with suppress(OSError), _locked(left):
            shutil.rmtree(left)
    scratch = Path(tempfile.mkdtemp(prefix=_SCRATCH, dir=folder))
    with _locked(scratch):
        try:
            yield scratch
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """Connect to a scheduler that is running.

    Args:
        address: As Dask has it, tls://HOST:PORT with the certificates that are in Dask's settings, or
            tcp://HOST:PORT.

    Raises:
        WorkersError: It does not answer, or its workers do not have this package.
    """
    try:
        client = _connected(address)
    except TypeError as error:  # which Dask makes of a missing certificate
        raise WorkersError(
            f"no certificate for {address} is known to Dask ({one_line(error)}); set "
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, and the same with CLIENT__CERT and CLIENT__KEY for CA_FILE"
        ) from error
    except (OSError, ValueError, TimeoutError) as error:
        raise WorkersError(
            f"no scheduler answers at {address} ({one_line(error)}); start one with 'dask scheduler', or "
            "leave out --scheduler to use this machine"
        ) from error
    with client:
        _check_versions(client, address)
        yield client


def _connected(address: str) -> Client:
    """Return a client of a scheduler; try again where its first answer comes together with a second one.

    A scheduler that cancels tasks of another client at that moment may send both at once. Dask's client
    expects one message and fails with an AssertionError (dask/distributed, issue 4175).
    """
    for _ in range(_MAX_TRIES - 1):
        try:
            return Client(address, timeout=_CONNECT_S)
        except AssertionError:
            time.sleep(_PAUSE_S)
    return Client(address, timeout=_CONNECT_S)


def _check_versions(client: Client, address: str) -> None:
    """Make sure that scheduler and workers run what this process runs: same versions, same numbers."""
    try:
        # The scheduler unpickles tasks as well.
        found = {"the scheduler": client.run_on_scheduler(versions)}
        found |= {f"worker {worker}": each for worker, each in client.run(versions).items()}
    except Exception as error:  # whatever unpickling raises over there
        raise WorkersError(
            f"scheduler or workers of {address} cannot run this package ({one_line(error)}); install "
            f"stereo_selfcal {versions()['stereo_selfcal']} there"
        ) from error
    for name, theirs in found.items():
        if theirs != versions():
            raise WorkersError(
                f"{name} has {_listed(theirs)}, this process {_listed(versions())}: the numbers could "
                "differ; install the same versions"
            )


def _listed(found: dict[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in found.items())


@contextmanager
def _free_port_if_taken() -> Iterator[None]:
    """Keep Dask from warning that the port of its dashboard is taken: the one it takes instead is shown."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Port .* is already in use")
        yield


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    resource_tracker.ensure_running()  # starting it later would undo this
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _with_ctrl_c() -> Iterator[None]:
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
