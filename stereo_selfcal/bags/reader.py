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

"""Stereo frames of a recording, one after the other: the same pairing and conversion as in the node."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from ..core.camera.bit_depth import BitDepth, Pixels
from ..core.camera.frozen import checksum
from ..core.camera.image_messages import message_to_grey
from ..core.camera.pairing import StampedPair, StampPairer, message_stamp_ns, stamp_to_s
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.errors import ImageError, RigError, printable
from .errors import BagError
from .found_pair import FoundPair, first_judged
from .frame import StereoFrame, readable
from .frame_cameras import LATE_NS, FrameCameras
from .part import Message, Part, open_bags
from .part_topics import baseline_reader, in_order, topics_of
from .remarks import remarks_on, unpaired_reason
from .selection import Selection
from .topics import StereoTopics, Topic, find_camera_info, find_stereo_pairs, find_stereo_topics, other_images
from .turns import TurnsBetweenFrames, find_turn_topics

# Images of one camera that may be recorded ahead of the other's; more than the node keeps, as a
# recorder writes topics in bursts. It bounds the memory.
_QUEUE_SIZE = 30
# Fewer of them wait where they are large: up to so many bytes of both cameras.
_QUEUE_BYTES = 2**29

# Margin around a stretch of a recording. With it, the images find the same partners as in the whole
# recording. A full queue at 10 Hz is shorter.
_MARGIN_NS = 4_000_000_000

# Places in a recording at which the depth of its 16-bit images is looked up: it may begin in the dark.
_LOOKS = 5


class StereoBag:
    """The stereo camera of one recording; use it in a ``with`` statement.

    Images are read, paired and converted one by one, so memory does not grow with the recording.

    Attributes:
        paths: The bags of the recording.
        topics: The image topics of the two cameras.
        remarks: Sentences about the images that are in no frame; complete when all images have been read.
        any_repeated: Whether one of the images read so far was there twice.
        depth: Bits of the images, where they have more than 8.
        rig_size: (width, height) of the images of the rig, None as long as it is not known; images far larger
            are not decoded.
    """

    def __init__(
        self,
        path: Path | str | Sequence[Path | str],
        left: str | None = None,
        right: str | None = None,
        tolerance_s: float = 0.0,
        raw: bool = False,
        left_info: str | None = None,
        right_info: str | None = None,
        odometry: str | None = None,
        imu: str | None = None,
    ) -> None:
        """Open a recording and find its cameras.

        Args:
            path: A rosbag2 folder, a single .mcap or .db3 file, or a ROS 1 .bag; or several of them, which
                are read as one recording in the order of time.
            left: Image topic of the left camera, None to find it.
            right: Image topic of the right camera, None to find it.
            tolerance_s: Greatest difference of the header stamps of a pair [s]; 0 means equal stamps.
            raw: Whether raw images are looked for, not rectified ones.
            left_info: CameraInfo topic of the left camera, None to find it.
            right_info: The same of the right camera.
            odometry: Topic of nav_msgs/Odometry, whose messages the frames have; None for none.
            imu: The same of sensor_msgs/Imu.

        Raises:
            BagError: The recording cannot be read or has no unambiguous stereo pair.
        """
        self.paths = tuple(Path(each) for each in ([path] if isinstance(path, str | Path) else path))
        self.remarks: tuple[str, ...] = ()
        self.depth = BitDepth(self._look_ahead, lasting=False)
        self.any_repeated = False
        self.rig_size: tuple[int, int] | None = None
        self._tolerance_s = tolerance_s
        self._info_names = left_info, right_info
        self._cameras: FrameCameras | None = None
        self._bags = open_bags(self.paths)
        self._parts = [part for _, parts in self._bags for part in parts]
        try:
            topics = topics_of(self._parts)
            self.topics = find_stereo_topics(topics, left, right, raw, baseline_reader(self._parts))
            self._turns = TurnsBetweenFrames(find_turn_topics(topics, odometry, imu))
            self._others = [] if left and right else other_images(topics, self.topics)
        except BagError as error:
            self.close()
            raise BagError("; ".join([f"{self._name}: {error}", *self.file_remarks])) from error

    def __enter__(self) -> StereoBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for part in self._parts:
            part.close()

    @property
    def n_frames(self) -> int:
        """The most frames there can be: messages on the sparser image topic."""
        return min(self.topics.left.count, self.topics.right.count)

    @property
    def turn_topics(self) -> tuple[str, ...]:
        """Names of the topics with turn rates that were asked for."""
        return tuple(topic.name for topic in self._turns.topics)

    @property
    def start_ns(self) -> int:
        """When the first message was recorded, of whatever topic [ns]; what a selection counts from."""
        return min(part.start_ns for part in self._parts)

    @property
    def end_ns(self) -> int:
        """When the last message was recorded [ns]."""
        return max(part.end_ns for part in self._parts)

    def read_rig(self) -> StereoRig:
        """Return the rig from the first calibrated CameraInfo of each camera.

        Raises:
            BagError: A CameraInfo is missing, or does not describe a rectified pair.
        """
        try:
            return StereoRig.from_camera_info(*self._frame_cameras(True).first_infos)
        except RigError as error:
            raise BagError(f"{self._name}: {error}") from error

    def follow_cameras(
        self, rectified: bool = True, selection: Selection | None = None, declared: bool = False
    ) -> StereoRectifier:
        """Rectify the frames that are read from now on, each by its own CameraInfo.

        Args:
            rectified: Whether the images are rectified; False: they are raw.
            selection: Which frames are going to be read.
            declared: Whether the user says that they are rectified, whatever their topics are called.

        Returns:
            The cameras at the start of the selection.

        Raises:
            BagError: A CameraInfo is missing, or cannot be right.
        """
        self._cameras = self._frame_cameras(rectified, declared)
        start_ns = 0 if selection is None else selection.start_ns
        return self._cameras.at_start(self.start_ns + start_ns if start_ns > 0 else None)

    @property
    def file_remarks(self) -> tuple[str, ...]:
        """Sentences about storage files that are not read."""
        return tuple(part.remark for part in self._parts if part.remark)

    @property
    def info_remarks(self) -> tuple[str, ...]:
        """Sentences about the CameraInfo that is followed."""
        return () if self._cameras is None else self._cameras.remarks

    def _frame_cameras(self, rectified: bool, declared: bool = False) -> FrameCameras:
        def read(
            parts: Sequence[Part], topic: Topic, start_ns: int | None, stop_ns: int | None
        ) -> Iterator[Message]:
            return in_order(parts, [topic], start_ns, stop_ns)

        images = self.topics.left, self.topics.right
        try:
            infos = find_camera_info(topics_of(self._parts), self.topics, *self._info_names)
        except BagError as error:
            raise BagError(f"{self._name}: {error}") from error
        return FrameCameras(
            self._name,
            [(path, partial(read, parts)) for path, parts in self._bags],
            partial(read, self._parts),
            (images[0].name, images[1].name),
            infos,
            rectified,
            self._others,
            declared,
        )

    def frames(self, selection: Selection | None = None) -> Iterator[StereoFrame]:
        """Yield the paired images in the order of the recording.

        Args:
            selection: Which ones, None for all.

        Raises:
            BagError: The recording is damaged, an image cannot be converted, or no images pair.
        """
        selection = selection or Selection()
        start_ns, end_ns = self.start_ns + selection.start_ns, selection.end_ns
        pairs = self._pairs(
            None if selection.start_ns <= 0 else start_ns - _MARGIN_NS,
            None if end_ns is None else self.start_ns + end_ns + _MARGIN_NS,
            turns=True,
        )
        chosen = selection.choose(
            first_judged(pairs), lambda found: found.pair.left.recorded_ns - self.start_ns
        )
        n_frames = 0
        for frame in readable(map(self._frame, chosen), self._name):
            n_frames += 1
            yield replace(frame, turns=self._turns.take())
        if n_frames == 0:
            raise BagError(selection.nothing_in(self._name, (self.end_ns - self.start_ns) * 1e-9))

    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again.

        Args:
            recorded_ns: Of the frame.

        Raises:
            BagError: There is none, or the recording is damaged.
        """
        for found in first_judged(self._pairs(recorded_ns - _MARGIN_NS, recorded_ns + _MARGIN_NS)):
            if found.pair.left.recorded_ns == recorded_ns:
                return self._frame(found)
        raise BagError(f"{self._name}: there is no frame recorded at {recorded_ns} ns")

    def _pairs(self, start_ns: int | None, stop_ns: int | None, turns: bool = False) -> Iterator[FoundPair]:
        self._largest = 0
        # One tolerance is enough to say both: zero asks for equal stamps.
        pairer: StampPairer[Message] = StampPairer(self._tolerance_s > 0, self._tolerance_s, _QUEUE_SIZE)
        topics = [self.topics.left, self.topics.right]
        topics += [] if self._cameras is None else self._cameras.topics
        topics += self._turns.topics if turns else ()
        messages = self._messages(topics, start_ns, stop_ns)
        if turns:
            messages = self._turns.taken_out(messages)
        if self._cameras is None:
            for message in messages:
                yield from (FoundPair(pair, None) for pair in self._add(pairer, message))
            yield from (FoundPair(pair, None) for pair in pairer.flush())
        else:
            yield from self._with_infos(self._cameras, pairer, messages, start_ns)
        counts = pairer.counts
        self.any_repeated |= counts.repeated_left + counts.repeated_right > 0
        if start_ns is None and stop_ns is None:
            said = self.topics.left.count, self.topics.right.count
            self.remarks = remarks_on(counts, said)
        if counts.pairs == 0 and counts.left + counts.right > 0:
            raise BagError(
                f"{self._name}: no pair of images among {counts.left} on {self.topics.left.name} and "
                f"{counts.right} on {self.topics.right.name}, at most {self._tolerance_s:g} s apart: "
                f"{unpaired_reason(pairer.pattern, _QUEUE_SIZE)}"
            )

    def _add(self, pairer: StampPairer[Message], message: Message) -> list[StampedPair[Message]]:
        n_bytes = len(message.content.data)
        if n_bytes > self._largest:
            self._largest = n_bytes
            most = max(1, min(_QUEUE_SIZE, _QUEUE_BYTES // (2 * n_bytes)))
            pairer.configure(self._tolerance_s > 0, self._tolerance_s, most)
        add = pairer.add_left if message.topic == self.topics.left.name else pairer.add_right
        return add(message_stamp_ns(message.content), message, checksum(message.content))

    def _with_infos(
        self,
        cameras: FrameCameras,
        pairer: StampPairer[Message],
        messages: Iterator[Message],
        start_ns: int | None,
    ) -> Iterator[FoundPair]:
        """Yield pairs with their CameraInfo, which may be recorded a little later than they are."""
        histories = cameras.histories(start_ns)
        waiting: deque[StampedPair[Message]] = deque()

        def found(pair: StampedPair[Message]) -> FoundPair:
            both = pair.left.recorded_ns, pair.right.recorded_ns
            return FoundPair(
                pair, cameras.infos_at(histories, (pair.left_stamp_ns, pair.right_stamp_ns), both)
            )

        def is_ready(pair: StampedPair[Message], now_ns: int) -> bool:
            if len(waiting) > _QUEUE_SIZE or now_ns > pair.right.recorded_ns + LATE_NS:
                return True
            return histories[0].has(pair.left_stamp_ns) and histories[1].has(pair.right_stamp_ns)

        for message in messages:
            if message.topic not in (self.topics.left.name, self.topics.right.name):
                cameras.add(histories, message)
            else:
                waiting.extend(self._add(pairer, message))
            while waiting and is_ready(waiting[0], message.recorded_ns):
                yield found(waiting.popleft())
        waiting.extend(pairer.flush())
        yield from map(found, waiting)

    def _frame(self, found: FoundPair) -> StereoFrame:
        pair = found.pair
        frame = StereoFrame.from_images(
            stamp_to_s(pair.stamp_ns),
            lambda: self._grey(self.topics.left, pair.left.content),
            lambda: self._grey(self.topics.right, pair.right.content),
            self.depth,
            pair.left.recorded_ns,
            frozen=pair.frozen,
        )
        frame = replace(frame, stamp_difference_s=pair.difference_s)
        if self._cameras is None or found.infos is None:
            return frame
        try:
            return frame.seen_by(self._cameras.cameras_of(found.infos))
        except BagError as error:
            return replace(frame, rig_problem=str(error))

    def _grey(self, topic: Topic, message: Any) -> Pixels:
        try:
            return message_to_grey(message, self.rig_size)
        except ImageError as error:
            stamp_s = stamp_to_s(message_stamp_ns(message))
            raise ImageError(printable(f"{topic.name} at {stamp_s:.3f} s: {error}")) from error

    def _look_ahead(self) -> Iterator[Pixels]:
        """Yield an image of each camera at some places of the recording; what cannot be read is left out."""
        for place in range(_LOOKS):
            start_ns = self.start_ns + (self.end_ns - self.start_ns) * place // _LOOKS
            for topic in (self.topics.left, self.topics.right):
                with suppress(BagError, ImageError):
                    for message in self._messages([topic], start_ns):
                        yield message_to_grey(message.content, self.rig_size)
                        break

    @property
    def _name(self) -> str:
        return _name(self.paths)

    def _messages(
        self, topics: Collection[Topic], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Message]:
        return in_order(self._parts, topics, start_ns, stop_ns)


def stereo_pairs(paths: Sequence[Path], raw: bool = False) -> list[StereoTopics]:
    """Return the topics of all stereo cameras of a recording, ordered by their names.

    Args:
        paths: Its bags.
        raw: Whether raw images are looked for, not rectified ones.

    Raises:
        BagError: A bag cannot be read, or there is no stereo pair.
    """
    parts = [part for _, each in open_bags(paths) for part in each]
    try:
        return find_stereo_pairs(topics_of(parts), raw, baseline_reader(parts))
    except BagError as error:
        raise BagError(f"{_name(paths)}: {error}") from error
    finally:
        for part in parts:
            part.close()


def _name(paths: Sequence[Path]) -> str:
    """Return a recording in an error text."""
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    return f"{paths[0]}{more}"
