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

"""Frames from bags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ..bags import BagError, Selection, StereoBag, StereoFrame
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.camera.rig_checks import Finding
from .camera_files import cameras_of_files, check_topics, turn_note
from .recording import FrameSource


class BagSource(FrameSource):
    """The stereo camera of one or several bags, which are one recording in the order of time.

    Args:
        paths: The bags, as :class:`~stereo_selfcal.bags.StereoBag` takes them.
        left: Image topic of the left camera, None to find it.
        right: Image topic of the right camera, None to find it.
        tolerance_s: Greatest difference of the header stamps of a pair [s]; 0 means equal stamps.
        rig: The rig, None for that of the CameraInfo topics.
        selection: Which frames are used, None for all.
        raw: Whether the images are raw: they are undistorted and rectified with their CameraInfo.
        left_info: CameraInfo topic of the left camera, None to find it.
        right_info: The same of the right camera.
        rectified: Whether the images are rectified whatever their topics are called.
        camera_info: CameraInfo files of the left and of the right camera, in place of the topics.
        odometry: Topic of nav_msgs/Odometry that says how the car turns, None for none.
        imu: The same of sensor_msgs/Imu.

    Raises:
        BagError: A bag cannot be read, or there is no unambiguous stereo pair or no rig.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        left: str | None = None,
        right: str | None = None,
        tolerance_s: float = 0.0,
        rig: StereoRig | None = None,
        selection: Selection | None = None,
        raw: bool = False,
        left_info: str | None = None,
        right_info: str | None = None,
        rectified: bool = False,
        camera_info: tuple[Path, Path] | None = None,
        odometry: str | None = None,
        imu: str | None = None,
    ) -> None:
        named = [
            option
            for option, given in (
                ("--rig", rig),
                ("--camera-info", camera_info),
                ("the CameraInfo topics", left_info or right_info),
            )
            if given is not None
        ]
        if len(named) > 1:
            raise BagError(f"the rig is given by {' and by '.join(named)}: leave one of them")
        if raw and rig is not None:
            raise BagError(
                "a rig file describes rectified cameras: K, D, R and P of raw ones come from CameraInfo; "
                "leave out --rig or --raw"
            )
        self._bag = StereoBag(paths, left, right, tolerance_s, raw, left_info, right_info, odometry, imu)
        try:
            topics = self._bag.topics
            self.name = " ".join(path.resolve().name for path in paths)
            self.left_name, self.right_name = topics.left.name, topics.right.name
            self.turn_topics = self._bag.turn_topics
            self.n_images = topics.left.count, topics.right.count
            self.start_ns = self._bag.start_ns
            self._doubts: dict[Finding, None] = {}
            self._given: StereoRectifier | None = None
            if camera_info is not None:
                self._given = cameras = cameras_of_files(camera_info, raw)
                names = self.left_name, self.right_name
                check_topics(cameras, camera_info, names, raw, rectified)
                rig = cameras.rig
            elif rig is None:
                cameras = self._bag.follow_cameras(not raw, selection, rectified)
                rig = cameras.rig
            else:
                cameras = StereoRectifier.of_rig(rig)
            self._note(cameras)
            self.notes = turn_note(cameras)
            self.rig = rig
            self._bag.rig_size = rig.width, rig.height
            self.selection = selection or Selection()
        except BaseException:
            self.close()
            raise

    @property
    def length_s(self) -> float:
        """Duration of the recording, from its first message to its last [s]."""
        return (self._bag.end_ns - self._bag.start_ns) * 1e-9

    @property
    def any_repeated(self) -> bool:
        """Whether one of the images read so far was there twice."""
        return self._bag.any_repeated

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about files, CameraInfo and bits of the frames so far, and images in no frame."""
        depth = (self._bag.depth.remark,) if self._bag.depth.remark else ()
        doubts = (doubt.message for doubt in self._doubts)
        return (*self._bag.file_remarks, *doubts, *self._bag.info_remarks, *depth, *self._bag.remarks)

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in the order of the recording."""
        for recorded in self._bag.frames(self.selection):
            frame = self._seen(recorded)
            self._note(frame.cameras)
            yield frame

    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again."""
        return self._seen(self._bag.frame_at(recorded_ns))

    def _seen(self, frame: StereoFrame) -> StereoFrame:
        """Return a frame as the cameras of the CameraInfo files see it, if there are any."""
        return frame if self._given is None else frame.seen_by(self._given)

    def _note(self, cameras: StereoRectifier | None) -> None:
        """Remember what is unusual about the cameras of a frame."""
        if cameras is not None:
            self._doubts |= dict.fromkeys(cameras.doubts)

    def close(self) -> None:
        """Close the bags."""
        self._bag.close()
