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

"""How the right camera is turned against the left one, by the rows of points that both see.

In rectified images, a point has the same row in both. A right camera that is turned moves it, in normalised
coordinates x to the right and y down, by ``-roll x - pitch (1 + y^2) + yaw x y`` (the derivative of
:func:`..geometry.alignment.optical_rotation`). One that sits higher or farther ahead than the calibration has
it moves near points: by ``nearness (up + ahead y)``, where the nearness is the disparity over the focal
length (epipolar geometry: Hartley and Zisserman, Multiple View Geometry, chapter 9). The images of cameras
that are not triggered at the same time look like those of a camera that sits farther ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..numerics.linear import invert, is_covariance, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..rejection import Bound, NotFitted
from ..road.priors import (
    BASELINE_DIRECTION_STD_RAD,
    ROW_YAW_STD_RAD,
)
from ..types import Array
from .matched_points import MatchedPoints

_REWEIGHTING = Reweighting(rounds=8, absolute_rounds=4)
# Rows of matched points scatter by 0.1 to 0.3 px in recorded frames. Where texture is but noise, matches
# scatter by several pixels.
_LEAST_SCATTER_PX, _MOST_SCATTER_PX = 0.01, 1.0
_LEAST_POINTS = 30  # six for each of five unknowns
_DETERMINED = "numbers of the rows that the points determine"
_ANY_TURN_RAD = 0.02  # a degree: beyond, a pair of images is hardly matched at all
# What all points have in common, at least: the interpolation of grey values draws them to whole pixels by
# about this (Shimizu and Okutomi, IJCV 2005).
LEAST_SMOOTH_PX = 0.03
_ANY_DIRECTION = 3.0  # of the baseline: an image is 30 ms late at 15 m/s, with a baseline of 0.15 m
# Least disparity over that of a right camera that does not sit ahead: beyond, a point is not matched.
_LEAST_WIDENING = 0.2
# Parts of the image, side by side and one above the other, in which rows have an error of their own.
_PARTS_ACROSS, _PARTS_DOWN = 6, 3


@dataclass(frozen=True, slots=True, eq=False)
class RowAlignment:
    """How the right camera is turned and moved, by the rows of matched points.

    Attributes:
        turn: (3,) pitch, roll and yaw of the right camera [rad], with the signs of an
            :class:`..geometry.alignment.Alignment`.
        ahead: How much farther ahead it sits than the rig has it, over the baseline.
        up: How much higher it sits, over the baseline.
        covariance: (5, 5) of (pitch, roll, yaw, up, ahead), with the smooth error that calibrations leave.
        scatter_px: Standard deviation of the rows of one point.
        distortion_px: Standard deviation over the image of the smooth error of the rows that no pitch and no
            roll explains [px]: what lenses and rectification leave.
        n_points: Number of points that agree.
    """

    turn: Array
    ahead: float
    up: float
    covariance: Array
    scatter_px: float
    distortion_px: float
    n_points: int

    @property
    def yaw(self) -> tuple[float, float]:
        """The yaw of the right camera and its standard deviation [rad]."""
        return float(self.turn[2]), math.sqrt(float(self.covariance[2, 2]))

    @property
    def ahead_std(self) -> float:
        """Standard deviation of :attr:`ahead`."""
        return math.sqrt(float(self.covariance[4, 4]))


def row_derivatives(rig: StereoRig, points: MatchedPoints, ahead: float = 0.0) -> Array:
    """Return the derivatives (N, 5) of the rows [px] in the right image, less those in the left one.

    Args:
        rig: Intrinsics.
        points: Matched points.
        ahead: How much farther ahead the right camera sits, over the baseline, as far as it is known. It
            moves points along the row, too, so that their disparities tell another nearness.

    Returns:
        By pitch, roll and yaw of the right camera [rad], and by its way up and ahead over the baseline.
    """
    u, v = points.right.astype(np.float64).T
    x, y = (u - rig.cx) / rig.fx, (v - rig.cy) / rig.fy
    nearness = (points.left[:, 0].astype(np.float64) - u) / rig.fx
    nearness = nearness / np.maximum(1.0 - ahead * x, _LEAST_WIDENING)
    columns = [-(1.0 + y * y), -x, x * y, nearness, nearness * y]
    return rig.fy * np.column_stack(columns)


def align_rows(points: MatchedPoints, rig: StereoRig) -> RowAlignment | NotFitted:
    """Fit the turn of the right camera to the rows of matched points.

    The angles have no prior here: other evidence tells them, too. The direction of the baseline has one with
    heavy tails (Cauchy): what calibrations leave, or much more where images are late. Its variance is that of
    the prior and the square of the estimate.

    Args:
        points: Matched points.
        rig: Intrinsics and baseline.

    Returns:
        The turn, or why there is none: too few points, or points that do not agree.
    """
    if len(points) < _LEAST_POINTS:
        return NotFitted("points of texture that both images show", len(points), Bound.LEAST, _LEAST_POINTS)
    rows = (points.right[:, 1] - points.left[:, 1]).astype(np.float64)
    design = row_derivatives(rig, points)
    prior = np.array([_ANY_TURN_RAD] * 3 + [BASELINE_DIRECTION_STD_RAD] * 2)
    # The first fits do not hold the baseline: near points of late images would seem to be outliers.
    solution, held = np.array([0.0, 0.0, 0.0, _ANY_DIRECTION, _ANY_DIRECTION]), 0

    def fit(weights: Array, scale: float | Array) -> tuple[tuple[Array, Array], Array] | NotFitted:
        nonlocal solution, design, held
        weighted = design * (weights / np.square(scale))[:, None]
        normal = weighted.T @ design + np.diag(1.0 / (prior**2 + solution**2))
        found = solve_linear(normal, weighted.T @ rows, _DETERMINED)
        if isinstance(found, NotFitted):
            return found
        held += 1
        solution = found if held >= _REWEIGHTING.absolute_rounds else np.append(found[:3], solution[3:])
        design = row_derivatives(rig, points, float(found[4]))
        return (found, normal), rows - design @ found

    found = fit_reweighted(fit, len(points), _REWEIGHTING, scale_by_median(_LEAST_SCATTER_PX))
    if isinstance(found, NotFitted):
        return found
    scatter = float(found.scale)
    if scatter > _MOST_SCATTER_PX:
        return NotFitted("scatter of the rows of matched points", scatter, Bound.MOST, _MOST_SCATTER_PX, "px")
    covariance = invert(found.solution[1], _DETERMINED)
    if isinstance(covariance, NotFitted):
        return covariance
    values, used = found.solution[0], int(np.count_nonzero(found.weights))
    smooth_px = math.hypot(
        LEAST_SMOOTH_PX, _smooth_error(points, found.residuals, found.weights, scatter, rig)
    )
    covariance[:2, :2] += np.diag(turn_by_smooth_rows(smooth_px, rig) ** 2)
    # The product of column and row, over the image, by more than its standard deviation.
    product = max(0.0, float(values[2] ** 2 - covariance[2, 2])) * (rig.width * rig.height / 4.0) ** 2 / 9.0
    distortion_px = math.hypot(smooth_px, math.sqrt(product) / rig.fx)
    covariance[2, 2] += ROW_YAW_STD_RAD**2
    if not is_covariance(covariance):
        return NotFitted(_DETERMINED, 4, Bound.LEAST, 5)
    turn, up, ahead = values[:3], float(values[3]), float(values[4])
    return RowAlignment(turn, ahead, up, covariance, scatter, distortion_px, used)


def turn_by_smooth_rows(smooth_px: float, rig: StereoRig) -> Array:
    """Return the pitch and the roll (2,) [rad] that a smooth error of the rows is taken for.

    A constant error is a pitch; one that grows with the column, to as much at the border, is a roll.

    Args:
        smooth_px: The error of the rows [px].
        rig: Intrinsics.
    """
    return smooth_px / rig.fy * np.array([1.0, 2.0 * rig.fx / rig.width])


def _smooth_error(
    points: MatchedPoints, residuals: Array, weights: Array, scatter_px: float, rig: StereoRig
) -> float:
    """Return the standard deviation of what points of a part of the image have in common [px]."""
    column, row = points.right.astype(np.float64).T
    across = np.clip(column * _PARTS_ACROSS / rig.width, 0, _PARTS_ACROSS - 1).astype(np.intp)
    down = np.clip(row * _PARTS_DOWN / rig.height, 0, _PARTS_DOWN - 1).astype(np.intp)
    part, n_parts = across * _PARTS_DOWN + down, _PARTS_ACROSS * _PARTS_DOWN
    count = np.bincount(part, weights, n_parts)
    sums = np.bincount(part, weights * residuals, n_parts)
    # The square of a mean exceeds that of the smooth error by the variance of the mean.
    excess = float((sums**2).sum() - scatter_px**2 * count.sum()) / float((count**2).sum())
    return math.sqrt(max(0.0, excess))
