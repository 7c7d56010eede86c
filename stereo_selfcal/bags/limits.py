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

"""How much of a recording is believed. Each limit is far above what recorders of cameras write.

A few kilobytes can state, or unpack to, any number of gigabytes. What is above a limit is refused with the
size it states, before the memory is taken.
"""

from __future__ import annotations

from .errors import TooLargeError

# A message, unpacked: the largest cameras on cars send 75 MB (25 megapixels in colour).
MOST_MESSAGE_BYTES = 2**27
# The chunks that are unpacked at one time, together. Recorders write chunks of 0.8 to 4 MB, or one message.
MOST_CHUNK_BYTES = 2**27
# A record that describes the recording: a topic, a type, the place of a chunk.
MOST_RECORD_BYTES = 2**22
# The definition of a message type: that of CameraInfo, the longest of those read, has 7 kB with comments.
MOST_DEFINITION_BYTES = 2**16
# metadata.yaml: of a recording of 10 000 files, it has 2.5 MB.
MOST_METADATA_BYTES = 2**22
# A storage file that is compressed as a whole is unpacked to the disk. Images compress to a third, at night
# to a tenth; small files may be drawings.
MOST_FILE_RATIO = 100
MOST_FILE_FLOOR_BYTES = 2**28
# Left free where a file is unpacked.
FREE_BYTES = 2**28
# A file of which less than this part is stored has holes; file systems that compress reach a tenth.
LEAST_STORED = 0.01
_SMALL_FILE_BYTES = 2**26


def size_text(n_bytes: int) -> str:
    """Return a number of bytes for people."""
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if n_bytes >= unit:
            return f"{n_bytes / unit:.1f} {name}"
    return f"{n_bytes} bytes"


def check_size(what: str, n_bytes: int, most_bytes: int) -> None:
    """Refuse what states too large a size.

    Args:
        what: What it is.
        n_bytes: The size it states.
        most_bytes: The limit.

    Raises:
        TooLargeError: It is above the limit.
    """
    if n_bytes > most_bytes:
        raise TooLargeError(
            f"{what} states {size_text(n_bytes)}, more than the {size_text(most_bytes)} that are read: "
            "it is damaged or made to do harm"
        )


def check_unpacked(what: str, n_bytes: int, most_bytes: int) -> None:
    """Refuse what unpacks to more than it may, and did not state so.

    Args:
        what: What it is.
        n_bytes: How much there is so far.
        most_bytes: The limit.

    Raises:
        TooLargeError: It is above the limit.
    """
    if n_bytes > most_bytes:
        raise TooLargeError(
            f"{what} unpacks to more than the {size_text(most_bytes)} that are read: it is damaged or made "
            "to do harm"
        )


def check_no_holes(n_bytes: int, stored_bytes: int) -> None:
    """Refuse a file that is nearly all hole: an interrupted copy, or made to look large.

    Args:
        n_bytes: Its length.
        stored_bytes: How many of these the file system stores; 0 where it does not say.

    Raises:
        TooLargeError: Nearly nothing of it is stored.
    """
    if n_bytes > _SMALL_FILE_BYTES and 0 < stored_bytes < LEAST_STORED * n_bytes:
        raise TooLargeError(
            f"it is {size_text(n_bytes)} long, but only {size_text(stored_bytes)} of it are stored, the "
            "others are holes: copy the recording again"
        )
