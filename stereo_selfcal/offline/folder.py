"""Frames from a folder of image pairs: ``left/NAME.png`` beside ``right/NAME.png``, without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ..bags import BagError, Selection, StereoFrame, readable
from ..core.camera.image_messages import decode_compressed
from ..core.camera.pairing import stamp_to_s
from ..core.camera.rig import StereoRig
from ..core.errors import ImageError
from ..core.types import Image
from .recording import FrameSource

DEFAULT_FOLDERS = ("left", "right")
# Formats in which cameras are recorded, and which OpenCV decodes.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff")

_NS_PER_S = 1_000_000_000
# Nanoseconds since 1970 have had 19 digits since 2001; a number of a frame never has that many.
_NANOSECONDS = re.compile(r"\d{19}")
_SECONDS = re.compile(r"(\d+)\.(\d{1,9})")


class FolderSource(FrameSource):
    """Image pairs in two folders, paired by their file names and read in the order of these.

    A name of 19 digits is a time stamp in nanoseconds, one with a decimal point is one in seconds
    (the datasets of EuRoC and TUM have such names). Where one name is neither, frame n has the stamp
    n seconds.

    Args:
        path: The folder with the two folders in it.
        rig: The rig; images carry none.
        left: Folder of the left images in ``path``, None for "left".
        right: Folder of the right images in it, None for "right".
        selection: Which frames are used, None for all.

    Raises:
        BagError: There are no two folders with images of the same names.
    """

    def __init__(
        self,
        path: Path,
        rig: StereoRig,
        left: str | None = None,
        right: str | None = None,
        selection: Selection | None = None,
    ) -> None:
        self.path, self.rig, self.selection = path, rig, selection or Selection()
        self.name = path.resolve().name
        self.left_name, self.right_name = folders_of(left, right)
        files = [_images_in(path / folder) for folder in (self.left_name, self.right_name)]
        self.n_images = len(files[0]), len(files[1])
        names = sorted(files[0].keys() & files[1].keys())
        if not names:
            shown = (", ".join(sorted(each)[:3]) or "none" for each in files)
            raise BagError(
                f"{path}: no image of {self.left_name} has the name of one of {self.right_name} "
                f"({' ...; '.join(shown)} ...): give both images of a pair one name"
            )
        stamps_ns = [_stamp_ns(name) for name in names]
        self.notes = ("stamps are in the names of the images",)
        if None in stamps_ns:
            self.notes = ("the names of the images are no stamps: frame n is at n seconds",)
            stamps_ns = [index * _NS_PER_S for index in range(len(names))]
        # Of names of different lengths the order is not that of the stamps.
        self._pairs = sorted(
            (stamp_ns, files[0][name], files[1][name])
            for stamp_ns, name in zip(stamps_ns, names, strict=True)
            if stamp_ns is not None
        )
        self.start_ns = self._pairs[0][0]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about the images that are in no frame."""
        alone = [count - len(self._pairs) for count in self.n_images]
        if not any(alone):
            return ()
        return (f"{alone[0]} left and {alone[1]} right images have no partner of the same name",)

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in the order of their stamps."""
        chosen = self.selection.choose(self._pairs, lambda pair: pair[0] - self.start_ns)
        empty = True
        for frame in readable((self._frame(*pair) for pair in chosen), str(self.path)):
            empty = False
            yield frame
        if empty:
            length_s = (self._pairs[-1][0] - self.start_ns) / _NS_PER_S
            raise BagError(self.selection.nothing_in(str(self.path), length_s))

    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again."""
        for pair in self._pairs:
            if pair[0] == recorded_ns:
                return self._frame(*pair)
        raise BagError(f"{self.path}: there is no frame with the stamp {recorded_ns} ns")

    def _frame(self, stamp_ns: int, left: Path, right: Path) -> StereoFrame:
        return StereoFrame.from_images(
            stamp_to_s(stamp_ns), lambda: _read(left), lambda: _read(right), stamp_ns, left.name
        )


def folders_of(left: str | None, right: str | None) -> tuple[str, str]:
    """Return the names of both folders; what is not given is called left and right."""
    return left or DEFAULT_FOLDERS[0], right or DEFAULT_FOLDERS[1]


def is_image_folder(path: Path, left: str | None = None, right: str | None = None) -> bool:
    """Whether ``path`` is a folder of image pairs, and no bag."""
    folders = [path / each for each in folders_of(left, right)]
    return not (path / "metadata.yaml").exists() and all(folder.is_dir() for folder in folders)


def _images_in(folder: Path) -> dict[str, Path]:
    """Return the images of a folder by their names without suffix."""
    files = [file for file in folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
    return {file.stem: file for file in sorted(files)}


def _stamp_ns(name: str) -> int | None:
    if _NANOSECONDS.fullmatch(name):
        return int(name)
    seconds = _SECONDS.fullmatch(name)
    return seconds and int(seconds[1]) * _NS_PER_S + int(seconds[2].ljust(9, "0"))


def _read(path: Path) -> Image:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ImageError(f"{path.name} cannot be read ({error.strerror})") from error
    return decode_compressed(content, path.suffix.lstrip("."))
