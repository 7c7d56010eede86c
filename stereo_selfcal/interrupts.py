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

"""Ctrl-C while a program starts and ends: no traceback from the midst of an import."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


def end_at_once_by_ctrl_c() -> None:
    """Let SIGINT end this process as the system does, until the program handles it itself.

    Python would raise KeyboardInterrupt wherever it is, which modules written in C turn into errors of their
    own. Nothing that needs cleaning has begun. A SIGINT that is ignored (background job of a shell) stays so.
    To be called by programs alone, before their heavy imports: it concerns the whole process.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def raised_by_ctrl_c() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGINT inside the block, where :func:`end_at_once_by_ctrl_c` was called."""
    ours = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def ignore_ctrl_c_at_the_end() -> None:
    """Let no further SIGINT change the status of a program that is ending, where it would end it at once."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
