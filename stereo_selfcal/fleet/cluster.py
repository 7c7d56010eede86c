"""The Dask cluster that does the work: processes of this machine, or an existing cluster."""

from __future__ import annotations

import signal
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

import dask
from distributed import Client, LocalCluster

from ..core.errors import SelfcalError
from .work import one_line, versions

LOOPBACK = "127.0.0.1"
DASHBOARD_PORT = 8787  # Dask's own
_CONNECT_S = 10.0
_MAX_TRIES, _PAUSE_S = 5, 0.2  # messages of one cancellation are sent within milliseconds
# Workers that die are replaced, and their task tried again: Dask's own default.
_ALLOWED_FAILURES = 3
# Variables of libraries that would start threads of their own in every worker.
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Our workers log nothing: one whose heartbeat meets the end of an interrupted run makes an error of that,
# with a traceback. What a task raises comes back as its result; that a worker died is said by its nanny.
_QUIET = {"DASK_LOGGING__DISTRIBUTED": "critical"}


class ClusterError(SelfcalError):
    """The cluster cannot be used, or was lost. The message is one line."""


@contextmanager
def local_cluster(
    workers: int, dashboard_port: int = DASHBOARD_PORT, allowed_failures: int = _ALLOWED_FAILURES
) -> Iterator[Client]:
    """Start processes on this machine, which nobody else can reach, and end them.

    Args:
        workers: How many.
        dashboard_port: Of Dask's dashboard on the loopback interface; where it is taken, a free one.
        allowed_failures: Workers that may die at a task before it is suspected to be the cause.
    """
    settings = {
        "distributed.scheduler.allowed-failures": allowed_failures,
        # One task a worker, and no other waiting there: who dies with a worker was its cause.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.comm.timeouts.connect": _CONNECT_S,
        # Dask's own has MALLOC_TRIM_THRESHOLD_ besides, with which every image is mapped and unmapped anew:
        # a frame then takes 1.6 times as long.
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(_ONE_THREAD, 1) | _QUIET,
    }
    with (
        tempfile.TemporaryDirectory(prefix="stereo_selfcal_fleet.") as scratch,
        dask.config.set(settings),
        # A Ctrl-C goes to all processes of a terminal; ending the workers is our business. Those that take
        # the place of dead ones inherit it as well.
        _without_ctrl_c(),
        _free_port_if_taken(),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:{dashboard_port}",
            local_directory=scratch,
        ) as cluster,
        Client(cluster) as client,
        _with_ctrl_c(),
    ):
        yield client


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """Connect to a scheduler that is running.

    Args:
        address: As Dask has it, tcp://HOST:PORT.

    Raises:
        ClusterError: It does not answer, or its workers do not have this package.
    """
    try:
        client = _connected(address)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(
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
        raise ClusterError(
            f"scheduler or workers of {address} cannot run this package ({one_line(error)}); install "
            f"stereo_selfcal {versions()['stereo_selfcal']} there"
        ) from error
    for name, theirs in found.items():
        if theirs != versions():
            raise ClusterError(
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
