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

"""Lines that a cold frame has found to be paint on the road, in the frames after it.

Whether two lines are the paint of one road needs much of an image: what lies beside them, between them and
below them. A cold frame has looked at all that. As long as the same lines are seen, it is not asked again.
They are the same where they are followed from frame to frame; and where the clearest lines are as far apart
as they were.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig, TextureConfig
from ..evidence.frame_evidence import FrameObservations, Hypothesis
from ..geometry.homography import horizon_row
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm
from ..lanes.line_geometry import lane_in_road
from ..lanes.stripe_points import find_stripe_points
from ..reservations import Reservation
from ..road.priors import HARD_RIDE_STD
from .attempt import Attempt
from .known_lines import HALF_DOUBLE_LINE_M, KnownLines
from .solve import solve
from .strategy import FrameSearch

# The horizon of the road lies no farther above that of the frame before: a car pitches by no more.
_MOST_PITCH_RAD = 3.0 * HARD_RIDE_STD[1]
# What the shape of a road between lines adds to the uncertainty of a pose from them.
_ROAD_TERMS = ("roughness", "camber", "mismatch")


@dataclass(frozen=True, slots=True, eq=False)
class RoadLines:
    """Two lines of a road, and what a cold frame has found besides.

    Attributes:
        camera: The lines, and the pose over the road when they were seen last.
        width_m: Distance between both [m].
        road_terms: Terms of the uncertainty by the shape of the road between them.
        reservations: What the cold frame could not check.
    """

    camera: KnownLines
    width_m: float
    road_terms: tuple[UncertaintyTerm, ...]
    reservations: tuple[Reservation, ...]

    @classmethod
    def of(cls, chosen: Attempt | None, stamp_s: float, rig: StereoRig) -> RoadLines | None:
        """Return those of a frame; None of one without two clear lines, or refused.

        Args:
            chosen: The attempt whose result is that of the frame; None without one.
            stamp_s: Time stamp of the frame [s].
            rig: Intrinsics and baseline.
        """
        camera = KnownLines.after(chosen, stamp_s)
        if camera is None or chosen is None or chosen.estimate is None or chosen.pattern is None:
            return None
        _, left_m, right_m = lane_in_road(chosen.pattern.boundaries, rig, chosen.estimate.pose)
        terms = tuple(term for term in chosen.estimate.terms if term.name in _ROAD_TERMS)
        return cls(camera, float(left_m - right_m), terms, chosen.estimate.reservations)

    def attempts(
        self,
        frame: FrameObservations,
        stamp_s: float,
        rig: StereoRig,
        config: CalibratorConfig,
    ) -> Iterator[tuple[Attempt, RoadLines | None]]:
        """Yield attempts with these lines in another frame, and the lines after each; None where they differ.

        Args:
            frame: Images of the frame.
            stamp_s: Time stamp of the frame [s].
            rig: Intrinsics and baseline.
            config: Settings.
        """
        config = replace(config, texture=TextureConfig(check=0))
        frame = self._with_points(frame, rig, config)
        for hypothesis in self._hypotheses(frame, stamp_s, rig, config):
            attempt = solve(hypothesis, frame, rig, config)
            if attempt.estimate is not None:
                estimate = replace(attempt.estimate, reservations=self.reservations)
                attempt = replace(attempt, estimate=estimate.with_terms(*self.road_terms))
            after = RoadLines.of(attempt, stamp_s, rig)
            same = after is not None and abs(after.width_m - self.width_m) <= HALF_DOUBLE_LINE_M
            yield attempt, replace(self, camera=after.camera) if after is not None and same else None

    def _hypotheses(
        self, frame: FrameObservations, stamp_s: float, rig: StereoRig, config: CalibratorConfig
    ) -> Iterator[Hypothesis]:
        """Yield the lines that are followed, then the clearest ones: a brake moves lines far."""
        if self.camera.reaches(stamp_s):
            followed = FrameSearch(frame, rig, config).followed(self.camera)
            if followed is not None:
                yield followed
        clearest = FrameSearch(frame, rig, config).clearest()
        if clearest is not None:
            yield clearest

    def _with_points(
        self, frame: FrameObservations, rig: StereoRig, config: CalibratorConfig
    ) -> FrameObservations:
        """Return a frame with the stripe points of the road."""
        first_row = first_road_row(self.camera.pose, rig)
        left, right = (find_stripe_points(image, config.extraction, first_row) for image in frame.images)
        return replace(frame, points=(left, right))


def first_road_row(pose: Extrinsics, rig: StereoRig) -> int:
    """Return the first row in which a road may be seen: its horizon, if the car pitches as much as it can.

    Args:
        pose: Pose over the road before.
        rig: Intrinsics and baseline.
    """
    nose_down = replace(pose, pitch_rad=pose.pitch_rad + _MOST_PITCH_RAD)
    highest = float(horizon_row(rig, nose_down, [0.0, rig.width - 1.0]).min())
    return int(np.clip(highest, 0, rig.height // 2))
