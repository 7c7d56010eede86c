"""One call of ``~/calibrate``: waits for new pairs, calibrates, and says what is missing. Needs no ROS."""

from __future__ import annotations

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
from ..core.errors import ImageError, RigError
from ..core.faults import Fault
from ..core.results import CalibrationResult
from .config import NodeConfig
from .pair_source import PairSource, known_rectifier, no_pair_reason, publishers_text
from .record import FrameReport, calibrate_timed, failed_frame, refused_frame

INTERRUPTED = "interrupted: the node shuts down"

_CLOCK_STEP_S = 1e-3  # a call that ends at once must not divide by zero
# After this time without a pair, the camera is said to have stopped. It may send one image per second.
_SILENCE_S = 1.5
# The first pair waits so long for the second one, and goes on without it where the camera is slower.
_SECOND_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class CallOutcome:
    """Answer of a call.

    Attributes:
        message: One sentence: the result, or the reason.
        result: The accepted calibration, None when there is none.
        rig: The rig it holds for.
        stamp_ns: Stamp of the last frame in it [ns].
        cameras: The cameras of its frames, None where they are not known.
    """

    message: str
    result: CalibrationResult | None = None
    rig: StereoRig | None = None
    stamp_ns: int = 0
    cameras: StereoRectifier | None = None


class CalibrationCall:
    """Calibrates from the frames that arrive within the timeout.

    A frame that is refused does not end the call: the next one may be better. The call ends with the
    configured number of accepted frames, or at the timeout with the reason of the last refusal.

    Args:
        source: Where the frames come from.
        config: Parameters at the start of the call.
        report: Told of every frame that was calibrated, in the thread of the call. It must return at once.
    """

    def __init__(
        self,
        source: PairSource,
        config: NodeConfig,
        report: Callable[[FrameReport], None] | None = None,
    ) -> None:
        self._source = source
        self._report = report
        self._config = config
        self._calibrator: Calibrator | None = None
        self._follower = CameraFollower()
        self._depth = BitDepth()
        self._rig_problem: str | None = None
        self._begun = False
        self._second: StampedPair[Any] | None = None
        self._pairs = 0
        self._accepted = 0
        self._last_rejection = ""
        self._last_pair: tuple[float, PairCounts] | None = None

    def run(self) -> CallOutcome:
        """Return the result, or the reason why there is none after the timeout."""
        start_s = time.monotonic()
        before = self._source.state.counts
        while True:
            remaining_s = max(0.0, self._config.timeout_s - (time.monotonic() - start_s))
            pair = self._next_pair(remaining_s)
            if pair is not None:
                self._last_pair = time.monotonic(), self._source.state.counts
                self._take_or_refuse(pair)
                if self._calibrator is not None and self._accepted == self._config.frames:
                    estimate, rig = self._calibrator.estimate, self._calibrator.rig
                    message = estimate.message + _misalignment(estimate, rig) + _lateness(estimate)
                    message += self._changes() + self._doubts(before)
                    if estimate.accepted:
                        rig, cameras = self._calibrator.rig, self._follower.current
                        return CallOutcome(message, estimate, rig, pair.stamp_ns, cameras)
                    return CallOutcome(message)
            if pair is None or remaining_s == 0.0:
                break
        if self._source.stopped:
            return CallOutcome(INTERRUPTED)
        elapsed_s = max(time.monotonic() - start_s, _CLOCK_STEP_S)
        return CallOutcome(self._failure(before, elapsed_s) + self._doubts(before))

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
            self._last_rejection = frame.result.message
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
            self._last_rejection = str(error)
            return
        left, right = self._depth.to_8_bits(left, right)
        refusal = refuse_frozen(pair.frozen, left, right, since=True)
        rectifier = rectifier.for_images(left, right)
        calibrator = self._calibrator_of(rectifier, pair.stamp_ns)
        if calibrator is None:
            return
        left, right = rectifier.apply(left, right)
        if refusal is not None:
            frame = refused_frame(left, right, calibrator.rig, refusal, pair.stamp_ns)
        else:
            frame = calibrate_timed(calibrator, left, right, pair.stamp_ns, pair.difference_s)
        if self._report is not None:
            self._report(frame)
        result = frame.result
        if result.accepted:
            self._accepted += 1
        else:
            self._last_rejection = result.message

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
            self._calibrator, self._accepted = None, 0
            return None
        if changed or self._calibrator is None:
            self._calibrator, self._accepted = Calibrator(rectifier.rig, self._config.calibrator), 0
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
        return "".join(f"; {doubt}" for doubt in (*doubts, self._depth.remark, repeated) if doubt)

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
        if self._accepted:
            return (
                f"{self._accepted} of {self._config.frames} frames accepted, {seen}: raise timeout_s or "
                f"lower frames; last refusal: {self._last_rejection or 'none'}"
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
