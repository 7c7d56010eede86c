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

"""metadata.yaml of a rosbag2 folder: what of it is used, and each value checked.

Only which files there are, how they are packed and how many messages each topic has is taken from it. All
else the storage files know themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import yaml

from ..core.errors import printable, shortened
from .errors import BagError
from .limits import MOST_METADATA_BYTES, check_size, size_text
from .order import natural_key
from .regular_file import open_regular

METADATA = "metadata.yaml"

_ROOT = "rosbag2_bagfile_information"
_NEWEST_VERSION = 9  # of ROS 2 Jazzy; nothing that is used here has changed since 4
_STORAGES = ("mcap", "sqlite3")
_COMPRESSION = "zstd"
_FILE_SUFFIXES, _PACKED = (".mcap", ".db3"), ".zstd"
_MOST_DEPTH = 20  # five levels in fact, and the QoS of a topic
# A recording of 10 000 files has 300 000 nodes: keys, values, lists.
_MOST_NODES = 500_000
# libyaml's, which is ten times as fast, where PyYAML was built with it.
_BASE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _MetadataLoader(_BASE):  # type: ignore[misc]  # PyYAML has no types
    """Loader without merge keys, a few lines of which stand for gigabytes."""

    def flatten_mapping(self, node: Any) -> None:
        """Refuse ``<<``."""
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                problem = "merge keys (<<) are not read"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)


@dataclass(frozen=True, slots=True)
class Metadata:
    """What metadata.yaml says.

    Attributes:
        files: Storage files, in the order of recording.
        compression: ``file``, ``message``, or "" for none.
        counts: Messages of each topic, by name and type.
        unlisted: Names of the storage files beside it of which it says nothing.
    """

    files: tuple[Path, ...]
    compression: str
    counts: dict[tuple[str, str], int]
    unlisted: tuple[str, ...] = ()


def read_metadata(folder: Path) -> Metadata:
    """Read the metadata.yaml of a recording.

    Args:
        folder: The recording.

    Raises:
        BagError: It cannot be read, or a value is not what it has to be; the message names it.
    """
    try:
        with open_regular(folder / METADATA) as file:
            content = file.read(MOST_METADATA_BYTES + 1)
            check_size(METADATA, (folder / METADATA).stat().st_size, MOST_METADATA_BYTES)
        text = content.decode()
    except OSError as error:
        raise BagError(f"{METADATA} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BagError(f"{METADATA} is no text") from error
    document = _parsed(text)
    root = _mapping(_mapping(document, METADATA).get(_ROOT), _ROOT)
    version = _count(root.get("version"), "version")
    if version > _NEWEST_VERSION:
        raise BagError(f"{METADATA}: version {version} is not supported; please report it")
    storage = root.get("storage_identifier")
    if storage not in _STORAGES:
        raise BagError(f"Storage plugin {shortened(storage)} is not supported")
    names = [
        _word(name, "relative_file_paths")
        for name in _list(root.get("relative_file_paths"), "relative_file_paths")
    ]
    if not names:
        raise BagError(f"{METADATA}: relative_file_paths names no file")
    files = tuple(folder / PurePath(name).name for name in names)
    missing = [file.name for file in files if not _exists(file)]
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        listed = ", ".join(shortened(name) for name in missing[:3])
        raise BagError(f"storage files are missing: {listed}{more}")
    if len(set(files)) < len(files):
        raise BagError(f"{METADATA}: relative_file_paths names a file twice")
    return Metadata(files, _compression(root), _counts(root), _unlisted(folder, files))


def _exists(file: Path) -> bool:
    try:
        return file.exists()
    except (OSError, ValueError):  # a name that no file can have
        return False


def _unlisted(folder: Path, files: Iterable[Path]) -> tuple[str, ...]:
    """Return the names of the storage files of a folder that are none of these, packed or unpacked."""
    listed = {file.name.removesuffix(_PACKED) for file in files}
    names = (file.name for file in folder.iterdir())
    found = {name for name in names if name.removesuffix(_PACKED).endswith(_FILE_SUFFIXES)}
    return tuple(sorted((n for n in found if n.removesuffix(_PACKED) not in listed), key=natural_key))


def _compression(root: Mapping[str, Any]) -> str:
    mode = _word(root.get("compression_mode") or "", "compression_mode").lower()
    if mode in ("", "none"):
        return ""
    if mode not in ("file", "message"):
        raise BagError(f"{METADATA}: compression_mode is {shortened(mode)}: file or message is needed")
    if root.get("compression_format") != _COMPRESSION:
        raise BagError(f"Compression format {shortened(root.get('compression_format'))} is not supported")
    return mode


def _counts(root: Mapping[str, Any]) -> dict[tuple[str, str], int]:
    counts: dict[tuple[str, str], int] = {}
    key = "topics_with_message_count"
    for number, value in enumerate(_list(root.get(key), key)):
        where = f"{key}[{number}]"
        entry = _mapping(value, where)
        topic = _mapping(entry.get("topic_metadata"), f"{where}.topic_metadata")
        name = _word(topic.get("name"), f"{where}.topic_metadata.name")
        kind = _word(topic.get("type"), f"{where}.topic_metadata.type")
        count = _count(entry.get("message_count"), f"{where}.message_count of {printable(name)}")
        counts[name, kind] = counts.get((name, kind), 0) + count
    return counts


def _parsed(text: str) -> Any:
    depth = 0
    try:
        # The events come one by one, whatever the depth; building the values from them does not bear any.
        for number, event in enumerate(yaml.parse(text, Loader=_BASE)):
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
            if depth > _MOST_DEPTH or number > _MOST_NODES:
                many = f"{_MOST_DEPTH} levels" if depth > _MOST_DEPTH else f"{_MOST_NODES} values"
                raise BagError(f"{METADATA} of {size_text(len(text))} has more than {many}")
        return yaml.load(text, Loader=_MetadataLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        detail = printable(str(getattr(error, "problem", None) or "damaged"))
        raise BagError(f"{METADATA} is not YAML that can be read{where} ({detail})") from error
    except (ValueError, OverflowError, TypeError, AttributeError, RecursionError) as error:
        raise BagError(f"{METADATA} has a value that cannot be read ({printable(str(error))})") from error


def _mapping(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(what, value, "names with values are needed")
    return value


def _list(value: Any, what: str) -> list[Any]:
    if not isinstance(value, list):
        raise _wrong(what, value, "a list is needed")
    return value


def _word(value: Any, what: str) -> str:
    if not isinstance(value, str):
        raise _wrong(what, value, "a text is needed")
    return value


def _count(value: Any, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**63:
        raise _wrong(what, value, "a whole number, zero or more, is needed")
    return value


def _wrong(what: str, value: Any, needed: str) -> BagError:
    where = METADATA if what == METADATA else f"{METADATA}: {what}"
    return BagError(f"{where} is {'missing' if value is None else shortened(value)}: {needed}")
