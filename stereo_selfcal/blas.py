"""One thread for linear algebra: the matrices of a frame are small.

OpenBLAS starts a thread per core, and those wait for each other by spinning. To decompose matrices of
64 x 64 this way takes three times the processor time of one thread, and more on busy cores.
"""

import os
from collections.abc import MutableMapping

_VARIABLE = "OPENBLAS_NUM_THREADS"


def one_thread(environment: MutableMapping[str, str] | None = None) -> None:
    """Ask OpenBLAS for one thread, unless the user asked for another number.

    OpenBLAS reads it when numpy is imported, so programs call this first.

    Args:
        environment: Variables of a process to be started, None for those of this one.
    """
    (os.environ if environment is None else environment).setdefault(_VARIABLE, "1")
