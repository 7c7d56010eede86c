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

"""The pose over the road at this moment, by the known camera.

A calibration tells the mount: its pose, and how the right camera is turned. So a frame needs no search. The
surface of the road is aligned from the expected pose on; where a road is bare, its lines are followed. What
these tell is read by the same gates, and the covariance is that of a frame. Where they do not confirm the
known camera, the frame is looked at cold, as if nothing were known, and so is a frame now and then.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from .calibrator import Calibrator
from .camera.rig import StereoRig
from .camera.working_size import WorkingSize
from .config import CORRECT_ALL, CORRECT_NOTHING, CalibratorConfig
from .estimators.texture_search import SEARCH_PITCH_RAD
from .evidence.camera_turn import CameraTurn, turned_back
from .evidence.camera_yaw import YawTold, yaw_posterior
from .evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis, clipped_share
from .evidence.measurements import Reading, pose_difference
from .evidence.road_surface import RoadSurface, surface_from
from .geometry.alignment import Alignment
from .geometry.pose import Extrinsics
from .lanes import frame_checks
from .lanes.stripe_points import StripePoints
from .rejection import Bound, Rejection, RejectReason
from .results import CalibrationResult, rejected, result_of
from .road.priors import HARD_RIDE_STD, RIDE_MEMORY_S
from .search.attempt import Attempt
from .search.known import KnownCamera
from .search.known_lines import MOST_SIGMAS
from .search.refusal import FIND_ROAD
from .search.road_lines import RoadLines, first_road_row
from .search.solve import solve
from .search.strategy import choose
from .types import Array, Image

# A frame is looked at cold so long after the last cold one. The watch does so more often; without it, this
# costs a tenth of what following costs.
COLD_EVERY_S = 5.0
# Where frames are not confirmed, one is looked at cold so long after the last: as often as the watch does.
COLD_APART_S = 2.0
# A cold frame is compared with a followed one whose stamp differs by no more than a frame of 10 Hz.
_SAME_MOMENT_S = 0.1
_REMEMBERED = 64  # followed frames that a cold one may come to: six seconds of 10 Hz
# A road that needs more blur for its texture is taken for one that still does for so long.
_SAME_ROAD_S = 1.0
_UNKNOWN_ALIGNMENT = Alignment.from_values({})
_LINES_LOST = Rejection(
    RejectReason.NO_LINES_FOUND,
    "lines of the frame before that are found again",
    0,
    Bound.LEAST,
    2,
    "",
    FIND_ROAD,
)
_MOVED = "call ~/calibrate where the camera was moved, else drive on"


@dataclass(frozen=True, slots=True, eq=False)
class RoadPose:
    """A pose over the road.

    Attributes:
        stamp_s: Time stamp of its frame [s].
        pose: The pose.
        covariance: (3, 3) of it.
    """

    stamp_s: float
    pose: Extrinsics
    covariance: Array

    @classmethod
    def of(cls, result: CalibrationResult) -> RoadPose | None:
        """Return that of an accepted frame; None of a refused one."""
        if result.extrinsics is None or result.covariance is None:
            return None
        return cls(result.stamp_s, result.extrinsics, result.covariance)

    def difference(self, other: RoadPose, what: str, moved_std: Array) -> Reading:
        """Return how far another pose differs, and what both uncertainties and a motion between explain.

        Args:
            other: The other pose.
            what: Sentence of the reading, as of :func:`.pose_difference`.
            moved_std: (3,) standard deviations of the motion [m, rad, rad].
        """
        variance = np.diag(self.covariance + other.covariance) + np.square(moved_std)
        difference = other.pose.as_array() - self.pose.as_array()
        return pose_difference(what, difference, MOST_SIGMAS * np.sqrt(variance))

    def motion_to(self, stamp_s: float) -> Array:
        """Return the standard deviations (3,) of what a car does from here to another time [s]."""
        # Of a stationary motion whose correlation falls by 1 / e in its memory.
        moved = 2.0 - 2.0 * math.exp(-abs(stamp_s - self.stamp_s) / RIDE_MEMORY_S)
        std: Array = math.sqrt(moved) * np.array(HARD_RIDE_STD)
        return std


class RoadTracker:
    """Follows the pose over the road from frame to frame of a rig whose mount is known. One thread at a time.

    Args:
        rig: The rig all frames come from.
        config: Settings.
        mount: The calibration of the mount, with the alignment of the right camera where that is known.

    Raises:
        ValueError: The mount is a refusal.
    """

    def __init__(self, rig: StereoRig, config: CalibratorConfig, mount: CalibrationResult) -> None:
        at = RoadPose.of(mount)
        if at is None:
            raise ValueError(f"a road is followed by an accepted calibration of the mount: {mount.message}")
        self._images_rig, self._size = rig, WorkingSize.of(rig)
        rig = self._size.rig
        self._rig, self._config, self._mount = rig, config, at
        self._calibrator = Calibrator(rig, config)
        alignment = mount.alignment or _UNKNOWN_ALIGNMENT
        self._turn = CameraTurn.known(alignment, rig)
        self._first_row = first_road_row(at.pose, rig)
        self._yaw_told = _yaw_of(alignment)
        correct_yaw = config.alignment.correct == CORRECT_ALL
        self._yaw_rad = (
            yaw_posterior(self._yaw_told, None, rig, calibrated=True).yaw_rad if correct_yaw else 0.0
        )
        self._followed: deque[RoadPose] = deque(maxlen=_REMEMBERED)
        self._alignment = alignment
        self._known: KnownCamera | None = None
        self._lines: RoadLines | None = None
        self._attempt, self._attempt_s = 0, -math.inf
        self._by_lines = False
        self._cold_s: float | None = None

    def follow(
        self, left: Image, right: Image, stamp_s: float = 0.0, stamp_difference_s: float = 0.0
    ) -> CalibrationResult:
        """Return the pose over the road of a frame, or why it is not known.

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.
            stamp_s: Time stamp of the frame [s].
            stamp_difference_s: Stamp of the right image minus that of the left one [s].
        """
        refusal = frame_checks.check_images(left, right, self._images_rig)
        if refusal:
            return rejected(refusal, stamp_s)
        images = self._size.images((np.asarray(left), np.asarray(right)))
        since_s = self._since_cold_s(stamp_s)
        guard = since_s >= COLD_EVERY_S
        result = None if guard else self._from_known(images, stamp_s, stamp_difference_s)
        if result is None or not (result.accepted or since_s < COLD_APART_S):
            result = self._cold(images, stamp_s, stamp_difference_s, guard=guard)
        road = RoadPose.of(result)
        if road is not None:
            self._followed.append(road)
        return result.in_images(self._size)

    def compare(self, cold: CalibrationResult) -> bool:
        """Compare a cold look at a frame with what was followed; return whether it agrees.

        Where it does not, what is known of the road is forgotten, and the next frame is looked at cold.

        Args:
            cold: Result of a frame that was looked at as if nothing were known. A refused one, and one of
                another time than those followed, tell nothing.
        """
        road = RoadPose.of(cold)
        near = min(self._followed, key=lambda each: abs(each.stamp_s - cold.stamp_s), default=None)
        if road is None or near is None or abs(near.stamp_s - cold.stamp_s) > _SAME_MOMENT_S:
            return True
        if near.difference(road, "", near.motion_to(road.stamp_s)).passed:
            self._cold_s = max(cold.stamp_s, self._cold_s or cold.stamp_s)
            return True
        self._forget()
        return False

    def _since_cold_s(self, stamp_s: float) -> float:
        """Return the time since the last cold look; infinite without one, or where time has jumped."""
        last_s = self._followed[-1].stamp_s if self._followed else -math.inf
        if self._cold_s is None:
            return math.inf
        if stamp_s < max(self._cold_s, last_s) - _SAME_MOMENT_S:
            self._forget()
            return math.inf
        return stamp_s - self._cold_s

    def _forget(self) -> None:
        self._followed.clear()
        self._known, self._lines, self._by_lines, self._cold_s = None, None, False, None

    def _cold(
        self, images: tuple[Image, Image], stamp_s: float, apart_s: float, *, guard: bool
    ) -> CalibrationResult:
        """Look at a frame as if nothing were known: as a guard, or as it is not confirmed."""
        result = self._calibrator.calibrate_frame(*images, stamp_s, apart_s)
        self._cold_s = stamp_s
        chosen = choose(result.attempts)
        # A guard that refuses what was followed takes the lines away; a frame that shows none does not.
        if result.accepted or guard:
            rig, config = self._rig, self._config
            self._known = KnownCamera.after(chosen, self._alignment, stamp_s, rig, config)
            self._lines = RoadLines.of(chosen, stamp_s, self._rig)
        self._by_lines = self._lines is not None and chosen is not None and chosen.hypothesis.texture is None
        return result

    def _from_known(self, images: tuple[Image, Image], stamp_s: float, apart_s: float) -> CalibrationResult:
        """Look at a frame from the last cold one on; where that does not confirm it, from the mount on."""
        known = self._known
        if known is not None and stamp_s - known.stamp_s <= COLD_EVERY_S:
            attempt = known.follow(images, stamp_s, apart_s)
            if attempt is not None:
                return replace(result_of(attempt, (attempt,), stamp_s), known_start=True)
        turn = self._turn
        if self._config.alignment.correct != CORRECT_NOTHING:
            images, turn = turned_back(images, self._rig, turn, self._yaw_rad, self._first_row)
        frame = FrameObservations(
            images,
            (StripePoints.none(), StripePoints.none()),
            clipped_share(images),
            turn=turn,
            yaw_told=tuple(replace(each, yaw_rad=each.yaw_rad - self._yaw_rad) for each in self._yaw_told),
            yaw_corrected_rad=self._yaw_rad,
            stamp_difference_s=apart_s,
        ).with_yaw(None, self._rig)
        answers: list[_AnswerOfWay] = []
        ways = self._by_its_lines, self._by_its_surface
        for way in ways if self._by_lines else ways[::-1]:
            answer = way(frame, stamp_s)
            if answer is None:
                continue
            answers.append(answer)
            if answer.rejection is None:
                self._by_lines = way == self._by_its_lines
                break
        attempts = tuple(answer.attempt for answer in answers if answer.attempt is not None)
        refusals = [answer.rejection for answer in answers if answer.rejection is not None]
        if answers and answers[-1].rejection is None:
            return replace(result_of(answers[-1].attempt, attempts, stamp_s), known_start=True)
        refusal = refusals[0] if refusals else _LINES_LOST
        return rejected(refusal, stamp_s, attempts=attempts, known_start=True)

    def _by_its_surface(self, frame: FrameObservations, stamp_s: float) -> _AnswerOfWay | None:
        """Return what the road surface tells, from the first start from which it is aligned."""
        if not self._config.texture.check:
            return None
        surfaces: list[RoadSurface] = []
        if not 0.0 <= stamp_s - self._attempt_s < _SAME_ROAD_S:
            self._attempt, self._attempt_s = 0, stamp_s
        expected = self._expected(stamp_s)
        # A car that brakes or drives off: the range that is searched from one start begins where that of the
        # other ends.
        for step in (0, 1, -1):
            start = replace(expected, pitch_rad=expected.pitch_rad + 2.0 * step * SEARCH_PITCH_RAD)
            surfaces.append(surface_from(start, frame.images, self._rig, None, self._attempt))
            if surfaces[-1].located is not None:
                break
        lacking = surfaces[-1].lacking and surfaces[0].lacking
        if lacking is not None:
            what = f"the road surface is not seen from the known camera: {lacking.what}"
            numbers = lacking.value, lacking.bound, lacking.limit, lacking.unit
            return _AnswerOfWay(None, Rejection(RejectReason.ROAD_WITHOUT_TEXTURE, what, *numbers, FIND_ROAD))
        located = surfaces[-1].located
        assert located is not None  # nothing is lacking
        self._attempt = located.attempt
        hypothesis = Hypothesis(FoundBy.SURFACE, None, texture=located)
        attempt = solve(hypothesis, replace(frame, surface=surfaces[-1]), self._rig, self._config)
        what = "the road is seen under a pose that differs from that of the mount in {axis} by {value}"
        return _answer_of_way(attempt, stamp_s, self._mount, what, np.array(HARD_RIDE_STD))

    def _expected(self, stamp_s: float) -> Extrinsics:
        """Return the pose that is most probable: the last one, which fades into that of the mount."""
        expected = self._mount.pose.as_array()
        if self._followed:
            last = self._followed[-1]
            lasts = math.exp(-abs(stamp_s - last.stamp_s) / RIDE_MEMORY_S)
            expected = expected + lasts * (last.pose.as_array() - expected)
        return Extrinsics.from_array(expected)

    def _by_its_lines(self, frame: FrameObservations, stamp_s: float) -> _AnswerOfWay | None:
        """Return what the lines of the road tell; None where none were seen lately."""
        lines = self._lines
        if lines is None or self._config.texture.required:
            return None
        if stamp_s - lines.camera.stamp_s > COLD_EVERY_S:
            return None
        before = RoadPose(lines.camera.stamp_s, lines.camera.pose, lines.camera.covariance)
        what = "the lines of the road show a pose that differs from the one before in {axis} by {value}"
        first: _AnswerOfWay | None = None
        for attempt, after in lines.attempts(frame, stamp_s, self._rig, self._config):
            answer = _answer_of_way(attempt, stamp_s, before, what, before.motion_to(stamp_s))
            if answer.rejection is None and after is not None:
                self._lines = after
                return answer
            first = first or replace(answer, rejection=answer.rejection or _LINES_LOST)
        return first or _AnswerOfWay(None, _LINES_LOST)


@dataclass(frozen=True, slots=True, eq=False)
class _AnswerOfWay:
    """What one way to look at a frame has found.

    Attributes:
        attempt: The attempt; None where it came to none.
        rejection: Why it is not the result; None where it is.
    """

    attempt: Attempt | None
    rejection: Rejection | None = None


def _answer_of_way(
    attempt: Attempt, stamp_s: float, before: RoadPose, what: str, moved_std: Array
) -> _AnswerOfWay:
    """Return an attempt, refused where no motion explains how its pose differs from one before.

    Args:
        attempt: The attempt.
        stamp_s: Time stamp of the frame [s].
        before: The pose before.
        what: Sentence of the refusal, as of :func:`.pose_difference`.
        moved_std: (3,) standard deviations of the motion [m, rad, rad].
    """
    if attempt.estimate is None or not attempt.accepted:
        return _AnswerOfWay(attempt, attempt.rejection or _not_fitted(attempt))
    now = RoadPose(stamp_s, attempt.estimate.pose, attempt.estimate.covariance)
    reading = before.difference(now, what, moved_std)
    if reading.passed:
        return _AnswerOfWay(attempt)
    numbers = reading.value, reading.bound, reading.threshold, reading.unit
    return _AnswerOfWay(attempt, Rejection(RejectReason.TEXTURE_DISAGREES, reading.what, *numbers, _MOVED))


def _not_fitted(attempt: Attempt) -> Rejection:
    """Refuse a frame in which an estimator has given up."""
    what = f"estimates from the known camera on: {{value}}, as {attempt.message}"
    return Rejection(RejectReason.ESTIMATE_UNCERTAIN, what, 0, Bound.LEAST, 1, "", FIND_ROAD)


def _yaw_of(alignment: Alignment) -> tuple[YawTold, ...]:
    """Return the yaw of the right camera as frames before have told it; () where they have not."""
    if not alignment.known()[2]:
        return ()
    return (YawTold(alignment.yaw_rad, float(alignment.std[2])),)
