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

"""One call of ``~/calibrate``: calibrates new pairs until the mount is known well enough. Needs no ROS.

It says what it has reached, and what is missing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ..core.alignment_verdict import report_alignment
from ..core.calibrator import Calibrator
from ..core.camera.bit_depth import BitDepth, Pixels
from ..core.camera.frozen import refuse_frozen
from ..core.camera.image_messages import message_to_grey
from ..core.camera.pairing import PairCounts, StampedPair, stamp_to_s
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.delay_report import describe_delay, is_late
from ..core.drive.camera_changes import CameraFollower
from ..core.drive.targets import EstimateTimes, explain_shortfall
from ..core.errors import ImageError, RigError
from ..core.faults import Fault
from ..core.results import CalibrationResult
from .call_progress import CallProgress
from .config import NodeConfig
from .pair_source import PairSource, known_rectifier, no_pair_reason, publishers_text
from .record import FrameReport, calibrate_timed, failed_frame, refused_frame
from .turns_of_call import TurnsOfCall

INTERRUPTED = "interrupted: the node shuts down"
RESET = "ended by ~/reset: nothing was activated; call again to calibrate anew"

_CLOCK_STEP_S = 1e-3  # a call that ends at once must not divide by zero
# After this time without a pair, the camera is said to have stopped. It may send one image per second.
_SILENCE_S = 1.5
# The first pair waits so long for the second one, and goes on without it where the camera is slower.
_SECOND_S = 1.0
# Time between two reports of the progress. There is none while no frame comes: the log is not to fill.
_PROGRESS_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class CallOutcome:
    """Answer of a call.

    Attributes:
        message: One sentence: the result, or the reason.
        result: The accepted calibration, None when there is none.
        rig: The rig it holds for.
        stamp_ns: Stamp of the last frame in it [ns].
        cameras: The cameras of its frames, None where they are not known.
        reached: Whether the result has reached the targets; one that has not may be no better than what is in
            force.
    """

    message: str
    result: CalibrationResult | None = None
    rig: StereoRig | None = None
    stamp_ns: int = 0
    cameras: StereoRectifier | None = None
    reached: bool = True


class CalibrationCall:
    """Calibrates from the frames that arrive, until the targets are reached or the timeout is over.

    A frame that is refused does not end the call: the next one may be better. Where any standard deviation is
    good enough, the call ends with the configured number of accepted frames.

    Args:
        source: Where the frames come from.
        config: Parameters at the start of the call.
        report: Told of every frame that was calibrated, in the thread of the call. It must return at once.
        tell: Told of the progress once a second, while frames come; as ``report``.
        turns: What odometry and a gyroscope say meanwhile; None without them.
    """

    def __init__(
        self,
        source: PairSource,
        config: NodeConfig,
        report: Callable[[FrameReport], None] | None = None,
        tell: Callable[[CallProgress], None] | None = None,
        turns: TurnsOfCall | None = None,
    ) -> None:
        self._source = source
        self._report = report
        self._tell = tell
        self._turns = TurnsOfCall() if turns is None else turns
        self._config = config
        self._targets = config.targets
        self._cancelled = threading.Event()
        self._start_s = self._told_s = time.monotonic()
        self._calibrator: Calibrator | None = None
        self._estimate: CalibrationResult | None = None
        self._times = EstimateTimes(config.targets.frames)
        self._stamp_ns = 0
        self._follower = CameraFollower()
        self._depth = BitDepth()
        self._rig_problem: str | None = None
        self._begun = False
        self._second: StampedPair[Any] | None = None
        self._pairs = 0
        self._last_rejection = ""
        self._last_reason = ""
        self._last_pair: tuple[float, PairCounts] | None = None

    @property
    def progress(self) -> CallProgress:
        """What it has so far; any thread may ask."""
        estimate = self._estimate
        return CallProgress(
            self._times.accepted,
            self._pairs,
            time.monotonic() - self._start_s,
            self._config.timeout_s,
            self._targets,
            None if estimate is None else estimate.std,
            self._last_reason,
        )

    @property
    def cancelled(self) -> bool:
        """Whether :meth:`cancel` was called."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """End the call without a result, after the present frame; any thread may do so."""
        self._cancelled.set()
        self._source.interrupt()

    def run(self) -> CallOutcome:
        """Return the result, or the reason why there is none after the timeout."""
        self._start_s = self._told_s = time.monotonic()
        before = self._source.state.counts
        while not self.cancelled:
            remaining_s = max(0.0, self._config.timeout_s - (time.monotonic() - self._start_s))
            pair = self._next_pair(remaining_s)
            if pair is not None:
                self._last_pair = time.monotonic(), self._source.state.counts
                self._take_or_refuse(pair)
                if self._is_good and not self.cancelled:
                    return self._answer(before)
                self._tell_progress()
            if pair is None or remaining_s == 0.0:
                break
        if self._source.stopped:
            return CallOutcome(INTERRUPTED)
        if self.cancelled:
            return CallOutcome(RESET)
        return self._answer_at_timeout(before)

    @property
    def _is_good(self) -> bool:
        """Whether the estimate is good enough. It is looked at as often as it is worth its time."""
        estimate = self._estimate
        if estimate is None or self._rig_problem is not None:
            return False
        if self._targets.any_std and self._times.accepted >= self._targets.frames:
            return True  # whether it is accepted or not
        return self._targets.reached(estimate)

    def _answer(self, before: PairCounts) -> CallOutcome:
        """Return the answer where the estimate is good enough."""
        estimate = self._estimate
        assert estimate is not None
        told = "" if self._targets.any_std else f"; targets reached {self._effort()}"
        return self._outcome(estimate, told, before, reached=True)

    def _answer_at_timeout(self, before: PairCounts) -> CallOutcome:
        """Return the answer after the timeout: what was reached, and what keeps it from the targets."""
        elapsed_s = max(time.monotonic() - self._start_s, _CLOCK_STEP_S)
        calibrator = self._calibrator
        if calibrator is None or self._rig_problem is not None or self._times.accepted < self._targets.frames:
            return CallOutcome(self._failure(before, elapsed_s) + self._doubts(before))
        self._estimate = estimate = calibrator.estimate
        if self._is_good:  # the last frames were not looked at yet
            return self._answer(before)
        told = f"; targets not reached {self._effort()}"
        if estimate.accepted:
            told += f": {explain_shortfall(estimate, self._targets)}"
        if 2 * self._times.accepted < self._pairs and self._last_rejection:
            told += f"; last refusal: {self._last_rejection}"
        return self._outcome(estimate, told + self._silence(), before, reached=False)

    def _effort(self) -> str:
        """Return what was asked, and what has been done for it."""
        return f"with {self.progress.frames_text} (asked {self._targets.describe()})"

    def _outcome(
        self, estimate: CalibrationResult, told: str, before: PairCounts, *, reached: bool
    ) -> CallOutcome:
        assert self._calibrator is not None
        rig, cameras = self._calibrator.rig, self._follower.current
        message = estimate.message + told + _misalignment(estimate, rig) + _lateness(estimate)
        message += self._changes() + self._doubts(before)
        if not estimate.accepted:
            return CallOutcome(message)
        return CallOutcome(message, estimate, rig, self._stamp_ns, cameras, reached)

    def _tell_progress(self) -> None:
        """Tell the progress, once a second at most."""
        now_s = time.monotonic()
        if self._tell is not None and now_s >= self._told_s + _PROGRESS_S:
            self._told_s = now_s
            self._tell(self.progress)

    def _next_pair(self, timeout_s: float) -> StampedPair[Any] | None:
        """Return the next pair; of the first one, an image that the second one repeats may be old already."""
        if self._second is not None:
            second, self._second = self._second, None
            return second
        pair = self._source.next_pair(timeout_s)
        if pair is None or self._begun:
            return pair
        self._begun = True
        if pair.frozen is None:
            self._second = self._source.next_pair(min(timeout_s, _SECOND_S))
            if self._second is not None:
                pair = replace(pair, frozen=self._second.frozen)
        return pair

    def _take_or_refuse(self, pair: StampedPair[Any]) -> None:
        """Calibrate one pair; refuse it where something comes up that was not foreseen."""
        try:
            self._take(pair)
        except Exception as error:  # noqa: BLE001  (whatever it is, the next pairs are taken)
            frame = failed_frame(Fault.of(error), pair.stamp_ns)
            self._refuse(frame.result)
            if self._report is not None:
                self._report(frame)

    def _take(self, pair: StampedPair[Any]) -> None:
        """Calibrate one pair, or remember why it could not be."""
        self._pairs += 1
        try:
            rectifier = self._find_rectifier(pair)
        except RigError as error:
            self._rig_problem = str(error)
            return
        topics = self._source.topics
        try:
            size = rectifier.rig.width, rectifier.rig.height
            left = _grey(pair.left, topics.left, size)
            right = _grey(pair.right, topics.right, size)
        except ImageError as error:
            self._rig_problem = None
            self._last_rejection, self._last_reason = str(error), "an image that cannot be read"
            return
        left, right = self._depth.to_8_bits(left, right)
        refusal = refuse_frozen(pair.frozen, left, right, since=True)
        rectifier = rectifier.for_images(left, right)
        calibrator = self._calibrator_of(rectifier, pair.stamp_ns)
        if calibrator is None:
            return
        self._turns.pass_on(calibrator)
        left, right = rectifier.apply(left, right)
        if refusal is not None:
            frame = refused_frame(left, right, calibrator.rig, refusal, pair.stamp_ns)
        else:
            frame = calibrate_timed(
                calibrator.rig, calibrator.add, left, right, pair.stamp_ns, pair.difference_s
            )
        if self._report is not None:
            self._report(frame)
        if frame.result.accepted:
            self._accept(calibrator, pair.stamp_ns)
        else:
            self._refuse(frame.result)

    def _accept(self, calibrator: Calibrator, stamp_ns: int) -> None:
        """Count an accepted frame, and look at the estimate where that is worth its time."""
        self._stamp_ns = stamp_ns
        if self._times.count():
            self._estimate = calibrator.estimate

    def _refuse(self, result: CalibrationResult) -> None:
        self._last_rejection, self._last_reason = result.message, str(result.reason)

    def _begin_anew(self, calibrator: Calibrator | None) -> None:
        """Forget the frames so far: they are of another rig."""
        self._calibrator, self._estimate = calibrator, None
        self._times = EstimateTimes(self._targets.frames)

    def _calibrator_of(self, rectifier: StereoRectifier, stamp_ns: int) -> Calibrator | None:
        """Return the calibrator of a frame's rig; frames of two rigs must not be fused.

        Args:
            rectifier: Cameras of the frame.
            stamp_ns: Its stamp [ns].

        Returns:
            A new one where CameraInfo has changed; None where two rigs alternate.
        """
        try:
            changed = self._follower.follow(rectifier, stamp_to_s(stamp_ns)) is not None
            self._rig_problem = None
        except RigError as error:
            self._rig_problem = str(error)
            self._begin_anew(None)
            return None
        if changed or self._calibrator is None:
            self._begin_anew(Calibrator(rectifier.rig, self._config.calibrator))
        return self._calibrator

    def _find_rectifier(self, pair: StampedPair[Any]) -> StereoRectifier:
        rectifier = known_rectifier(self._source, self._config, pair)
        if rectifier is not None:
            return rectifier
        topics, (left, right) = self._source.topics, self._source.camera_infos
        missing = [t for t, info in ((topics.left_info, left), (topics.right_info, right)) if info is None]
        named = " and ".join(f"{topic} ({publishers_text(self._source, topic)})" for topic in missing)
        why = "; ".join(self._source.state.info_mismatches) or "publish it or set the parameters rig.*"
        raise RigError(f"no CameraInfo on {named}: {why}")

    def _doubts(self, before: PairCounts) -> str:
        """Return what is unusual about the CameraInfo and the images, to be added to a message.

        Args:
            before: Counts at the beginning of the call.
        """
        cameras = self._follower.current
        doubts = [] if cameras is None else [doubt.message for doubt in cameras.doubts]
        repeated = self._source.state.counts.since(before).repeated_remark
        turns = self._turns.doubts(self._calibrator)
        return "".join(f"; {doubt}" for doubt in (*doubts, self._depth.remark, repeated, *turns) if doubt)

    def _changes(self) -> str:
        """Return the last change of CameraInfo, to be added to the message of a result."""
        changes = self._follower.changes
        return f"; {changes[-1].message}" if changes else ""

    def _failure(self, before: PairCounts, elapsed_s: float) -> str:
        """Return why the call ends without a result."""
        if not self._pairs:
            return no_pair_reason(self._source, self._config, before, elapsed_s)
        seen = f"{self._pairs} {'pair' if self._pairs == 1 else 'pairs'} in {elapsed_s:.1f} s"
        late = "" if self._calibrator is None else _lateness(self._calibrator.estimate)
        return self._reason_after_pairs(seen) + late + self._silence()

    def _reason_after_pairs(self, seen: str) -> str:
        n_changes = len(self._follower.changes)
        if n_changes:
            times = "once" if n_changes == 1 else f"{n_changes} times"
            seen += f", CameraInfo changed {times} meanwhile"
        if self._rig_problem is not None:
            return f"{self._rig_problem} ({seen})"
        if self._times.accepted:
            return (
                f"{self._times.accepted} of {self._config.frames} frames accepted, {seen}: raise timeout_s "
                f"or lower frames; last refusal: {self._last_rejection or 'none'}"
            )
        return f"no frame accepted, {seen}; last refusal: {self._last_rejection}"

    def _silence(self) -> str:
        """Return why no more pairs came, "" if they did."""
        if self._last_pair is None:
            return ""
        last_s, counts = self._last_pair
        silent_s = time.monotonic() - last_s
        if silent_s < _SILENCE_S:
            return ""
        return f"; since then {no_pair_reason(self._source, self._config, counts, silent_s)}"


def _misalignment(estimate: CalibrationResult, rig: StereoRig) -> str:
    """Return how the right camera is turned, to be added to a message; "" where nothing is to be done."""
    report = report_alignment(estimate.alignment, rig)
    return f"; {report.message}" if report.verdict.is_fault else ""


def _lateness(estimate: CalibrationResult) -> str:
    """Return by how much right images are late, to be added to a message; "" where that is not sure."""
    return f"; {describe_delay(estimate.delay)}" if is_late(estimate.delay) else ""


def _grey(message: Any, topic: str, rig_size: tuple[int, int]) -> Pixels:
    try:
        return message_to_grey(message, rig_size)
    except ImageError as error:
        raise ImageError(f"{topic}: {error}") from error
