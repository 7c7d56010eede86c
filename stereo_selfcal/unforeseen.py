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

"""The end of a program that meets what nobody has foreseen: it says so, and how to report it."""

from __future__ import annotations

import traceback

from .closed_streams import tell_error
from .core.errors import printable

EXIT_UNFORESEEN = 3


def unforeseen(program: str, error: BaseException) -> int:
    """Write the traceback of an error to stderr, and below it one line with what to do about it.

    Args:
        program: Name in front of the line.
        error: What was raised.

    Returns:
        The exit status of the program.
    """
    tell_error(
        f"{''.join(_told(error))}"
        f"{program}: this was not foreseen ({type(error).__name__}), and no result can be relied on; "
        "please report the lines above and the command, best with the recording, to the maintainers "
        "(package.xml)\n"
    )
    return EXIT_UNFORESEEN


def _told(error: BaseException) -> list[str]:
    """Return the traceback, as Python has it, but for what a message may hold from outside."""
    before = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    lines = [*_told(before), "\nThen:\n\n"] if before is not None else []
    lines += ["Traceback (most recent call last):\n", *traceback.format_tb(error.__traceback__)]
    return [*lines, f"{type(error).__name__}: {printable(str(error))}\n"]
