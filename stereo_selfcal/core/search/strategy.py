"""Which hypotheses are solved, in which order, and which attempt is the result of a frame.

Each hypothesis takes the time of a search, a fit of the stripes and an alignment of the texture. So the pair
of lines with the best score comes first. Other pairs follow where one of its lines is not a line on the road.
All but the first choice must be confirmed by the texture of the road surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.texture_alignment import TextureFit
from ..evidence.cue_fusion import same_road
from ..evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from ..evidence.lane_heights import lies_on
from ..geometry.pose import Extrinsics
from ..lanes.closed_form import solve_plane
from ..lanes.extra_lines import find_extra_lines
from ..lanes.hypotheses import LaneHypotheses, cross, find_hypotheses, lines_below_plane
from ..lanes.lane_pair import LanePattern
from ..rejection import NotFitted, RejectReason
from .attempt import Attempt, Verdict
from .texture_guided_lines import find_road, lines_on_road

# Most other pairs that are solved: each takes as much time as the first one.
_MAX_PAIRS_TO_CONFIRM = 4
# Where one of two lines is not on the road, or not the same in both cameras, other pairs are solved. In most
# random worlds, the right pair was among this many.
_REASONS_FOR_OTHER_PAIRS = (
    RejectReason.LINES_NOT_MATCHED,
    RejectReason.LINE_BELOW_ROAD,
    RejectReason.LINES_NOT_COPLANAR,
    RejectReason.LINE_NOT_PAINTED,
)
_MAX_OTHER_PAIRS = 2


def hypotheses(
    first: LaneHypotheses,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
    attempts: Sequence[Attempt],
) -> Iterator[Hypothesis]:
    """Yield the hypotheses about a frame, most promising first, until one of them is accepted.

    Args:
        first: Pairs of lines for which single stripe points have voted.
        frame: Images and stripe points.
        rig: Intrinsics and baseline.
        config: Settings.
        attempts: Attempts so far; the caller appends each one before it takes the next hypothesis.
    """
    yield from _first_choice(first, frame, rig, config, attempts)
    if not config.texture.check or (attempts and attempts[-1].accepted):
        return
    refused, n_first = (attempts[-1] if attempts else None), len(attempts)
    chained = find_hypotheses(frame.points, frame.images, rig, config, chained=True)
    yield from _other_pairs(first, chained, rig, attempts)
    if attempts and attempts[-1].accepted:
        return
    # The pose over the surface, from the first of these attempts that has aligned its texture.
    seen = [each.poses.textured for each in attempts[max(n_first - 1, 0) :]]
    known_pose = next((pose for pose in seen if pose is not None), None)
    matches = [match for found in (chained, first) for side in found.matches for match in side]
    texture = find_road(frame.images, known_pose, matches, rig, config)
    if texture is None or (known_pose is not None and not same_road(known_pose, texture.extrinsics)):
        return
    candidates = [found.candidates[0] for found in (chained, first)]
    for pattern in lines_on_road(texture.extrinsics, candidates, frame.points, frame.images, rig, config):
        yield Hypothesis(FoundBy.TEXTURE, pattern, locating_texture=texture, needs_texture=True)
        if attempts[-1].accepted:
            return
    if not _shows_another_slope(refused, texture, rig):
        yield Hypothesis(FoundBy.SURFACE, None, locating_texture=texture, single_lines=tuple(matches))


def choose(attempts: Sequence[Attempt]) -> Attempt | None:
    """Return the attempt whose result is that of the frame; None without one.

    It is the accepted attempt. Without one, it is the last attempt that a gate has refused, of those of the
    first choice and of the surface alone. Lines that need the texture's confirmation are less likely to be
    the lane's, so their refusals do not count.
    """
    for attempt in attempts:
        if attempt.accepted:
            return attempt
    refused = [
        each for each in attempts if each.verdict is Verdict.REFUSED and not each.hypothesis.needs_texture
    ]
    return refused[-1] if refused else None


def _first_choice(
    first: LaneHypotheses,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
    attempts: Sequence[Attempt],
) -> Iterator[Hypothesis]:
    """Yield the pair with the best score, with and without extra lines; then other pairs."""
    if not isinstance(first.patterns, list):
        return
    depths = lines_below_plane(first.patterns, rig)

    def pair(pattern: LanePattern, index: int) -> Hypothesis:
        return Hypothesis(FoundBy.HOUGH, pattern, first.matches, depths[index])

    clearest = first.patterns[0]
    extra = find_extra_lines(clearest, first.matches, frame.points, rig, config)
    yield pair(clearest.joined(extra), 0)
    if extra and not attempts[-1].accepted:
        yield pair(clearest, 0)
    if attempts[-1].reason not in _REASONS_FOR_OTHER_PAIRS:
        return
    others = [
        index
        for index, depth in enumerate(depths)
        if index and not depth.surely_below and not cross(clearest, first.patterns[index])
    ]
    for index in others[:_MAX_OTHER_PAIRS]:
        if attempts[-1].reason in _REASONS_FOR_OTHER_PAIRS:
            yield pair(first.patterns[index], index)


def _other_pairs(
    first: LaneHypotheses, chained: LaneHypotheses, rig: StereoRig, attempts: Sequence[Attempt]
) -> Iterator[Hypothesis]:
    """Yield pairs of lines whose plane differs from those before, until one is accepted."""
    tried: list[Extrinsics] = []
    road_pose: Extrinsics | None = None
    if attempts:
        road_pose = attempts[-1].poses.textured
        tried += [pose for pose in (attempts[-1].poses.genetic,) if pose is not None]
    n_tried = 0
    for found, found_by in ((chained, FoundBy.CHAINS), (first, FoundBy.HOUGH)):
        for pattern in found.patterns if isinstance(found.patterns, list) else ():
            closed = solve_plane(pattern, rig)
            if isinstance(closed, NotFitted) or n_tried == _MAX_PAIRS_TO_CONFIRM:
                continue
            if any(same_road(closed.extrinsics, other) for other in tried):
                continue
            tried.append(closed.extrinsics)
            if road_pose is not None and not lies_on(pattern, rig, closed.extrinsics, road_pose):
                continue
            n_tried += 1
            yield Hypothesis(found_by, pattern, needs_texture=True)
            if attempts[-1].accepted:
                return
            road_pose = road_pose or attempts[-1].poses.textured


def _shows_another_slope(refused: Attempt | None, texture: TextureFit, rig: StereoRig) -> bool:
    """Whether lines that lie in the surface were refused because the slope of the road changes ahead.

    Such a refusal is kept, as the texture shows less of the road farther ahead.
    """
    if refused is None or refused.reason is not RejectReason.ROAD_NOT_FLAT or refused.pattern is None:
        return False
    line_pose = refused.poses.by_lines
    return line_pose is not None and lies_on(refused.pattern, rig, line_pose, texture.extrinsics)
