"""Whether the right camera has turned about the vertical against its calibration.

Such a turn changes all disparities by the same number. The surface of the road fits as well as before, with
another pitch. Two things know of it: what is infinitely far away has a disparity, and lane lines, which are
parallel, do not meet at the horizon of the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics
from ..lanes.line_geometry import height_and_offset_m
from ..lanes.matching import Matches
from ..road.priors import MAX_LANE_WIDTH_M, MIN_LANE_WIDTH_M, PAINT_ANGLE_STD_RAD, VERGENCE_STD_RAD
from ..tolerances import EXCLUDED_SIGMAS, WRONG
from ..types import Array, Mask
from .far_disparity import MOST_TURN_RAD, FarDisparity, equally_far
from .rig_unknowns import response_of_surface

# Least likeness of the two lines of a lane in both images for them to contradict the surface.
_LEAST_LIKENESS = 0.9
# Least votes of them, over those of the clearest line: a dashed line is painted over a third of its length.
_LEAST_VOTES = 0.3
# Lines are parallel within this many standard deviations of their paint; nearer ones tell no horizon.
_PARALLEL_STDS, _LEAST_SPAN_M = 3.0, 1.0


@dataclass(frozen=True, slots=True)
class Vergence:
    """A turn of the right camera about the vertical, by what contradicts its calibration most.

    Attributes:
        yaw_rad: The angle by which it looks farther left [rad]: disparities are smaller by ``fx * yaw_rad``.
        std_rad: Its standard deviation.
        wrong_rad: The turn from which on a pose over the road surface is wrong.
        by_lines: Whether lane lines tell it, else what is far away.
    """

    yaw_rad: float
    std_rad: float
    wrong_rad: float
    by_lines: bool


def measure_vergence(
    far: FarDisparity | None,
    lines: Matches,
    rig: StereoRig,
    extrinsics: Extrinsics,
    pitch_std_rad: float = 0.0,
) -> tuple[Vergence, ...]:
    """Measure how the right camera has turned, by what is far away and by lane lines on the road surface.

    Args:
        far: The disparity of what is farthest away; None where nothing is seen.
        lines: Lines that both cameras see on the road surface.
        rig: Intrinsics and baseline.
        extrinsics: Pose over the road surface.
        pitch_std_rad: Standard deviation of its pitch, without what is unknown of the rig.

    Returns:
        What each of them tells; the clearest contradiction of the calibration comes first.
    """
    wrong_rad = _wrong_rad(rig, extrinsics)
    found = []
    if far is not None:
        # Nothing is farther than infinity; what is nearer than it shows no turn.
        disparity = min(far.disparity_px, 0.0) / rig.fx
        found.append(Vergence(-disparity, far.std_px / rig.fx, wrong_rad, by_lines=False))
    by_lines = _by_lines(lines, rig, extrinsics, wrong_rad, pitch_std_rad)
    if by_lines is not None and not _denied(by_lines, far, rig):
        found.append(by_lines)
    return tuple(sorted(found, key=lambda each: -abs(each.yaw_rad) / each.std_rad))


def _wrong_rad(rig: StereoRig, extrinsics: Extrinsics) -> float:
    """Return the turn from which on a pose over the road surface is wrong."""
    response = np.abs(response_of_surface(rig, extrinsics).changes[:, 0]) / VERGENCE_STD_RAD
    return float(np.min(WRONG / np.maximum(response, np.finfo(np.float64).eps)))


@dataclass(frozen=True, slots=True, eq=False)
class _Bundle:
    """Lines on the road surface, as they meet its horizon, in the left image.

    Lines that are parallel on a road meet in one point. Its row is that of the true horizon; the horizon of
    the surface they meet in columns that grow with their slopes, by the rows between both.

    Attributes:
        columns: (N,) where they meet the horizon of the surface [px].
        slopes: (N,) columns by which each line moves for a row below that horizon.
        variances: (N,) of the columns, by the fit and by paint that is not parallel.
        offsets_m: (N,) how far left of the camera they lie.
        votes: (N,) how clear they are.
        alike: (N,) whether both cameras see the same line, and clearly.
        px_per_row: Growth of the surface's disparity by the row.
    """

    columns: Array
    slopes: Array
    variances: Array
    offsets_m: Array
    votes: Array
    alike: Mask
    px_per_row: float

    def parallel(self, rows: float, column: float) -> Mask:
        """Whether each line leads to a column of a horizon that lies so many rows below the surface's."""
        off = self.columns + self.slopes * rows - column
        near: Mask = np.abs(off) < _PARALLEL_STDS * np.sqrt(self.variances)
        return near

    def fitted(self, chosen: Mask) -> tuple[float, float]:
        """Return the rows from the horizon of the surface down to where lines meet, and their variance."""
        weights = 1.0 / self.variances[chosen]
        slopes, columns = self.slopes[chosen], self.columns[chosen]
        slopes = slopes - np.average(slopes, weights=weights)
        information = float(weights @ slopes**2)
        return -float(weights @ (slopes * columns)) / information, 1.0 / information

    def spans_lane(self, chosen: Mask) -> bool:
        """Whether lines lie far enough apart to tell where they meet."""
        return bool(chosen.any()) and float(np.ptp(self.offsets_m[chosen])) >= _LEAST_SPAN_M


def _bundle(lines: Matches, rig: StereoRig, extrinsics: Extrinsics) -> _Bundle:
    """Return the lines as they meet the horizon of the road surface."""
    middle = plane_from_pose(extrinsics, rig)
    plane = middle.of_camera(PlaneCamera.LEFT, rig)
    ahead, aside, down = plane.coefficients
    # The horizon is where the disparity is zero: a straight line of the image, tilted by the roll.
    tilt = -aside / down * rig.fy / rig.fx
    at_column_0 = rig.cy + ahead / down * rig.fy - tilt * rig.cx
    found = []
    for match in (each for side in lines for each in side):
        line = match.left.line
        row = (at_column_0 + tilt * (line.u_mid - line.slope * line.v_mid)) / (1.0 - tilt * line.slope)
        by_fit = np.array([1.0, row - line.v_mid])
        variance = by_fit @ line.covariance @ by_fit + (rig.fx * PAINT_ANGLE_STD_RAD) ** 2 / 2.0
        offset_m = height_and_offset_m(line, match.right.line, middle, rig)[1]
        column = float(line.column_at(np.array(row)))
        by_row = line.slope / (1.0 - tilt * line.slope)
        found.append((column, by_row, variance, offset_m, match.votes, match.similarity))
    columns, slopes, variances, offsets_m, votes, similarity = np.array(found).reshape(-1, 6).T
    alike = (similarity > _LEAST_LIKENESS) & (votes >= _LEAST_VOTES * votes.max(initial=0.0))
    return _Bundle(columns, slopes, variances, offsets_m, votes, alike, -float(down) / rig.fy)


def _by_lines(
    lines: Matches, rig: StereoRig, extrinsics: Extrinsics, wrong_rad: float, pitch_std_rad: float
) -> Vergence | None:
    """Return the turn under which the lines of a lane are parallel; None where lines confirm the surface.

    Lines confirm the surface where two of them are parallel on it that are not parallel under the turn.
    """
    bundle = _bundle(lines, rig, extrinsics)
    best: Mask | None = None
    for first, second in combinations(range(len(bundle.columns)), 2):
        width_m = abs(float(bundle.offsets_m[first] - bundle.offsets_m[second]))
        both_alike = bool(bundle.alike[first] and bundle.alike[second])
        if not (both_alike and MIN_LANE_WIDTH_M <= width_m <= MAX_LANE_WIDTH_M):
            continue
        two = np.isin(np.arange(len(bundle.columns)), (first, second))
        rows = bundle.fitted(two)[0]
        chosen = (
            bundle.parallel(rows, float(bundle.columns[first] + bundle.slopes[first] * rows)) & bundle.alike
        )
        if best is None or bundle.votes[chosen].sum() > bundle.votes[best].sum():
            best = chosen
    if best is None:
        return None
    confirming = [bundle.parallel(0.0, float(column)) for column in bundle.columns]
    if any(bundle.spans_lane(each) and bool((each & ~best).any()) for each in confirming):
        return None
    rows, variance = bundle.fitted(best)
    to_rad = bundle.px_per_row / rig.fx
    yaw_rad = -rows * to_rad
    if abs(yaw_rad) > MOST_TURN_RAD:  # no calibration is that far off: such lines are not parallel
        return None
    std_rad = math.hypot(math.sqrt(variance), pitch_std_rad * rig.fy) * to_rad
    return Vergence(yaw_rad, std_rad, wrong_rad, by_lines=True)


def _denied(by_lines: Vergence, far: FarDisparity | None, rig: StereoRig) -> bool:
    """Whether what is far away shows that it is the lines that are not parallel."""
    if far is None:
        return False
    # The disparity at infinity that lines tell, over the one that is seen: nothing is farther than infinity.
    excess_px = -by_lines.yaw_rad * rig.fx - far.disparity_px
    limit_px = EXCLUDED_SIGMAS * math.hypot(by_lines.std_rad * rig.fx, far.std_px)
    return excess_px > limit_px or (equally_far(far) >= 1.0 and -excess_px > limit_px)
