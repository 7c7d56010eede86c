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

"""The yaw of the right camera, by everything that tells it: rows, lane lines, and what is far away.

Each of them gives a likelihood of the yaw. Rows and lines give a value with a standard deviation. The least
disparity that is seen is that at infinity plus that of the farthest thing, which is never negative. With a
prior of what calibrations leave, the product is the probability of the yaw (Bayes), on a grid.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..lanes.lane_pair import ImageLine
from ..lanes.line_geometry import heights_and_offsets_m
from ..lanes.matching import Matches
from ..road.priors import (
    FARTHEST_M,
    MAX_LANE_WIDTH_M,
    MIN_LANE_WIDTH_M,
    PAINT_ANGLE_STD_RAD,
    PARALLEL_PART,
    TURNED_PART,
    TURNED_STD_RAD,
    VERGENCE_STD_RAD,
)
from ..tolerances import WRONG
from ..types import Array
from .far_disparity import MOST_TURN_RAD, FarDisparity, infinitely_far
from .rig_unknowns import RigStd, response_of_surface

# The grid has so many points around each value that is told, and around zero, closer together where they
# matter: from a thousandth of the width to all of the range.
_POINTS = 161
_CLOSEST = 1e-3
_REACH = 6.0  # standard deviations to either side that are on the grid
_WRONG_MATCH = 0.01  # how often what seems farthest away is a wrong match
_ANYTHING = 1.0 / (2.0 * MOST_TURN_RAD)  # density of an angle that tells nothing


@dataclass(frozen=True, slots=True)
class YawTold:
    """The yaw of the right camera as one thing tells it.

    Attributes:
        yaw_rad: The yaw [rad], > 0: it looks farther left.
        std_rad: Its standard deviation.
        certainty: How likely it tells it at all: two lines may be edges that are not parallel.
    """

    yaw_rad: float
    std_rad: float
    certainty: float = 1.0

    @property
    def rms_rad(self) -> float:
        """Root of the mean square of the yaw: what a pose that is not corrected by it has to allow for."""
        return math.hypot(self.yaw_rad, self.std_rad)


def wrong_yaw_rad(rig: StereoRig, pose: Extrinsics) -> float:
    """Return the yaw of the right camera from which on a pose over the road surface is wrong.

    Args:
        rig: Intrinsics and baseline.
        pose: The pose.
    """
    response = np.abs(response_of_surface(rig, pose, RigStd(yaw_rad=1.0)).changes[:, 0])
    return float(np.min(WRONG / np.maximum(response, np.finfo(np.float64).eps)))


def yaw_of_matches(matches: Matches, rig: StereoRig, road_pose: Extrinsics) -> YawTold | None:
    """Return the yaw that the clearest two lines on a road tell, wherever they meet.

    Args:
        matches: Lines to the left and to the right of the camera that both cameras see.
        rig: Intrinsics and baseline.
        road_pose: Pose over the road.

    Returns:
        The yaw; None without two lines as far apart as those of a lane.
    """
    plane = plane_from_pose(road_pose, rig)
    sides = [
        list(zip(side, heights_and_offsets_m([match.lines for match in side], plane, rig)[1], strict=True))
        for side in matches
    ]
    best, most_votes = None, 0.0
    for (first, first_m), (second, second_m) in product(*sides):
        width_m = abs(float(first_m - second_m))
        votes = first.votes + second.votes
        if MIN_LANE_WIDTH_M <= width_m <= MAX_LANE_WIDTH_M and votes > most_votes:
            best, most_votes = (first, second, width_m), votes
    if best is None:
        return None
    first, second, width_m = best
    in_left, in_right = zip(first.lines, second.lines, strict=True)
    return yaw_of_lines(in_left, in_right, width_m, rig)


def yaw_of_lines(
    in_left: tuple[ImageLine, ImageLine],
    in_right: tuple[ImageLine, ImageLine],
    width_m: float,
    rig: StereoRig,
) -> YawTold | None:
    """Return the yaw that the disparity tells where two lane lines meet, which is infinitely far.

    Args:
        in_left: The lines in the left image.
        in_right: The same lines in the right image.
        width_m: Distance between them [m].
        rig: Intrinsics and baseline.

    Returns:
        The yaw; None where the lines do not meet. Lines are painted parallel within
        :data:`..road.priors.PAINT_ANGLE_STD_RAD`; two at that angle meet at a distance, where the disparity
        is the focal length times the baseline times the angle over their distance.
    """
    (at_left, left_variance), (at_right, right_variance) = (
        _meeting_column(*lines) for lines in (in_left, in_right)
    )
    variance_px = left_variance + right_variance
    if not (math.isfinite(variance_px) and width_m > 0.0):
        return None
    by_paint = rig.baseline_m * PAINT_ANGLE_STD_RAD / width_m
    std = math.hypot(math.sqrt(variance_px) / rig.fx, by_paint)
    return YawTold((at_right - at_left) / rig.fx, std, PARALLEL_PART)


def _meeting_column(first: ImageLine, second: ImageLine) -> tuple[float, float]:
    """Return the column where two lines of an image meet, and its variance [px]; infinite if they do not."""
    between = first.slope - second.slope
    if between == 0.0:
        return 0.0, math.inf
    row = (second.column_at(np.zeros(1)) - first.column_at(np.zeros(1)))[0] / between
    variance = 0.0
    for line, other in ((first, second), (second, first)):
        # A line that is moved by one, or by one for each row, moves the point along the other line.
        along = other.slope / (other.slope - line.slope)
        by_line = along * np.array([1.0, row - line.v_mid])
        variance += float(by_line @ line.covariance @ by_line)
    return float(first.column_at(np.array([row]))[0]), variance


def yaw_posterior(
    told: Sequence[YawTold],
    far: FarDisparity | None,
    rig: StereoRig,
    *,
    calibrated: bool,
    corrected_rad: float = 0.0,
) -> YawTold:
    """Return the yaw by all that tells it.

    Args:
        told: The yaw by rows and lines.
        far: The disparity of what is farthest away; None where nothing is seen.
        rig: Intrinsics and baseline.
        calibrated: Whether the prior is that of calibrated pairs, of which few have turned by much since;
            else all angles are equally probable, up to where far things are searched for, or farther where
            rows or lines tell more.
        corrected_rad: The yaw of which the images are free already [rad].

    Returns:
        Mean and standard deviation of the yaw that is left in the images.
    """
    return _posterior(tuple(told), far, rig, calibrated, corrected_rad)


@functools.lru_cache(maxsize=16)  # the observations of a frame are asked more than once
def _posterior(
    told: tuple[YawTold, ...],
    far: FarDisparity | None,
    rig: StereoRig,
    calibrated: bool,
    corrected_rad: float,
) -> YawTold:
    """Return what :func:`yaw_posterior` does."""
    # What rows tell beyond the range is a turn all the same: at its end, it would look sharply known.
    most_rad = MOST_TURN_RAD
    if not calibrated:
        most_rad = max(most_rad, *(abs(each.yaw_rad) + _REACH * each.std_rad for each in told), 0.0)
    grid = _grid(told, corrected_rad, most_rad)
    likelihood = np.ones(len(grid))
    for each in told:
        seen = _normal(grid - each.yaw_rad, each.std_rad)
        likelihood *= each.certainty * seen + (1.0 - each.certainty) * _ANYTHING
    if far is not None:
        likelihood *= _likelihood_of_far(far, rig, grid)
    if calibrated:
        whole = grid + corrected_rad
        usual, turned = _normal(whole, VERGENCE_STD_RAD), _normal(whole, TURNED_STD_RAD)
        likelihood *= (1.0 - TURNED_PART) * usual + TURNED_PART * turned
    weights = likelihood * np.gradient(grid)
    weights /= weights.sum()
    mean = float(weights @ grid)
    return YawTold(mean, math.sqrt(float(weights @ (grid - mean) ** 2)))


def _grid(told: Sequence[YawTold], corrected_rad: float, most_rad: float) -> Array:
    """Return angles, in order, that are close together where the probability may be."""
    reach = np.geomspace(_CLOSEST, 1.0, _POINTS // 2)
    steps = np.concatenate([-reach[::-1], [0.0], reach]) * 2.0 * most_rad
    centres = [0.0, -corrected_rad, *(min(max(each.yaw_rad, -most_rad), most_rad) for each in told)]
    # A narrow likelihood needs points within it.
    narrow = [each.yaw_rad + each.std_rad * np.linspace(-_REACH, _REACH, _POINTS) for each in told]
    grid = np.unique(np.concatenate([*(centre + steps for centre in centres), *narrow]))
    inside: Array = grid[np.abs(grid) <= most_rad]
    return inside


def _likelihood_of_far(far: FarDisparity, rig: StereoRig, grid: Array) -> Array:
    """Return the likelihood of yaws (N,) by the least disparity that is seen.

    It is the disparity at infinity, ``-fx * yaw``, plus that of the farthest thing: zero if that is
    infinitely far, else exponentially distributed.
    """
    excess, std = far.disparity_px / rig.fx + grid, far.std_px / rig.fx
    at_infinity = infinitely_far(far)
    mean = rig.baseline_m / FARTHEST_M
    # A normal error plus an exponential excess (exponentially modified Gaussian distribution).
    inside = np.array([math.erfc(each) for each in (std / mean - excess / std) / math.sqrt(2.0)])
    nearer = np.exp(np.minimum(0.5 * (std / mean) ** 2 - excess / mean, 700.0)) * inside / (2.0 * mean)
    seen = at_infinity * _normal(excess, std) + (1.0 - at_infinity) * nearer
    likelihood: Array = (1.0 - _WRONG_MATCH) * seen + _WRONG_MATCH * _ANYTHING
    return likelihood


def _normal(values: Array, std: float) -> Array:
    density: Array = np.exp(-0.5 * (values / std) ** 2) / (std * math.sqrt(2.0 * math.pi))
    return density
