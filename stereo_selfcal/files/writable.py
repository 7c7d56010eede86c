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

"""Whether a file can be written, asked before there is anything to write."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from ..core.errors import OutputError, printable
from .atomic_file import cannot_be_written, refuse_other_than_files


def check_writable(path: Path | str, made: Path | None = None) -> None:
    """Make sure that a file can be put at ``path``; changes nothing.

    Args:
        path: The file. A link is followed.
        made: A folder in which missing folders are made when they are needed, and it itself.

    Raises:
        OutputError: It cannot: one sentence with the path, the cause and the remedy.
    """
    try:
        refuse_other_than_files(path)
        target = Path(os.path.realpath(path))
        if _is_other_than_file(target):
            raise OutputError(
                f"{printable(str(path))} cannot be written: it is not a file; give the name of a file"
            )
        folder = target.parent
        if made is not None and folder.is_relative_to(os.path.realpath(made)):
            while not folder.exists() and folder != folder.parent:
                folder = folder.parent
        # Files are replaced by renaming a new one beside them, so the folder is what counts.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise cannot_be_written(path, error) from error


def check_absent(path: Path) -> None:
    """Refuse a file that is there already: recordings are not overwritten.

    Raises:
        OutputError: It is.
    """
    if os.path.lexists(path):
        shown = printable(str(path))
        raise OutputError(f"{shown} exists already and is not overwritten; choose another name or remove it")


def _is_other_than_file(target: Path) -> bool:
    try:
        return not stat.S_ISREG(target.lstat().st_mode)
    except FileNotFoundError:
        return False
