"""One bag of a recording, opened by rosbags. Each error message is one line."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from .errors import BagError
from .order import natural_key
from .topics import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, Topic

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

# Storage files that are a recording by themselves, without a folder and its metadata.yaml.
_STORAGE_SUFFIXES = (".mcap", ".db3")
_SUFFIXES = (*_STORAGE_SUFFIXES, ".bag")

# Types of the messages that are read, and of their parts. None has changed since the first ROS 2.
_MESSAGE_TYPES = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO)
_PART_TYPES = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/RegionOfInterest")

_COMPRESSED_SUFFIX = ".zstd"

# Messages of rosbags, and the remedy for each.
_REPAIR = "if it was cut off, 'ros2 bag reindex', 'mcap recover' or 'rosbag reindex' may save it"
_REMEDIES = {
    "Profile is not ros2": "an MCAP file of another system: record it with ROS 2, or convert it",
    "Compression format": "'ros2 bag convert' writes it anew with zstd, or without compression",
    "Storage plugin": "'ros2 bag convert' writes it anew as mcap or sqlite3",
    "Serialization format": "'ros2 bag convert' writes it anew in cdr",
    "not supported; please report": "a newer version of rosbags may read it",
    "its definition of": "record it with the messages of ROS",
    "files are missing": "put them beside metadata.yaml, or 'ros2 bag reindex' writes that anew",
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

    Raises:
        BagError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._damage_reported():
            # Recordings older than ROS 2 Iron carry no message definitions; these types never changed.
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            self._reader.open()
            _sort_by_time(self._reader)
            self.connections = list(self._reader.connections)
            self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time
            self._check_definitions()

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

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
        connections = [c for c in self.connections if (c.topic, c.msgtype) in wanted]
        if not connections:
            return
        with self._damage_reported():
            messages = self._reader.messages(connections=connections, start=start_ns, stop=stop_ns)
        while True:
            with self._damage_reported():
                item: tuple[Connection, int, bytes] | None = next(messages, None)
                if item is None:
                    return
                content = self._reader.deserialize(item[2], item[0].msgtype)
            yield Message(item[1], item[0].topic, content)

    def _check_definitions(self) -> None:
        """Refuse a recording with other definitions of the types that are read: it would be misread."""
        ours = get_typestore(Stores.ROS2_JAZZY).fielddefs
        theirs = self._reader.typestore.fielddefs
        for msgtype in (*_MESSAGE_TYPES, *_PART_TYPES):
            if msgtype not in theirs:
                continue
            fields = dict(theirs[msgtype][1])
            for name, kind in ours[msgtype][1]:
                # ROS 1 has a field more in Header, and D, K, R, P in capitals.
                if fields.get(name.upper() if len(name) == 1 and name not in fields else name) != kind:
                    raise BagError(f"its definition of {msgtype} has another field than {name}")

    @contextmanager
    def _damage_reported(self) -> Iterator[None]:
        """Translate the exceptions of rosbags for a damaged file into one line."""
        try:
            yield
        except Exception as error:  # struct.error, apsw.Error, ZstdError, AssertionError, ... by the damage
            detail = (" ".join(str(error).split()) or type(error).__name__).rstrip(".")
            remedy = next((text for sign, text in _REMEDIES.items() if sign in detail), _REPAIR)
            raise BagError(f"{self.path}: cannot be read as a recording ({detail}); {remedy}") from error


def _sort_by_time(reader: AnyReader) -> None:
    """Put the storage files of a recording in the order of time.

    rosbags reads them as metadata.yaml lists them, which may be the order of letters (10 before 2).
    """
    for each in reader.readers:
        storages = getattr(getattr(each, "storage", each), "storages", [])
        storages.sort(key=lambda storage: storage.metadata.start_time)


def recordings_at(path: Path) -> list[Path]:
    """Return what rosbags has to open for ``path``: a folder with metadata.yaml, or files.

    Raises:
        BagError: There is no recording.
    """
    if not path.exists():
        raise BagError(f"{path}: no such file or folder; {_GIVE}")
    if path.is_file():
        if path.suffix == _COMPRESSED_SUFFIX:
            raise BagError(f"{path}: {_unpack(path)}")
        if path.suffix not in _SUFFIXES:
            raise BagError(f"{path}: not a recording; {_GIVE}")
        return [path]
    if (path / "metadata.yaml").exists():
        return [path]
    # A recorder that was killed leaves its storage files without metadata.yaml.
    entries = sorted(path.iterdir(), key=lambda file: natural_key(file.name))
    files = [file for file in entries if file.suffix in _SUFFIXES]
    packed = [file for file in entries if file.suffix == _COMPRESSED_SUFFIX]
    if packed:
        raise BagError(f"{path}: there is no metadata.yaml, and {packed[0].name} {_unpack(packed[0])}")
    if not files:
        raise BagError(
            f"{path}: not a recording (a folder without metadata.yaml and without storage files); {_GIVE}; "
            "or a folder of image pairs, in left and right or the folders of --left and --right"
        )
    return files


def _unpack(path: Path) -> str:
    return f"is compressed as a file: give its folder with metadata.yaml, or unpack it: zstd -d {path.name}"
