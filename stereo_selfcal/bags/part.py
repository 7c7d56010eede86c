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

"""One bag of a recording, open. Each error message is one line."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ..core.errors import one_line, printable
from .definitions import check_definitions, deserialize
from .errors import BagError, NoFileError, TooLargeError
from .mcap_storage import MAGIC as MCAP_MAGIC
from .mcap_storage import McapStorage
from .metadata import METADATA, Metadata, read_metadata
from .order import natural_key
from .regular_file import check_regular, open_regular
from .ros1_storage import MAGIC as ROS1_MAGIC
from .ros1_storage import Ros1Storage
from .sqlite_storage import MAGIC as SQLITE_MAGIC
from .sqlite_storage import SqliteStorage
from .storage import CDR, MESSAGE_TYPES, ROS1, Channel, Storage
from .topics import Topic
from .unpacking import unpack_file, unpack_zstd

# Files that are a recording by themselves, without a folder and its metadata.yaml.
RECORDING_SUFFIXES = (".mcap", ".db3", ".bag")
_COMPRESSED_SUFFIX = ".zstd"
_SHOWN = 3  # names of files that are not read

_STORAGES = ((MCAP_MAGIC, McapStorage), (SQLITE_MAGIC, SqliteStorage), (ROS1_MAGIC, Ros1Storage))

_REPAIR = "if it was cut off, 'ros2 bag reindex', 'mcap recover' or 'rosbag reindex' may save it"
_REINDEX = "'ros2 bag reindex' writes it anew from the storage files"
# Words of errors, and the remedy for each; the first that fits.
_REMEDIES = {
    "Profile is not ros2": "an MCAP file of another system: record it with ROS 2, or convert it",
    "Compression format": "'ros2 bag convert' writes it anew with zstd, or without compression",
    "Storage plugin": "'ros2 bag convert' writes it anew as mcap or sqlite3",
    "Serialization format": "'ros2 bag convert' writes it anew in cdr",
    "not supported; please report": "a newer version of this program may read it",
    "its definition of": "record it with the messages of ROS",
    "files are missing": "put them beside metadata.yaml, or 'ros2 bag reindex' writes that anew",
    "set TMPDIR": "or unpack it yourself",
    METADATA: _REINDEX,
}
_GIVE = "give a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag"


class Message(NamedTuple):
    """A message of a recording.

    Attributes:
        recorded_ns: When it was recorded [ns].
        topic: Name of its topic.
        content: The message, deserialized by rosbags.
    """

    recorded_ns: int
    topic: str
    content: Any


class Part:
    """One bag of a recording, open.

    Attributes:
        path: A rosbag2 folder, a single .mcap or .db3 file, or a ROS 1 .bag.
        connections: Recorded topics, with types and numbers of messages.
        start_ns: Time at which its first message was recorded [ns].
        end_ns: Time at which its last message was recorded [ns].
        remark: What is strange about its files, "" for nothing.

    Raises:
        BagError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remark = ""
        self._stack = ExitStack()
        self._storages: list[Storage] = []
        self._packed_messages = False
        try:
            with self._damage_reported():
                self._open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def messages(
        self, topics: Collection[Topic], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Message]:
        """Yield the messages of topics in the order of the recording.

        Args:
            topics: Which ones, by name and type.
            start_ns: None recorded before this [ns].
            stop_ns: None recorded at this time or later [ns].

        Raises:
            BagError: The recording is damaged.
        """
        wanted = {(topic.name, topic.msgtype) for topic in topics}
        for storage in self._storages:
            channels = [c for c in storage.channels if (c.topic, c.msgtype) in wanted]
            messages = storage.messages(channels, start_ns, stop_ns)
            while True:
                with self._damage_reported():
                    found = next(messages, None)
                    if found is None:
                        break
                    data = unpack_zstd(found.data, "a message") if self._packed_messages else found.data
                    content = deserialize(found.channel, data)
                yield Message(found.recorded_ns, found.channel.topic, content)

    def _open(self) -> None:
        said: dict[tuple[str, str], int] = {}
        files: tuple[Path, ...] = (self.path,)
        if self.path.is_dir():
            metadata = read_metadata(self.path)
            self._packed_messages = metadata.compression == "message"
            files, said = self._unpacked(metadata), metadata.counts
            self.remark = _not_read(self.path, metadata)
        for file in files:
            storage = _open_storage(file)
            self._stack.callback(storage.close)
            self._storages.append(storage)
        # metadata.yaml may list them by letters, 10 before 2.
        self._storages.sort(key=lambda storage: storage.start_ns)
        channels = [channel for storage in self._storages for channel in storage.channels]
        for channel in channels:
            if channel.msgtype in MESSAGE_TYPES and channel.serialization not in (CDR, ROS1):
                raise BagError(f"Serialization format {channel.serialization[:20]!r} is not supported")
        check_definitions(channels)
        self.connections = self._joined(said)
        self.start_ns = min(storage.start_ns for storage in self._storages)
        self.end_ns = max(storage.end_ns for storage in self._storages)

    def _unpacked(self, metadata: Metadata) -> tuple[Path, ...]:
        if metadata.compression != "file":
            return metadata.files
        folder = Path(self._stack.enter_context(TemporaryDirectory(prefix="stereo_selfcal_")))
        unpacked = tuple(folder / file.name.removesuffix(_COMPRESSED_SUFFIX) for file in metadata.files)
        for file, target in zip(metadata.files, unpacked, strict=True):
            unpack_file(file, target)
        return unpacked

    def _joined(self, said: dict[tuple[str, str], int]) -> list[Channel]:
        """Return the topics of all files, each with the number of messages it should have."""
        found: dict[tuple[str, str], Channel] = {}
        for channel in (channel for storage in self._storages for channel in storage.channels):
            key = channel.topic, channel.msgtype
            before = found[key].msgcount if key in found else 0
            found[key] = channel._replace(msgcount=before + channel.msgcount)
        for (topic, msgtype), count in said.items():
            channel = found.get((topic, msgtype), Channel(0, topic, msgtype, 0))
            found[topic, msgtype] = channel._replace(msgcount=max(channel.msgcount, count))
        return list(found.values())

    @contextmanager
    def _damage_reported(self) -> Iterator[None]:
        """Make one line of the exceptions for a damaged file."""
        try:
            yield
        except NoFileError:
            raise
        except TooLargeError as error:
            raise TooLargeError(f"{self.path}: {error}") from error
        except MemoryError as error:
            raise BagError(f"{self.path}: reading it needs more memory than there is") from error
        except Exception as error:  # struct.error, sqlite3.Error, ZstdError, AssertionError: by the damage
            detail = one_line(error).rstrip(".")
            remedy = next((text for sign, text in _REMEDIES.items() if sign in detail), _REPAIR)
            raise BagError(f"{self.path}: cannot be read as a recording ({detail}); {remedy}") from error


def _not_read(folder: Path, metadata: Metadata) -> str:
    """Return a sentence about the storage files that metadata.yaml does not list, "" where it lists all."""
    names = metadata.unlisted
    if not names:
        return ""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    listed = ", ".join(printable(name) for name in names[:_SHOWN])
    return (
        f"{METADATA} of {printable(folder.resolve().name)} lists {len(metadata.files)} of "
        f"{len(metadata.files) + len(names)} storage files, not {listed}{more}, which "
        f"{'is' if len(names) == 1 else 'are'} not read: if they are one recording, {_REINDEX}"
    )


def _open_storage(path: Path) -> Storage:
    """Open a storage file as what its first bytes say it is."""
    with open_regular(path) as file:
        start = file.read(max(len(magic) for magic, _ in _STORAGES))
    if not start:
        raise BagError(f"{path.name} is empty")
    for magic, storage in _STORAGES:
        if start.startswith(magic):
            return storage(path)
    raise BagError(f"{path.name} does not begin as MCAP, SQLite or ROS 1 bag files do")


def recordings_at(path: Path) -> list[Path]:
    """Return the bags at ``path``: a folder with metadata.yaml, or files.

    Raises:
        BagError: There is no recording.
    """
    try:
        status = path.stat()
        if not path.is_dir():
            check_regular(status.st_mode, path)
            if path.suffix == _COMPRESSED_SUFFIX:
                raise BagError(f"{path}: {_unpack(path)}")
            if path.suffix not in RECORDING_SUFFIXES:
                raise BagError(f"{path}: not a recording; {_GIVE}")
            return [path]
        if (path / METADATA).exists():
            return [path]
        # A recorder that was killed leaves its storage files without metadata.yaml.
        entries = sorted(path.iterdir(), key=lambda file: natural_key(file.name))
    except FileNotFoundError as error:
        raise BagError(f"{path}: no such file or folder; {_GIVE}") from error
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise BagError(
            f"{path}: cannot be opened ({getattr(error, 'strerror', None) or error}); {_GIVE}"
        ) from error
    files = [file for file in entries if file.suffix in RECORDING_SUFFIXES]
    packed = [file for file in entries if file.suffix == _COMPRESSED_SUFFIX]
    if packed:
        raise BagError(f"{path}: there is no metadata.yaml, and {packed[0].name} {_unpack(packed[0])}")
    if not files:
        raise BagError(
            f"{path}: not a recording (a folder without metadata.yaml and without storage files); {_GIVE}; "
            "or a folder of image pairs, in left and right or the folders of --left and --right"
        )
    return files


def open_bags(paths: Sequence[Path]) -> list[tuple[Path, list[Part]]]:
    """Return the bags, each with its parts: the files of one without metadata.yaml.

    Raises:
        BagError: One of them cannot be read, or is given twice.
    """
    bags: list[tuple[Path, list[Part]]] = []
    try:
        for path in _distinct(paths):
            bags.append((path, []))
            for target in recordings_at(path):
                bags[-1][1].append(Part(target))
    except BaseException:
        for _, parts in bags:
            for part in parts:
                part.close()
        raise
    return bags


def _distinct(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the paths, all of which must lead to different files.

    Raises:
        BagError: Two of them lead to one file.
    """
    seen = set()
    for path in paths:
        try:
            place = os.path.realpath(path)
        except ValueError as error:
            raise BagError(f"{printable(str(path))}: no such file or folder ({error})") from error
        if place in seen:
            raise BagError(f"{path}: given twice; every bag of a drive once")
        seen.add(place)
        yield path


def _unpack(path: Path) -> str:
    return f"is compressed as a file: give its folder with metadata.yaml, or unpack it: zstd -d {path.name}"
