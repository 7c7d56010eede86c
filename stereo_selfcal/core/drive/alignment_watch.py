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

"""Watch over the alignment of the right camera: where it is now, and whether it has left the calibration's.

Each frame tells the alignment anew. It varies slowly, as mounts and lenses warm up, and jumps with a bump. A
Kalman filter with a random walk follows it (R. E. Kalman, "A new approach to linear filtering and prediction
problems", 1960); a frame far away from it counts less (P. J. Huber, "Robust estimation of a location
parameter", 1964), so that one wrong frame moves it little, and several move it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..alignment_verdict import GOOD_LIMITS_RAD
from ..evidence.told_alignment import UNTOLD_VARIANCES, told_variances
from ..geometry.alignment import ALIGNMENT_NAMES, Alignment
from ..road.priors import CALIBRATED_TURN_STD_RAD
from ..tolerances import EXCLUDED_SIGMAS
from ..types import Array

# Errors of frames are alike for so long: they show the same road, paint and trees. The watch over the pose
# compares means of this length, too.
CORRELATION_S = 10.0
_LEAST_STEP_S = 0.01  # of two frames with one stamp
# A rig that warms up turns within this time by about what calibrations leave. Variance by second [rad^2/s].
_WARMING_S = 1800.0
_WALK: Array = np.diag(np.square(CALIBRATED_TURN_STD_RAD)) / _WARMING_S
# Beyond so many standard deviations a frame counts less (Huber's constant is 1.3; frames are rarely wrong).
_HUBER_SIGMAS = 3.0
_FEWEST_FRAMES = 5  # as the drift test of the pose
# An alarm ends where this part of the limit is not reached any more, so that it does not flicker.
_EASED = 0.5


class AlignmentState(Enum):
    """Whether the alignment is that of the calibration; ``str(state)`` is a stable snake_case word."""

    NOT_WATCHED = "not_watched"
    STEADY = "steady"
    DRIFTED = "drifted"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentFinding:
    """What the watch has found.

    Attributes:
        state: Whether the alignment is that of the calibration.
        present: The alignment now; None before the first frame.
        frames: Number of frames behind it.
        message: One sentence: by how much which angle has changed, or "".
    """

    state: AlignmentState = AlignmentState.NOT_WATCHED
    present: Alignment | None = None
    frames: int = 0
    message: str = ""


class AlignmentWatch:
    """Follows the alignment over frames, and compares it with that of a calibration."""

    def __init__(self) -> None:
        self.start(None)

    def start(self, reference: Alignment | None) -> None:
        """Begin anew.

        Args:
            reference: Alignment of the calibration that is watched; None where there is none, or where it
                does not say.
        """
        self._reference = reference
        self._mean: Array = np.zeros(3)
        self._information: Array = np.zeros((3, 3))
        self._frames = 0
        self._last_s = -math.inf
        self._drifted = np.zeros(3, dtype=bool)

    def add(self, alignment: Alignment | None, stamp_s: float) -> AlignmentFinding:
        """Take a frame into account.

        Args:
            alignment: Alignment that it tells; None where it tells none.
            stamp_s: Its stamp [s]. One before that of the last frame begins another drive.
        """
        if alignment is None:
            return self.finding
        elapsed_s = stamp_s - self._last_s
        if elapsed_s < 0.0:
            elapsed_s = CORRELATION_S
        told = _information(alignment) * min(max(elapsed_s, _LEAST_STEP_S) / CORRELATION_S, 1.0)
        if not np.any(told):
            return self.finding
        self._last_s = stamp_s
        self._forget(elapsed_s)
        told *= self._weight(alignment, told)
        self._information = self._information + told
        step = told @ (alignment.as_array() - self._mean)
        covariance = _covariance(self._information)
        self._mean = self._mean + np.where(np.isfinite(covariance), covariance, 0.0) @ step
        self._frames += 1
        self._judge()
        return self.finding

    @property
    def finding(self) -> AlignmentFinding:
        """What is known now."""
        if not self._frames:
            return AlignmentFinding()
        state = AlignmentState.DRIFTED if self._drifted.any() else AlignmentState.STEADY
        if self._reference is None or self._frames < _FEWEST_FRAMES:
            state = AlignmentState.NOT_WATCHED
        return AlignmentFinding(state, self._present(), self._frames, self._message())

    def _present(self) -> Alignment:
        pitch_rad, roll_rad, yaw_rad = map(float, self._mean)
        return Alignment(pitch_rad, roll_rad, yaw_rad, _covariance(self._information))

    def _forget(self, elapsed_s: float) -> None:
        """Let the alignment walk: what was known is known less well."""
        if self._frames and math.isfinite(elapsed_s):
            known = np.linalg.inv(np.eye(3) + self._information @ _WALK * elapsed_s) @ self._information
            self._information = (known + known.T) / 2.0

    def _weight(self, alignment: Alignment, told: Array) -> float:
        """Return how much a frame counts, 0 ... 1: less, the farther away it is."""
        if not self._frames:
            return 1.0
        variances = np.diag(_covariance(self._information)) + np.diag(_covariance(told))
        sigmas = np.abs(alignment.as_array() - self._mean) / np.sqrt(variances)
        return min(1.0, _HUBER_SIGMAS / max(float(np.max(sigmas)), _HUBER_SIGMAS))

    def _judge(self) -> None:
        """Raise the alarm for angles that have changed, and end it for those that have come back."""
        if self._reference is None or self._frames < _FEWEST_FRAMES:
            return
        change, std = self._change()
        raised = (change > GOOD_LIMITS_RAD) & (change > EXCLUDED_SIGMAS * std)
        stays = (change > _EASED * GOOD_LIMITS_RAD) & (change > _HUBER_SIGMAS * std)
        self._drifted = raised | (self._drifted & stays)

    def _change(self) -> tuple[Array, Array]:
        """Return by how much each angle has changed (3,), and the standard deviations."""
        assert self._reference is not None
        change: Array = np.abs(self._mean - self._reference.as_array())
        std: Array = np.hypot(self._reference.std, np.sqrt(np.diag(_covariance(self._information))))
        return change, std

    def _message(self) -> str:
        if self._reference is None or not self._drifted.any():
            return ""
        changes, stds = self._change()
        signed = np.degrees(self._mean - self._reference.as_array())
        index = int(np.argmax(np.where(self._drifted, changes / stds, 0.0)))
        name = ALIGNMENT_NAMES[index].rpartition("_")[0]
        return (
            f"the right camera has turned in {name} by {signed[index]:+.3f} deg since the calibration, "
            f"{changes[index] / stds[index]:.1f} standard deviations, at most "
            f"{math.degrees(GOOD_LIMITS_RAD[index]):.2f} deg allowed; calibrate anew"
        )


def _information(alignment: Alignment) -> Array:
    """Return the information (3, 3) of a frame; an angle that may be anything gives none."""
    telling = np.isfinite(told_variances(alignment))
    information = np.zeros((3, 3))
    if telling.any():
        chosen = np.ix_(telling, telling)
        # What it would have without being told anything is no information: the angle lies within a range.
        told = np.linalg.inv(alignment.covariance[chosen]) - np.diag(1.0 / UNTOLD_VARIANCES[telling])
        values, vectors = np.linalg.eigh((told + told.T) / 2.0)
        information[chosen] = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return information


def _covariance(information: Array) -> Array:
    """Return the covariance (3, 3) of an information; the variance of what it does not tell is infinite."""
    told = np.diag(information) > 0.0
    covariance = np.diag(np.where(told, 0.0, np.inf))
    if told.any():
        chosen = np.ix_(told, told)
        covariance[chosen] = np.linalg.inv(information[chosen])
    return covariance
