"""One file a recording, so that an interrupted run goes on where it was, and does nothing twice."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import ConfigError
from ..files.atomic_file import write_atomically
from .outcome import BagOutcome
from .work import FleetSettings, versions

# Raised when what stands in a result file changes: files of another schema are done again.
_SCHEMA = 1
_RESULTS, _REPORTS = "results", "reports"
_NAME_CHARACTERS = 60  # of a bag's name in that of its result: file systems allow 255
_STRANGE = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True, slots=True)
class Bag:
    """A recording of the fleet.

    Attributes:
        name: As it was given.
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
        place = path.resolve()
        identity = {
            "schema": _SCHEMA,
            "files": _state_of(place),
            "settings": settings.to_mapping(),
            "versions": versions(),
        }
        named = _STRANGE.sub("_", place.name)[-_NAME_CHARACTERS:]
        return cls(str(path), place, f"{named}-{_hash(str(place))[:8]}", _hash(identity, str(place)))


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
            content = json.loads(self._result(bag).read_text(encoding="utf-8"))
            if content["key"] != bag.key:
                return None
            outcome = BagOutcome.from_mapping(content["outcome"])
        except (OSError, ValueError, KeyError, TypeError, ConfigError):
            return None  # whatever is wrong with the file, doing the bag again mends it
        has_report = bool(outcome.report) and (self.folder / outcome.report).is_file()
        if not outcome.finished or (self.reports and not has_report):
            return None
        return outcome.named(bag.name, outcome.report if has_report else "")

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
        write_atomically(self._result(bag), (json.dumps(content, allow_nan=False) + "\n").encode())

    def save_report(self, bag: Bag, content: bytes) -> str:
        """Write the report of a recording and return its name in the folder.

        Raises:
            OutputError: It cannot be written.
        """
        name = f"{_REPORTS}/{bag.stem}.html"
        write_atomically(self.folder / name, content)
        return name

    def _result(self, bag: Bag) -> Path:
        return self.folder / _RESULTS / f"{bag.stem}.json"


def _state_of(path: Path) -> list[tuple[str, int, int]]:
    """Return name, size and time of change of every file of a recording."""
    try:
        files = [path] if not path.is_dir() else sorted(each for each in path.rglob("*") if each.is_file())
        states = [(each, each.stat()) for each in files]
    except OSError:  # it is not there, or going just now; the worker says so
        return []
    return [(str(each.relative_to(path)), state.st_size, state.st_mtime_ns) for each, state in states]


def _hash(*values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
