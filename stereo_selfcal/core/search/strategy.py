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

"""Which hypotheses are solved, in which order, and which attempt is the result of a frame.

The road comes first: where its surface is seen, lines are looked for on it, and without lines it is an
estimate of its own. Where the surface is not seen, or is too uncertain, lines are looked for in the whole
image. Each hypothesis takes the time of a search and of a fit of the stripes, so the most promising ones come
first. A contradiction ends the search: what clear lines or the surface refuse, no other hypothesis accepts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..camera.rig import StereoRig
from ..config import CORRECT_NOTHING, CalibratorConfig
from ..evidence.camera_turn import CameraTurn, with_prior
from ..evidence.camera_yaw import yaw_of_matches
from ..evidence.cross_checks import remaining_turn
from ..evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from ..lanes.extra_lines import find_extra_lines
from ..lanes.hypotheses import (
    LaneHypotheses,
    NoPattern,
    cross,
    find_hypotheses,
    lines_below_plane,
    pair_candidates,
)
from ..lanes.lane_pair import LanePattern
from ..rejection import Rejection, RejectReason
from .attempt import Attempt, Verdict, coarse_pose
from .known_lines import KnownLines
from .lines_on_road import lines_on_road
from .refusal import with_lines_missing, without_pair

# Gates by which one kind of evidence contradicts another, or the rig, whatever the lines are.
_CONTRADICTIONS = ("surface_agrees", "strip_agrees", "rectified", "not_turned", "parallel_cameras")
# Where one of two lines is not on the road, or not the same in both cameras, other pairs are solved. In most
# random worlds, the right pair was among this many.
_REASONS_FOR_OTHER_PAIRS = (
    RejectReason.LINES_NOT_MATCHED,
    RejectReason.LINE_BELOW_ROAD,
    RejectReason.LINES_NOT_COPLANAR,
    RejectReason.LINE_NOT_PAINTED,
)
_MAX_OTHER_PAIRS = 2
# Refusals of lines that are none of a road, such as the edges of houses.
_REASONS_OF_CLUTTER = (
    *_REASONS_FOR_OTHER_PAIRS,
    RejectReason.FITNESS_TOO_LOW,
    RejectReason.SEARCH_SPACE_EDGE,
    RejectReason.STAGES_DISAGREE,
)


class FrameSearch:
    """The hypotheses about one frame, and the lines they were found among.

    Attributes:
        on_road: Lines on the road surface; None where they were not looked for.
        in_image: Lines of the whole image; None where they were not looked for.
        of_known: Lines that were followed; None where they were not.
    """

    def __init__(self, frame: FrameObservations, rig: StereoRig, config: CalibratorConfig) -> None:
        self._frame, self._rig, self._config = frame, rig, config
        self.on_road: LaneHypotheses | None = None
        self.in_image: LaneHypotheses | None = None
        self.of_known: LaneHypotheses | None = None

    @property
    def lines(self) -> LaneHypotheses:
        """The lines that were looked for last; those of the whole image, if none were."""
        return self.of_known or self.in_image or self.on_road or self._lines_in_image()

    def refusal(self, attempts: Sequence[Attempt]) -> tuple[Rejection, LanePattern | None]:
        """Return the refusal of a frame in which no hypothesis was accepted, and the lines it is about.

        Args:
            attempts: All attempts.
        """
        chosen = choose(attempts)
        rejection = None if chosen is None else with_lines_missing(chosen, self.on_road)
        if chosen is not None and rejection is not None and not self._rests_on_nothing(chosen):
            return rejection, chosen.pattern
        in_image = self._lines_in_image()
        pattern = in_image.patterns.pattern if isinstance(in_image.patterns, NoPattern) else None
        return without_pair(self.on_road, in_image, self._frame.surface, attempts), pattern

    def _rests_on_nothing(self, attempt: Attempt) -> bool:
        """Whether an attempt is at a surface that is too weak for an estimate, in a frame without lines."""
        texture = attempt.hypothesis.texture
        weak = texture is not None and not texture.enough_texture
        without_lines = attempt.found_by is FoundBy.SURFACE
        return weak and without_lines and isinstance(self._lines_in_image().patterns, NoPattern)

    def hypotheses(self, attempts: Sequence[Attempt]) -> Iterator[Hypothesis]:
        """Yield the hypotheses about the frame, most promising first, until one of them is accepted.

        Args:
            attempts: Attempts so far; the caller appends each one before it takes the next hypothesis.
        """
        for hypothesis in self._all(attempts):
            yield hypothesis
            if attempts[-1].accepted or attempts[-1].refused_by in _CONTRADICTIONS:
                return

    def followed(self, known: KnownLines) -> Hypothesis | None:
        """Return the hypothesis that the lines bound the lane that did so in another frame.

        Args:
            known: The lines of that frame, and where they lay on the road.

        Returns:
            The lines, as this frame shows them: on its road surface where that is seen. None where two are
            not found again.
        """
        frame, rig, config = self._frame, self._rig, self._config
        texture = None if frame.surface is None else frame.surface.located
        if texture is None:
            pose = coarse_pose(frame).coarse or known.pose
            left, right = (known.follow(camera, frame.points[camera], pose, rig) for camera in (0, 1))
            found = pair_candidates((left, right), frame.points, frame.images, rig, config)
        else:
            on_road = texture.extrinsics
            found = lines_on_road(
                on_road,
                frame.points,
                frame.images,
                rig,
                config,
                lambda points, _: known.follow(0, points, on_road, rig),
            )
        if not isinstance(found.patterns, list):
            return None
        pattern = found.patterns[0]
        lines = pattern.joined(find_extra_lines(pattern, found.matches, frame.points, rig, config))
        self.of_known = found
        if texture is None:
            below = lines_below_plane(found.patterns, rig)[0]
            return Hypothesis(FoundBy.KNOWN, lines, found.matches, below)
        told = yaw_of_matches(found.matches, rig, texture.extrinsics)
        return Hypothesis(FoundBy.KNOWN, lines, found.matches, texture=texture, yaw_told=told)

    def clearest(self) -> Hypothesis | None:
        """Return the hypothesis that the clearest two lines of the image are those of a known road.

        Returns:
            The lines; None without two.
        """
        found = self._lines_in_image()
        if not isinstance(found.patterns, list):
            return None
        pattern, points = found.patterns[0], self._frame.points
        extra = find_extra_lines(pattern, found.matches, points, self._rig, self._config)
        below = lines_below_plane(found.patterns, self._rig)[0]
        return Hypothesis(FoundBy.KNOWN, pattern.joined(extra), found.matches, below)

    def _all(self, attempts: Sequence[Attempt]) -> Iterator[Hypothesis]:
        texture = None if self._frame.surface is None else self._frame.surface.located
        if texture is not None:
            frame, rig, config = self._frame, self._rig, self._config
            found = lines_on_road(texture.extrinsics, frame.points, frame.images, rig, config)
            self.on_road = found
            told = yaw_of_matches(found.matches, rig, texture.extrinsics)
            for pattern in found.patterns if isinstance(found.patterns, list) else ():
                extra = find_extra_lines(pattern, found.matches, frame.points, rig, config)
                lines = pattern.joined(extra)
                yield Hypothesis(FoundBy.ROAD, lines, found.matches, texture=texture, yaw_told=told)
            yield Hypothesis(FoundBy.SURFACE, None, found.matches, texture=texture, yaw_told=told)
        yield from self._in_image(attempts)

    def _in_image(self, attempts: Sequence[Attempt]) -> Iterator[Hypothesis]:
        """Yield the pair with the best score, with and without extra lines; then other pairs."""
        found = self._lines_in_image()
        if not isinstance(found.patterns, list):
            return
        depths = lines_below_plane(found.patterns, self._rig)
        clearest = found.patterns[0]
        points = self._frame.points
        extra = find_extra_lines(clearest, found.matches, points, self._rig, self._config)
        yield Hypothesis(FoundBy.HOUGH, clearest.joined(extra), found.matches, depths[0])
        if extra:
            yield Hypothesis(FoundBy.HOUGH, clearest, found.matches, depths[0])
        others = [
            index
            for index, depth in enumerate(depths)
            if index and not depth.surely_below and not cross(clearest, found.patterns[index])
        ]
        for index in others[:_MAX_OTHER_PAIRS]:
            if attempts[-1].reason in _REASONS_FOR_OTHER_PAIRS:
                yield Hypothesis(FoundBy.HOUGH, found.patterns[index], found.matches, depths[index])

    def _lines_in_image(self) -> LaneHypotheses:
        if self.in_image is None:
            self.in_image = find_hypotheses(self._frame.points, self._frame.images, self._rig, self._config)
        return self.in_image


def choose(attempts: Sequence[Attempt]) -> Attempt | None:
    """Return the attempt whose result is that of the frame; None without one.

    It is the accepted attempt. Without one, it is a contradiction, then the refusal of lines, then that of
    the surface alone. Where the surface was seen, and no two lines on it, what says that lines of the whole
    image are none of a road comes last.
    """
    refused = [each for each in attempts if each.verdict is Verdict.REFUSED]
    for which in (
        [each for each in attempts if each.accepted],
        [each for each in refused if each.refused_by in _CONTRADICTIONS],
        [each for each in refused if each.pattern is not None and not _of_clutter(each)],
        [each for each in refused if each.found_by is FoundBy.SURFACE],
        refused,
    ):
        if which:
            return which[0]
    return None


def _of_clutter(attempt: Attempt) -> bool:
    """Whether lines of the whole image were refused as lines that do not belong to a road."""
    return attempt.found_by is FoundBy.HOUGH and attempt.reason in _REASONS_OF_CLUTTER


def turn_under_pose(
    attempts: Sequence[Attempt], frame: FrameObservations, rig: StereoRig, config: CalibratorConfig
) -> CameraTurn | None:
    """Return how the right camera has turned, where only the pose over the road lets the rows be compared.

    Args:
        attempts: All attempts.
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.
        config: Settings.

    Returns:
        The turn; None where it was corrected before, is not to be corrected, or is not seen.
    """
    chosen = choose(attempts)
    if chosen is None or frame.turn.corrected or config.alignment.correct == CORRECT_NOTHING:
        return None
    pose = chosen.poses.textured or chosen.poses.by_lines
    if pose is None:
        return None
    yaw = None if chosen.estimate is None else chosen.estimate.lane_yaw_rad
    turn = chosen.rows or remaining_turn(frame, rig, pose, yaw)
    return None if turn is None else replace(with_prior(turn), landmarks=frame.turn.landmarks)
