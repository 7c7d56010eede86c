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

"""The calibrator: results of single frames, and the fused estimate. Node and replay both use it."""

from __future__ import annotations

import math
import numbers
import threading
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from .camera.rig import StereoRig
from .camera.working_size import WorkingSize
from .config import CORRECT_ALL, CalibratorConfig
from .drive.drive import Drive
from .drive.memory import DriveMemory
from .drive.travel import MotionSince, TravelStep
from .drive.turn_rates import TurnRate
from .errors import shortened
from .evidence.frame_evidence import FrameObservations
from .evidence.road_surface import SurfaceCells
from .geometry.alignment import Alignment
from .lanes import frame_checks
from .lanes.hypotheses import NoPattern, find_hypotheses, unused_lines
from .lanes.lane_pair import LanePattern
from .lanes.matching import Matches
from .results import CalibrationResult, caught, rejected, result_of
from .road.priors import STRIPES_PARALLEL_PART, TURNED_STD_RAD
from .search.attempt import Attempt, coarse_pose
from .search.diagnosis import diagnose, lateness_of_refused, not_synchronised
from .search.known import KnownCamera
from .search.parts_of_time import PartsOfTime
from .search.solve import solve
from .search.strategy import FrameSearch, choose, turn_under_pose
from .types import Image


@dataclass(frozen=True, slots=True, eq=False)
class _FrameLook:
    """One look at a frame: its observations, the hypotheses about it, and what became of them."""

    frame: FrameObservations
    search: FrameSearch
    attempts: list[Attempt]


class Calibrator:
    """Stateful calibrator of one rig: add frames, read the fused estimate.

    Attributes:
        rig: The rig all frames come from.
        config: Settings.
    """

    def __init__(self, rig: StereoRig, config: CalibratorConfig | None = None) -> None:
        self.rig = rig
        self.config = config or CalibratorConfig()
        self._size = WorkingSize.of(rig)
        self._memory = DriveMemory(rig)
        self._parts = PartsOfTime(self.config.known.cold_every_s)
        self._lock = threading.Lock()  # of the parts; frames are calibrated without it

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy is made from: everything but the lock."""
        with self._lock:
            state = self.__dict__ | {"_parts": copy(self._parts)}
        del state["_lock"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.Lock()

    def add(
        self, left: Image, right: Image, stamp_s: float = 0.0, stamp_difference_s: float = 0.0
    ) -> CalibrationResult:
        """Calibrate one frame and remember it when it is accepted.

        A frame soon after an accepted one starts from that one's result (:class:`.KnownCamera`), and
        otherwise the result depends on this frame alone; with the setting ``known.cold_every_s`` of 0 it
        always does. The random numbers start from the seed for each frame. What was not foreseen refuses the
        frame (``internal_error``), and the result has its traceback. Several threads may add frames and read
        the estimate.

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.
            stamp_s: Time stamp of the frame [s].
            stamp_difference_s: Stamp of the right image minus that of the left one [s].

        Raises:
            TypeError: A time is no number.
            ValueError: It is not finite.
        """
        stamp_s = _checked_time("stamp_s", stamp_s)
        apart_s = _checked_time("stamp_difference_s", stamp_difference_s)
        result = self.calibrate_next_or_refuse(left, right, stamp_s, apart_s)
        return replace(result, stood=self.remember(result).stood)

    def calibrate_next_or_refuse(
        self, left: Image, right: Image, stamp_s: float = 0.0, stamp_difference_s: float = 0.0
    ) -> CalibrationResult:
        """Calibrate the next frame as :meth:`calibrate_next`; what was not foreseen refuses it."""
        return caught(lambda: self.calibrate_next(left, right, stamp_s, stamp_difference_s), stamp_s)

    def calibrate_next(
        self, left: Image, right: Image, stamp_s: float = 0.0, stamp_difference_s: float = 0.0
    ) -> CalibrationResult:
        """Calibrate the next frame of a recording, from the frame before where that one tells the camera.

        Arguments and result are those of :meth:`add`. It is not added to the estimate, and every exception
        passes.
        """
        with self._lock:
            known = self._parts.of_next(stamp_s)
        result = None
        if known is not None:
            result = self._follow(known, left, right, stamp_s, stamp_difference_s)
        if result is None:
            result = self.calibrate_frame(left, right, stamp_s, stamp_difference_s)
            cold = choose(result.attempts)
            ahead = 0.0 if result.landmarks is None else result.landmarks.ahead
            # A turn that was told under the pose alone, and is usual, was left in the images.
            corrected = cold is None or cold.rows is None
            alignment, rig, config = result.alignment, self._size.rig, self.config
            known = KnownCamera.after(cold, alignment, stamp_s, rig, config, ahead, corrects=corrected)
        with self._lock:
            self._parts.note(known)
        return result

    def _follow(
        self, known: KnownCamera, left: Image, right: Image, stamp_s: float, stamp_difference_s: float
    ) -> CalibrationResult | None:
        """Return the result of a frame by the known camera; None where it is to be looked at cold."""
        if frame_checks.check_images(left, right, self.rig):
            return None
        images = self._size.images((np.asarray(left), np.asarray(right)))
        attempt = known.follow(images, stamp_s, stamp_difference_s)
        if attempt is None:
            return None
        result = result_of(attempt, (attempt,), stamp_s)
        return replace(
            result,
            known_start=True,
            stamp_difference_s=stamp_difference_s,
            landmarks=known.landmarks(images, stamp_s),
        ).in_images(self._size)

    def remember(self, result: CalibrationResult, moved: MotionSince | None = None) -> CalibrationResult:
        """Add the result of a frame of this rig to the estimate, in whichever process it was calibrated.

        Args:
            result: Result of :meth:`calibrate_frame`, of this calibrator or of one with the same settings.
            moved: The motion to it where it is known already; None to estimate it.

        Returns:
            What is kept of it: with whether the car stood, and without what only pictures need.

        Raises:
            ValueError: It is accepted, and its pose, stamp or covariance cannot be right.
        """
        return self._memory.remember(result, moved)

    def note_turn_rate(self, rate: TurnRate) -> None:
        """Add what odometry or a gyroscope says of the turn of the car."""
        self._memory.note_turn_rate(rate)

    @property
    def estimate(self) -> CalibrationResult:
        """The mount by all accepted frames so far; the last rejection when none was accepted.

        Its uncertainty holds what the motion of the car leaves of a mean over time. That of one frame of a
        moving car is as large as the usual motion of cars.
        """
        return self.drive.estimate

    @property
    def drive(self) -> Drive:
        """The mount over all frames so far: its estimate, and the parts of the drive between its moves."""
        return self._memory.drive

    @property
    def travel_steps(self) -> tuple[TravelStep, ...]:
        """The motion of the car between all frames so far, accepted or not, where it is seen."""
        return self._memory.steps

    def calibrate_frame(
        self,
        left: Image,
        right: Image,
        stamp_s: float = 0.0,
        stamp_difference_s: float = 0.0,
    ) -> CalibrationResult:
        """Calibrate one frame without adding it to the estimate, and let every exception pass.

        The other arguments and the result are those of :meth:`add`. The hypotheses about its lines are solved
        one after the other, until one is accepted.

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.
            stamp_s: Time stamp of the frame [s].
            stamp_difference_s: Stamp of the right image minus that of the left one [s].
        """
        refusal = frame_checks.check_images(left, right, self.rig)
        if refusal:
            return rejected(refusal, stamp_s)
        rig = self._size.rig
        # Of plain arrays, whatever was derived from them.
        images = self._size.images((np.asarray(left), np.asarray(right)))
        look = self._look(images, stamp_difference_s)
        frame, search, attempts = look.frame, look.search, look.attempts
        chosen = choose(attempts)
        result = result_of(chosen, attempts, stamp_s)
        lines = search.lines
        if chosen is None or not chosen.accepted:
            refusal, pattern = search.refusal(attempts)
            cause = diagnose(refusal, lines, pattern, frame, rig, self.config)
            late = lateness_of_refused(cause, chosen, frame, rig)
            cause = not_synchronised(cause, late)
            result = replace(result, rejection=cause, message=cause.message, pattern=pattern, lateness=late)
        result = replace(
            result,
            alignment=_alignment(frame, chosen, rig),
            landmarks=frame.turn.landmarks,
            stamp_difference_s=stamp_difference_s,
        )
        if chosen is None:
            result = _with_what_was_seen(result, lines.matches, frame)
        result = replace(result, unused_lines=unused_lines(lines, result.pattern, result.lane_line))
        return result.in_images(self._size)

    def _look(self, images: tuple[Image, Image], stamp_difference_s: float) -> _FrameLook:
        """Look at a frame; once more where only the pose over the road shows how the camera has turned."""
        observed = partial(
            FrameObservations.from_images,
            images,
            self._size.rig,
            self.config,
            stamp_difference_s=stamp_difference_s,
        )
        look = self._search(observed())
        turn = turn_under_pose(look.attempts, look.frame, self._size.rig, self.config)
        if turn is not None and turn.is_usual:
            look = replace(look, frame=replace(look.frame, turn=turn))
        elif turn is not None:
            look = self._search(observed(turn))
        if self.config.alignment.correct == CORRECT_ALL:
            yaw = _as_told(look.frame, choose(look.attempts)).yaw_left(self._size.rig)
            look = self._search(observed(look.frame.turn, yaw.yaw_rad))
        return look

    def _search(self, frame: FrameObservations) -> _FrameLook:
        """Solve the hypotheses about a frame, one after the other, until one is accepted."""
        search = FrameSearch(frame, self._size.rig, self.config)
        attempts: list[Attempt] = []
        for hypothesis in search.hypotheses(attempts):
            attempts.append(solve(hypothesis, frame, self._size.rig, self.config))
        return _FrameLook(frame, search, attempts)

    def extract(self, left: Image, right: Image) -> LanePattern | NoPattern:
        """Extract the calibration pattern of one frame (paper section 2.2).

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.

        Returns:
            The two lane boundaries in both images, sampled; or why there are none.
        """
        refusal = frame_checks.check_images(left, right, self.rig)
        if refusal:
            return NoPattern(refusal)
        images, rig = self._size.images((left, right)), self._size.rig
        frame = FrameObservations.from_images(images, rig, self.config)
        found = find_hypotheses(frame.points, frame.images, rig, self.config).patterns
        if isinstance(found, list):
            return found[0].in_images(self._size)
        return replace(found, pattern=None if found.pattern is None else found.pattern.in_images(self._size))


def _alignment(frame: FrameObservations, chosen: Attempt | None, rig: StereoRig) -> Alignment:
    """Return how the right camera is turned: by the rows, and by all that tells its yaw."""
    told = _as_told(frame, chosen)
    if chosen is not None and chosen.accepted and _in_whole_image(chosen):
        # Stripes that have passed all gates are paint on one road, and parallel as such.
        certain = tuple(
            replace(each, certainty=1.0) if each.certainty == STRIPES_PARALLEL_PART else each
            for each in told.yaw_told
        )
        told = replace(told, yaw_told=certain)
    yaw = told.yaw_left(rig, calibrated=False)
    covariance = np.zeros((3, 3))
    # Where rows were not compared, calibrations may have left anything.
    covariance[:2, :2] = frame.turn.covariance if frame.turn.seen else np.eye(2) * TURNED_STD_RAD**2
    covariance[2, 2] = yaw.std_rad**2
    whole_yaw = frame.yaw_corrected_rad + yaw.yaw_rad
    unexplained_rad = frame.turn.distortion_px / rig.fx if frame.turn.points is not None else 0.0
    return Alignment(
        frame.turn.pitch_rad,
        frame.turn.roll_rad,
        whole_yaw,
        covariance,
        unexplained_rad=unexplained_rad,
        yaw_corrected_rad=frame.yaw_corrected_rad,
    )


def _in_whole_image(attempt: Attempt) -> bool:
    """Whether an attempt is one at two lines that were found without the road surface."""
    return attempt.pattern is not None and attempt.hypothesis.texture is None


def _as_told(frame: FrameObservations, chosen: Attempt | None) -> FrameObservations:
    """Return the observations with what the lines of the chosen attempt tell of the yaw."""
    return frame if chosen is None or not chosen.yaw_told else replace(frame, yaw_told=chosen.yaw_told)


def _with_what_was_seen(
    result: CalibrationResult, matches: Matches, frame: FrameObservations
) -> CalibrationResult:
    """Return the result of a frame without an estimate, with the line and the part of the road it shows."""
    in_both = [match for side in matches for match in side]
    clearest = max(in_both, key=lambda match: match.votes, default=None)
    return replace(
        result,
        stages=coarse_pose(frame).as_dict(),
        surface=None if frame.surface is None else SurfaceCells.of(frame.surface.texture),
        lane_line=None if clearest is None or result.pattern is not None else clearest.left.line,
    )


def _checked_time(name: str, time_s: float) -> float:
    """Return a time as a float.

    Raises:
        TypeError: It is no number.
        ValueError: It is not finite.
    """
    if isinstance(time_s, bool) or not isinstance(time_s, numbers.Real):
        raise TypeError(f"{name} is {shortened(time_s)}: a number of seconds is needed")
    value = float(time_s)
    if not math.isfinite(value):
        raise ValueError(f"{name} is {value}: a finite number of seconds is needed")
    return value


def calibrate(
    left: Image, right: Image, rig: StereoRig, seed: int = 0, config: CalibratorConfig | None = None
) -> CalibrationResult:
    """Calibrate one stereo frame.

    Args:
        left: (H, W) uint8 rectified image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        seed: Seed of the random numbers; same input and seed, same result.
        config: Settings; its seed is replaced by ``seed``.
    """
    return Calibrator(rig, replace(config or CalibratorConfig(), seed=seed)).add(left, right)
