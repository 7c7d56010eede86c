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

"""The files a command writes, checked before any work is done: none replaces what it should not."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ..bags import RECORDING_SUFFIXES, open_regular
from ..bags.errors import BagError
from ..bags.metadata import METADATA
from ..core.errors import printable
from ..files.writable import check_absent
from ..offline.folder import IMAGE_SUFFIXES, folders_of
from ..offline.opening import RIG_FILES
from .console import UsageError, check_writable

# What SQLite keeps beside a .db3.
_SQLITE_SUFFIXES = ("-wal", "-shm", "-journal")
_PNG, _PARQUET = "a PNG picture", "a Parquet table"
# First bytes of files that are no text, and metadata.yaml of a recording under whatever name.
_KINDS = (
    (b"\x89MCAP0\r\n", "an MCAP recording"),
    (b"SQLite format 3\x00", "an SQLite file, as recordings are"),
    (b"#ROSBAG V", "a ROS 1 recording"),
    (b"rosbag2_bagfile_information", "the metadata.yaml of a recording"),
    (b"\x28\xb5\x2f\xfd", "a file compressed with zstd"),
    (b"\x1f\x8b", "a file compressed with gzip"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x7fELF", "a program"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"\x89PNG\r\n", _PNG),
    (b"PAR1", _PARQUET),
)
_KIND_OF_SUFFIX = {".png": _PNG, ".parquet": _PARQUET}
_MOST_MAGIC = max(len(magic) for magic, _ in _KINDS)


class File(NamedTuple):
    """A file that a command reads or writes.

    Attributes:
        what: Its option, or what it is, for messages: ``--output``, ``the recording``.
        path: Where it is.
        is_recording: Whether it is a recording that is written: a new one, as none is overwritten.
    """

    what: str
    path: Path
    is_recording: bool = False


def check_outputs(outputs: Iterable[File], inputs: Iterable[File]) -> None:
    """Refuse outputs that cannot be written, or that would replace what they should not.

    That is a file the same command reads or writes, under whatever name or link; a recording; and what is
    plainly a file of another kind than the output.

    Args:
        outputs: The files that are going to be written.
        inputs: The files that are going to be read; they need not exist.

    Raises:
        UsageError: One of them is refused; nothing has been changed.
    """
    taken: dict[object, File] = {}
    for file in inputs:
        taken |= dict.fromkeys(_places(file.path), file)
    written: dict[object, File] = {}
    for output in outputs:
        check_writable(output.path, output.what)
        shown = f"{output.what} {printable(str(output.path))}"
        places = _places(output.path)
        for place in places:
            if place in taken:
                other = taken[place]
                raise UsageError(
                    f"{shown} is {other.what} {printable(str(other.path))}, which is read and must not be "
                    "overwritten: give another file"
                )
            if place in written:
                other = written[place]
                raise UsageError(
                    f"{other.what} and {output.what} are both {printable(str(output.path))}"
                    f"{_named_else(other.path, output.path)}: give two files"
                )
        if output.is_recording:
            check_absent(output.path)
            written |= dict.fromkeys(places, output)
            continue
        kind = _kind_of(output.path)
        if kind is not None and kind != _KIND_OF_SUFFIX.get(output.path.suffix.lower()):
            raise UsageError(f"{shown} would replace {kind}: give another file")
        if _is_recording(output.path) or _is_recording(Path(os.path.realpath(output.path))):
            raise UsageError(f"{shown} has the name of a file of a recording: give another name")
        written |= dict.fromkeys(places, output)


def recording_files(
    paths: Sequence[Path], left: str | None = None, right: str | None = None
) -> Iterator[File]:
    """Yield the files of recordings, as far as they are there.

    Args:
        paths: The recordings.
        left: Folder of the left images in a folder of image pairs, None for "left".
        right: The same of the right images.
    """
    for path in paths:
        yield File("the recording", path)
        with suppress(OSError, ValueError):  # whoever reads it says what is wrong with it
            yield from (File("the recording's file", file) for file in path.iterdir() if _of_recording(file))
        for name in folders_of(left, right):
            with suppress(OSError, ValueError):
                for file in (path / name).iterdir():
                    if file.suffix.lower() in IMAGE_SUFFIXES:
                        yield File("the image", file)


def _of_recording(file: Path) -> bool:
    """Whether a file in the folder of a recording is one of it, by its name."""
    return _is_recording(file) or file.name in RIG_FILES or file.name.endswith(_SQLITE_SUFFIXES)


def _is_recording(file: Path) -> bool:
    return file.name == METADATA or file.suffix.lower() in RECORDING_SUFFIXES


def _places(path: Path) -> set[object]:
    """Return what tells a file from all others: its real path, and its number or that of its folder."""
    with suppress(OSError, ValueError):
        real = Path(os.path.realpath(path))
        found: set[object] = {str(real)}
        with suppress(OSError):
            folder = real.parent.stat()
            found.add((folder.st_dev, folder.st_ino, real.name))  # one folder may have several paths
        with suppress(OSError):
            state = real.stat()
            found.add((state.st_dev, state.st_ino))
        return found
    return {str(path)}


def _kind_of(path: Path) -> str | None:
    """Return what a file plainly is, None where it is not there or anything else."""
    with suppress(OSError, ValueError, BagError):
        with open_regular(path) as file:
            start = file.read(_MOST_MAGIC)
        return next((kind for magic, kind in _KINDS if start.startswith(magic)), None)
    return None


def _named_else(path: Path, other: Path) -> str:
    return "" if path == other else f" (by another name, {printable(str(path))})"
