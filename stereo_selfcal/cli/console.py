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

"""Code that the command line tools share: exit statuses, one-line errors, a progress bar."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn, TextIO

from ..closed_streams import let_go, open_closed_streams
from ..core.errors import OutputError, SelfcalError, one_line, printable
from ..files.writable import check_writable as can_be_written
from ..search_path import SAFE_PATH
from ..unforeseen import unforeseen

# Exit status of every command.
EXIT_OK = 0
EXIT_NOT_ACCEPTED = 1
EXIT_BAD_INPUT = 2
# The shell's convention for a program that is ended by a signal: this and its number.
EXIT_BY_SIGNAL = 128
EXIT_BROKEN_PIPE = EXIT_BY_SIGNAL + signal.SIGPIPE

# What the --help of every command says below its own exit statuses.
OTHER_STATUSES = "3 something unforeseen, with a traceback; 129, 130, 143 ended by SIGHUP, Ctrl-C, SIGTERM."

_BAR_WIDTH = 30  # characters; the line stays below 80 columns


class UsageError(SelfcalError):
    """The command line is wrong; the message is one line."""


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a wrong command line in one line."""

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing the usage and exiting."""
        raise UsageError(f"{message}; see --help")


def without_ros_args(argv: Sequence[str]) -> list[str]:
    """Drop ``--ros-args ... [--]``, which ros2 run and launch may append; there is no node here."""
    kept: list[str] = []
    in_ros_args = False
    for argument in argv:
        if argument == "--ros-args":
            in_ros_args = True
        elif not in_ros_args:
            kept.append(argument)
        elif argument == "--":
            in_ros_args = False
    return kept


def run(program: str, work: Callable[[list[str]], int], argv: Sequence[str] | None) -> int:
    """Run a tool and turn every failure into an exit status and one line on stderr.

    What was not foreseen is told with its traceback. Ctrl-C, SIGHUP and SIGTERM end it cleanly.

    Args:
        program: Name in front of the error line.
        work: The tool: takes the arguments, returns the exit status.
        argv: Arguments without the program name, None for those of the process.

    Returns:
        Exit status.
    """
    open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError):  # what a caller has put in their place
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    ended: list[signal.Signals] = []
    try:
        with _ended_by_signals(ended), _safe_path_for_workers():
            status = work(without_ros_args(sys.argv[1:] if argv is None else argv))
            sys.stdout.flush()  # a closed pipe has to show up here, not in the interpreter's exit
            return status
    except SystemExit as error:  # argparse's --help
        return int(error.code or 0)
    except BrokenPipeError:
        let_go(sys.stdout)
        return EXIT_BROKEN_PIPE
    except (KeyboardInterrupt, Exception) as error:  # noqa: BLE001 - whatever it is, it is told, with a status
        # After a signal, any error is its consequence: modules in C make others of a KeyboardInterrupt.
        if ended or isinstance(error, KeyboardInterrupt):
            number = ended[0] if ended else signal.SIGINT
            _say(f"{program}: {_ENDED[number]}\n")
            return EXIT_BY_SIGNAL + number
        if isinstance(error, (SelfcalError, OSError)):
            _say(f"{program}: {one_line(error)}\n")
            return EXIT_BAD_INPUT
        return unforeseen(program, error)


class _Ended(KeyboardInterrupt):
    """A signal asks the program to end; a class of its own, as Python notes a plain one that passes exec().

    It then ends by SIGINT (3.8 and later), whatever status is returned.
    """


_ENDED = {
    signal.SIGINT: "interrupted",
    signal.SIGHUP: "ended, as the terminal is gone (SIGHUP)",
    signal.SIGTERM: "ended by SIGTERM",
}


@contextmanager
def _ended_by_signals(ended: list[signal.Signals]) -> Iterator[None]:
    """Raise KeyboardInterrupt at each of these signals, which else leave temporary files and workers behind.

    Where one is ignored (nohup, background job of a shell) it stays so.

    Args:
        ended: Gets the signal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _ENDED}

    def end(number: int, _frame: object) -> None:
        for each in before:
            signal.signal(each, signal.SIG_IGN)  # a second one must not disturb the cleaning
        ended.append(signal.Signals(number))
        raise _Ended

    usual = (signal.SIG_DFL, signal.default_int_handler)
    ours = [number for number, handler in before.items() if handler in usual]
    for number in ours:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


@contextmanager
def _safe_path_for_workers() -> Iterator[None]:
    """Keep the modules of the current folder from all processes that are started meanwhile."""
    given = os.environ.get(SAFE_PATH)
    os.environ.setdefault(SAFE_PATH, "1")
    try:
        yield
    finally:
        if given is None:
            os.environ.pop(SAFE_PATH, None)


def _say(text: str) -> None:
    """Write to stderr, if anybody is there."""
    with suppress(OSError, ValueError):
        sys.stderr.write(text)
        sys.stderr.flush()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            let_go(stream)


def check_writable(path: Path, option: str) -> None:
    """Make sure that a file can be put at ``path``, before any work is done for it.

    Raises:
        UsageError: It cannot; nothing has been changed.
    """
    try:
        can_be_written(path)
    except OutputError as error:
        raise UsageError(f"{option} {error}") from error


class Progress:
    """Progress bar on a terminal, a counter where the total is not known (None); silent elsewhere."""

    def __init__(self, total: int | None, stream: TextIO | None = None) -> None:
        self._total = None if total is None else max(total, 1)
        self._stream = sys.stderr if stream is None else stream
        self._shown = self._stream.isatty()

    def show(self, done: int, note: str = "") -> None:
        """Draw the bar for ``done`` of the total."""
        note = printable(note)
        if self._shown and self._total is None:
            self._stream.write(f"\r{done} {note}\x1b[K")
            self._stream.flush()
        elif self._shown and self._total is not None:
            filled = min(_BAR_WIDTH * done // self._total, _BAR_WIDTH)
            bar = "#" * filled + "." * (_BAR_WIDTH - filled)
            self._stream.write(f"\r[{bar}] {done}/{self._total} {note}\x1b[K")
            self._stream.flush()

    def clear(self) -> None:
        """Take the bar off the line, for other output or at the end."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
