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

"""The net around a single frame: what was not foreseen refuses that frame, and is told with its traceback.

A fault of the program on one picture must not end a recording, a call or a watch. It is not hidden either:
the refusal says what happened, and who collects the results logs the traceback of each distinct fault once.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePath

from .errors import printable
from .rejection import Bound, Rejection, RejectReason

# A program with more faults than this has one that is everywhere; no more of them are logged.
_MOST_LOGGED = 50
_LONGEST_TEXT = 200  # of an exception, in a message of one line; the traceback has all of it


@dataclass(frozen=True, slots=True)
class Fault:
    """An exception that was not foreseen. It is text only, so that it can be sent between processes.

    Attributes:
        what: Type and text of the exception, and the line of this package in which it came up; in one line.
        trace: Its traceback, several lines.
        where: Type of the exception and all lines of code of its traceback, which tell faults apart.
    """

    what: str
    trace: str
    where: tuple[str, ...]

    @classmethod
    def of(cls, error: BaseException) -> Fault:
        """Return the fault that an exception shows."""
        frames = traceback.extract_tb(error.__traceback__)
        kind, text = type(error).__name__, str(error)
        named = f"{kind}: {printable(text[:_LONGEST_TEXT])}" if text else kind
        if frames:
            named += f" ({PurePath(frames[-1].filename).name}, line {frames[-1].lineno})"
        lines = tuple(f"{frame.filename}:{frame.lineno}" for frame in frames)
        return cls(named, "".join(traceback.format_exception(error)), (kind, *lines))

    @property
    def rejection(self) -> Rejection:
        """Why the frame in which it came up is refused."""
        return Rejection(
            RejectReason.INTERNAL_ERROR,
            "{value} fault of this program, {limit} allowed, ended the work on this frame: "
            # The text of an exception may have braces of its own.
            + self.what.replace("{", "(").replace("}", ")"),
            1,
            Bound.MOST,
            0,
            "",
            "report this with the traceback in the log; the other frames are not affected",
        )


class FaultLog:
    """Logs the traceback of each distinct fault once. Several threads may use it.

    Args:
        write: Writes a text of several lines to a log.
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._lock = threading.Lock()
        self._seen: set[tuple[str, ...]] = set()

    def note(self, fault: Fault | None, stamp_s: float) -> None:
        """Log the fault of a frame, if it has one that was not logged before."""
        if fault is None:
            return
        with self._lock:
            if fault.where in self._seen or len(self._seen) == _MOST_LOGGED:
                return
            self._seen.add(fault.where)
        self._write(
            f"the frame of {stamp_s:.6f} s is refused, {fault.what}; this fault is not logged again\n"
            f"{fault.trace}"
        )
