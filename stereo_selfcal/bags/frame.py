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

"""A pair of images of a recording, and the fault of a pair that cannot be converted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.camera.bit_depth import BitDepth, Pixels
from ..core.camera.frozen import FrozenImage
from ..core.camera.rectifier import StereoRectifier
from ..core.drive.turn_topics import TurnMessage
from ..core.errors import ImageError
from ..core.faults import Fault
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
        frozen: Which image is only the last one again, None where both are new.
        fault: The fault of the program that came up when it was; None in any other case.
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
        turns: Messages of odometry and gyroscopes that were recorded since the frame before.
    """

    stamp_s: float
    left: Image
    right: Image
    recorded_ns: int = 0
    name: str = ""
    problem: str = ""
    cameras: StereoRectifier | None = None
    rig_problem: str = ""
    frozen: FrozenImage | None = None
    fault: Fault | None = None
    stamp_difference_s: float = 0.0
    turns: tuple[TurnMessage, ...] = ()

    def seen_by(self, cameras: StereoRectifier) -> StereoFrame:
        """Return the frame as cameras see it: rectified, with their rig."""
        if self.problem:
            return self
        try:
            cameras = cameras.for_images(self.left, self.right)
            left, right = cameras.apply(self.left, self.right)
        except Exception as error:  # noqa: BLE001  (whatever it is, the other frames go on)
            return self.failed(error)
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
        frozen: FrozenImage | None = None,
    ) -> StereoFrame:
        """Return the frame of two images that are still to be converted.

        Args:
            stamp_s: Stamp [s].
            left: Returns the left image, or raises an ImageError.
            right: The same for the right one.
            depth: Converts images of more than 8 bits.
            recorded_ns: When it was recorded [ns].
            name: Its name.
            frozen: Which image is only the last one again.
        """
        try:
            return cls(stamp_s, *depth.to_8_bits(left(), right()), recorded_ns, name, frozen=frozen)
        except ImageError as error:
            nothing = np.empty((0, 0), np.uint8)
            return cls(stamp_s, nothing, nothing, recorded_ns, name, str(error))
        except Exception as error:  # noqa: BLE001  (whatever it is, the other frames go on)
            nothing = np.empty((0, 0), np.uint8)
            return cls(stamp_s, nothing, nothing, recorded_ns, name).failed(error)

    def failed(self, error: Exception) -> StereoFrame:
        """Return the frame without images: what was done with them raised what was not foreseen."""
        nothing, fault = np.empty((0, 0), np.uint8), Fault.of(error)
        return replace(self, left=nothing, right=nothing, problem=fault.what, fault=fault)


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
