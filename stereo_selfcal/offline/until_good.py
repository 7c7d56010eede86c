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

"""Reading a recording until the mount is known as well as asked.

The estimate is looked at after an accepted frame, and not after every one: it takes time in proportion to
the frames behind it. When it is looked at depends on the number of accepted frames alone, so that a recording
ends at the same frame with any number of jobs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..bags import StereoFrame
from ..core.calibrator import Calibrator
from ..core.drive.targets import EstimateTimes, Targets, explain_shortfall
from ..core.results import CalibrationResult
from .recording import FrameSource


@dataclass(frozen=True, slots=True)
class Goal:
    """What was asked of a recording, and what became of it.

    Attributes:
        targets: Standard deviations that are good enough.
        reached: Whether they are reached.
        stopped: Whether frames after that were left unread.
        frames: Number of frames that were read.
        duration_s: Time from the first to the last of these [s].
        shortfall: One sentence: what keeps the estimate from the targets; "" where they are reached.
    """

    targets: Targets
    reached: bool
    stopped: bool
    frames: int
    duration_s: float
    shortfall: str = ""

    @classmethod
    def of(
        cls, targets: Targets, estimate: CalibrationResult, frames: int, duration_s: float, stopped: bool
    ) -> Goal:
        """Judge the estimate of a recording."""
        reached = targets.reached(estimate)
        why = "" if reached else explain_shortfall(estimate, targets)
        return cls(targets, reached, stopped, frames, duration_s, why)

    @property
    def message(self) -> str:
        """One sentence: whether the targets were reached, after how long, or what keeps it from them."""
        count = "1 frame" if self.frames == 1 else f"{self.frames} frames"
        after = f"{count}, {self.duration_s:.1f} s"
        asked = "the asked number of frames" if self.targets.any_std else "the asked std"
        asked += "" if self.targets.any_std else f" of {self.targets.describe()}"
        if not self.reached:
            return f"{asked} is not reached in {after}: {self.shortfall}"
        return f"{asked} is reached after {after}{'; nothing more was read' if self.stopped else ''}"


class GoalWatch:
    """Says after which frame the estimate is good enough.

    Args:
        targets: Standard deviations that are good enough.
    """

    def __init__(self, targets: Targets) -> None:
        self._targets = targets
        self._times = EstimateTimes(targets.frames)

    def is_reached(self, calibrator: Calibrator) -> bool:
        """Count one more accepted frame, and return whether the targets are reached with it.

        Args:
            calibrator: It has all of them; its estimate is made where it is time to look.
        """
        if not self._times.count() or self._times.accepted < self._targets.frames:
            return False
        return self._targets.reached(calibrator.estimate)


class NotedFrames:
    """The frames of a recording, with what was remarkable up to each: workers read ahead of the results.

    Args:
        source: The recording, open.
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._remarks: list[tuple[int, tuple[str, ...]]] = []  # those from a frame on, by its index

    def frames(self) -> Iterator[StereoFrame]:
        """Yield the selected frames in order."""
        for index, frame in enumerate(self._source.frames()):
            remarks = self._source.remarks
            if not self._remarks or self._remarks[-1][1] != remarks:
                self._remarks.append((index, remarks))
            yield frame

    def remarks_until(self, n_frames: int) -> tuple[str, ...]:
        """Return the remarks on so many frames from the first on."""
        return next((remarks for index, remarks in reversed(self._remarks) if index < n_frames), ())
