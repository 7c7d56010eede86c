"""Keeps the memory of a process that runs for years flat, where the C library is glibc; collects it fast."""

from __future__ import annotations

import ctypes
import gc
from contextlib import suppress

_M_ARENA_MAX = -8  # of mallopt(3), malloc.h of glibc


def use_one_heap() -> None:
    """Have no thread from now on get a heap of its own.

    By default each has one, which keeps what a calibration took for the next one in that thread: the node
    grew by 30 MiB in its first minutes. Python's own lock lets one thread allocate at a time anyway.
    (Importing rclpy starts threads that get two heaps before the node can ask: all share these three.)
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def trim_heap() -> None:
    """Give back what is not in use: 25 MiB after a frame of 1280 x 720, 5 after a look.

    Takes some milliseconds at most.
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def spare_what_stays() -> None:
    """Have the garbage collector leave alone what there is now: modules and the node, which stay to the end.

    It would go through all of it now and then, for 20 to 60 ms in which Python's lock is held and nothing is
    answered. What is made from now on is collected as ever.
    """
    gc.collect()
    gc.freeze()
