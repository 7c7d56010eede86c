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

"""Decompression with a limit: what unpacks to more than it may is refused before the memory is taken."""

from __future__ import annotations

import bz2
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]  # it has no types

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

from .errors import BagError
from .limits import (
    FREE_BYTES,
    MOST_FILE_FLOOR_BYTES,
    MOST_FILE_RATIO,
    MOST_MESSAGE_BYTES,
    check_size,
    check_unpacked,
    size_text,
)
from .regular_file import open_regular

# A stream is usually one frame; parallel packers write several. Each costs a copy of what follows it.
_MOST_FRAMES = 64
_BLOCK_BYTES = 2**20


def unpack_zstd(data: bytes, what: str, size: int | None = None) -> bytes:
    """Return the content of zstd frames.

    Args:
        data: The frames.
        what: What they are, for the error.
        size: Size it must have, already checked [bytes]; None where only a limit is known.

    Raises:
        BagError: It is too large, or of another size, or damaged.
    """
    if size is None:
        stated = zstd.get_frame_info(data).decompressed_size
        check_size(what, stated or 0, MOST_MESSAGE_BYTES)
    return _unpacked(zstd.ZstdDecompressor, data, what, size)


def unpack_lz4(data: bytes, what: str, size: int | None = None) -> bytes:
    """Return the content of lz4 frames; see :func:`unpack_zstd`."""
    return _unpacked(lz4.frame.LZ4FrameDecompressor, data, what, size)


def unpack_bz2(data: bytes, what: str, size: int | None = None) -> bytes:
    """Return the content of bz2 streams; see :func:`unpack_zstd`."""
    return _unpacked(bz2.BZ2Decompressor, data, what, size)


def unpack_file(path: Path, target: Path) -> None:
    """Unpack a file of zstd to another.

    Args:
        path: The packed file.
        target: Where the content is written.

    Raises:
        BagError: It is too large for a recording or for the disk, or damaged.
        OSError: It cannot be read or written.
    """
    with open_regular(path) as packed:
        n_bytes = path.stat().st_size
        most = max(MOST_FILE_FLOOR_BYTES, MOST_FILE_RATIO * n_bytes)
        head = packed.read(_BLOCK_BYTES)
        packed.seek(0)
        stated = zstd.get_frame_info(head).decompressed_size or 0
        check_size(f"{path.name} ({size_text(n_bytes)})", stated, most)
        free = shutil.disk_usage(target.parent).free - FREE_BYTES
        if stated > free:
            raise BagError(_no_space(path, target, stated, free))
        written = 0
        with zstd.open(packed, "rb") as content, target.open("wb") as file:
            while block := content.read(_BLOCK_BYTES):
                written += len(block)
                check_unpacked(f"{path.name} ({size_text(n_bytes)})", written, most)
                if written > free:
                    raise BagError(_no_space(path, target, written, free))
                file.write(block)


def _unpacked(make: Callable[[], Any], data: bytes, what: str, size: int | None) -> bytes:
    limit = MOST_MESSAGE_BYTES if size is None else size
    parts: list[bytes] = []
    n_bytes = 0
    for _ in range(_MOST_FRAMES):
        unpacker = make()
        # One byte more than allowed tells that there is more.
        part = unpacker.decompress(data, max_length=limit - n_bytes + 1)
        parts.append(part)
        n_bytes += len(part)
        if n_bytes > limit and size is None:
            check_unpacked(what, n_bytes, limit)
        if n_bytes > limit:
            raise BagError(f"{what} states {limit} bytes and has more")
        if not unpacker.eof:
            raise BagError(f"{what} is cut short")
        data = unpacker.unused_data or b""
        if not data:
            break
    else:
        raise BagError(f"{what} has more than {_MOST_FRAMES} frames")
    if size is not None and n_bytes != size:
        raise BagError(f"{what} states {size} bytes and has {n_bytes}")
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _no_space(path: Path, target: Path, needed: int, free: int) -> str:
    return (
        f"{path.name} needs {size_text(needed)} to be unpacked, {target.parent} has "
        f"{size_text(max(free, 0))} to spare: set TMPDIR to a folder with more"
    )
