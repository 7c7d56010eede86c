"""Further lines beside the two boundaries of a lane: double lines, those of bus lanes and of the next lanes.

Only the boundaries make the plane, as the next lane may slope otherwise. What is told apart here: a line
that is none of the road (a rail, the top of a kerb, a shadow) misses the point where all lines meet, or lies
too high.
"""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..geometry.plane import DisparityPlane, plane_from_pose
from ..geometry.rays import LEAST_DISPARITY_PX, pixel_rays
from ..rejection import NotFitted
from ..road.priors import FALL_STD, GREATEST_FALL, HIGHEST_CROWN_M, LANE_M, UNEVEN_STD_M
from ..tolerances import MAX_LINE_HEIGHT_M
from .closed_form import solve_plane
from .lane_pair import ExtraLine, ImageLine, LanePattern
from .line_fit import refit_line
from .line_geometry import HeightOverLane, height_and_offset_m, height_std_m
from .matching import HALF_CREDIT_PX, Match, Matches, common_point, first_sampled_row
from .stripe_points import StripePoints

# Boundaries that miss their common point by this have half of their credit (`core.lanes.matching`); a further
# line could be left out, so it is held to that.
_MAX_CONCURRENCY_PX = HALF_CREDIT_PX
# Each costs as much as a boundary in the refinement; a road has rarely more lines within a lane's width.
_MOST_LINES = 4
# Lines are marked along the row. Farther aside, a line moves by more columns a row than it is wide where its
# direction is seen, and is marked off by up to half a pixel, which the angles between lines do not bear.
_MAX_SLOPE = 2.5
_SIGMAS = 4.0  # a line between the boundaries is beside their plane for sure


def find_extra_lines(
    pattern: LanePattern,
    matches: Matches,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[ExtraLine, ...]:
    """Return the other lines both cameras see on the road of a lane, most voted first.

    Args:
        pattern: The boundaries of the lane.
        matches: Lines both cameras see.
        points: Stripe points of both images.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.
    """
    closed = solve_plane(pattern, rig)
    if isinstance(closed, NotFitted):
        return ()
    plane = plane_from_pose(closed.extrinsics, rig)
    own = [
        height_and_offset_m(*pair, plane, rig)[1] for pair in zip(pattern.left, pattern.right, strict=True)
    ]
    taken = [(place, _width_m(line, plane, rig)) for place, line in zip(own, pattern.left, strict=True)]
    found: list[ExtraLine] = []
    for match in sorted((m for side in matches for m in side), key=lambda m: -m.votes):
        if len(found) == _MOST_LINES:
            break
        if _is_one_of(own, match, plane, rig):
            continue
        lines = _refit(match, pattern, points, rig, config)
        if lines is None:
            continue
        height_m, aside_m = height_and_offset_m(*lines, plane, rig)
        width_m = _width_m(lines[0], plane, rig)
        if any(abs(aside_m - place) < (width_m + width) / 2.0 for place, width in taken):
            continue
        beyond_m = max(aside_m - max(own), min(own) - aside_m, 0.0)
        allowed_m = MAX_LINE_HEIGHT_M + GREATEST_FALL * beyond_m
        if beyond_m > LANE_M or abs(height_m) > allowed_m:
            continue
        _, missed_px = common_point([*pattern.left, *pattern.right, *lines])
        if missed_px > _MAX_CONCURRENCY_PX:
            continue
        taken.append((aside_m, width_m))
        found.append(ExtraLine(*lines, float(np.hypot(UNEVEN_STD_M, FALL_STD * _lever_m(own, aside_m)))))
    return tuple(found)


def _lever_m(own: list[float], aside_m: float) -> float:
    """Return how much higher a line comes to lie over the plane by a change of slope beside it [m].

    Beyond the boundaries, where the next lane begins: at the nearer one; between them: at the line itself.
    """
    first, second = abs(aside_m - min(own)), abs(aside_m - max(own))
    if min(own) < aside_m < max(own):
        return first * second / (first + second)
    return min(first, second)


def inner_line_height(
    pattern: LanePattern,
    plane: DisparityPlane,
    matches: Matches,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> HeightOverLane:
    """Return how far a line between the boundaries lies above or below their plane.

    A lane has no lines in it but its own: one that lies over the plane says that the boundaries are those of
    more than one lane, with a crown between them; one below it, that one of them is a kerb or a rail.

    Args:
        pattern: The boundaries.
        plane: Through them, of the camera in the middle.
        matches: Lines both cameras see.
        points: Stripe points of both images.
        rig: Intrinsics and baseline.
        config: Settings of the extraction.

    Returns:
        Of the line that stands out the most; zeros where there is none.
    """
    own = [
        height_and_offset_m(*pair, plane, rig)[1] for pair in zip(pattern.left, pattern.right, strict=True)
    ]
    widths = [_width_m(line, plane, rig) for line in pattern.left]
    worst = HeightOverLane(0.0, 0.0)
    for match in (m for side in matches for m in side):
        # Before it is fitted again, a line may be off by as much as it is wide.
        _, aside_m = height_and_offset_m(match.left.line, match.right.line, plane, rig)
        if _is_one_of(own, match, plane, rig) or not min(own) < aside_m < max(own):
            continue
        lines = _refit(match, pattern, points, rig, config)
        if lines is None:
            continue
        height_m, aside_m = height_and_offset_m(*lines, plane, rig)
        if not min(own) + max(widths) < aside_m < max(own) - max(widths) or height_m > HIGHEST_CROWN_M:
            continue
        _, missed_px = common_point([*pattern.left, *pattern.right, *lines])
        if missed_px > _MAX_CONCURRENCY_PX:
            continue
        std_m = height_std_m(*lines, plane, rig)
        if abs(height_m) - _SIGMAS * std_m > abs(worst.value_m) - _SIGMAS * worst.std_m:
            worst = HeightOverLane(height_m, std_m)
    return worst


def _is_one_of(places_m: list[float], match: Match, plane: DisparityPlane, rig: StereoRig) -> bool:
    """Whether a line lies where one is known already, by less than half its width."""
    _, aside_m = height_and_offset_m(match.left.line, match.right.line, plane, rig)
    return any(abs(aside_m - place) < _width_m(match.left.line, plane, rig) / 2.0 for place in places_m)


def _refit(
    match: Match,
    pattern: LanePattern,
    points: tuple[StripePoints, StripePoints],
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[ImageLine, ImageLine] | None:
    """Measure a line of both cameras where the pattern is sampled."""
    first_row = first_sampled_row(pattern.vanishing_point, rig, config)
    left, right = (
        refit_line(view.gradient, candidate.line, view.noise_grey, first_row)
        for view, candidate in zip(points, (match.left, match.right), strict=True)
    )
    if max(abs(match.left.line.slope), abs(match.right.line.slope)) > _MAX_SLOPE:
        return None
    if left is None or right is None or min(left.n_rows, right.n_rows) < config.extraction.min_line_rows:
        return None
    return left, right


def _width_m(line: ImageLine, plane: DisparityPlane, rig: StereoRig) -> float:
    """Return the width of a stripe of the left image on the road [m]."""
    # A pixel is baseline / disparity wide. That the plane is of another camera does not matter here.
    disparity = float(plane.disparities(pixel_rays(rig, line.u_mid, line.v_mid)))
    return line.width_px * rig.baseline_m / max(disparity, LEAST_DISPARITY_PX)
