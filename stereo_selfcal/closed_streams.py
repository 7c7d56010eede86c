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

"""Standard streams that whoever started the program has closed (``>&-``, some services): they go nowhere."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO


def open_closed_streams() -> None:
    """Open the standard streams that are closed on the null device.

    To be called before any other file is opened: a file or a socket would get the number of the closed
    stream, and what libraries and worker processes print would be written into it. Python has None in place
    of a closed stream, and nothing can be written to that.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            if null == number:
                os.set_inheritable(number, True)
            else:
                os.dup2(null, number)
                os.close(null)
    if sys.stdin is None:
        sys.stdin = _null("r")
    if sys.stdout is None:
        sys.stdout = _null("w")
    if sys.stderr is None:
        sys.stderr = _null("w")


def tell_error(text: str) -> None:
    """Write to stderr, if anybody is there."""
    with suppress(OSError, ValueError):
        sys.stderr.write(text)
        sys.stderr.flush()


def let_go(stream: TextIO) -> None:
    """Let go of a stream that nobody reads any more: what is still buffered must not complain at exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _null(mode: str) -> Any:
    """Return a stream that holds nothing; it is open until the program ends."""
    return Path(os.devnull).open(mode, encoding="utf-8", errors="backslashreplace")
