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

"""An MCAP file that is whole or not there at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from ..files.atomic_file import cannot_be_written, sync_folder
from ..files.writable import check_absent
from . import SUFFIX
from .messages import STORE, serialize
from .topics import RecordingTopic

_METADATA_VERSION: Literal[9] = 9  # of ROS 2 Jazzy


class McapFile:
    """Takes the messages of a recording, which are written in pieces of a megabyte.

    Args:
        writer: The open writer of rosbags.
        topics: All topics; one without a message is there all the same.
    """

    def __init__(self, writer: Writer, topics: Iterable[RecordingTopic]) -> None:
        self._writer = writer
        self._connections: dict[RecordingTopic, Connection] = {
            topic: writer.add_connection(
                topic.name, topic.kind, typestore=STORE, offered_qos_profiles=[topic.qos]
            )
            for topic in topics
        }

    def add(self, topic: RecordingTopic, message: Any, recorded_ns: int) -> None:
        """Write a message.

        Args:
            topic: Its topic.
            message: The message.
            recorded_ns: Time at which a player sends it [ns].
        """
        self._writer.write(self._connections[topic], max(recorded_ns, 0), serialize(message, topic.kind))


@contextmanager
def new_mcap_file(path: Path, topics: Iterable[RecordingTopic]) -> Iterator[McapFile]:
    """Write a new recording beside its place, and move it there when it is complete.

    Args:
        path: The file; its folder must exist.
        topics: Its topics.

    Raises:
        OutputError: It exists already, or cannot be written. Nothing of it remains then.
    """
    check_absent(path)
    try:
        # rosbags writes a folder, in which the storage file has the name of the folder.
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".stereo_selfcal-") as folder:
            made = Path(folder, path.stem)
            writer = Writer(made, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            with writer:
                yield McapFile(writer, topics)
            file = made / f"{path.stem}{SUFFIX}"
            with file.open("rb") as written:
                os.fsync(written.fileno())  # before the rename, or a power cut leaves a name without content
            check_absent(path)
            file.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise cannot_be_written(path, error) from error
