"""A pair of images of a recording, and the fault of a pair that cannot be converted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.camera.bit_depth import BitDepth, Pixels
from ..core.camera.rectifier import StereoRectifier
from ..core.errors import ImageError
from ..core.types import Image
from .errors import BagError

# Frames at the start that may be lost, before it is the camera that cannot be read.
_MOST_LOST = 10


@dataclass(frozen=True, slots=True, eq=False)
class StereoFrame:
    """One pair of images.

    Attributes:
        stamp_s: Header stamp of the left image [s].
        left: (H, W) uint8 grey image of the left camera.
        right: The same of the right camera.
        recorded_ns: When the left image was recorded [ns]: where the frame is found again.
        name: Name of the left image where it has one, "" in a bag.
        problem: Why an image could not be converted, in one line; both are empty then.
        cameras: The cameras that the images were rectified for, by their CameraInfo; None where there is one
            rig for all frames.
        rig_problem: Why there are no cameras for the frame, in one line.
    """

    stamp_s: float
    left: Image
    right: Image
    recorded_ns: int = 0
    name: str = ""
    problem: str = ""
    cameras: StereoRectifier | None = None
    rig_problem: str = ""

    def seen_by(self, cameras: StereoRectifier) -> StereoFrame:
        """Return the frame as cameras see it: rectified, with their rig."""
        if self.problem:
            return self
        cameras = cameras.for_images(self.left, self.right)
        left, right = cameras.apply(self.left, self.right)
        return replace(self, left=left, right=right, cameras=cameras)

    @classmethod
    def from_images(
        cls,
        stamp_s: float,
        left: Callable[[], Pixels],
        right: Callable[[], Pixels],
        depth: BitDepth,
        recorded_ns: int,
        name: str = "",
    ) -> StereoFrame:
        """Return the frame of two images that are still to be converted.

        Args:
            stamp_s: Stamp [s].
            left: Returns the left image, or raises an ImageError.
            right: The same for the right one.
            depth: Converts images of more than 8 bits.
            recorded_ns: When it was recorded [ns].
            name: Its name.
        """
        try:
            return cls(stamp_s, *depth.to_8_bits(left(), right()), recorded_ns, name)
        except ImageError as error:
            nothing = np.empty((0, 0), np.uint8)
            return cls(stamp_s, nothing, nothing, recorded_ns, name, str(error))


def readable(frames: Iterable[StereoFrame], name: str) -> Iterator[StereoFrame]:
    """Yield the frames, those with a problem too, unless they all have one.

    One image that cannot be converted is a frame lost; a camera of which no image can is an error.

    Args:
        frames: Frames in order.
        name: The recording, for the error.

    Raises:
        BagError: None of the first frames could be converted.
    """
    lost: list[StereoFrame] = []
    iterator = iter(frames)
    for frame in iterator:
        if not frame.problem:
            yield from lost
            yield frame
            yield from iterator
            return
        lost.append(frame)
        if len(lost) == _MOST_LOST:
            break
    if lost:
        raise BagError(f"{name}: {lost[0].problem}")
