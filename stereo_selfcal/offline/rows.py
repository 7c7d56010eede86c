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

"""The stored outcome of a frame, without its images."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from ..core.drive.travel import TravelStep, ahead_only
from ..core.evidence.frame_evidence import FoundBy
from ..core.geometry.alignment import Alignment
from ..core.geometry.pose import Extrinsics
from ..core.geometry.uncertainty import UncertaintyTerm
from ..core.rejection import GateReading, Rejection
from ..core.reservations import Reservation
from ..core.results import CalibrationResult
from ..core.search.attempt import Attempt, Verdict
from ..core.types import Array


@dataclass(frozen=True, slots=True)
class AttemptSummary:
    """What became of one hypothesis, without the poses and readings of an :class:`.Attempt`.

    These weigh ten times as much, and a long drive has many frames with several attempts.

    Attributes:
        found_by: How the lines were found.
        verdict: What became of it.
        rejection: The gate's refusal with its measured value, limit and remedy; None without one.
        gate: Label of the gate that refused it, "" where none did.
        comment: Why it was not accepted where no gate refused it, else "".
    """

    found_by: FoundBy
    verdict: Verdict
    rejection: Rejection | None = None
    gate: str = ""
    comment: str = ""

    @classmethod
    def of(cls, attempt: Attempt) -> AttemptSummary:
        """Keep of an attempt what reports need."""
        last = attempt.readings[-1] if attempt.readings else None
        return cls(
            attempt.found_by,
            attempt.verdict,
            attempt.rejection,
            "" if last is None or last.passed else last.label,
            attempt.message if attempt.rejection is None else "",
        )

    @property
    def reason(self) -> str | None:
        """Why a gate refused it, None where none did."""
        return None if self.rejection is None else str(self.rejection.reason)

    @property
    def message(self) -> str:
        """One sentence: why it was not accepted, "" where it was."""
        return self.comment if self.rejection is None else self.rejection.message


@dataclass(frozen=True, slots=True, eq=False)
class FrameRow:
    """Outcome of one frame, without its images and points.

    Attributes:
        stamp_s: Time stamp of the frame [s].
        reason: Why it was refused, None when accepted.
        extrinsics: The calibration, None when refused.
        recorded_ns: When it was recorded [ns]; :meth:`.FrameSource.frame_at` finds it again by this.
        name: Name of the left image where it has one.
        rejection: The refusal with its measured value, limit and remedy; None when accepted.
        covariance: (3, 3) covariance of (height_m, pitch_rad, roll_rad), None when refused.
        lane_yaw_rad: Yaw of the camera against the lane [rad], > 0: points left; None when not known.
        lane_curvature_per_m: Curvature of the lane [1/m], > 0 bends left; None when not known.
        stages: Estimate of every stage that ran, by name, when refused too.
        gates: Readings of all gates up to the first one that refused the frame.
        reservations: What could not be checked, or is not quite as it should be.
        uncertainty: Terms of the covariance, which they add up to; empty when refused.
        attempts: Every hypothesis that was solved for the frame, in order, and what became of it.
        confirmed_by_texture: Whether the texture of the road surface has confirmed the lines.
        alignment: How the right camera is turned, of refused frames too; None where nothing tells.
        known_start: Whether the frame started from the known camera, without a search.
        started_from: When the frames were recorded that it started from, each from the one before, the first
            one cold [ns]; :func:`.look_again` needs them.
        stood: Whether the car stood since the frame before.
        yaw_rad: Yaw of the camera against its way since the frame before [rad], > 0: points left of it; with
            what a bend and the swaying of the car do to that way. None where the car did not drive ahead.
        yaw_std_rad: What the noise of the landmarks leaves of it [rad].
    """

    stamp_s: float
    reason: str | None
    extrinsics: Extrinsics | None
    recorded_ns: int = 0
    name: str = ""
    rejection: Rejection | None = None
    covariance: Array | None = None
    lane_yaw_rad: float | None = None
    lane_curvature_per_m: float | None = None
    stages: dict[str, Extrinsics] = field(default_factory=dict)
    gates: tuple[GateReading, ...] = ()
    reservations: tuple[Reservation, ...] = ()
    uncertainty: tuple[UncertaintyTerm, ...] = ()
    attempts: tuple[AttemptSummary, ...] = ()
    confirmed_by_texture: bool = False
    alignment: Alignment | None = None
    known_start: bool = False
    started_from: tuple[int, ...] = ()
    stood: bool = False
    yaw_rad: float | None = None
    yaw_std_rad: float | None = None

    @classmethod
    def from_result(
        cls,
        result: CalibrationResult,
        stamp_s: float,
        recorded_ns: int = 0,
        name: str = "",
        started_from: tuple[int, ...] = (),
    ) -> FrameRow:
        """Return the parts of a result that reports need."""
        accepted = result.accepted
        return cls(
            stamp_s,
            None if result.reason is None else str(result.reason),
            result.extrinsics if accepted else None,
            recorded_ns,
            name,
            result.rejection,
            result.covariance if accepted else None,
            result.lane_yaw_rad if accepted else None,
            result.lane_curvature_per_m if accepted else None,
            result.stages,
            result.gates,
            result.reservations,
            result.uncertainty,
            tuple(map(AttemptSummary.of, result.attempts)),
            result.confirmed_by_texture,
            result.alignment,
            result.known_start,
            started_from if result.known_start else (),
            result.stood,
        )

    @property
    def accepted(self) -> bool:
        """Whether the frame gave a calibration."""
        return self.reason is None

    @property
    def notes(self) -> tuple[str, ...]:
        """The reservations as sentences."""
        return tuple(each.sentence for each in self.reservations)

    @property
    def confirmed(self) -> bool:
        """Whether the road surface confirmed the calibration; lines alone may be those of a kerb."""
        return self.accepted and self.confirmed_by_texture


def with_steps(rows: Sequence[FrameRow], steps: Iterable[TravelStep]) -> list[FrameRow]:
    """Return rows with the yaw of the camera against its way, for the frames that a step ends with.

    Args:
        rows: Rows of one drive.
        steps: The steps between its frames.
    """
    ends = {_to_microseconds(step.stamp_s + step.duration_s): step for step in ahead_only(steps)}
    return [_with_step(row, ends.get(_to_microseconds(row.stamp_s))) for row in rows]


def _with_step(row: FrameRow, step: TravelStep | None) -> FrameRow:
    if step is None:
        return row
    yaw_rad, _ = step.against_travel(0.0 if row.extrinsics is None else row.extrinsics.roll_rad)
    return replace(row, yaw_rad=yaw_rad, yaw_std_rad=math.sqrt(float(step.noise()[0])))


def _to_microseconds(stamp_s: float) -> int:
    """Return a stamp without the rounding that a sum of times has."""
    return round(stamp_s * 1e6)
