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

"""Keeps the memory of a process that runs for years flat, where the C library is glibc; collects it fast."""

from __future__ import annotations

import ctypes
import gc
from contextlib import suppress

# Of mallopt(3), malloc.h of glibc.
_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_M_ARENA_MAX = -8
# Blocks below this size are kept in the heap [bytes]: the largest glibc allows (half of its HEAP_MAX_SIZE).
_KEPT_BLOCK = 32 << 20
# What is beyond this at its end the heap gives back by itself [bytes]. A frame of 2448 x 2048 needs less,
# and trim_heap() gives that back when images are over.
_KEPT_AT_THE_END = 256 << 20
# The heap is trimmed one tick after the unsubscribing: until then an image may still be in a callback.
_TICKS_BEFORE_TRIMMING = 2


def use_one_heap() -> None:
    """Have no thread from now on get a heap of its own.

    By default each thread has its own heap, which keeps the memory of a calibration for the next one in that
    thread: the node grew by 30 MiB in its first minutes. One heap costs no time, because Python's lock lets
    only one thread allocate at a time. (Importing rclpy starts threads that get two heaps before the node can
    ask. All threads share these three.)

    What is free stays in it until :func:`trim_heap`. By default, the memory of an image goes back to the
    system with each one, and the next touches 600 new pages (of 1280 x 720): two thirds of the time that
    taking one from DDS costs.
    """
    with suppress(AttributeError, OSError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_ARENA_MAX, 1)
        library.mallopt(_M_MMAP_THRESHOLD, _KEPT_BLOCK)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT_AT_THE_END)


def trim_heap() -> None:
    """Return unused memory to the system: 25 MiB after a frame of 1280 x 720, 5 MiB after a probe.

    Takes some milliseconds at most.
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


class HeapTrimmer:
    """Trims the heap once after each time the images were unsubscribed."""

    def __init__(self) -> None:
        self._ticks = 0

    def tick(self, subscribed: bool) -> None:
        """Count a tick, and trim the heap when it is the one to do so.

        Args:
            subscribed: Whether the images are subscribed to.
        """
        self._ticks = 0 if subscribed else self._ticks + 1
        if self._ticks == _TICKS_BEFORE_TRIMMING:
            trim_heap()


def spare_what_stays() -> None:
    """Have the garbage collector ignore what exists now: modules and the node, which stay to the end.

    It would go through all of it now and then. That took 20 to 60 ms, in which Python's lock is held and the
    node answers nothing. Later objects are collected as usual.
    """
    gc.collect()
    gc.freeze()
