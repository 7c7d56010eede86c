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

"""What a calibration returns: extrinsics with their uncertainty, or the reason why not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from .camera.working_size import WorkingSize
from .estimators.landmarks import Landmarks
from .evidence.road_surface import SurfaceCells
from .evidence.synchronisation import Lateness
from .faults import Fault
from .geometry.alignment import Alignment
from .geometry.mount import MountEvidence
from .geometry.pose import Extrinsics
from .geometry.travel import RightDelay, Travel
from .geometry.uncertainty import UncertaintyTerm
from .lanes.lane_pair import ImageLine, LanePattern
from .numerics.genetic import GeneticResult
from .rejection import GateReading, Rejection, RejectReason
from .reservations import Reservation, mostly_reserved
from .search.attempt import Attempt
from .types import Array


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CalibrationResult:
    """Result of one frame, or the fused result of several.

    Attributes:
        message: One sentence: the calibration; or the measured value, its limit and the remedy.
        rejection: The reason of the refusal, None when accepted.
        extrinsics: The calibration, None when rejected.
        covariance: (3, 3) covariance of (height_m, pitch_rad, roll_rad), None when rejected.
        lane_yaw_rad: Yaw of the camera against the lane [rad], > 0: camera points left of it.
        lane_curvature_per_m: Curvature of the lane [1/m], > 0: bends left; None where it was not measured.
        stages: Pose by every stage that ran, by name ("genetic", ...); also kept when rejected.
        stamp_s: Time stamp of the frame (of the last one when fused) [s].
        n_frames: Number of accepted frames behind the result.
        pattern: Lines and sampled points of the estimate, for pictures.
        unused_lines: Lines of the left camera that were found and are not in the pattern.
        surface: The road surface that was seen, for pictures; None without one.
        lane_line: Without a pair of lines, the clearest line of the left image that both cameras see on the
            road, for pictures.
        genetic: Report of the genetic algorithm.
        gates: Readings of all gates up to the first one that refused.
        uncertainty: Terms of the covariance, one for each cause; their sum is the covariance. Empty when
            rejected.
        alignment: How the right camera is turned against where the rig has it; None where
            the images were not looked at.
        landmarks: Points of this frame that the next one may see again; None of fused results.
        travel: The camera against the direction of travel, over several frames; None where it is not known.
        delay: When right images are taken, against the left ones, over several frames; None where unknown.
        lateness: The way of the car between both images, of refused frames too; None where nothing tells it.
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
        attempts: Every hypothesis that was solved for this frame, in order; empty when several are fused.
        confirmed_by_texture: Whether the texture of the road surface has confirmed the lines.
        mount: How the estimate of the mount was reached, over several frames; None of a single frame.
        known_start: Whether this frame started from the known camera, without a search.
        stood: Whether the car stood since the frame before.
        fault: The fault of the program for which the frame is refused; None in any other case.
        reservations: What could not be checked, or is not quite as it should be, and is no reason to refuse
            the frame; of several frames, with the number of those it holds for.
    """

    message: str
    rejection: Rejection | None = None
    extrinsics: Extrinsics | None = None
    covariance: Array | None = None
    lane_yaw_rad: float | None = None
    lane_curvature_per_m: float | None = None
    stages: dict[str, Extrinsics] = field(default_factory=dict)
    stamp_s: float = 0.0
    n_frames: int = 0
    pattern: LanePattern | None = None
    unused_lines: tuple[ImageLine, ...] = ()
    surface: SurfaceCells | None = None
    lane_line: ImageLine | None = None
    genetic: GeneticResult | None = None
    gates: tuple[GateReading, ...] = ()
    reservations: tuple[Reservation, ...] = ()
    uncertainty: tuple[UncertaintyTerm, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    alignment: Alignment | None = None
    lateness: Lateness | None = None
    stamp_difference_s: float = 0.0
    landmarks: Landmarks | None = None
    travel: Travel | None = None
    delay: RightDelay | None = None
    confirmed_by_texture: bool = False
    mount: MountEvidence | None = None
    known_start: bool = False
    stood: bool = False
    fault: Fault | None = None

    def __repr__(self) -> str:
        """Return what came out, in one line; all fields, with every point, are ten thousand characters."""
        return f"CalibrationResult(accepted={self.accepted}, {self.message!r})"

    @property
    def accepted(self) -> bool:
        """Whether there is a calibration."""
        return self.rejection is None

    @property
    def reason(self) -> RejectReason | None:
        """Why there is no calibration, None when there is one."""
        return None if self.rejection is None else self.rejection.reason

    @property
    def notes(self) -> tuple[str, ...]:
        """The reservations as sentences."""
        return tuple(each.text(self.n_frames) for each in self.reservations)

    @property
    def with_reservations(self) -> bool:
        """Whether there is a calibration, and a reservation that holds for most of its frames."""
        return self.accepted and mostly_reserved(self.reservations, self.n_frames)

    @property
    def std(self) -> Extrinsics | None:
        """Standard deviations (height_m, pitch_rad, roll_rad), None when rejected."""
        if self.covariance is None:
            return None
        return Extrinsics(*(math.sqrt(float(variance)) for variance in self.covariance.diagonal()))

    def copied(self) -> CalibrationResult:
        """Return the result with a covariance of its own, which its reader may change."""
        terms = tuple(replace(term, covariance=term.covariance.copy()) for term in self.uncertainty)
        covariance = None if self.covariance is None else self.covariance.copy()
        return replace(self, covariance=covariance, uncertainty=terms, stages=dict(self.stages))

    def slim(self) -> CalibrationResult:
        """Return the result without its points and lines, which take as much memory as an image."""
        return replace(self.without_pictures(), genetic=None, attempts=(), landmarks=None)

    def in_images(self, size: WorkingSize) -> CalibrationResult:
        """Return the result with its lines and points in images that were looked at in another size.

        Args:
            size: That size. The attempts stay in it.
        """
        if size.scale == 1:
            return self
        return replace(
            self,
            pattern=None if self.pattern is None else self.pattern.in_images(size),
            unused_lines=tuple(line.in_images(size) for line in self.unused_lines),
            lane_line=None if self.lane_line is None else self.lane_line.in_images(size),
            landmarks=None if self.landmarks is None else self.landmarks.in_images(size),
        )

    def drawn_as(self, frame: CalibrationResult) -> CalibrationResult:
        """Return the result with the lines and the road surface of one frame, to draw it over that frame.

        Args:
            frame: Result of the frame.
        """
        return replace(self, pattern=frame.pattern, surface=frame.surface, lane_line=frame.lane_line)

    def without_pictures(self) -> CalibrationResult:
        """Return the result without what only pictures need: points, lines and cells."""
        return replace(self, pattern=None, unused_lines=(), surface=None, lane_line=None)


def result_of(chosen: Attempt | None, attempts: Sequence[Attempt], stamp_s: float) -> CalibrationResult:
    """Return the result of a frame.

    Args:
        chosen: The attempt whose result is that of the frame; None without one.
        attempts: All attempts.
        stamp_s: Time stamp of the frame [s].
    """
    if chosen is None:
        return CalibrationResult("", stamp_s=stamp_s, attempts=tuple(attempts))
    common = CalibrationResult(
        chosen.message,
        stages=chosen.stages,
        stamp_s=stamp_s,
        pattern=chosen.pattern,
        surface=chosen.surface,
        lane_line=chosen.lane_line,
        genetic=chosen.genetic,
        gates=chosen.readings,
        attempts=tuple(attempts),
        lateness=chosen.lateness,
    )
    if chosen.estimate is None or not chosen.accepted:
        return replace(common, rejection=chosen.rejection)
    accepted = replace(
        common,
        extrinsics=chosen.estimate.pose,
        covariance=chosen.estimate.covariance,
        uncertainty=chosen.estimate.terms,
        lane_yaw_rad=chosen.estimate.lane_yaw_rad,
        lane_curvature_per_m=chosen.lane_curvature_per_m,
        n_frames=1,
        reservations=chosen.estimate.reservations,
        confirmed_by_texture=chosen.poses.textured is not None,
    )
    return replace(accepted, message=announce(accepted))


def rejected(rejection: Rejection, stamp_s: float = 0.0, **evidence: object) -> CalibrationResult:
    """Return the result of a refused frame; ``evidence`` sets further fields of the result."""
    # The fields have many types; a name that does not exist fails at once.
    return CalibrationResult(message=rejection.message, rejection=rejection, stamp_s=stamp_s, **evidence)  # type: ignore[arg-type]


def refused_for(fault: Fault, stamp_s: float) -> CalibrationResult:
    """Return the result of a frame in which a fault of the program has come up."""
    return rejected(fault.rejection, stamp_s, fault=fault)


def caught(work: Callable[[], CalibrationResult], stamp_s: float) -> CalibrationResult:
    """Return the result of some work on one frame; a refusal where it raises what was not foreseen.

    Args:
        work: Everything from the frame's data to its result.
        stamp_s: Time stamp of the frame [s].
    """
    try:
        return work()
    except Exception as error:  # noqa: BLE001  (whatever it is, the other frames go on)
        return refused_for(Fault.of(error), stamp_s)


def announce(result: CalibrationResult) -> str:
    """Return the sentence of an accepted result.

    Args:
        result: The result of a frame, or an estimate of the mount.

    Raises:
        ValueError: The result is not an accepted one.
    """
    if result.extrinsics is None or result.std is None:
        raise ValueError("only an accepted result can be announced")
    frames = "1 frame" if result.n_frames == 1 else f"{result.n_frames} frames"
    aside = ""
    if result.mount is not None:
        if result.n_frames > 1:
            frames += f" in {result.mount.duration_s:.1f} s"
        if result.mount.stood:
            frames += " of a standing car"
        if result.mount.n_outliers:
            aside = f" ({result.mount.n_outliers} more set aside as outliers)"
    pose = result.extrinsics.describe(result.std)
    if result.travel is not None and result.travel.tells_yaw:
        pose += f", {result.travel.describe_yaw()}"
    notes = "".join(f"; {note}" for note in result.notes)
    return f"calibrated from {frames}{aside}: {pose}{notes}"
