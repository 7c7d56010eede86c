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

"""ROS 1 bags, read by rosbags through a file that hands out no more than a bag can have."""

from __future__ import annotations

import io
import os
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Header, RecordType

from .errors import BagError
from .limits import MOST_CHUNK_BYTES, MOST_RECORD_BYTES, check_no_holes, check_size
from .regular_file import check_regular, open_regular
from .storage import ROS1, Channel, RawMessage, checked_definition
from .unpacking import unpack_bz2, unpack_lz4

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

MAGIC = b"#ROSBAG V"
# What may be read while a bag is opened, its index: 12 bytes for each message. rosbags keeps ten times that.
# The share of a bag with small messages only is a tenth.
_INDEX_FLOOR_BYTES = 2**25
_INDEX_SHARE = 0.1
_READ_BYTES = 16  # a read of fewer bytes takes the same time
_UNPACK = {"bz2": unpack_bz2, "lz4": unpack_lz4}


class Ros1Storage:
    """A ROS 1 bag, open; see :class:`~stereo_selfcal.bags.storage.Storage`.

    Args:
        path: The file.

    Raises:
        BagError: It is damaged, or states a size that is not read.
    """

    def __init__(self, path: Path) -> None:
        limited = _LimitedPath(path)
        self._reader = Reader(limited)
        self._reader.open()
        try:
            for position, chunk in self._reader.chunks.items():
                check_size("the content of a chunk", chunk.datasize, MOST_CHUNK_BYTES)
                unpack = self._unpacker(position)
                self._reader.chunks[position] = chunk._replace(decompressor=unpack)
            limited.opened()
            self._connections: dict[int, Connection] = {c.id: c for c in self._reader.connections}
            self.channels = [_channel(connection) for connection in self._reader.connections]
            self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def messages(
        self, channels: Collection[Channel], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages in the order of time; see :class:`~stereo_selfcal.bags.storage.Storage`."""
        wanted = {channel.key: channel for channel in channels}
        connections = [self._connections[key] for key in wanted]
        if connections:
            for connection, recorded_ns, data in self._reader.messages(connections, start_ns, stop_ns):
                yield RawMessage(recorded_ns, wanted[connection.id], data)

    def _unpacker(self, position: int) -> Any:
        """Return what unpacks the chunk at a position, of which rosbags knows no size."""
        file = cast("BinaryIO", self._reader.bio)
        file.seek(position)
        header = Header.read(file, RecordType.CHUNK)
        size = header.get_uint32("size")
        check_size("a chunk", size, MOST_CHUNK_BYTES)
        unpack = _UNPACK.get(header.get_string("compression"))
        return partial(unpack, what="a chunk", size=size) if unpack else lambda content: content


def _channel(connection: Connection) -> Channel:
    definition = checked_definition(connection.msgtype, connection.msgdef.data)
    return Channel(connection.id, connection.topic, connection.msgtype, connection.msgcount, ROS1, definition)


class _LimitedFile(io.BufferedReader):
    """A file that refuses to be read in pieces, or while a bag is opened to an extent, that no bag needs."""

    def __init__(self, file: io.BufferedReader, opening_bytes: int) -> None:
        super().__init__(file.detach())
        self._most = MOST_RECORD_BYTES
        self._left: float = opening_bytes

    def opened(self) -> None:
        self._most, self._left = MOST_CHUNK_BYTES, float("inf")

    def read(self, size: int | None = -1) -> bytes:
        size = -1 if size is None else size
        check_size("a record", size, self._most)
        self._left -= max(size, _READ_BYTES)
        if self._left < 0:
            raise BagError("its index is larger than that of any bag of this size")
        return super().read(size if size >= 0 else self._most)

    def readline(self, size: int | None = -1) -> bytes:
        return super().readline(MOST_RECORD_BYTES)


class _LimitedPath:
    """A path as rosbags takes it for files that are elsewhere; what is opened is limited."""

    def __init__(self, path: Path) -> None:
        status = path.stat()
        check_regular(status.st_mode, path)
        check_no_holes(status.st_size, 512 * getattr(status, "st_blocks", 0))
        self._path = path
        self._opening_bytes = max(_INDEX_FLOOR_BYTES, int(_INDEX_SHARE * status.st_size))
        self._files: list[_LimitedFile] = []

    def opened(self) -> None:
        """Allow chunks to be read."""
        for file in self._files:
            file.opened()

    def open(self, *_: Any, **__: Any) -> BinaryIO:
        file = _LimitedFile(open_regular(self._path), self._opening_bytes)
        self._files.append(file)
        return cast("BinaryIO", file)

    def exists(self) -> bool:
        return self._path.exists()

    def is_dir(self) -> bool:
        return False

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        return self._path.stat(follow_symlinks=follow_symlinks)

    def read_text(self, encoding: str | None = None) -> str:
        raise BagError(f"{self._path}: a bag is no text")

    def __truediv__(self, key: _LimitedPath | PurePath | str) -> _LimitedPath:
        return _LimitedPath(self._path / str(key))

    @property
    def stem(self) -> str:
        return self._path.stem

    @property
    def suffix(self) -> str:
        return self._path.suffix

    def __str__(self) -> str:
        return str(self._path)
