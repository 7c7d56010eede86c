"""Finds recordings by their paths. A folder that is no recording stands for all recordings below it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..bags.order import natural_key
from ..offline.folder import is_image_folder

_STORAGE_SUFFIXES = (".mcap", ".db3")
_BAG_SUFFIXES = (*_STORAGE_SUFFIXES, ".bag")
_SPLIT = re.compile(r"(.+)_\d+\.(?:mcap|db3)")  # as rosbag2 names the files of one recording


def find_bags(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings, in the order named, those of one folder by name; each of them once.

    A path that leads to no recording is kept: what is wrong with it is said where it is read.

    Args:
        paths: Recordings, as ``replay`` takes them; or folders of recordings.
    """
    found: dict[str, Path] = {}
    for path in paths:
        for bag in list(_below(path)) or [path]:
            found.setdefault(os.path.realpath(bag), bag)
    return list(found.values())


def _below(path: Path) -> Iterator[Path]:
    """Yield the recordings at a path: the path itself, or the recordings below it."""
    if not path.is_dir():
        if path.suffix in _BAG_SUFFIXES:
            yield path
        return
    entries = sorted(path.iterdir(), key=lambda entry: natural_key(entry.name))
    if (path / "metadata.yaml").exists() or is_image_folder(path) or _one_recording(entries):
        yield path
        return
    for entry in entries:
        yield from _below(entry)


def _one_recording(entries: Sequence[Path]) -> bool:
    """Whether the files of a folder are those of one recording, which a killed recorder has left."""
    files = [entry.name for entry in entries if entry.suffix in _STORAGE_SUFFIXES]
    matches = [_SPLIT.fullmatch(name) for name in files]
    return bool(files) and None not in matches and len({match[1] for match in matches if match}) == 1
