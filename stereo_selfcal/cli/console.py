"""Code that the command line tools share: exit statuses, one-line errors, a progress bar."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

from ..core.errors import SelfcalError

# Exit status of every command.
EXIT_OK = 0
EXIT_NOT_ACCEPTED = 1
EXIT_BAD_INPUT = 2
# The shell's convention for a program ended by a signal: 128 + SIGINT, 128 + SIGPIPE.
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

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
    """Run a tool and turn every expected failure into one line on stderr and an exit status.

    Args:
        program: Name in front of the error line.
        work: The tool: takes the arguments, returns the exit status.
        argv: Arguments without the program name, None for those of the process.

    Returns:
        Exit status.
    """
    try:
        status = work(without_ros_args(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()  # a closed pipe has to show up here, not in the interpreter's exit
        return status
    except SystemExit as error:  # argparse's --help
        return int(error.code or 0)
    except BrokenPipeError:
        # Nobody reads any more; what is still buffered must not complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except KeyboardInterrupt:
        sys.stderr.write(f"{program}: interrupted\n")
        return EXIT_INTERRUPTED
    except (SelfcalError, OSError) as error:
        sys.stderr.write(f"{program}: {' '.join(str(error).split())}\n")
        return EXIT_BAD_INPUT


def check_writable(path: Path, option: str) -> None:
    """Make sure that a file can be put at ``path``, before any work is done for it.

    Raises:
        UsageError: It cannot; nothing has been changed.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise UsageError(f"{option} {path}: is not a file; give the name of a file")
    try:
        # Files are replaced by renaming a new one beside them, so the folder is what counts.
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise UsageError(
            f"{option} {path}: cannot be written ({error.strerror}); choose a writable folder that exists"
        ) from error


class Progress:
    """Progress bar on a terminal, a counter where the total is not known (None); silent elsewhere."""

    def __init__(self, total: int | None, stream: TextIO | None = None) -> None:
        self._total = None if total is None else max(total, 1)
        self._stream = sys.stderr if stream is None else stream
        self._shown = self._stream.isatty()

    def show(self, done: int, note: str = "") -> None:
        """Draw the bar for ``done`` of the total."""
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
