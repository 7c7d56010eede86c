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

"""One file a recording, so that an interrupted run goes on where it was, and does nothing twice."""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import ConfigError, OutputError, one_line, printable
from ..files.atomic_file import write_atomically
from .bags import files_of, place_of
from .outcome import BagOutcome
from .work import FleetSettings, versions

# Raised when what stands in a result file changes: files of another schema are done again.
_SCHEMA = 5
_RESULTS, _REPORTS = "results", "reports"
_LARGEST_RESULT = 2**28  # bytes; a row of a frame takes 2 kB, or 10 kB with many attempts
_NAME_CHARACTERS = 60  # of a bag's name in that of its result: file systems allow 255
_STRANGE = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True, slots=True)
class Bag:
    """A recording of the fleet.

    Attributes:
        name: As it was given, made printable.
        path: The place of it, without links.
        stem: Name of its files in the output folder: that of the bag and a hash of its place.
        key: Hash of all its numbers depend on: place, sizes and times of its files, settings, versions.
    """

    name: str
    path: Path
    stem: str
    key: str

    @classmethod
    def of(cls, path: Path, settings: FleetSettings) -> Bag:
        """Return the recording at a path, which need not exist."""
        place = Path(place_of(path))
        identity = {
            "schema": _SCHEMA,
            "files": _state_of(place),
            "settings": settings.to_mapping(),
            "versions": versions(),
        }
        named = _STRANGE.sub("_", place.name)[-_NAME_CHARACTERS:]
        return cls(
            printable(str(path)), place, f"{named}-{_hash(str(place))[:8]}", _hash(identity, str(place))
        )


class Store:
    """The output folder of a fleet.

    Attributes:
        folder: The folder; it exists.
        reports: Whether a recording without its report is not finished.
    """

    def __init__(self, folder: Path, reports: bool = False) -> None:
        self.folder = folder
        self.reports = reports
        for name in (_RESULTS, _REPORTS):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def finished(self, bag: Bag) -> BagOutcome | None:
        """Return what a former run has found, None where there is nothing that still holds."""
        try:
            content = json.loads(_read(self._result(bag)))
            if content["key"] != bag.key or content["check"] != _check(content):
                return None
            outcome = BagOutcome.from_mapping(content["outcome"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError, ConfigError):
            return None  # whatever is wrong with the file, doing the bag again mends it
        has_report = outcome.report == _report_name(bag) and (self.folder / outcome.report).is_file()
        if not outcome.finished or (self.reports and not has_report):
            return None
        return outcome.named(bag.name, outcome.report if has_report else "")

    def check(self, bag: Bag) -> None:
        """Refuse to do a recording whose result would have no place.

        Raises:
            OutputError: Something that is no file is there.
        """
        for path in (self._result(bag), self.folder / _report_name(bag)):
            if os.path.lexists(path) and not path.is_file():
                raise OutputError(f"{path} is in the way of a result: it is not a file; move it away")

    def save(self, bag: Bag, outcome: BagOutcome, replay: dict[str, Any] | None) -> None:
        """Write the result of a recording, whole or not at all.

        Args:
            bag: The recording.
            outcome: Its row.
            replay: The object that ``replay --json`` prints, None where there is none.

        Raises:
            OutputError: It cannot be written.
        """
        content = {"key": bag.key, "outcome": outcome.to_mapping(), "replay": replay}
        content["check"] = _check(content)
        write_atomically(self._result(bag), (json.dumps(content, allow_nan=False) + "\n").encode())

    def save_report(self, bag: Bag, content: bytes) -> str:
        """Write the report of a recording and return its name in the folder.

        Raises:
            OutputError: It cannot be written.
        """
        name = _report_name(bag)
        write_atomically(self.folder / name, content)
        return name

    def _result(self, bag: Bag) -> Path:
        return self.folder / _RESULTS / f"{bag.stem}.json"


def read_outcomes(folder: Path) -> tuple[list[BagOutcome], list[str]]:
    """Read all results that fleets have left in a folder, whatever they depend on.

    Args:
        folder: The output folder.

    Returns:
        The outcomes by the name of their files, and a sentence for each file that cannot be used.

    Raises:
        ConfigError: It is no output folder of a fleet.
    """
    try:
        paths = sorted((folder / _RESULTS).glob("*.json"))
    except OSError as error:
        raise ConfigError(f"{folder} cannot be read: {error.strerror}") from error
    if not paths:
        raise ConfigError(f"{folder} has no results of a fleet in it; give the --output of a fleet")
    outcomes, problems = [], []
    for path in paths:
        try:
            content = json.loads(_read(path))
            if content["check"] != _check(content):
                raise ConfigError("it is damaged")
            outcome = BagOutcome.from_mapping(content["outcome"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError, ConfigError) as error:
            why = one_line(error) if isinstance(error, ConfigError) else "it is no result of this version"
            problems.append(f"{printable(str(path))}: {why}; run the fleet again")
            continue
        is_there = bool(outcome.report) and (folder / outcome.report).is_file()
        outcomes.append(outcome.named(outcome.bag, outcome.report if is_there else ""))
    return outcomes, problems


def _report_name(bag: Bag) -> str:
    return f"{_REPORTS}/{bag.stem}.html"


def _read(path: Path) -> bytes:
    """Return the content of a result file.

    Raises:
        OSError: It cannot be read, is no file, or far too large for one.
    """
    # Opening a pipe would wait for somebody who writes.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:  # noqa: PTH123
        state = os.fstat(file.fileno())
        if not stat.S_ISREG(state.st_mode) or state.st_size > _LARGEST_RESULT:
            raise OSError(f"{path} is no result")
        return file.read()


def _check(content: dict[str, Any]) -> str:
    """Return the hash of what stands in a result file: a number that is not what it was is no result."""
    return _hash(content["key"], content["outcome"], content["replay"])


def _state_of(path: Path) -> list[tuple[str, int, int]]:
    """Return name, size and time of change of every file of a recording."""
    return [(str(each.relative_to(path)), state.st_size, state.st_mtime_ns) for each, state in files_of(path)]


def _hash(*values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
