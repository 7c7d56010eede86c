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

"""SQLite files of rosbag2, also those whose recorder was killed or still runs.

rosbags reads such files as unchangeable, and so without what SQLite keeps in files beside them: the last
messages (``-wal``), or what of an unfinished change has to be undone (``-journal``).
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from array import array
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

import numpy as np

from .errors import BagError
from .limits import FREE_BYTES, MOST_MESSAGE_BYTES, check_no_holes, check_size, size_text
from .regular_file import check_regular, open_regular
from .storage import CDR, MESSAGE_TYPES, Channel, RawMessage, checked_definition

MAGIC = b"SQLite format 3\0"
_SIDE_FILES = ("-wal", "-journal")
_WAL_VERSION = 2  # byte 18 of a file in WAL mode
_BUSY_S = 5.0  # how long a recorder may hold the file for one write
# Steps of SQLite's machine for each byte of the file that a question may take: a row has ten bytes
# at least and takes about ten steps. Pages that name one another would never end.
_STEPS_PER_BYTE = 2
_LEAST_STEPS = 10_000_000
_STEPS_AT_A_TIME = 100_000
_MOST_TOPICS = 100_000


class SqliteStorage:
    """An SQLite file, open; see :class:`~stereo_selfcal.bags.storage.Storage`.

    Every message is read by a question of its own: a recorder that still writes the file never has to wait.
    What is recorded after it was opened is not read.

    Args:
        path: The file.

    Raises:
        BagError: It is damaged, or states a size that is not read.
    """

    def __init__(self, path: Path) -> None:
        status = path.stat()
        check_regular(status.st_mode, path)
        check_no_holes(status.st_size, 512 * getattr(status, "st_blocks", 0))
        self._stack = ExitStack()
        n_bytes = sum(_size(each) for each in (path, *(_beside(path, side) for side in _SIDE_FILES)))
        self._steps_left = self._most_steps = max(_LEAST_STEPS, _STEPS_PER_BYTE * n_bytes)
        try:
            self._connection = self._opened(path)
            self.channels = list(self._read_channels())
            start_ns, end_ns = self._ask("SELECT MIN(timestamp), MAX(timestamp) FROM messages")[0]
            self.start_ns = _integer(start_ns, "a time") if start_ns is not None else 2**63 - 1
            self.end_ns = _integer(end_ns, "a time") + 1 if end_ns is not None else 0
            (self._last_row,) = self._ask("SELECT MAX(rowid) FROM messages")[0]
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def messages(
        self, channels: Collection[Channel], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages in the order of time; see :class:`~stereo_selfcal.bags.storage.Storage`."""
        wanted = {channel.key: channel for channel in channels}
        rows = array("q")
        for key in wanted:
            found = self._ask(
                "SELECT rowid, timestamp FROM messages"
                " WHERE topic_id = ? AND timestamp >= ? AND timestamp < ? AND rowid <= ?",
                key,
                -(2**63) if start_ns is None else max(start_ns, -(2**63)),
                2**63 - 1 if stop_ns is None else min(stop_ns, 2**63 - 1),
                self._last_row or 0,
            )
            for row, time_ns in found:
                rows.extend((key, row, _integer(time_ns, "a time")))
        table = np.frombuffer(rows, dtype=np.int64).reshape(-1, 3) if rows else np.empty((0, 3), np.int64)
        for index in np.lexsort((table[:, 1], table[:, 2])):
            key, row, time_ns = table[index].tolist()
            yield RawMessage(time_ns, wanted[key], self._data(row))

    def _data(self, row: int) -> bytes:
        ((length,),) = self._ask("SELECT length(data) FROM messages WHERE rowid = ?", row) or ((0,),)
        check_size("a message", length or 0, MOST_MESSAGE_BYTES)
        found = self._ask("SELECT data FROM messages WHERE rowid = ?", row)
        if not found or not isinstance(found[0][0], bytes):
            raise BagError(f"message {row} has no data")
        data: bytes = found[0][0]
        return data

    def _read_channels(self) -> Iterator[Channel]:
        tables = {name for (name,) in self._ask("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"messages", "topics"} <= tables:
            raise BagError("the tables 'messages' and 'topics' of a recording are missing")
        counts = dict(self._ask("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        rows = self._ask("SELECT id, name, type, serialization_format FROM topics ORDER BY id")
        if len(rows) > _MOST_TOPICS:
            raise BagError(f"there are {len(rows)} topics, at most {_MOST_TOPICS} are read")
        for key, topic, msgtype, serialization in rows:
            definition, is_idl = "", False
            if "message_definitions" in tables and msgtype in MESSAGE_TYPES:
                definition, is_idl = self._definition(msgtype)
            yield Channel(
                _integer(key, "the number of a topic"),
                _name(topic, "the name of a topic"),
                _name(msgtype, "the type of a topic"),
                counts.get(key, 0),
                _name(serialization, "the serialization of a topic") or CDR,
                definition,
                is_idl,
            )

    def _definition(self, msgtype: str) -> tuple[str, bool]:
        found = self._ask(
            "SELECT encoding, substr(encoded_message_definition, 1, 1000000) FROM message_definitions"
            " WHERE topic_type = ? ORDER BY id LIMIT 1",
            msgtype,
        )
        if not found:
            return "", False
        encoding, definition = found[0]
        text = checked_definition(msgtype, _name(definition, "a message definition"))
        if text and encoding not in ("ros2msg", "ros2idl"):
            raise BagError(
                f"its definition of {msgtype} is in {str(encoding)[:20]!r}, ros2msg or ros2idl is read"
            )
        return text, encoding == "ros2idl"

    def _ask(self, question: str, *values: Any) -> list[Any]:
        """Return the answer as a whole, so that no lock is held."""
        self._steps_left = self._most_steps
        try:
            return self._connection.execute(question, values).fetchall()
        except sqlite3.OperationalError as error:
            if self._steps_left < 0:
                raise BagError("its pages name one another: there is no end of them") from error
            raise

    # Opening

    def _opened(self, path: Path) -> sqlite3.Connection:
        with open_regular(path) as file:
            head = file.read(100)
        if not head:
            raise BagError("the file is empty")
        if not head.startswith(MAGIC):
            raise BagError("the file does not begin as SQLite files do")
        beside = [side for side in _SIDE_FILES if _size(_beside(path, side)) > 0]
        if not beside:
            shared = _beside(path, "-shm").exists()
            # In a folder that cannot be written, a file in WAL mode can only be read as unchangeable.
            if head[18] == _WAL_VERSION and not shared:
                return self._connected(path, "immutable=1")
            with suppress(sqlite3.OperationalError):
                return self._connected(path, "mode=ro")
            return self._connected(path, "immutable=1")  # no locks in this file system
        with suppress(sqlite3.OperationalError):
            return self._connected(path, "mode=ro")
        return self._connected(self._copied(path, beside), "mode=rw")

    def _connected(self, path: Path, mode: str) -> sqlite3.Connection:
        # Characters such as '#', '?' and '%' have a meaning in a URI.
        uri = f"file:{quote(os.fsencode(path.absolute()))}?{mode}"
        connection = sqlite3.connect(uri, uri=True, timeout=_BUSY_S, check_same_thread=False)
        try:
            connection.set_progress_handler(self._step, _STEPS_AT_A_TIME)
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("PRAGMA cell_size_check = ON")
            connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchall()
        except BaseException:
            connection.close()
            raise
        self._stack.callback(connection.close)
        return connection

    def _copied(self, path: Path, beside: list[str]) -> Path:
        """Copy the file and those beside it to where they can be changed: SQLite has to complete them."""
        folder = self._stack.enter_context(TemporaryDirectory(prefix="stereo_selfcal_"))
        copy = Path(folder) / "copy.db3"
        files = [(path, copy), *((_beside(path, side), _beside(copy, side)) for side in beside)]
        needed = sum(source.stat().st_size for source, _ in files)
        free = shutil.disk_usage(folder).free - FREE_BYTES
        if needed > free:
            raise BagError(
                f"{path.name}{beside[0]} holds messages that are not in {path.name} yet: to read them, a "
                f"copy of {size_text(needed)} is needed, and {folder} has "
                f"{size_text(max(free, 0))} to spare: set TMPDIR to a folder with more"
            )
        for source, target in files:
            with open_regular(source) as content, target.open("wb") as file:
                shutil.copyfileobj(content, file)
        return copy

    def _step(self) -> int:
        """Count the steps of SQLite; a value other than zero ends the question."""
        self._steps_left -= _STEPS_AT_A_TIME
        return int(self._steps_left < 0)


def _beside(path: Path, side: str) -> Path:
    # SQLite looks beside the file itself, not beside a link to it.
    real = Path(os.path.realpath(path))
    return real.with_name(real.name + side)


def _size(path: Path) -> int:
    """Return the length of a file, 0 where there is none."""
    try:
        status = path.stat()
    except OSError:
        return 0
    check_regular(status.st_mode, path)
    return status.st_size


def _integer(value: Any, what: str) -> int:
    if not isinstance(value, int):
        raise BagError(f"{what} is {str(value)[:20]!r}, a whole number is needed")
    return value


def _name(value: Any, what: str) -> str:
    if isinstance(value, bytes):
        value = value.decode()
    if not isinstance(value, str):
        raise BagError(f"{what} is {value!r}, a text is needed")
    return value
