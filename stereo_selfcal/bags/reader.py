"""Stereo frames of a recording, one after the other: the same pairing and conversion as in the node."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from ..core.errors import ImageError, RigError
from ..core.images import message_to_grey
from ..core.pairing import StampedPair, StampPairer, message_stamp_ns, stamp_to_s
from ..core.rig import StereoRig
from .errors import BagError
from .topics import CAMERA_INFO, StereoTopics, Topic, find_stereo_topics

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

# Storage files that are a recording by themselves, without a folder and its metadata.yaml.
_STORAGE_SUFFIXES = (".mcap", ".db3")
_SUFFIXES = (*_STORAGE_SUFFIXES, ".bag")

# Images of one camera that may be recorded ahead of the other's; more than the node keeps, as a
# recorder writes topics in bursts. It bounds the memory.
_QUEUE_SIZE = 30


@dataclass(frozen=True, slots=True, eq=False)
class StereoFrame:
    """One pair of images.

    Attributes:
        stamp_s: Header stamp of the left image [s].
        left: (H, W) uint8 grey image of the left camera.
        right: The same of the right camera.
    """

    stamp_s: float
    left: npt.NDArray[np.uint8]
    right: npt.NDArray[np.uint8]


class StereoBag:
    """The stereo camera of one recording; use it in a ``with`` statement.

    Images are read, paired and converted one by one, so memory does not grow with the recording.

    Attributes:
        path: The recording.
        topics: The image topics of the two cameras.
    """

    def __init__(
        self,
        path: Path | str,
        left: str | None = None,
        right: str | None = None,
        tolerance_s: float = 0.0,
    ) -> None:
        """Open a recording and find its cameras.

        Args:
            path: A rosbag2 folder, a single .mcap or .db3 file, or a ROS 1 .bag.
            left: Image topic of the left camera, None to find it.
            right: Image topic of the right camera, None to find it.
            tolerance_s: Greatest difference of the header stamps of a pair [s]; 0 means equal stamps.

        Raises:
            BagError: The recording cannot be read or has no unambiguous stereo pair.
        """
        self.path = Path(path)
        self._tolerance_s = tolerance_s
        target = _recording(self.path)
        with self._damage_reported():
            # Recordings older than ROS 2 Iron carry no message definitions; these types never changed.
            self._reader = AnyReader([target], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            self._reader.open()
        try:
            self.topics = self._find_topics(left, right)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> StereoBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    @property
    def n_frames(self) -> int:
        """The most frames there can be: messages on the sparser image topic."""
        return min(self.topics.left.count, self.topics.right.count)

    def read_rig(self) -> StereoRig:
        """Return the rig from the first CameraInfo of each camera.

        Raises:
            BagError: A CameraInfo is missing, or does not describe a rectified pair.
        """
        left, right = (self._first_info(topic) for topic in (self.topics.left, self.topics.right))
        try:
            return StereoRig.from_camera_info(left, right)
        except RigError as error:
            raise BagError(
                f"{self.path}: {error} (topics {self.topics.left.camera_info} and "
                f"{self.topics.right.camera_info}, or give --rig)"
            ) from error

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the paired images in the order of the recording.

        Raises:
            BagError: The recording is damaged, an image cannot be converted, or no images pair.
        """
        # One tolerance is enough to say both: zero asks for equal stamps.
        pairer: StampPairer[Any] = StampPairer(self._tolerance_s > 0, self._tolerance_s, _QUEUE_SIZE)
        for name, message in self._messages(self.topics.left, self.topics.right):
            add = pairer.add_left if name == self.topics.left.name else pairer.add_right
            for pair in add(message_stamp_ns(message), message):
                yield self._frame(pair)
        for pair in pairer.flush():
            yield self._frame(pair)
        counts = pairer.counts
        if counts.pairs == 0:
            nearest = "none" if pairer.nearest_s is None else f"{pairer.nearest_s:.6f} s"
            raise BagError(
                f"{self.path}: no pair of images among {counts.left} on {self.topics.left.name} and "
                f"{counts.right} on {self.topics.right.name}: nearest difference of their header stamps "
                f"{nearest}, allowed {self._tolerance_s:g} s; see --approximate-sync-tolerance"
            )

    def _frame(self, pair: StampedPair[Any]) -> StereoFrame:
        return StereoFrame(
            stamp_to_s(pair.stamp_ns),
            self._grey(self.topics.left, pair.left),
            self._grey(self.topics.right, pair.right),
        )

    def _find_topics(self, left: str | None, right: str | None) -> StereoTopics:
        topics: dict[tuple[str, str], int] = {}
        for connection in self._reader.connections:  # a topic may have several publishers
            key = (connection.topic, connection.msgtype)
            topics[key] = topics.get(key, 0) + connection.msgcount
        try:
            return find_stereo_topics((Topic(*key, count) for key, count in topics.items()), left, right)
        except BagError as error:
            raise BagError(f"{self.path}: {error}") from error

    def _first_info(self, topic: Topic) -> Any:
        """Return the first CameraInfo of the camera that publishes ``topic``."""
        info = Topic(topic.camera_info, CAMERA_INFO, 0)
        for _, message in self._messages(info):
            return message
        present = sorted({c.topic for c in self._reader.connections if c.msgtype == CAMERA_INFO})
        raise BagError(
            f"{self.path}: no CameraInfo on {info.name} for {topic.name}; "
            f"CameraInfo topics: {', '.join(present) or 'none'}; give the rig with --rig"
        )

    def _messages(self, *topics: Topic) -> Iterator[tuple[str, Any]]:
        """Yield (topic name, message) in the order of the recording."""
        wanted = {(topic.name, topic.msgtype) for topic in topics}
        connections = [c for c in self._reader.connections if (c.topic, c.msgtype) in wanted]
        if not connections:
            return
        with self._damage_reported():
            messages = self._reader.messages(connections=connections)
        while True:
            with self._damage_reported():
                item: tuple[Connection, int, bytes] | None = next(messages, None)
                if item is None:
                    return
                message = self._reader.deserialize(item[2], item[0].msgtype)
            yield item[0].topic, message

    def _grey(self, topic: Topic, message: Any) -> npt.NDArray[np.uint8]:
        try:
            return message_to_grey(message)
        except ImageError as error:
            stamp_s = stamp_to_s(message_stamp_ns(message))
            raise BagError(f"{self.path}: {topic.name} at {stamp_s:.3f} s: {error}") from error

    @contextmanager
    def _damage_reported(self) -> Iterator[None]:
        """Translate whatever rosbags raises on a damaged file into one line."""
        try:
            yield
        except Exception as error:  # struct.error, apsw.Error, ZstdError, AssertionError, ... by the damage
            detail = " ".join(str(error).split()) or type(error).__name__
            raise BagError(
                f"{self.path}: cannot be read as a recording ({detail.rstrip('.')}); if it was cut off, "
                "'ros2 bag reindex', 'mcap recover' or 'rosbag reindex' may save it"
            ) from error


def _recording(path: Path) -> Path:
    """Return what rosbags has to open for ``path``: a folder with metadata.yaml, or one file."""
    if not path.exists():
        raise BagError(
            f"{path}: no such file or folder; give a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag"
        )
    if path.is_file():
        if path.suffix not in _SUFFIXES:
            raise BagError(
                f"{path}: not a recording; give a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag"
            )
        return path
    if (path / "metadata.yaml").exists():
        return path
    # A recorder that was killed leaves its storage file without metadata.yaml.
    files = [file for file in sorted(path.iterdir()) if file.suffix in _STORAGE_SUFFIXES]
    if len(files) != 1:
        raise BagError(
            f"{path}: not a recording (a folder without metadata.yaml and with {len(files)} storage files); "
            "give a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag"
        )
    return files[0]
