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

"""Finds recordings by their paths. A folder that is no recording stands for all recordings below it."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..bags.order import natural_key
from ..offline.folder import is_image_folder

_STORAGE_SUFFIXES = (".mcap", ".db3")
_BAG_SUFFIXES = (*_STORAGE_SUFFIXES, ".bag")
_SPLIT = re.compile(r"(.+)_\d+\.(?:mcap|db3)")  # as rosbag2 names the files of one recording

_NOWHERE = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


def find_bags(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings, in the order named, those of one folder by name; each of them once.

    A path that leads to no recording is kept, and so is a folder that cannot be read: what is wrong with it
    is said where it is read. Links are followed, but no folder is entered twice below one path: links may
    lead in circles.

    Args:
        paths: Recordings, as ``replay`` takes them; or folders of recordings.
    """
    found: dict[str, Path] = {}
    for path in paths:
        for bag in list(_below(path)) or [path]:
            found.setdefault(place_of(bag), bag)
    return list(found.values())


def place_of(path: Path) -> str:
    """Return the place of a path, without links where it leads anywhere."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):  # ValueError: a NUL character
        return str(path)


def files_of(path: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Yield the files of a recording and what is known of them: the file itself, or all below a folder.

    What is not there, or cannot be looked at, is passed over.
    """
    entries, entered = [path], set[tuple[int, int]]()
    while entries:
        entry = entries.pop()
        with suppress(OSError, ValueError):  # ValueError: a NUL character
            state = entry.stat()
            if stat.S_ISREG(state.st_mode):
                yield entry, state
            elif stat.S_ISDIR(state.st_mode) and _new(state, entered):
                entries += sorted(entry.iterdir(), reverse=True)


def _below(path: Path) -> Iterator[Path]:
    """Yield the recordings at a path: the path itself, or the recordings below it."""
    entries, entered = [path], set[tuple[int, int]]()
    while entries:
        entry = entries.pop()
        try:
            state = entry.stat()
            if not stat.S_ISDIR(state.st_mode):
                if entry.suffix in _BAG_SUFFIXES:
                    yield entry
                continue
            if not _new(state, entered):
                continue
            below = sorted(entry.iterdir(), key=lambda each: natural_key(each.name))
            if (entry / "metadata.yaml").exists() or is_image_folder(entry) or _one_recording(below):
                yield entry
            else:
                entries += reversed(below)
        except (OSError, ValueError) as error:
            # A link to nowhere is nothing, unless its name says that it is a recording.
            if entry.suffix in _BAG_SUFFIXES or getattr(error, "errno", None) not in _NOWHERE:
                yield entry


def _new(state: os.stat_result, entered: set[tuple[int, int]]) -> bool:
    """Whether a folder has not been entered yet; now it has."""
    folder = state.st_dev, state.st_ino
    if folder in entered:
        return False
    entered.add(folder)
    return True


def _one_recording(entries: Sequence[Path]) -> bool:
    """Whether the files of a folder are those of one recording, which a killed recorder has left."""
    files = [entry.name for entry in entries if entry.suffix in _STORAGE_SUFFIXES]
    matches = [_SPLIT.fullmatch(name) for name in files]
    return bool(files) and None not in matches and len({match[1] for match in matches if match}) == 1
