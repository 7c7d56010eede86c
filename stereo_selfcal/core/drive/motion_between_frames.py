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

"""Motion of the camera between two frames, by landmarks that both frames show.

A landmark of the first frame has a place in the left image and a disparity. Turned and moved, it has another
place and another disparity in the second frame (visual odometry: Nister et al., CVPR 2004; Geiger et al.,
"StereoScan", IV 2011). Depth is the least certain part of it. So the direction of the motion rests on the
places, as it would with one camera; its length rests on the disparities. A right camera that is turned about
the vertical makes all disparities wrong by the same number: this is a seventh unknown. The parallax of the
motion tells it, because far and near points show it differently.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..geometry.pose import BODY_FROM_OPTICAL
from ..numerics.linear import invert, is_covariance, solve_linear
from ..numerics.robust import TUKEY_SIGMAS, Reweighting, fit_reweighted, tukey_weights
from ..numerics.statistics import MEDIAN_CHI2_3, upper_median
from ..rejection import Bound, NotFitted
from ..types import Array, Floats, Indices
from .landmark_matches import different_bits, match_anywhere, match_near

# Standard deviations of a landmark [px]: corners are found to half a pixel in either image, and disparities
# are measured to a fifth. The scatter of each motion scales both.
_PLACE_STD_PX, _DISPARITY_STD_PX = 0.7, 0.3
_STD_PX = np.array([_PLACE_STD_PX, _PLACE_STD_PX, _DISPARITY_STD_PX])
_LEAST_SCALE, _MOST_SCALE = 0.1, 3.0
_ANY_VERGENCE_RAD = 0.005  # prior: a third of a degree, many times what calibrations leave
_LEAST_TO_START = 8  # pairs that surely look alike; with the motion by them, more are found
_LEAST_PAIRS = 20  # three numbers each, for seven unknowns
_LEAST_SHARE = 0.4  # of the pairs that agree with one motion: the rest belongs to other cars, or is wrong
_WAYS_M = np.arange(-1.0, 20.1, 0.5)  # ahead, that a motion may start from
_AGREES = 0.02  # of the width: how far a landmark may be from where such a start moves it
# How far from where they are expected landmarks are looked for, over the width: after the start, and after a
# first fit; and how the motion is fitted to them.
_COARSE = 0.03, Reweighting(rounds=4, absolute_rounds=6)
_FINE = 0.01, Reweighting(rounds=6)
_TINY = 1e-12
_LEAST_WIDENING = 0.2  # beyond, a point is hardly matched

_NOT_BEHIND = 0.1  # least depth after the motion over that before: nearer, a landmark passes the camera
_FAR_OFF_PX = 1e3  # residual of a landmark that would be behind the camera
_DETERMINED = "numbers of the motion that the landmarks determine"


@dataclass(frozen=True, slots=True, eq=False)
class FrameMotion:
    """How the camera has moved from one frame to another one, in body axes (x forward, y left, z up).

    Attributes:
        turned_rad: (3,) rotation vector of its body, in the body of the first frame [rad]. Its components are
            roll, pitch and yaw for small turns: z > 0 is a turn to the left.
        moved_m: (3,) place of the left camera, in the body of the first frame [m].
        right_yaw_rad: Yaw of the right camera that the parallax tells [rad], > 0: farther left.
        covariance: (7, 7) of (turned_rad, moved_m, right_yaw_rad).
        n_points: Number of landmarks that agree.
        scatter: Scatter of the landmarks over what is expected.
    """

    turned_rad: Array
    moved_m: Array
    right_yaw_rad: float
    covariance: Array
    n_points: int
    scatter: float


@dataclass(frozen=True, slots=True, eq=False)
class _MotionState:
    """An estimate, in optical axes: ``p_after = rotation p_before + shift``."""

    rotation: Array
    shift_m: Array
    yaw_rad: float

    def changed(self, step: Array) -> _MotionState:
        turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
        return _MotionState(turn @ self.rotation, self.shift_m + step[3:6], self.yaw_rad + float(step[6]))


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Landmarks of one frame as rays.

    Attributes:
        rays: (N, 3) rays (x, y, 1) of the left camera.
        seen: (N, 3) columns, rows and disparities [px].
        stretch: (N,) disparity of a turn of the right camera about the vertical, over that in its middle.
    """

    rays: Array
    seen: Array
    stretch: Array

    @classmethod
    def of(cls, landmarks: Landmarks, rig: StereoRig) -> _Points:
        left = landmarks.left.astype(np.float64)
        rays = np.column_stack([(left - (rig.cx, rig.cy)) / (rig.fx, rig.fy), np.ones(len(left))])
        of_right = (landmarks.right[:, 0].astype(np.float64) - rig.cx) / rig.fx
        # To a right camera that sits farther ahead, its left half looks nearer and its right half farther.
        widening = np.maximum(1.0 - landmarks.ahead * of_right, _LEAST_WIDENING)
        disparity = (left[:, 0] - landmarks.right[:, 0]) / widening
        return cls(rays, np.column_stack([left, disparity]), 1.0 + of_right**2)

    def chosen(self, index: Indices) -> _Points:
        return _Points(self.rays[index], self.seen[index], self.stretch[index])

    def nearness(self, yaw_rad: float, rig: StereoRig) -> Array:
        """Return the inverse depths (N,) [1/m]."""
        nearness: Array = (self.seen[:, 2] / rig.fx + yaw_rad * self.stretch) / rig.baseline_m
        return nearness


def estimate_motion(before: Landmarks, after: Landmarks, rig: StereoRig) -> FrameMotion | NotFitted:
    """Estimate how the camera has moved between two frames.

    Args:
        before: Landmarks of the first frame.
        after: Landmarks of the second frame.
        rig: Intrinsics and baseline.

    Returns:
        The motion, or why there is none: too few landmarks in common, or no motion that most agree with.
    """
    first, second = _Points.of(before, rig), _Points.of(after, rig)
    bits = different_bits(before, after)
    pairs = match_anywhere(bits)
    if len(pairs[0]) < _LEAST_TO_START:
        return NotFitted(
            "landmarks that two frames have in common", len(pairs[0]), Bound.LEAST, _LEAST_TO_START
        )
    state = _start(first.chosen(pairs[0]), second.chosen(pairs[1]), rig)
    coarse = _search(bits, (first, second), state, rig, *_COARSE)
    if isinstance(coarse, NotFitted):
        return coarse
    fine = _search(bits, (first, second), coarse.state, rig, *_FINE)
    if isinstance(fine, NotFitted):
        return fine
    if fine.scale > _MOST_SCALE:
        return NotFitted("scatter of landmarks over what is expected", fine.scale, Bound.MOST, _MOST_SCALE)
    least = max(_LEAST_PAIRS, math.ceil(_LEAST_SHARE * fine.n_pairs))
    if fine.n_points < least:
        return NotFitted("landmarks that agree with one motion", fine.n_points, Bound.LEAST, least)
    return _in_body_axes(fine)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A fitted state.

    Attributes:
        state: The state.
        covariance: (7, 7) of small turn, shift and yaw of the right camera.
        n_pairs: Number of pairs.
        n_points: Number of pairs that agree.
        scale: Their scatter over what is expected.
    """

    state: _MotionState
    covariance: Array
    n_pairs: int
    n_points: int
    scale: float


def _too_few(number: int) -> NotFitted:
    return NotFitted("landmarks that two frames have in common", number, Bound.LEAST, _LEAST_PAIRS)


def _search(
    bits: Floats,
    points: tuple[_Points, _Points],
    state: _MotionState,
    rig: StereoRig,
    radius: float,
    how: Reweighting,
) -> _Fit | NotFitted:
    """Look for landmarks near where a motion moves them, and fit the motion to them."""
    first, second = points
    q, inverse = _moved(first, state, rig)
    expected = np.column_stack([q[:, :2] * (rig.fx, rig.fy), first.seen[:, 2]]) * inverse[:, None]
    expected[:, :2] += rig.cx, rig.cy
    pairs = match_near(bits, expected, second.seen, radius * rig.width)
    if len(pairs[0]) < _LEAST_PAIRS:
        return _too_few(len(pairs[0]))
    return _fit(first.chosen(pairs[0]), second.chosen(pairs[1]), state, rig, how)


def _start(before: _Points, after: _Points, rig: StereoRig) -> _MotionState:
    """Return a first estimate: of many ways ahead, the one that most pairs agree with after a turn.

    The turn that belongs to a way is the median of what remains. No random numbers are drawn.
    """
    focal = np.array([rig.fx, rig.fy])
    after_way = 1.0 - _WAYS_M[:, None] * before.nearness(0.0, rig)  # depth then over that before, (W, N)
    behind = after_way < _NOT_BEHIND
    inverse = 1.0 / np.maximum(after_way, _NOT_BEHIND)
    apart = (after.rays[None, :, :2] - before.rays[None, :, :2] * inverse[:, :, None]) * focal
    turns_px = np.median(apart, axis=1)
    squares = ((apart - turns_px[:, None]) ** 2).sum(axis=2)
    squares += (after.seen[:, 2] - before.seen[:, 2] * inverse) ** 2
    agreeing = tukey_weights(squares / (_AGREES * rig.width) ** 2)
    agreeing[behind] = 0.0
    best = int(agreeing.sum(axis=1).argmax())
    right, down = turns_px[best] / focal
    way = _MotionState(np.eye(3), np.array([0.0, 0.0, -float(_WAYS_M[best])]), 0.0)
    return way.changed(np.array([-down, right, 0.0, 0.0, 0.0, 0.0, 0.0]))


def _moved(points: _Points, state: _MotionState, rig: StereoRig) -> tuple[Array, Array]:
    """Return landmarks after a motion, over their depths before, and the inverse of their depths then."""
    q = points.rays @ state.rotation.T + points.nearness(state.yaw_rad, rig)[:, None] * state.shift_m
    return q, np.where(q[:, 2] > _NOT_BEHIND, 1.0 / np.maximum(q[:, 2], _NOT_BEHIND), np.nan)


def _whitened(before: _Points, after: _Points, state: _MotionState, rig: StereoRig) -> tuple[Array, Array]:
    """Return the residuals of the pairs after a motion, each of unit variance, and their derivatives.

    The error of the disparity before the motion is common to the residuals of a pair: their covariance is a
    diagonal matrix and the product of a vector with itself, whose root is known.

    Returns:
        (N, 3) seen less expected columns, rows and disparities; (N, 3, 7) derivatives of what is expected, by
        a small turn, the shift and the yaw of the right camera. Landmarks that would be behind the camera
        have large residuals and no derivatives.
    """
    depth = rig.fx * rig.baseline_m
    near = before.nearness(state.yaw_rad, rig)
    q, inverse = _moved(before, state, rig)
    behind = ~np.isfinite(inverse)
    inverse[behind] = 0.0
    x, y = q[:, 0] * inverse, q[:, 1] * inverse
    right = after.seen - np.column_stack(
        [
            rig.cx + rig.fx * x,
            rig.cy + rig.fy * y,
            depth * near * inverse - rig.fx * state.yaw_rad * after.stretch,
        ]
    )
    by_q = np.zeros((len(near), 3, 3))
    by_q[:, 0, 0], by_q[:, 0, 2] = rig.fx * inverse, -rig.fx * x * inverse
    by_q[:, 1, 1], by_q[:, 1, 2] = rig.fy * inverse, -rig.fy * y * inverse
    by_q[:, 2, 2] = -depth * near * inverse**2
    by_near = by_q @ state.shift_m
    by_near[:, 2] += depth * inverse
    derivatives = np.empty((len(near), 3, 7))
    # A turn moves a point across itself.
    derivatives[:, :, :3] = np.cross((before.rays @ state.rotation.T)[:, None], by_q)
    derivatives[:, :, 3:6] = by_q * near[:, None, None]
    derivatives[:, :, 6] = by_near * (before.stretch / rig.baseline_m)[:, None]
    derivatives[:, 2, 6] -= rig.fx * after.stretch
    right[behind], derivatives[behind] = _FAR_OFF_PX, 0.0
    common = by_near * (_DISPARITY_STD_PX / depth / _STD_PX)
    square = (common * common).sum(axis=1) + _TINY
    shrunk = common * ((1.0 - 1.0 / np.sqrt(1.0 + square)) / square)[:, None]
    right /= _STD_PX
    derivatives /= _STD_PX[:, None]
    right -= shrunk * (common * right).sum(axis=1)[:, None]
    derivatives -= shrunk[:, :, None] * (common[:, None] @ derivatives)
    return right, derivatives


def _fit(
    before: _Points, after: _Points, state: _MotionState, rig: StereoRig, how: Reweighting
) -> _Fit | NotFitted:
    """Fit the motion to pairs of landmarks, from a state on."""
    prior = np.zeros(7)
    prior[6] = _ANY_VERGENCE_RAD**-2
    normal = np.zeros((7, 7))
    right, derivatives = _whitened(before, after, state, rig)

    def fit(weights: Array, scale: float | Array) -> tuple[_MotionState, Array] | NotFitted:
        nonlocal state, normal, right, derivatives
        design = derivatives.reshape(-1, 7)
        weighted = design.T * np.repeat(weights / np.square(scale), 3)
        normal = weighted @ design + np.diag(prior)
        pull = weighted @ right.ravel()
        pull[6] -= prior[6] * state.yaw_rad
        step = solve_linear(normal, pull, _DETERMINED)
        if isinstance(step, NotFitted):
            return step
        state = state.changed(step)
        right, derivatives = _whitened(before, after, state, rig)
        return state, np.linalg.norm(right, axis=1)

    def scale_of(residuals: Array) -> float:
        return max(_LEAST_SCALE, upper_median(residuals) / math.sqrt(MEDIAN_CHI2_3))

    found = fit_reweighted(fit, len(before.seen), how, scale_of)
    if isinstance(found, NotFitted):
        return found
    scale, agreeing = float(found.scale), int(np.count_nonzero(found.weights))
    covariance = _covariance(right, derivatives, found.weights, scale, prior)
    if isinstance(covariance, NotFitted) or not is_covariance(covariance):
        return NotFitted(_DETERMINED, 6, Bound.LEAST, 7)
    return _Fit(state, covariance, len(right), agreeing, scale)


def _covariance(
    right: Array, derivatives: Array, weights: Array, scale: float, prior: Array
) -> Array | NotFitted:
    """Return the covariance (7, 7) of a robust fit, by how much its residuals really scatter.

    Landmarks that are confused scatter more than the median of all. So the scatter of their pulls is measured
    (Huber's sandwich). The derivative of Tukey's pull is less than its weight: on average over the directions
    of a residual by 4/3 of the square of its length, times one less that square, both over the limit.
    """
    squares = (right * right).sum(axis=1) / (TUKEY_SIGMAS * scale) ** 2
    slopes = weights - 4.0 / 3.0 * squares * np.maximum(1.0 - squares, 0.0)
    pulls = np.einsum("nij,ni->nj", derivatives, right) * weights[:, None]
    hessian = np.einsum("nij,nik->jk", derivatives * slopes[:, None, None], derivatives) / scale**2
    response = invert(hessian + np.diag(prior), _DETERMINED)
    if isinstance(response, NotFitted):
        return response
    spread = len(right) / (len(right) - 7.0) * (pulls.T @ pulls) / scale**4
    product = response @ (spread + np.diag(prior)) @ response
    covariance: Array = (product + product.T) / 2.0
    return covariance


def _in_body_axes(fit: _Fit) -> FrameMotion:
    """Return the motion of the camera for that of the points before it."""
    state = fit.state
    back = BODY_FROM_OPTICAL @ state.rotation.T
    jacobian = np.zeros((7, 7))
    jacobian[:3, :3] = -back
    jacobian[3:6, :3] = -back @ _cross_matrix(state.shift_m)
    jacobian[3:6, 3:6] = -back
    jacobian[6, 6] = 1.0
    turned = BODY_FROM_OPTICAL @ -np.asarray(cv2.Rodrigues(state.rotation)[0], np.float64).ravel()
    covariance = jacobian @ fit.covariance @ jacobian.T
    return FrameMotion(turned, -back @ state.shift_m, state.yaw_rad, covariance, fit.n_points, fit.scale)


def _cross_matrix(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
