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

"""Interface of a recording: a stereo rig and its frames, one after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType

from ..bags import Selection, StereoFrame
from ..core.camera.rig import StereoRig


class FrameSource(ABC):
    """The frames of one stereo camera; use it in a ``with`` statement.

    Each frame is read when the caller takes it, so memory does not grow with the recording.

    Attributes:
        name: Name of the recording, without the folders above it.
        left_name: Topic or folder of the left images.
        right_name: Topic or folder of the right images.
        n_images: Number of left and of right images in the whole recording.
        start_ns: Time at which the recording starts [ns]; a selection counts from it.
        rig: Intrinsics and baseline of the rectified pair.
        selection: Which frames are used.
        notes: Notes on the frames, one sentence each.
        turn_topics: Names of the topics with turn rates that the frames have.
        counted: Whether the frames have no stamps: they are taken for 0.1 s apart.
    """

    name: str
    left_name: str
    right_name: str
    n_images: tuple[int, int]
    start_ns: int
    rig: StereoRig
    selection: Selection
    notes: tuple[str, ...] = ()
    turn_topics: tuple[str, ...] = ()
    counted: bool = False

    @property
    def count(self) -> int | None:
        """Most number of frames; None where it is not known before they are read."""
        return self.selection.count(min(self.n_images))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about anomalies of the recording; complete when all frames have been read."""
        return ()

    @abstractmethod
    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in order, at least one; can be called again.

        Raises:
            SelfcalError: The recording cannot be read, or has no such frame.
        """

    @abstractmethod
    def frame_at(self, recorded_ns: int) -> StereoFrame:
        """Return one frame again, whether it is selected or not.

        Args:
            recorded_ns: Of the frame, or of its row.

        Raises:
            SelfcalError: There is none, or it cannot be read.
        """

    def close(self) -> None:  # noqa: B027  (not every source has something to close)
        """Close the files."""

    def __enter__(self) -> FrameSource:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
