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

"""Frames from a folder of image pairs: ``left/NAME.png`` beside ``right/NAME.png``, without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from filecmp import cmp
from pathlib import Path

from ..bags import BagError, Selection, StereoFrame, open_regular, readable
from ..bags.order import natural_key
from ..core.camera.bit_depth import BitDepth, Pixels
from ..core.camera.frozen import FrozenImage
from ..core.camera.image_header import most_pixels
from ..core.camera.image_messages import decode_compressed
from ..core.camera.pairing import stamp_to_s
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.errors import ImageError, printable
from .camera_files import turn_note
from .image_stamps import image_stamps
from .recording import FrameSource

DEFAULT_FOLDERS = ("left", "right")
# Formats in which cameras are recorded, and which OpenCV decodes.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")

_NS_PER_S = 1_000_000_000
_SHOWN = 3  # names of each folder, where none is in both
# Places in a recording at which the depth of its 16-bit images is looked up: it may begin in the dark.
_LOOKS = 5
# A file without compression has four channels of 16 bits at most.
_MOST_PIXEL_BYTES = 8


class FolderSource(FrameSource):
    """Image pairs in two folders, paired by their file names and read in the order of these.

    The names tell the stamps (:mod:`.image_stamps`).

    Args:
        path: The folder with the two folders in it.
        rig: The rig; images carry none.
        left: Folder of the left images in ``path``, None for "left".
        right: Folder of the right images in it, None for "right".
        selection: Which frames are used, None for all.
        cameras: Cameras that the images are rectified for; None where the rig is all there is.

    Raises:
        BagError: There are no two folders with images of the same names, or it is not certain which image
            comes after which.
    """

    def __init__(
        self,
        path: Path,
        rig: StereoRig,
        left: str | None = None,
        right: str | None = None,
        selection: Selection | None = None,
        cameras: StereoRectifier | None = None,
    ) -> None:
        self._cameras = cameras
        self.path, self.rig, self.selection = path, rig, selection or Selection()
        self.name = path.resolve().name
        self.left_name, self.right_name = folders_of(left, right)
        files = [_images_in(path / folder) for folder in (self.left_name, self.right_name)]
        self.n_images = len(files[0]), len(files[1])
        names = sorted(files[0].keys() & files[1].keys(), key=natural_key)
        if not names:
            shown = (
                ", ".join(map(printable, sorted(each, key=natural_key)[:_SHOWN])) or "none" for each in files
            )
            raise BagError(
                f"{path}: no image of {self.left_name} has the name of one of {self.right_name} "
                f"({' ...; '.join(shown)} ...): give both images of a pair one name"
            )
        try:
            stamps = image_stamps(names)
        except BagError as error:
            raise BagError(f"{path}: {error}") from error
        seen_by = cameras or StereoRectifier.of_rig(rig)
        self._doubts = tuple(doubt.message for doubt in seen_by.doubts)
        self._stamps_note = (stamps.note,)
        self.notes = (stamps.note, *turn_note(seen_by))
        self.counted = stamps.counted
        self._pairs = [
            (stamp_ns, files[0][name], files[1][name])
            for name, stamp_ns in zip(stamps.names, stamps.stamps_ns, strict=True)
        ]
        self.start_ns = self._pairs[0][0]
        self._judged: dict[int, FrozenImage | None] = {}
        self._depth = BitDepth(self._look_ahead, lasting=False)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about the rig, stamps that are none, bits of the images, and those in no frame."""
        remarks = self._doubts + (self._stamps_note if self.counted else ())
        if self._depth.remark:
            remarks += (self._depth.remark,)
        alone = [count - len(self._pairs) for count in self.n_images]
        if any(alone):
            remarks += (f"{alone[0]} left and {alone[1]} right images have no partner of the same name",)
        return remarks

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in the order of their stamps."""
        chosen = self.selection.choose(
            range(len(self._pairs)), lambda index: self._pairs[index][0] - self.start_ns
        )
        empty = True
        for frame in readable((self._frame(index) for index in chosen), str(self.path)):
            empty = False
            yield frame
        if empty:
            length_s = (self._pairs[-1][0] - self.start_ns) / _NS_PER_S
            raise BagError(self.selection.nothing_in(str(self.path), length_s))

    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again."""
        for index, (stamp_ns, *_) in enumerate(self._pairs):
            if stamp_ns == recorded_ns:
                return self._frame(index)
        raise BagError(f"{self.path}: there is no frame with the stamp {recorded_ns} ns")

    def _frame(self, index: int) -> StereoFrame:
        stamp_ns, left, right = self._pairs[index]
        frame = StereoFrame.from_images(
            stamp_to_s(stamp_ns),
            lambda: self._read(left),
            lambda: self._read(right),
            self._depth,
            stamp_ns,
            left.name,
            self._frozen(index),
        )
        return frame if self._cameras is None else frame.seen_by(self._cameras)

    def _frozen(self, index: int) -> FrozenImage | None:
        """Return which image of a pair is only the one before again, as :class:`.FrozenImages` does."""
        at, same = index, self._same(index)
        while at > 0 and all(same) and at not in self._judged:  # what is known of the pair before still holds
            at -= 1
            same = self._same(at)
        if at == 0 and len(self._pairs) > 1:  # nobody knows the age of an image that the second pair repeats
            same = self._same(1)
        if at not in self._judged:
            since_ns = self._pairs[max(0, at - 1)][0]
            one = any(same) and not all(same)
            self._judged[at] = FrozenImage("left" if same[0] else "right", since_ns) if one else None
        self._judged[index] = self._judged[at]
        return self._judged[index]

    def _same(self, index: int) -> tuple[bool, bool]:
        """Return of both images of a pair whether they are those of the pair before, byte for byte."""
        if index == 0:
            return False, False
        (_, *before), (_, *now) = self._pairs[index - 1], self._pairs[index]
        try:
            left, right = (cmp(one, other, shallow=False) for one, other in zip(before, now, strict=True))
        except OSError:  # a frame that cannot be read says so
            return False, False
        return left, right

    def _look_ahead(self) -> Iterator[Pixels]:
        """Yield both images at some places of the recording; what cannot be read is left out."""
        for _, *files in self._pairs[:: max(1, len(self._pairs) // _LOOKS)]:
            for file in files:
                with suppress(ImageError):
                    yield self._read(file)

    def _read(self, path: Path) -> Pixels:
        size = self.rig.width, self.rig.height
        most_bytes = _MOST_PIXEL_BYTES * most_pixels(size)
        try:
            with open_regular(path) as file:
                content = file.read(most_bytes + 1)
        except OSError as error:
            raise ImageError(f"{path.name} cannot be read ({error.strerror})") from error
        except BagError as error:
            raise ImageError(str(error)) from error
        if len(content) > most_bytes:
            raise ImageError(
                f"{path.name} has more than {most_bytes} bytes, an image of {size[0]} x {size[1]} has fewer"
            )
        return decode_compressed(content, path.suffix.lstrip("."), size)


def folders_of(left: str | None, right: str | None) -> tuple[str, str]:
    """Return the names of both folders; what is not given is called left and right."""
    return left or DEFAULT_FOLDERS[0], right or DEFAULT_FOLDERS[1]


def is_image_folder(path: Path, left: str | None = None, right: str | None = None) -> bool:
    """Whether ``path`` is a folder of image pairs, and no bag."""
    folders = [path / each for each in folders_of(left, right)]
    return not (path / "metadata.yaml").exists() and all(folder.is_dir() for folder in folders)


def _images_in(folder: Path) -> dict[str, Path]:
    """Return the images of a folder by their names without suffix; not what the system has hidden there.

    Raises:
        BagError: The folder cannot be read, or two images differ in their suffix only.
    """
    images: dict[str, Path] = {}
    try:
        files = sorted(folder.iterdir())
    except OSError as error:
        raise BagError(f"{folder}: cannot be read ({error.strerror})") from error
    for file in files:
        if file.suffix.lower() not in IMAGE_SUFFIXES or file.name.startswith("."):
            continue
        other = images.setdefault(file.stem, file)
        if other is not file:
            raise BagError(f"{folder}: {other.name} and {file.name} have one name: take one of them away")
    return images
