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

"""The lines of a frame, from which those of the next one start instead of from nothing.

A start is no evidence. The road is fitted again in the disparities of the frame, the lines in its stripe
points, and all gates are read. Where the frame is refused, or its pose differs from the prediction by more
than both uncertainties and the car's motion allow, the lines are not the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import SIDES, image_from_road, road_from_image
from ..geometry.pose import Extrinsics
from ..lanes.following import follow_lines, moved_line
from ..lanes.matching import Candidates, Matches
from ..lanes.stripe_points import StripePoints
from ..road.priors import RIDE_MEMORY_S, RIDE_STD, SIDEWAYS_MPS
from ..types import Array
from .attempt import Attempt
from .lines_on_road import is_clear

# Half the distance of the two stripes of a double line, 0.12 m each with 0.12 m between them: what has moved
# by more may be taken for the other stripe.
HALF_DOUBLE_LINE_M = 0.12
# A line is followed as long as a car that drifts has moved it by no more.
MOST_AGE_S = HALF_DOUBLE_LINE_M / SIDEWAYS_MPS
# Beyond so many standard deviations, the prediction was wrong, or the frame is: one of 5000 frames.
MOST_SIGMAS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class KnownLines:
    """What a frame tells of the lines of the next one.

    Attributes:
        pose: Pose over the road.
        covariance: (3, 3) of it.
        stamp_s: Time stamp of the frame it is of [s].
        lines: The lines that both cameras saw then.
    """

    pose: Extrinsics
    covariance: Array
    stamp_s: float
    lines: Matches

    @classmethod
    def after(cls, chosen: Attempt | None, stamp_s: float) -> KnownLines | None:
        """Return what a frame tells of the next one; None of one without two clear lines, or refused.

        Lines that chance has made in the texture of a road are not there to be followed.

        Args:
            chosen: The attempt whose result is that of the frame; None without one.
            stamp_s: Time stamp of the frame [s].
        """
        if chosen is None or not chosen.accepted or chosen.estimate is None or not has_clear_lines(chosen):
            return None
        estimate = chosen.estimate
        return cls(estimate.pose, estimate.covariance, stamp_s, chosen.hypothesis.other_lines)

    def reaches(self, stamp_s: float) -> bool:
        """Whether a frame comes soon enough after it to start from it."""
        return 0.0 < stamp_s - self.stamp_s <= MOST_AGE_S

    def is_confirmed_by(self, attempt: Attempt, stamp_s: float) -> bool:
        """Whether lines that were followed are accepted, and differ by no more than motion explains.

        Args:
            attempt: The attempt with these lines.
            stamp_s: Time stamp of the frame [s].
        """
        if not attempt.accepted or attempt.estimate is None or not has_clear_lines(attempt):
            return False
        # Of a stationary motion whose correlation falls by 1 / e in its memory.
        moved = 2.0 - 2.0 * math.exp(-abs(stamp_s - self.stamp_s) / RIDE_MEMORY_S)
        variance = np.diag(self.covariance + attempt.estimate.covariance) + moved * np.square(RIDE_STD)
        difference = attempt.estimate.pose.as_array() - self.pose.as_array()
        return bool(np.all(np.abs(difference) <= MOST_SIGMAS * np.sqrt(variance)))

    def follow(self, camera: int, points: StripePoints, pose: Extrinsics, rig: StereoRig) -> Candidates:
        """Return the lines of one image near those of the frame before, as these lay on the road.

        Args:
            camera: 0 for the left image, 1 for the right one.
            points: Stripe points of the image.
            pose: Pose over the road of the frame, as far as it is known.
            rig: Intrinsics and baseline.
        """
        side = SIDES[camera]
        mapping = image_from_road(rig, pose, side) @ road_from_image(rig, self.pose, side)
        before = [[(match.left, match.right)[camera].line for match in each] for each in self.lines]
        expected = [
            [moved for line in lines if (moved := moved_line(line, mapping)) is not None] for lines in before
        ]
        return follow_lines(points, expected)


def has_clear_lines(attempt: Attempt) -> bool:
    """Whether both boundaries of the lane are clear lines.

    Args:
        attempt: An attempt.
    """
    clear = [match.left.line for side in attempt.hypothesis.other_lines for match in side if is_clear(match)]
    return attempt.pattern is not None and all(
        any(line.is_same_stripe(each) for each in clear) for line in attempt.pattern.left
    )
