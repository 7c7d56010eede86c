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

"""How well the mount is known as a recording goes on: its standard deviations after so many frames."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.calibrator import Calibrator
from ..core.geometry.pose import Extrinsics
from ..core.results import CalibrationResult

# The estimate takes time in proportion to the frames behind it (0.26 ms a frame, at least 4 ms). Made after
# 1, 2, 4, 8, ... accepted frames, all of them together take as long as that of the whole: 1 % of the time of
# a long recording, 3 % of that of 50 frames.
_RATIO = 2


@dataclass(frozen=True, slots=True)
class ProgressPoint:
    """The estimate at one moment of a recording.

    Attributes:
        stamp_s: Stamp of the last frame behind it [s].
        accepted: Number of accepted frames up to then.
        std: Standard deviations of the mount by these.
    """

    stamp_s: float
    accepted: int
    std: Extrinsics


class ProgressNotes:
    """Notes the estimate after 1, 2, 4, 8, ... accepted frames, and at the end."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew: with other cameras, nothing is known."""
        self._points: list[ProgressPoint] = []
        self._accepted = 0
        self._next = 1
        self._last_s = 0.0

    def note(self, frame: CalibrationResult, calibrator: Calibrator) -> None:
        """Count one more frame where it was accepted; make the estimate where it is time to.

        Args:
            frame: Its result.
            calibrator: It has seen all of them.
        """
        if not frame.accepted:
            return
        self._accepted += 1
        self._last_s = frame.stamp_s
        if self._accepted == self._next:
            self._next *= _RATIO
            self._add(calibrator.estimate.std)

    def end(self, std: Extrinsics | None) -> tuple[ProgressPoint, ...]:
        """Return all points, the last one with the outcome of the recording.

        Args:
            std: Standard deviations of that; None where no frame was accepted.
        """
        if self._points and self._points[-1].accepted != self._accepted:
            self._add(std)
        return tuple(self._points)

    def _add(self, std: Extrinsics | None) -> None:
        if std is not None:
            self._points.append(ProgressPoint(self._last_s, self._accepted, std))
