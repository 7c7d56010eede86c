"""A domain of DDS for this process alone, so that tests which run at the same time do not meet."""

import os

# Up to this one they collide with no port that Linux hands out to others.
HIGHEST = 101


def domain_of(environment, process, parent):
    """Return a domain, 1 ... HIGHEST.

    Args:
        environment: Variables of the process; pytest-xdist numbers its workers in them.
        process: Number of the process.
        parent: Number of the process that started it: of all workers of a run the same.
    """
    worker = environment.get("PYTEST_XDIST_WORKER")  # gw0, gw1, ...
    place = process if worker is None else parent + int(worker.removeprefix("gw"))
    return 1 + place % HIGHEST


def own_domain():
    return domain_of(os.environ, os.getpid(), os.getppid())
