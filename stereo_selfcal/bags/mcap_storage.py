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

"""MCAP files. Each length is checked before it is read, and what is unpacked at one time has a limit.

Written after the specification (mcap.dev/spec). rosbags reads MCAP too, but allocates whatever a record or
the header of a chunk states, and has no place for a limit.
"""

from __future__ import annotations

import os
import struct
from array import array
from binascii import crc32
from collections.abc import Collection, Iterator
from heapq import merge
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from .errors import BagError
from .limits import (
    MOST_CHUNK_BYTES,
    MOST_MESSAGE_BYTES,
    MOST_RECORD_BYTES,
    check_no_holes,
    check_size,
    size_text,
)
from .regular_file import open_regular
from .storage import MESSAGE_TYPES, Channel, RawMessage, checked_definition
from .unpacking import unpack_lz4, unpack_zstd

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_CHUNK_INDEX, _STATISTICS, _DATA_END, _SUMMARY_OFFSET = 8, 11, 15, 14
_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_LONGEST_CHUNK_HEAD = 4096  # 40 bytes and the name of the compression
_FOOTER_BYTES = 20
_END_BYTES = _RECORD_HEAD.size + _FOOTER_BYTES + len(MAGIC)
_NOT_IDL = "ros2msg"
_IDL = ("ros2idl", "omgidl")


class _Chunk(NamedTuple):
    """A chunk: its time, where the content of its record is, and what is known of it."""

    start_ns: int
    end_ns: int
    position: int
    length: int
    stored: int
    size: int
    channels: frozenset[int] | None = None  # those with messages in it, where that is known


class McapStorage:
    """An MCAP file, open; see :class:`~stereo_selfcal.bags.storage.Storage`.

    Args:
        path: The file.

    Raises:
        BagError: It is damaged, or states a size that is not read.
    """

    def __init__(self, path: Path) -> None:
        self._forget()
        self._open_bytes = 0
        self._file: BinaryIO = open_regular(path)
        try:
            status = os.fstat(self._file.fileno())
            check_no_holes(status.st_size, 512 * getattr(status, "st_blocks", 0))
            self._end = status.st_size - _END_BYTES
            self._read_structure()
        except BaseException:
            self.close()
            raise
        self.channels = [c._replace(msgcount=self._counts.get(c.key, 0)) for c in self._known.values()]

    def _forget(self) -> None:
        self.start_ns, self.end_ns = 2**63 - 1, 0
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._known: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}
        self._chunks: list[_Chunk] = []
        # Messages that are in no chunk: time [ns], channel, position and length of each, one after the other.
        self._loose = array("Q")

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(
        self, channels: Collection[Channel], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages in the order of time; see :class:`~stereo_selfcal.bags.storage.Storage`."""
        wanted = {channel.key: channel for channel in channels}
        start = -1 if start_ns is None else start_ns
        stop = 2**64 if stop_ns is None else stop_ns
        parts = [
            self._chunk_messages(chunk, wanted, start, stop)
            for chunk in sorted(self._chunks)
            if chunk.start_ns < stop and start <= chunk.end_ns
            if chunk.channels is None or not chunk.channels.isdisjoint(wanted)
        ]
        parts.append(self._loose_messages(wanted, start, stop))
        for _, message in merge(*parts, key=lambda item: item[0]):
            if message is not None:
                yield message

    # The structure of a file

    def _read_structure(self) -> None:
        if self._end < len(MAGIC):
            raise BagError("the file is empty" if self._end == -_END_BYTES else "the file is cut short")
        if self._read(0, len(MAGIC)) != MAGIC:
            raise BagError("the file does not begin as MCAP files do")
        kind, position, length = self._record_at(len(MAGIC), self._end)
        if kind != _HEADER:
            raise BagError("the first record is no header")
        profile, _ = _text(self._content(position, length, "header"), 0)
        if profile != "ros2":
            raise BagError("Profile is not ros2")
        data_start = position + length
        end = self._read(self._end, _END_BYTES)
        if end[-len(MAGIC) :] != MAGIC or _RECORD_HEAD.unpack_from(end) != (_FOOTER, _FOOTER_BYTES):
            raise BagError("the end of the file is missing")
        (summary_start,) = struct.unpack_from("<Q", end, _RECORD_HEAD.size)
        if summary_start and not data_start <= summary_start <= self._end:
            raise BagError("the place of its summary is outside of the file")
        if not summary_start or not self._read_summary(summary_start):
            self._scan(data_start, summary_start or self._end)

    def _read_summary(self, position: int) -> bool:
        """Read the index of the file; return whether it has all that is needed."""
        has_statistics = False
        for kind, start, length in self._records(position, self._end):
            if kind in (_SUMMARY_OFFSET, _FOOTER):
                break
            if kind in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS):
                content = self._content(start, length, "record of the index")
                if kind == _CHUNK_INDEX:
                    self._chunks.append(self._indexed_chunk(content))
                elif kind == _STATISTICS:
                    has_statistics = True
                    self._read_statistics(content)
                else:
                    self._describe(kind, content)
        self._check_distinct()
        known = bool(self._schemas) and all(channel.msgtype for channel in self._known.values())
        return has_statistics and known and bool(self._chunks)

    def _scan(self, position: int, end: int) -> None:
        """Read the structure from the data themselves."""
        self._forget()
        for kind, start, length in self._records(position, end):
            if kind == _DATA_END:
                break
            if kind == _CHUNK:
                chunk = self._chunk_at(start, length)
                self._chunks.append(chunk._replace(channels=frozenset(self._scan_chunk(chunk))))
            elif kind == _MESSAGE:
                check_size("a message", length, MOST_MESSAGE_BYTES)
                key, time_ns = self._count(self._read(start, min(length, _MESSAGE_HEAD.size)))
                head = _MESSAGE_HEAD.size
                self._loose.extend((time_ns, key, start + head, length - head))
            elif kind in (_SCHEMA, _CHANNEL):
                self._describe(kind, self._content(start, length, "record"))

    def _scan_chunk(self, chunk: _Chunk) -> set[int]:
        seen = set()
        content = self._unpacked(chunk)
        for kind, start, length in _records_in(content):
            if kind == _MESSAGE:
                seen.add(self._count(content[start : start + min(length, _MESSAGE_HEAD.size)])[0])
            elif kind in (_SCHEMA, _CHANNEL):
                check_size("a record", length, MOST_RECORD_BYTES)
                self._describe(kind, content[start : start + length])
        return seen

    def _count(self, head: bytes) -> tuple[int, int]:
        key, _, time_ns, _ = _MESSAGE_HEAD.unpack(head)
        self._counts[key] = self._counts.get(key, 0) + 1
        self.start_ns, self.end_ns = min(self.start_ns, time_ns), max(self.end_ns, time_ns + 1)
        return key, time_ns

    def _describe(self, kind: int, content: bytes) -> None:
        """Take a schema or a channel."""
        (key,) = struct.unpack_from("<H", content)
        if kind == _SCHEMA:
            name, position = _text(content, 2)
            encoding, position = _text(content, position)
            definition, _ = _text(content, position)
            if name in MESSAGE_TYPES and definition and encoding not in (_NOT_IDL, *_IDL):
                raise BagError(f"its definition of {name} is in {encoding!r}, ros2msg or ros2idl is read")
            self._schemas[key] = name, encoding, checked_definition(name, definition)
        elif key not in self._known:
            (schema,) = struct.unpack_from("<H", content, 2)
            name, encoding, definition = self._schemas.get(schema, ("", "", ""))
            topic, position = _text(content, 4)
            serialization, _ = _text(content, position)
            self._known[key] = Channel(key, topic, name, 0, serialization, definition, encoding in _IDL)

    def _read_statistics(self, content: bytes) -> None:
        n_messages, start_ns, end_ns = struct.unpack_from("<Q18xQQ", content)
        (length,) = struct.unpack_from("<I", content, 42)
        counts = content[46 : 46 + length]
        self._counts = dict(struct.iter_unpack("<HQ", counts[: len(counts) // 10 * 10]))
        if n_messages:
            self.start_ns, self.end_ns = start_ns, end_ns + 1

    def _indexed_chunk(self, content: bytes) -> _Chunk:
        start_ns, end_ns, position, length = struct.unpack_from("<QQQQ", content)
        (map_length,) = struct.unpack_from("<I", content, 32)
        # Writers may leave out where the messages of a chunk are.
        keys = frozenset(key for key, _ in struct.iter_unpack("<HQ", content[36 : 36 + map_length])) or None
        _, offset = _text(content, 36 + map_length + 8)
        stored, size = struct.unpack_from("<QQ", content, offset)
        _check_chunk(stored, size)
        head = _RECORD_HEAD.size
        return _Chunk(start_ns, end_ns, position + head, length - head, stored, size, keys)

    def _chunk_at(self, position: int, length: int) -> _Chunk:
        """Return the chunk whose record has its content at ``position``."""
        head = self._read(position, min(length, _LONGEST_CHUNK_HEAD))
        start_ns, end_ns, size, _ = _CHUNK_HEAD.unpack_from(head)
        _, offset = _text(head, _CHUNK_HEAD.size)
        (stored,) = struct.unpack_from("<Q", head, offset)
        if offset + 8 + stored > length:
            raise BagError("the content of a chunk is longer than the chunk")
        _check_chunk(stored, size)
        return _Chunk(start_ns, end_ns, position, length, stored, size)

    def _check_distinct(self) -> None:
        """Refuse an index that names one part of the file many times: it would never end."""
        end = 0
        for position, length in sorted((chunk.position, chunk.length) for chunk in self._chunks):
            if position < end:
                raise BagError("its index names a part of the file twice")
            end = position + length

    # The content of chunks

    def _chunk_messages(
        self, chunk: _Chunk, wanted: dict[int, Channel], start: int, stop: int
    ) -> Iterator[tuple[int, RawMessage | None]]:
        """Yield the messages of a chunk by their time. It is unpacked when its time has come."""
        yield chunk.start_ns, None
        self._open_bytes += chunk.size
        try:
            if self._open_bytes > MOST_CHUNK_BYTES:
                check_size("chunks of one time, together,", self._open_bytes, MOST_CHUNK_BYTES)
            content = self._unpacked(chunk)
            rows = array("Q")
            for kind, position, length in _records_in(content):
                if kind == _MESSAGE:
                    key, _, time_ns, _ = _MESSAGE_HEAD.unpack_from(content, position)
                    if length < _MESSAGE_HEAD.size:
                        raise BagError("a message is shorter than its head")
                    if key in wanted and start <= time_ns < stop:
                        rows.extend((time_ns, key, position + _MESSAGE_HEAD.size, position + length))
            for time_ns, key, position, end in _by_time(rows):
                yield time_ns, RawMessage(time_ns, wanted[key], content[position:end])
        finally:
            self._open_bytes -= chunk.size

    def _loose_messages(
        self, wanted: dict[int, Channel], start: int, stop: int
    ) -> Iterator[tuple[int, RawMessage | None]]:
        for time_ns, key, position, length in _by_time(self._loose):
            if key in wanted and start <= time_ns < stop:
                yield time_ns, RawMessage(time_ns, wanted[key], self._read(position, length))

    def _unpacked(self, chunk: _Chunk) -> bytes:
        head = self._read(chunk.position, min(chunk.length, _LONGEST_CHUNK_HEAD))
        _, _, size, crc = _CHUNK_HEAD.unpack_from(head)
        compression, offset = _text(head, _CHUNK_HEAD.size)
        (stored,) = struct.unpack_from("<Q", head, offset)
        if (stored, size) != (chunk.stored, chunk.size):
            raise BagError("its index states another size of a chunk than the chunk does")
        content = self._read(chunk.position + offset + 8, stored)
        if compression == "zstd":
            content = unpack_zstd(content, "a chunk", size)
        elif compression == "lz4":
            content = unpack_lz4(content, "a chunk", size)
        elif compression:
            raise BagError(f"Compression format {compression[:20]!r} of a chunk is not supported")
        if len(content) != size:
            raise BagError(f"a chunk states {size} bytes and has {len(content)}")
        if crc and crc32(content) != crc:
            raise BagError("the checksum of a chunk is wrong")
        return content

    # Records and bytes

    def _records(self, position: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Yield kind, position of the content and its length of the records of a part of the file."""
        while position < end:
            kind, start, length = self._record_at(position, end)
            yield kind, start, length
            position = start + length

    def _record_at(self, position: int, end: int) -> tuple[int, int, int]:
        if position + _RECORD_HEAD.size > end + _END_BYTES:
            raise BagError("a record is outside of the file")
        kind, length = _RECORD_HEAD.unpack(self._read(position, _RECORD_HEAD.size))
        start = position + _RECORD_HEAD.size
        if kind == 0:
            raise BagError(f"there is no record where one should be, at byte {position}")
        if start + length > end and kind != _FOOTER:
            raise BagError(f"a record at byte {position} states {size_text(length)}, the file is cut short")
        return kind, start, length

    def _content(self, position: int, length: int, what: str) -> bytes:
        check_size(f"a {what}", length, MOST_RECORD_BYTES)
        return self._read(position, length)

    def _read(self, position: int, length: int) -> bytes:
        self._file.seek(position)
        data = self._file.read(length)
        if len(data) != length:
            raise BagError(
                f"the file ends at byte {position + len(data)}, {length - len(data)} bytes too early"
            )
        return data


def _check_chunk(stored: int, size: int) -> None:
    check_size("a chunk", size, MOST_CHUNK_BYTES)
    check_size("the content of a chunk", stored, MOST_CHUNK_BYTES)


def _by_time(rows: array[int]) -> Iterator[list[int]]:
    """Yield rows of four numbers in the order of the first one, those of one time as they were."""
    table = np.frombuffer(rows, dtype=np.uint64).reshape(-1, 4) if rows else np.empty((0, 4), np.uint64)
    for index in np.argsort(table[:, 0], kind="stable"):
        yield table[index].tolist()


def _records_in(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield kind, position of the content and its length of the records of a chunk."""
    position, end = 0, len(content)
    while position < end:
        kind, length = _RECORD_HEAD.unpack_from(content, position)
        position += _RECORD_HEAD.size
        if position + length > end:
            raise BagError(f"a record of a chunk states {size_text(length)}, more than the chunk has")
        yield kind, position, length
        position += length


def _text(content: bytes, position: int) -> tuple[str, int]:
    """Return the text at a position, and the position after it."""
    (length,) = struct.unpack_from("<I", content, position)
    start = position + 4
    if start + length > len(content):
        raise BagError("a text is longer than its record")
    return content[start : start + length].decode(), start + length
