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

"""The attempt to solve one hypothesis: stages that ran, readings of the gates, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from ..estimators.stripe_fit import StripeFit
from ..evidence.camera_turn import CameraTurn
from ..evidence.camera_yaw import YawTold
from ..evidence.estimate import Estimate, StagePoses
from ..evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from ..evidence.road_surface import SurfaceCells
from ..evidence.synchronisation import Lateness
from ..geometry.pose import Extrinsics
from ..lanes.lane_pair import ImageLine, LanePattern
from ..numerics.genetic import GeneticResult
from ..rejection import GateReading, NotFitted, Rejection, RejectReason


class Verdict(Enum):
    """Verdict on a hypothesis; ``str()`` is a stable snake_case word."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    NOT_FITTED = "not_fitted"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One hypothesis and its result.

    Attributes:
        hypothesis: Which lines were found, and how.
        verdict: ``accepted``; ``refused`` by a gate; ``not_fitted``: an estimator gave up.
        message: One sentence: why it was not accepted, "" where it was.
        rejection: The gate's refusal, None without one.
        poses: Pose by every stage that ran.
        readings: Readings of the gates, up to the first one that refused.
        estimate: The pose with its uncertainty; None where the hypothesis was refused or not fitted.
        lane_curvature_per_m: Curvature of the lane [1/m], > 0: bends left; None where it was not measured.
        genetic: Report of the genetic algorithm; None where it did not run.
        surface: The road surface the lines were compared with, or that is the estimate; None without one.
        lateness: The way of the car between both images, once it was measured; None where it is not told.
        yaw_told: The yaw of the right camera, by rows and lines; empty where the hypothesis was refused.
        lane_line: The line of the left image that tells the yaw of an estimate without a pair of lines.
        stripes: The fit of the stripes' grey values; None where there is none.
        rows: Pitch and roll of the right camera by the rows of both images, compared under the pose of an
            accepted attempt; None where they were not, or were corrected.
    """

    hypothesis: Hypothesis
    verdict: Verdict
    message: str = ""
    rejection: Rejection | None = None
    poses: StagePoses = field(default_factory=StagePoses)
    readings: tuple[GateReading, ...] = ()
    estimate: Estimate | None = None
    lane_curvature_per_m: float | None = None
    genetic: GeneticResult | None = None
    surface: SurfaceCells | None = None
    yaw_told: tuple[YawTold, ...] = ()
    lane_line: ImageLine | None = None
    lateness: Lateness | None = None
    stripes: StripeFit | None = None
    rows: CameraTurn | None = None

    @property
    def accepted(self) -> bool:
        """Whether the estimate is a calibration."""
        return self.verdict is Verdict.ACCEPTED

    @property
    def reason(self) -> RejectReason | None:
        """Why a gate refused it, None where none did."""
        return None if self.rejection is None else self.rejection.reason

    @property
    def refused_by(self) -> str:
        """Name of the gate that refused it, "" where none did."""
        return "" if self.rejection is None or not self.readings else self.readings[-1].name

    @property
    def found_by(self) -> FoundBy:
        """How the lines were found."""
        return self.hypothesis.found_by

    @property
    def pattern(self) -> LanePattern | None:
        """The lines, None where there is no pair of them."""
        return self.hypothesis.pattern

    @property
    def stages(self) -> dict[str, Extrinsics]:
        """Pose by every stage that ran, by name."""
        return self.poses.as_dict()

    def slim(self) -> Attempt:
        """Return the attempt without points and lines, which take as much memory as an image."""
        hypothesis = self.hypothesis.slim()
        return replace(
            self,
            hypothesis=hypothesis,
            genetic=None,
            surface=None,
            lane_line=None,
            rows=None,
            stripes=None,
        )


def coarse_pose(frame: FrameObservations) -> StagePoses:
    """Return the poses that are known before a hypothesis: that of the dense disparities.

    Args:
        frame: Images, and what is known of them without a hypothesis.
    """
    coarse = None if frame.surface is None else frame.surface.coarse
    return StagePoses() if coarse is None or isinstance(coarse, NotFitted) else StagePoses(coarse.extrinsics)
