"""What the node remembers of its frames: counts, times, the last refusal, the calibration in force."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..core.calibrator import Calibrator
from ..core.camera.pairing import StampedPair
from ..core.camera.rig import StereoRig
from ..core.rejection import Rejection
from ..core.results import CalibrationResult
from ..core.types import Image
from .calibration import CalibrationCall, PairSource
from .config import NodeConfig


@dataclass(frozen=True, slots=True, eq=False)
class FrameReport:
    """One frame that went through the calibrator.

    Attributes:
        left: (H, W) uint8 image of the left camera, as it was calibrated.
        right: The same of the right camera.
        rig: The rig both come from.
        result: What came of it.
        stamp_ns: Stamp of the frame [ns].
        elapsed_s: How long it took [s].
    """

    left: Image
    right: Image
    rig: StereoRig
    result: CalibrationResult
    stamp_ns: int
    elapsed_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ActiveCalibration:
    """The calibration the node stands by.

    Attributes:
        result: The result.
        rig: The rig it holds for.
        since_s: Steady time [s] since when (:func:`time.monotonic`).
        saved: Where it is saved, or why it is not.
        save_failed: Whether it should have been saved and could not be.
    """

    result: CalibrationResult
    rig: StereoRig
    since_s: float
    saved: str = ""
    save_failed: bool = False


@dataclass(frozen=True, slots=True)
class FrameStatistics:
    """Frames so far, whoever had them calibrated.

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


class ReportingCall(CalibrationCall):
    """A call of ``~/calibrate`` that reports every frame it calibrates.

    Args:
        source: Where the frames come from.
        config: Parameters at the start of the call.
        report: Told every frame, in the thread of the call: it must return at once.
    """

    def __init__(self, source: PairSource, config: NodeConfig, report: Callable[[FrameReport], None]) -> None:
        self._report = report
        self._stamp_ns = 0
        self._reporting: _ReportingCalibrator | None = None
        super().__init__(source, config)

    # The call makes its calibrator when the rig is known, and puts it here.
    @property
    def _calibrator(self) -> Any:
        return self._reporting

    @_calibrator.setter
    def _calibrator(self, calibrator: Calibrator | None) -> None:
        self._reporting = None if calibrator is None else _ReportingCalibrator(calibrator, self._tell)

    def _take(self, pair: StampedPair[Any]) -> None:
        self._stamp_ns = pair.stamp_ns
        super()._take(pair)

    def _tell(
        self, images: tuple[Image, Image], rig: StereoRig, result: CalibrationResult, elapsed_s: float
    ) -> None:
        self._report(FrameReport(*images, rig, result, self._stamp_ns, elapsed_s))


class _ReportingCalibrator:
    """A calibrator, and somebody who is told what it does."""

    def __init__(self, calibrator: Calibrator, tell: Callable[..., None]) -> None:
        self._calibrator = calibrator
        self._tell = tell

    @property
    def rig(self) -> StereoRig:
        return self._calibrator.rig

    @property
    def estimate(self) -> CalibrationResult:
        return self._calibrator.estimate

    def add(self, left: Image, right: Image, stamp_s: float) -> CalibrationResult:
        start_s = time.monotonic()
        result = self._calibrator.add(left, right, stamp_s)
        self._tell((left, right), self.rig, result, time.monotonic() - start_s)
        return result
