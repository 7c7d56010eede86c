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

"""What does the tasks of a fleet, as :mod:`.scheduling` sees it: here processes, there a Dask cluster."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from ..core.errors import SelfcalError, one_line

# Without a frame for so long a recording is given up [s]. Frames take a tenth of a second; to find the first
# one in a large recording without an index, all of it may have to be read, from a disk that is far away.
PATIENCE_S = 300.0


class WorkersError(SelfcalError):
    """There are no workers, or they were lost. The message is one line."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A call of a function that a worker imports by its name.

    Attributes:
        task: Whatever the caller wants to find again with the result.
        name: What is done, with which recording, and which part of it.
        work: The function.
        arguments: Its arguments, which can be pickled.
        begun: Whether it belongs to a recording that is begun: such jobs go first.
    """

    task: Any
    name: tuple[str, str, int]
    work: Callable[..., Any]
    arguments: tuple[Any, ...]
    begun: bool = False


@dataclass(frozen=True, slots=True)
class Died:
    """The workers that did a job died, again and again.

    Attributes:
        cause: How the last one ended, in a few words.
    """

    cause: str


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a recording could not be calibrated.

    Attributes:
        reason: One line.
    """

    reason: str


class Workers(ABC):
    """Workers that do jobs in any order, those that are begun first."""

    @abstractmethod
    def submit(self, job: Job) -> None:
        """Have a job done."""

    @abstractmethod
    def result(self, timeout_s: float) -> tuple[Job, Any] | None:
        """Return a job that is done and what its function has returned, None if there is none in time.

        In place of a result a :class:`Died` stands for a job whose workers died, and a :class:`Failure` for
        one that gave no sign of life for too long, or whose result cannot be brought here.

        Raises:
            WorkersError: No result will ever come: no worker is left.
        """

    @abstractmethod
    def cancel(self) -> None:
        """Forget all jobs, and stop what is being done."""


def _nobody() -> None:
    """Take a sign of life where nobody waits for it."""


_on_progress: ContextVar[Callable[[], None]] = ContextVar("_on_progress", default=_nobody)


def progress() -> None:
    """Give a sign of life: another frame is done."""
    _on_progress.get()()


def on_progress(take: Callable[[], None]) -> None:
    """Choose who hears of the signs of life of this thread."""
    _on_progress.set(take)


def silence(patience_s: float) -> Failure:
    """Return what is said of a job that gave no sign of life for so long [s]."""
    return Failure(
        f"no frame came for {patience_s:g} s: the recording or its disk does not answer, or a frame never "
        "ends; see whether replay reads it, or wait longer with --patience"
    )


def internal_error(error: BaseException) -> Failure:
    """Return the outcome of a fault of ours, which must not end the other 10 000 recordings."""
    return Failure(f"internal error: {type(error).__name__}: {one_line(error)}")
