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

"""Changes of the cameras in the middle of a drive, by their CameraInfo, in words for node and replay."""

from __future__ import annotations

from dataclasses import dataclass

from ..camera.camera_difference import (
    Difference,
    alternating_error,
    changes_text,
    find_differences,
    values_text,
)
from ..camera.rectifier import StereoRectifier
from ..camera.rig import StereoRig
from .drive import clock

# So many cameras in turn that are only two: A, B, A, B. A mount or a lens that was changed does not come back
# twice, two publishers on one topic do with nearly every frame.
_ALTERNATING = 4
# Within this time. A driver that is started twice may send the same wrong CameraInfo first each time.
_WITHIN_S = 60.0


@dataclass(frozen=True, slots=True)
class CameraChange:
    """A change of CameraInfo: frames before it are of another rig, and are not fused with those after it.

    Attributes:
        at_s: Stamp of the first frame of the new cameras [s].
        before: The rig before.
        after: The rig after.
        differences: What has changed.
    """

    at_s: float
    before: StereoRig
    after: StereoRig
    differences: tuple[Difference, ...]

    @property
    def since(self) -> str:
        """Half a sentence for the message of a result from the frames since the change."""
        return f"since CameraInfo changed at {clock(self.at_s)}"

    @property
    def message(self) -> str:
        """One sentence: when, and what changed from which value to which."""
        return (
            f"CameraInfo changed at {clock(self.at_s)} ({changes_text(self.differences)}): frames from "
            "before are of another rig and not in the result"
        )


class CameraFollower:
    """Follows the cameras from frame to frame and notes their changes.

    Attributes:
        current: Cameras of the last frame, None before the first one.
        changes: Changes so far, in order.
    """

    def __init__(self) -> None:
        self.current: StereoRectifier | None = None
        self.changes: tuple[CameraChange, ...] = ()
        self._turns: list[tuple[StereoRectifier, float]] = []

    def follow(self, cameras: StereoRectifier, stamp_s: float) -> CameraChange | None:
        """Take the cameras of the next frame; return their change, None where they are the same.

        Args:
            cameras: Cameras of the frame.
            stamp_s: Its stamp [s].

        Raises:
            CameraInfoError: Two rigs alternate.
        """
        before, self.current = self.current, cameras
        if before is not None and before.sees_as(cameras):
            return None
        self._turns = [*self._turns, (cameras, stamp_s)][-_ALTERNATING:]
        if before is None:
            return None
        differences = find_differences(before.cameras or (), cameras.cameras or ())
        change = CameraChange(stamp_s, before.rig, cameras.rig, differences)
        self.changes = (*self.changes, change)
        if self._alternates():
            first_s = self.changes[-_ALTERNATING + 1].at_s
            values = values_text(differences, after=False), values_text(differences, after=True)
            raise alternating_error(
                values, f"{_ALTERNATING - 1} times from {clock(first_s)} to {clock(stamp_s)}"
            )
        return change

    def _alternates(self) -> bool:
        if len(self._turns) < _ALTERNATING:
            return False
        (a, start_s), (b, _), (c, _), (d, end_s) = self._turns
        return abs(end_s - start_s) <= _WITHIN_S and a.sees_as(c) and b.sees_as(d)
