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

"""Which refusal a frame has, where no hypothesis was accepted, and its words.

A frame needs the road surface or two lane lines. Where it has neither, the refusal says what was missing of
both, each with its value and its limit.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..evidence.frame_evidence import FoundBy
from ..evidence.road_surface import RoadSurface
from ..lanes.frame_checks import FIND_LINES
from ..lanes.hypotheses import LaneHypotheses, NoPattern
from ..rejection import NotFitted, Rejection, RejectReason
from .attempt import Attempt

FIND_ROAD = "drive on in daylight, lens clean, where the road has texture or painted lines on both sides"
LOOK_AT_ROAD = "check that both cameras look at the road, in daylight and with a clean lens"
# Of these, the refusal also says what the road surface lacks: a road that is seen needs no lines.
_MISSING_LINES = (RejectReason.NO_LINES_FOUND, RejectReason.LINES_NOT_MATCHED)


def of_surface(attempts: Sequence[Attempt]) -> Attempt | None:
    """Return the attempt to take the road surface without lines, if it was not accepted; else None."""
    found = [each for each in attempts if each.found_by is FoundBy.SURFACE and not each.accepted]
    return found[0] if found else None


def without_pair(
    on_road: LaneHypotheses | None,
    in_image: LaneHypotheses,
    surface: RoadSurface | None,
    attempts: Sequence[Attempt],
) -> Rejection:
    """Return the refusal of a frame without any pair of lines whose surface is no estimate.

    Args:
        on_road: Lines on the road surface; None where they were not looked for.
        in_image: Lines of the whole image.
        surface: The road surface; None where ``texture.check`` is 0.
        attempts: Attempts with this frame.
    """
    of_image, of_road = missing_lines(in_image), None if on_road is None else missing_lines(on_road)
    assert of_image is not None  # a pair of lines is an attempt
    if of_image.reason not in _MISSING_LINES or surface is None:
        return of_image
    lacking = surface.lacking
    if (
        lacking is not None
        and isinstance(surface.coarse, NotFitted)
        and not any(map(any, in_image.candidates))
    ):
        return road_not_seen(lacking, of_image)
    tried = of_surface(attempts)
    of_lines = of_road or of_image
    if tried is not None:
        return of_lines.followed_by(f"the road surface alone is no estimate: {tried.message}", FIND_ROAD)
    remedy = FIND_ROAD if of_lines.remedy == FIND_LINES else of_lines.remedy
    return of_lines.followed_by(surface.described, remedy)


def missing_lines(found: LaneHypotheses) -> Rejection | None:
    """Return why there is no pair of lines; None where there is one."""
    return found.patterns.rejection if isinstance(found.patterns, NoPattern) else None


def road_not_seen(lacking: NotFitted, of_lines: Rejection) -> Rejection:
    """Refuse a frame that shows neither a plane of a road nor any line.

    Args:
        lacking: What the dense disparities lack.
        of_lines: The refusal for want of lines.
    """
    return Rejection(
        RejectReason.ROAD_NOT_SEEN,
        f"neither the road surface nor a lane line is seen: {lacking.what}: {{value}}, "
        f"{lacking.bound} {{limit}} needed; {of_lines.finding}",
        lacking.value,
        lacking.bound,
        lacking.limit,
        lacking.unit,
        LOOK_AT_ROAD,
    )


def with_lines_missing(attempt: Attempt, on_road: LaneHypotheses | None) -> Rejection | None:
    """Return the refusal of an attempt; of the road surface alone, it says which lines are missing as well.

    Args:
        attempt: The attempt whose refusal is that of the frame.
        on_road: Lines on the road surface; None where they were not looked for.
    """
    if attempt.rejection is None or attempt.found_by is not FoundBy.SURFACE or on_road is None:
        return attempt.rejection
    of_lines = missing_lines(on_road)
    if of_lines is None:
        return attempt.rejection
    return attempt.rejection.followed_by(of_lines.finding, attempt.rejection.remedy)
