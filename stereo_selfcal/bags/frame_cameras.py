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

"""The cameras of every frame of a recording, by the CameraInfo that is recorded beside the images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..core.camera.camera_difference import check_steady, find_differences, values_text
from ..core.camera.camera_info import CameraInfoError, CameraModel, InfoReason, content_of, is_uncalibrated
from ..core.camera.camera_info_checks import check_claim
from ..core.camera.camera_info_history import CameraInfoHistory
from ..core.camera.rectifier import StereoRectifier
from ..core.errors import RigError, printable
from .errors import BagError
from .part import Message
from .topics import Topic

# A CameraInfo may be recorded later than its image by so much: recorders write topics in bursts.
LATE_NS = 1_000_000_000
# A CameraInfo may be recorded earlier than its image by so much; as long as images wait for a partner.
_KEEP_NS = 5_000_000_000
# The last CameraInfo before a stretch is looked for in windows that grow by this factor, the nearest first.
_GROWTH = 8

_DECLARED = (
    "the images are taken as rectified, as --rectified says, although neither the names of their topics nor "
    "their CameraInfo say so: if they are raw, the pose is wrong"
)

# Reads the messages on one topic: start and stop [ns], None for all.
Read = Callable[[Topic, "int | None", "int | None"], Iterator[Message]]


class FrameCameras:
    """The cameras of the frames, from the CameraInfo of each.

    Args:
        name: The recording, for messages.
        bags: Its bags, each with what reads the messages of that bag alone.
        read: Reads the messages of all of them in the order of time.
        images: Names of the image topics of the left and of the right camera.
        topics: Their CameraInfo topics.
        rectified: Whether the images are rectified; False: they are raw.
        others: Topics with images of other cameras, where nobody has named the pair.
        declared: Whether the user says that the images are rectified, whatever their topics are called.

    Attributes:
        topics: The CameraInfo topics.
        first: The cameras of the first frame.
        remarks: Sentences about the CameraInfo.

    Raises:
        BagError: A CameraInfo is missing or cannot be right, or the bags are of different rigs.
    """

    def __init__(
        self,
        name: str,
        bags: Sequence[tuple[Path, Read]],
        read: Read,
        images: tuple[str, str],
        topics: tuple[Topic, Topic],
        rectified: bool,
        others: Sequence[str] = (),
        declared: bool = False,
    ) -> None:
        self._others, self._declared = others, declared
        self._name, self._read, self._images, self._rectified = name, read, images, rectified
        self.topics = topics
        self.remarks: tuple[str, ...] = ()
        self._last: tuple[tuple[bytes | None, bytes | None], StereoRectifier] | None = None
        self._first = self._first_calibrated(bags)
        self.first = self.cameras_of(self.first_infos)

    @property
    def first_infos(self) -> tuple[Any, Any]:
        """The first calibrated CameraInfo of both cameras."""
        return self._first[0].content, self._first[1].content

    def at_start(self, start_ns: int | None) -> StereoRectifier:
        """Return the cameras of the first frame from a time on; the first ones where those cannot be used.

        Args:
            start_ns: The time [ns], None for the beginning of the recording.
        """
        left, right = self.histories(start_ns)
        try:
            return self.cameras_of((left.last or self.first_infos[0], right.last or self.first_infos[1]))
        except BagError:  # it is a matter of these frames, each of which is refused
            return self.first

    def add(self, histories: Sequence[CameraInfoHistory], message: Message) -> None:
        """Add a CameraInfo to the history of its camera, unless it is from before the first calibrated one.

        Args:
            histories: Those of the left and of the right camera.
            message: The message; both cameras may share one topic.

        Raises:
            CameraInfoError: The messages of a topic alternate.
        """
        cameras = zip(("left", "right"), histories, self.topics, self._first, strict=True)
        for side, history, topic, first in cameras:
            if topic.name == message.topic and message.recorded_ns >= first.recorded_ns:
                history.add(message.content, message.recorded_ns)
                check_steady(history, topic.name, side, self._rectified)

    def histories(self, start_ns: int | None) -> tuple[CameraInfoHistory, CameraInfoHistory]:
        """Return the CameraInfo of both cameras up to a time, to go on from there.

        Args:
            start_ns: The time [ns], None for the beginning of the recording.
        """
        made = []
        for topic, first in zip(self.topics, self._first, strict=True):
            history = CameraInfoHistory(_KEEP_NS, self._rectified, calibrated=True)
            before = None if start_ns is None else self._last_before(topic, start_ns, first.recorded_ns)
            if before is not None:
                history.add(before.content, before.recorded_ns)
            made.append(history)
        return made[0], made[1]

    def infos_at(
        self, histories: Sequence[CameraInfoHistory], stamps_ns: tuple[int, int], recorded_ns: tuple[int, int]
    ) -> tuple[Any, Any]:
        """Return the CameraInfo that hold for both images of a pair.

        Args:
            histories: CameraInfo that was recorded up to a second after the pair.
            stamps_ns: Stamps of the left and of the right image [ns].
            recorded_ns: When they were recorded [ns].
        """
        left, right = (
            history.at(stamp_ns, at_ns) or first.content
            for history, stamp_ns, at_ns, first in zip(
                histories, stamps_ns, recorded_ns, self._first, strict=True
            )
        )
        return left, right

    def cameras_of(self, infos: tuple[Any, Any]) -> StereoRectifier:
        """Return the cameras of two CameraInfo; the same object where nothing has changed.

        Raises:
            BagError: They cannot be right, or the images are not what they are said to be.
        """
        contents = content_of(infos[0]), content_of(infos[1])
        if self._last is not None and None not in contents and contents == self._last[0]:
            return self._last[1]
        try:
            cameras = StereoRectifier.from_camera_info(*infos, self._rectified)
            if cameras.cameras is not None:
                remedy = (
                    "give --raw, or --rectified if they are rectified after all"
                    if self._rectified
                    else "leave out --raw"
                )
                try:
                    check_claim(cameras.cameras, self._images, self._rectified, remedy)
                except CameraInfoError as error:
                    if not self._declared or error.reason is not InfoReason.NOT_RECTIFIED:
                        raise
                    self._add_remark(_DECLARED)
        except RigError as error:
            named = "--rectified" in str(error) or not self._rectified
            otherwise = "" if named else ", or give --rig"
            if getattr(error, "reason", None) is InfoReason.BASELINE_ZERO and self._others:
                otherwise += (
                    f"; if other cameras are the stereo pair, choose them with --left and --right: "
                    f"{', '.join(map(printable, self._others))}"
                )
            left, right = self.topics
            raise BagError(
                f"{self._name}: {error} (topics {left.name} and {right.name}{otherwise})"
            ) from error
        if self._last is not None and cameras == self._last[1]:
            cameras = self._last[1]
        self._last = contents, cameras
        return cameras

    def _add_remark(self, remark: str) -> None:
        self.remarks = tuple(dict.fromkeys((*self.remarks, remark)))

    def _first_calibrated(self, bags: Sequence[tuple[Path, Read]]) -> tuple[Message, Message]:
        """Return the first calibrated CameraInfo of both cameras, and compare those of the bags."""
        found = []
        for topic, side in zip(self.topics, ("left", "right"), strict=True):
            firsts: list[tuple[Path, Message]] = []
            uncalibrated: list[int] = []
            fallback: Message | None = None
            for path, read in bags:
                for message in read(topic, None, None):
                    if not is_uncalibrated(message.content):
                        firsts.append((path, message))
                        break
                    uncalibrated.append(message.recorded_ns)
                    fallback = fallback or message
            self._compare(firsts, side)
            first = min((message for _, message in firsts), key=lambda m: m.recorded_ns, default=fallback)
            if first is None:
                raise BagError(f"{self._name}: there is no message on {topic.name}; give the rig with --rig")
            skipped = sum(at_ns < first.recorded_ns for at_ns in uncalibrated)
            if firsts and skipped:
                self.remarks += (
                    f"the first {skipped} CameraInfo on {topic.name} are uncalibrated (all zero) and were "
                    "skipped: frames from then are taken with the first calibrated one",
                )
            found.append(first)
        return found[0], found[1]

    def _compare(self, firsts: Sequence[tuple[Path, Message]], side: str) -> None:
        """Refuse bags that are of different cameras.

        Raises:
            BagError: Two of them are.
        """
        models = []
        for path, message in firsts:
            try:
                models.append((path, CameraModel.read(message.content, side, self._rectified)))
            except RigError:  # reported with its frames
                continue
        for path, model in models[1:]:
            if model.used != models[0][1].used:
                differences = find_differences([models[0][1]], [model])
                raise BagError(
                    f"the bags are of different rigs: by CameraInfo {models[0][0]} has "
                    f"{values_text(differences, after=False)}, {path} has "
                    f"{values_text(differences, after=True)}; calibrate each alone"
                    f"{', or give the rig of all with --rig' if self._rectified else ''}"
                )

    def _last_before(self, topic: Topic, start_ns: int, first_ns: int) -> Message | None:
        """Return the last CameraInfo recorded before a time, None where that is uncalibrated yet."""
        stop_ns, length_ns = start_ns, _KEEP_NS
        while stop_ns > first_ns:
            window = self._read(topic, max(stop_ns - length_ns, first_ns), stop_ns)
            last = deque(window, maxlen=1)
            if last:
                return last[0]
            stop_ns, length_ns = stop_ns - length_ns, length_ns * _GROWTH
        return None
