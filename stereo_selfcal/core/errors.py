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

"""Exceptions of the package: each message says what went wrong, with which object, and what to do.

A frame that cannot be calibrated is no exception but a result with a
:class:`~stereo_selfcal.core.results.RejectReason`; exceptions are for a wrong
call or an unusable file.
"""

from __future__ import annotations

from typing import Any

_LONGEST_SHOWN = 40
# Letters of a message of one line: some paths and a list of topics; a recording may have 60 kB of names.
_LONGEST_LINE = 4000


class SelfcalError(Exception):
    """Base of every exception this package raises on purpose."""


class RigError(SelfcalError, ValueError):
    """The description of the stereo rig cannot be right (zero focal length, no baseline, ...)."""


class ConfigError(SelfcalError, ValueError):
    """A setting is unknown, has the wrong type or lies outside its range."""


class ImageError(SelfcalError, ValueError):
    """An image message cannot be converted: unknown encoding, too few bytes, ..."""


class OutputError(SelfcalError):
    """A result cannot be written: no such folder, no permission, no space, ..."""


def shortened(value: Any) -> str:
    """Return a value for a message, cut to a fixed length: values from outside may be arbitrarily long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def printable(text: str) -> str:
    """Return a text on one line, with escapes in place of all that a terminal or a log would interpret.

    Names of topics, files and frames come from outside. Line ends and escape sequences in them could forge
    lines of output, and bytes that are no UTF-8 (surrogates in Python) could not be printed at all.

    Args:
        text: Any text; spaces and printable characters of any script stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text
    )


def one_line(error: BaseException) -> str:
    """Return the text of an error as one printable line, its type where it has none.

    What an error lists comes from outside and may be megabytes; the line has a limit.
    """
    text = printable(" ".join(str(error).split())) or type(error).__name__
    return text if len(text) <= _LONGEST_LINE else f"{text[:_LONGEST_LINE]}... ({len(text)} letters)"
