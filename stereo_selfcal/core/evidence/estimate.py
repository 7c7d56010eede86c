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

"""An estimate on its way through the stages: its pose by each stage, and the terms of its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, total_covariance
from ..reservations import Reservation, ReservationKind
from ..types import Array


@dataclass(frozen=True, slots=True)
class StagePoses:
    """The pose by every stage; None where a stage did not run or gave up.

    Attributes:
        coarse: By dense disparities at low resolution: the start of the alignment of the texture.
        genetic: By the genetic algorithm, from the sampled lines (paper section 2.3).
        nearby: By Gauss-Newton steps to the greatest fitness, in place of the genetic algorithm where the
            camera is known.
        closed_form: By linear least squares, from the same lines.
        refined: By the fit of the stripes' grey values.
        textured: By the texture of the road surface.
        combined: Of lines and texture together.
    """

    coarse: Extrinsics | None = None
    genetic: Extrinsics | None = None
    nearby: Extrinsics | None = None
    closed_form: Extrinsics | None = None
    refined: Extrinsics | None = None
    textured: Extrinsics | None = None
    combined: Extrinsics | None = None

    @property
    def by_lines(self) -> Extrinsics | None:
        """The best pose from lines alone."""
        return self.refined or self.nearby or self.genetic

    def as_dict(self) -> dict[str, Extrinsics]:
        """Return the stages that ran, by name, in their order."""
        poses = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: pose for name, pose in poses.items() if pose is not None}


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A pose over the road with its uncertainty.

    Attributes:
        pose: Height, pitch and roll.
        terms: Terms of the uncertainty, one for each name; their sum is the covariance.
        lane_yaw_rad: Yaw of the camera against the lane [rad], > 0: it points left; None without a line.
        reservations: What could not be checked, or is not quite as it should be.
    """

    pose: Extrinsics
    terms: tuple[UncertaintyTerm, ...]
    lane_yaw_rad: float | None
    reservations: tuple[Reservation, ...] = ()

    @property
    def covariance(self) -> Array:
        """(3, 3) of the pose: the sum of the terms."""
        return total_covariance(self.terms)

    def with_terms(self, *terms: UncertaintyTerm) -> Estimate:
        """Return the estimate with further terms of its uncertainty."""
        return replace(self, terms=merge_terms((*self.terms, *terms)))

    def with_reservation(self, kind: ReservationKind, detail: str = "") -> Estimate:
        """Return the estimate with one more reservation."""
        return replace(self, reservations=(*self.reservations, Reservation(kind, detail)))
