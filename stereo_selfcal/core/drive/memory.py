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

"""What is kept of the frames of a drive, and the estimate of the mount by all of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..geometry.uncertainty import total_covariance
from ..lanes.frame_checks import no_frames
from ..numerics.linear import is_covariance
from ..rejection import NotFitted, fitted
from ..results import CalibrationResult, rejected
from .drive import Drive, estimate_drive
from .fusion import fuse_frames
from .motion_between_frames import FrameMotion, estimate_motion
from .rig_alignment import SeenAlignment, drive_of_rig
from .rig_doubt import with_doubt_of_rig
from .right_delay import seen_ahead
from .standing import PlaceOfCar
from .travel import MotionSince, SeenLandmarks, TravelStep, step_between
from .turn_rates import TurnRate, TurnRates

_ROUNDING = 1e-6  # of a sum of terms, over what it is compared with


class DriveMemory:
    """The frames of one drive with one rig. Several threads may add frames and read the estimate.

    Args:
        rig: The rig that all frames come from.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        self._accepted: list[CalibrationResult] = []
        self._steps: list[TravelStep] = []
        self._seen: list[SeenAlignment] = []
        self._previous: SeenLandmarks | None = None
        self._place = PlaceOfCar()
        self._stood = False
        self._not_looked = 0  # accepted frames at the end that say nothing of the place
        self._turn_rates = TurnRates()
        self._last: CalibrationResult | None = None
        self._lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy is made from: everything but the lock."""
        with self._lock:
            lists = {name: list(self.__dict__[name]) for name in ("_accepted", "_steps", "_seen")}
            state = self.__dict__ | lists | {"_turn_rates": deepcopy(self._turn_rates)}
        del state["_lock"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.Lock()

    def remember(self, result: CalibrationResult, moved: MotionSince | None = None) -> CalibrationResult:
        """Add the result of a frame, accepted or not.

        Args:
            result: The result.
            moved: The motion from the landmarks before to those of the result, where it is known already;
                None to estimate it.

        Returns:
            What is kept of it: with whether the car stood, and without what only pictures need.

        Raises:
            ValueError: It is accepted, and its pose, stamp or covariance cannot be right.
        """
        # The points and lines are dropped: they take as much memory as images, and a bag has many frames.
        kept = result.slim().copied() if result.accepted else replace(result, landmarks=None)
        if kept.accepted:
            _check_accepted(kept)
        with self._lock:
            previous, place, stood = self._previous, self._place, self._stood
        motion = None
        if previous is not None and result.landmarks is not None:
            if moved is None or moved.stamp_s != previous.stamp_s:
                moved = MotionSince.between(previous, result.landmarks, self._rig)
            motion = None if moved is None else moved.motion
        step = None if previous is None else fitted(step_between(previous, result, self._rig, motion))
        # A frame that was followed without landmarks says nothing of the place: the car stands as long as it
        # is not seen to have left, and has stood between two frames of one place.
        looked = result.landmarks is not None or not result.known_start
        if looked:
            place = place.followed_by(result.landmarks, self._rig, _known_motion(previous, motion))
            stood = place.stands
        kept = replace(kept, stood=stood)
        with self._lock:
            self._stood = stood
            self._place = place.accepted() if looked and kept.accepted else place
            if looked and stood and self._not_looked:
                between = self._accepted[-self._not_looked :]
                self._accepted[-self._not_looked :] = [replace(each, stood=True) for each in between]
            self._not_looked = 0 if looked else self._not_looked + int(kept.accepted)
            if kept.accepted:
                self._accepted.append(kept)
            if step is not None:
                self._steps.append(step)
            if result.alignment is not None:
                ahead = seen_ahead(result, self._rig)
                self._seen.append(SeenAlignment(result.stamp_s, result.alignment, ahead))
            if result.landmarks is not None:
                self._previous = SeenLandmarks(result.stamp_s, result.landmarks)
            self._last = kept
        return kept

    def note_turn_rate(self, rate: TurnRate) -> None:
        """Add what odometry or a gyroscope says of the turn of the car."""
        with self._lock:
            self._turn_rates.add(rate)

    @property
    def steps(self) -> tuple[TravelStep, ...]:
        """The motion between the frames, where it is seen."""
        with self._lock:
            return tuple(self._steps)

    @property
    def drive(self) -> Drive:
        """The mount over all frames so far: its estimate, and the parts of the drive between its moves."""
        with self._lock:
            accepted, last = list(self._accepted), self._last
            seen = list(self._seen)
            steps = [step for step in self._steps if not self._turn_rates.contradict(step)]
        if last is None:
            return Drive(rejected(no_frames()))
        told = drive_of_rig(accepted, seen, steps, self._rig)
        fused = fuse_frames(accepted, self._rig).copied() if accepted else last
        fused = replace(fused, alignment=told.alignment, delay=told.delay)
        if accepted:
            fused = with_doubt_of_rig(fused, self._rig)
        return estimate_drive(accepted, self._rig, fused, steps)


def _known_motion(
    previous: SeenLandmarks | None, motion: FrameMotion | NotFitted | None
) -> Callable[[Landmarks, Landmarks, StereoRig], FrameMotion | NotFitted]:
    """Return what estimates motions; that from the landmarks before is known already."""

    def estimate(before: Landmarks, after: Landmarks, rig: StereoRig) -> FrameMotion | NotFitted:
        if motion is not None and previous is not None and before is previous.landmarks:
            return motion
        return estimate_motion(before, after, rig)

    return estimate


def _check_accepted(result: CalibrationResult) -> None:
    """Refuse the result of a frame that would spoil the mean of all.

    Raises:
        ValueError: Its pose or its stamp is not finite, its height not positive, its covariance not positive
            definite, or not the sum of its terms.
    """
    covariance, pose = result.covariance, result.extrinsics
    if covariance is None or not is_covariance(covariance):
        raise ValueError(f"the covariance {covariance} of a result is not positive definite")
    if pose is None or not np.all(np.isfinite([result.stamp_s, *pose.as_array()])) or pose.height_m <= 0.0:
        raise ValueError(f"the pose {pose} at {result.stamp_s} s of a result cannot be right")
    if result.uncertainty:
        apart = np.abs(total_covariance(result.uncertainty) - covariance)
        scale = np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
        if not np.all(apart <= _ROUNDING * scale):
            raise ValueError("the terms of a result do not add up to its covariance")
