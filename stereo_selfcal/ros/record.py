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

"""What the node remembers of its frames: counts, times and the last refusal. Needs no ROS."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..core.camera.pairing import stamp_to_s
from ..core.camera.rig import StereoRig
from ..core.faults import Fault
from ..core.rejection import Rejection
from ..core.results import CalibrationResult, refused_for, rejected
from ..core.types import Image


@dataclass(frozen=True, slots=True, eq=False)
class FrameReport:
    """One frame that went through the calibrator.

    Attributes:
        left: (H, W) uint8 image of the left camera, as it was calibrated; (0, 0) where a fault of the program
            came up before it was.
        right: The same of the right camera.
        rig: The rig both come from; None where it is not known.
        result: The result of this frame.
        stamp_ns: Stamp of the frame [ns].
        elapsed_s: How long it took [s].
    """

    left: Image
    right: Image
    rig: StereoRig | None
    result: CalibrationResult
    stamp_ns: int
    elapsed_s: float


def calibrate_timed(
    rig: StereoRig,
    calibrate: Callable[[Image, Image, float, float], CalibrationResult],
    left: Image,
    right: Image,
    stamp_ns: int,
    stamp_difference_s: float = 0.0,
) -> FrameReport:
    """Calibrate a frame and measure how long that takes.

    Args:
        rig: The rig it comes from.
        calibrate: Calibrates it, given its images, its stamp and the difference of their stamps [s].
        left: (H, W) uint8 rectified image of the left camera.
        right: The same of the right camera.
        stamp_ns: Stamp of the frame [ns].
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
    """
    start_s = time.monotonic()
    result = calibrate(left, right, stamp_to_s(stamp_ns), stamp_difference_s)
    return FrameReport(left, right, rig, result, stamp_ns, time.monotonic() - start_s)


def refused_frame(
    left: Image, right: Image, rig: StereoRig, refusal: Rejection, stamp_ns: int
) -> FrameReport:
    """Return the report of a frame that is refused before it is calibrated."""
    return FrameReport(left, right, rig, rejected(refusal, stamp_to_s(stamp_ns)), stamp_ns, 0.0)


def failed_frame(fault: Fault, stamp_ns: int) -> FrameReport:
    """Return the report of a frame that could not be read, for a fault of the program."""
    nothing = np.empty((0, 0), np.uint8)
    return FrameReport(nothing, nothing, None, refused_for(fault, stamp_to_s(stamp_ns)), stamp_ns, 0.0)


@dataclass(frozen=True, slots=True)
class FrameStatistics:
    """Frames so far, both of calls and of the watch.

    Attributes:
        accepted: Accepted frames.
        rejected: Refused frames by the word of the reason.
        last_rejection: The last refusal, None before the first.
        last_rejection_age_s: Time since then [s].
        last_s: How long the last frame took [s].
        mean_s: Mean of that over all frames [s].
        longest_s: Greatest of that [s].
    """

    accepted: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    last_rejection: Rejection | None = None
    last_rejection_age_s: float = 0.0
    last_s: float = 0.0
    mean_s: float = 0.0
    longest_s: float = 0.0

    @property
    def total(self) -> int:
        """Frames that went through the calibrator."""
        return self.accepted + sum(self.rejected.values())


class FrameRecord:
    """Counts frames; safe to be used by several threads.

    Args:
        clock: Steady time [s], for tests.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._accepted = 0
        self._rejected: Counter[str] = Counter()
        self._last_rejection: tuple[Rejection, float] | None = None
        self._last_s = self._sum_s = self._longest_s = 0.0

    def add(self, report: FrameReport) -> None:
        """Count a frame; keeps no image of it."""
        with self._lock:
            rejection = report.result.rejection
            if rejection is None:
                self._accepted += 1
            else:
                self._rejected[str(rejection.reason)] += 1
                self._last_rejection = rejection, self._clock()
            self._last_s = report.elapsed_s
            self._sum_s += report.elapsed_s
            self._longest_s = max(self._longest_s, report.elapsed_s)

    @property
    def statistics(self) -> FrameStatistics:
        """The counts so far; the most frequent reason comes first."""
        with self._lock:
            total = self._accepted + sum(self._rejected.values())
            rejection, at_s = self._last_rejection or (None, 0.0)
            return FrameStatistics(
                accepted=self._accepted,
                rejected=dict(self._rejected.most_common()),
                last_rejection=rejection,
                last_rejection_age_s=0.0 if rejection is None else self._clock() - at_s,
                last_s=self._last_s,
                mean_s=self._sum_s / total if total else 0.0,
                longest_s=self._longest_s,
            )
