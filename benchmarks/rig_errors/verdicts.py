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

"""What the calibrator says of the pose and of the right camera, and how that is judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator

from ..frames import READABLE
from ..road_pairs import RoadPair
from ..road_verdicts import RoadVerdict, verdict_of
from .angles import AS_IT_IS, Angles, Array, turned_on

NOISE = "noise"  # the term of the pixels' noise alone
NOTHING = np.empty(0)


@dataclass(frozen=True, slots=True, eq=False)
class RigVerdict:
    """What became of one pair whose right camera is turned.

    Attributes:
        road: What became of its pose.
        turn: How its right camera is turned on from where the rig has it, or from where it was recorded.
        alignment: Estimated (pitch, roll, yaw) of the right camera [deg]; empty where there is none.
        alignment_std: Its standard deviations [deg].
        noise_std: Standard deviations of the pose by the noise of the pixels alone [mm, deg, deg]; empty
            where there is none.
        change: Alignment less the one that is expected [deg]; empty where either is not known.
        change_std: Standard deviations to judge the change by [deg].
    """

    road: RoadVerdict
    turn: Angles = AS_IT_IS
    alignment: Array = field(default_factory=NOTHING.copy)
    alignment_std: Array = field(default_factory=NOTHING.copy)
    noise_std: Array = field(default_factory=NOTHING.copy)
    change: Array = field(default_factory=NOTHING.copy)
    change_std: Array = field(default_factory=NOTHING.copy)

    @property
    def faulty(self) -> bool:
        """Whether it was accepted and is wrong or gross."""
        return self.road.wrong or self.road.gross


def alignment_of(result: CalibrationResult) -> tuple[Array, Array]:
    """Return (pitch, roll, yaw) of the right camera and their standard deviations [deg], empty for none."""
    alignment: Any = getattr(result, "alignment", None)  # older versions have none
    if alignment is None:
        return NOTHING, NOTHING
    angles = np.array([alignment.pitch_rad, alignment.roll_rad, alignment.yaw_rad])
    return np.degrees(angles), np.degrees(np.sqrt(np.diag(alignment.covariance)))


def judge(pair: RoadPair, turn: Angles = AS_IT_IS) -> RigVerdict:
    """Calibrate a pair whose right camera is turned in that way."""
    result = Calibrator(pair.rig).add(pair.left, pair.right)
    noise = [term.covariance for term in result.uncertainty if term.name == NOISE]
    noise_std = np.sqrt(np.diag(noise[0])) * READABLE if noise else NOTHING
    return RigVerdict(verdict_of(pair, result), turn, *alignment_of(result), noise_std)


def against_recorded(verdict: RigVerdict, recorded: RigVerdict) -> RigVerdict:
    """Return the verdict with its change against the one of the pair as it was recorded.

    The greater standard deviation of both counts: most of what is uncertain is the same in both.
    """
    expected = turned_on(recorded.alignment, verdict.turn) if len(recorded.alignment) else NOTHING
    return _with_change(verdict, expected, recorded.alignment_std)


def against_truth(verdict: RigVerdict) -> RigVerdict:
    """Return the verdict of a rendered pair with its change against the truth."""
    return _with_change(verdict, verdict.turn.as_array(), np.zeros(3))


def _with_change(verdict: RigVerdict, expected: Array, std: Array) -> RigVerdict:
    if not len(expected) or not len(verdict.alignment):
        return verdict
    return RigVerdict(
        verdict.road,
        verdict.turn,
        verdict.alignment,
        verdict.alignment_std,
        verdict.noise_std,
        verdict.alignment - expected,
        np.maximum(verdict.alignment_std, std),
    )
