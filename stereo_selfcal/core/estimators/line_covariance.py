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

"""Covariance of the extrinsics from that of the measured lines, and a test for curvature.

Four measured lines (two lane boundaries, two cameras) are eight numbers with known covariance. The
genetic algorithm minimises E1, while E2 keeps the lines parallel in one camera. The implicit function
theorem gives the derivative of its result by the eight numbers, and the covariance follows from that.

Six parameters predict the eight numbers: height, pitch, roll, yaw of the lane and the positions of
both boundaries. Two degrees of freedom remain. Their chi-squared tests whether the lines are as consistent
as their covariances predict. Where they are not, the covariance is enlarged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..config import FitnessConfig
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms
from ..lanes.lane_pair import ImageLine, LanePattern
from ..lanes.line_geometry import lane_in_road
from ..numerics.derivatives import central_difference, linearise
from ..numerics.linear import invert, is_covariance, rank_of, solve_linear
from ..rejection import Bound, NotFitted
from ..road.stripe_model import predict_edges
from ..types import Array
from .fitness import PatternFitness

# The fit starts at the genetic result, so that its first step already converges to rounding.
_N_ITERATIONS = 2
# Steps of the numerical derivative: height [m], pitch, roll, yaw [rad], positions of the boundaries [m].
_STEPS = np.array([1e-5, 1e-6, 1e-6, 1e-6, 1e-5, 1e-5])
_LINE_STEP_PX = 1e-3
_DEGREES_OF_FREEDOM = 2
_DETERMINED = "numbers of the road that the lines determine"


@dataclass(frozen=True, slots=True, eq=False)
class LineFit:
    """Result of the six-parameter fit to the measured lines.

    Attributes:
        covariance: (3, 3) of (height_m, pitch_rad, roll_rad).
        lane_yaw_rad: Yaw of the camera against the lane, > 0: it points left.
        chi2: Weighted sum of the squared residuals, with two degrees of freedom; 2 is expected.
        jac_pose_lines: (3, 8) derivative of the pose by (u_mid, slope) of the lines of the left and of the
            right camera.
    """

    covariance: Array
    lane_yaw_rad: float
    chi2: float
    jac_pose_lines: Array

    @property
    def terms(self) -> tuple[UncertaintyTerm, ...]:
        """The covariance as a sum: the noise of the lines, and their disagreement beyond that noise."""
        noise = self.covariance / _enlargement(self.chi2)
        return merge_terms(
            (UncertaintyTerm("noise", noise), UncertaintyTerm("misfit", self.covariance - noise))
        )

    @property
    def misfit_sigmas(self) -> float:
        """Root of chi2 per degree of freedom; 1 is expected."""
        return float(np.sqrt(self.chi2 / _DEGREES_OF_FREEDOM))


def propagate(
    pattern: LanePattern,
    rig: StereoRig,
    extrinsics: Extrinsics,
    config: FitnessConfig,
    by_rig: Array | None = None,
) -> LineFit | NotFitted:
    """Propagate the covariance of the measured lines to the extrinsics.

    Args:
        pattern: The measured lines.
        rig: Intrinsics and baseline.
        config: The fitness that was maximised.
        extrinsics: The estimate, near which the fit starts.
        by_rig: (8, K) change of the lines by one standard deviation of each unknown of the rig, which lines
            may contradict each other by; None for a perfect rig. The covariance does not include it.

    Returns:
        The fit, or the reason why the lines leave a parameter undetermined. Where the lines disagree more
        than their covariances predict, the covariance is enlarged by chi2 / 2 (R. T. Birge, "The calculation
        of errors by the method of least squares", Phys. Rev. 40, 1932).
    """
    pattern = pattern.boundaries  # the information of the extra lines is not counted
    fit = _fit_parameters(pattern, rig, extrinsics, by_rig)
    if isinstance(fit, NotFitted):
        return fit
    parameters, of_lines, chi2 = fit
    jac_pose_lines = _sensitivity(pattern, rig, extrinsics.as_array(), config)
    if isinstance(jac_pose_lines, NotFitted):
        return jac_pose_lines
    covariance = jac_pose_lines @ of_lines @ jac_pose_lines.T
    covariance *= _enlargement(chi2)
    covariance = (covariance + covariance.T) / 2.0
    if not is_covariance(covariance):
        return NotFitted(_DETERMINED, min(rank_of(covariance), 2), Bound.LEAST, len(covariance))
    return LineFit(covariance, float(parameters[3]), chi2, jac_pose_lines)


def _fit_parameters(
    pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics, by_rig: Array | None
) -> tuple[Array, Array, float] | NotFitted:
    """Return the six parameters of the lines, the covariance (8, 8) of the lines, and their chi-squared."""
    lines = (*pattern.left, *pattern.right)
    measured = np.array([value for line in lines for value in (line.u_mid, line.slope)])
    covariance = np.zeros((8, 8))
    for i, line in enumerate(lines):
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = line.covariance
    whole = covariance if by_rig is None else covariance + by_rig @ by_rig.T
    information = invert(whole, "numbers of the lines that their points determine")
    if isinstance(information, NotFitted):
        return information
    parameters = np.concatenate([extrinsics.as_array(), lane_in_road(pattern, rig, extrinsics)])
    for _ in range(_N_ITERATIONS):
        predicted, jac_transposed = linearise(lambda p: _predict(p, lines, rig), parameters, _STEPS)
        normal = jac_transposed @ information @ jac_transposed.T
        rank = rank_of(normal)
        if rank < len(parameters):
            return NotFitted(_DETERMINED, rank, Bound.LEAST, len(parameters))
        step = solve_linear(normal, jac_transposed @ information @ (measured - predicted), _DETERMINED)
        if isinstance(step, NotFitted):
            return step
        parameters = parameters + step
    residual = measured - _predict(parameters[None], lines, rig)[0]
    chi2 = float(residual @ information @ residual)
    return parameters, covariance, chi2


def _enlargement(chi2: float) -> float:
    """Return the factor on the variances of lines that disagree more than their covariances predict."""
    return max(1.0, chi2 / _DEGREES_OF_FREEDOM)


def _sensitivity(
    pattern: LanePattern, rig: StereoRig, estimate: Array, config: FitnessConfig
) -> Array | NotFitted:
    """Return the derivative (3, 8) of the genetic result by (u_mid, slope) of the four lines.

    Let g be the angle between the lines in the camera that sees them more parallel. The result minimises
    E1 = |d|^2 under the constraint g = 0, so d_t^T d + lambda g_t = 0 and g = 0 (a subscript is a
    derivative). A change dl of the lines changes the result by dt with::

        [d_t^T d_t  g_t] [dt     ]     [d_t^T d_l]
        [g_t^T       0 ] [dlambda]  = -[g_l      ] dl
    """
    fitness = PatternFitness(pattern, rig, config)
    camera = int(np.argmin(np.abs(fitness.linear_terms(estimate)[1])))

    def terms(candidates: Array) -> Array:
        distances, angles = fitness.linear_terms(candidates)
        return np.column_stack([distances, angles[camera]])

    jac_terms_estimate = central_difference(terms, estimate, _STEPS[:3]).T
    d_t, g_t = jac_terms_estimate[:-1], jac_terms_estimate[-1:]
    d_l, g_l = np.zeros((len(d_t), 8)), np.zeros((1, 8))
    angle = fitness.linear_terms(estimate)[1][camera]
    # The ray (1, y, z) of a left column u has y = (cx - u) / fx. The measured disparity is the left column
    # minus the right one. So this is the derivative of a residual by the left and by the right column.
    jac_residual_column = (-fitness.plane(estimate).coefficients[1] / rig.fx - 1.0, 1.0)
    n_rows = len(pattern.rows)
    for i, line in enumerate((*pattern.left, *pattern.right)):
        side, boundary = divmod(i, 2)
        for j, change in enumerate((np.ones_like(pattern.rows), pattern.rows - line.v_mid)):
            points = slice(boundary * n_rows, (boundary + 1) * n_rows)
            d_l[points, 2 * i + j] = jac_residual_column[side] * change
            if side == camera:
                step = _LINE_STEP_PX / np.abs(change).max()
                columns = pattern.columns[camera].copy()
                columns[boundary] += step * change
                g_l[0, 2 * i + j] = (fitness.angle_with(columns, pattern.rows, estimate) - angle) / step
    system = np.block([[d_t.T @ d_t, g_t.T], [g_t, np.zeros((1, 1))]])
    rank, what = rank_of(system), "equations of the best fit that are independent"
    if rank < len(system):
        return NotFitted(what, rank, Bound.LEAST, len(system))
    solution = solve_linear(system, np.concatenate([d_t.T @ d_l, g_l]), what)
    return solution if isinstance(solution, NotFitted) else -solution[:3]


def _predict(parameters: Array, lines: tuple[ImageLine, ...], rig: StereoRig) -> Array:
    """Return (u_mid, slope) of the four lines for (B, 6) parameters, shape (B, 8)."""
    # The stripes have no width and no height over the plane: both edges coincide with the line.
    roads = np.zeros((len(parameters), 11))
    roads[:, :4], roads[:, 5:7] = parameters[:, :4], parameters[:, 4:]  # no curvature between them
    lines_uv = predict_edges(roads, rig)[:, :, :, 0].reshape(len(parameters), 4, 2)
    v_mid = np.array([line.v_mid for line in lines])
    u_mid = lines_uv[..., 0] + lines_uv[..., 1] * v_mid
    return np.stack([u_mid, lines_uv[..., 1]], axis=-1).reshape(len(parameters), 8)


@dataclass(frozen=True, slots=True)
class Bends:
    """Curvatures of the lane and of the road's profile, which all lines have in common.

    Attributes:
        lateral_per_m: Curvature of the lane [1/m], > 0: to the left.
        lateral_std_per_m: Standard deviation of the lateral curvature [1/m].
        vertical_per_m: Curvature of the road's profile [1/m], > 0: a dip, < 0: a crest.
        vertical_std_per_m: Standard deviation of the vertical curvature [1/m].
    """

    lateral_per_m: float
    lateral_std_per_m: float
    vertical_per_m: float
    vertical_std_per_m: float


def measure_bends(pattern: LanePattern, rig: StereoRig, height_m: float) -> Bends:
    """Measure the curvatures that the points of the four lines of both images have in common."""
    lines = (*pattern.left, *pattern.right)
    return bends_of_lines(lines, float(pattern.vanishing_point[1]), rig, height_m)


def bends_of_lines(
    lines: Sequence[ImageLine], vanishing_row: float, rig: StereoRig, height_m: float
) -> Bends:
    """Measure the curvatures that the points of lines of one lane have in common.

    On a road of curvature k, a line at the distance x is displaced by k x^2 / 2 to the left. In the image
    this is -k fx x / 2 = -k fx fy height / 2 / (v - v_horizon). Where the road rises by c x^2 / 2, a row
    shows a road point that is nearer by the fraction c x^2 / (2 height). A line of slope m therefore moves by
    m c fy^2 height / 2 / (v - v_horizon); lines on the left and on the right move in opposite directions.
    Both curvatures are fitted to the measured points, together with one straight line for each measured line.

    Args:
        lines: Lines of one or both images.
        vanishing_row: Row where they meet [px].
        rig: Intrinsics and baseline.
        height_m: Height of the camera [m].
    """
    n_parameters = 2 * len(lines) + 2
    normal = np.zeros((n_parameters, n_parameters))
    right_side = np.zeros(n_parameters)
    blocks = []
    for i, line in enumerate(lines):
        below = np.maximum(line.rows - vanishing_row, 1.0)
        design = np.zeros((len(line.rows), n_parameters))
        design[:, 2 * i] = 1.0
        design[:, 2 * i + 1] = line.rows - line.v_mid
        design[:, -2] = -rig.fx * rig.fy * height_m / 2.0 / below
        design[:, -1] = line.slope * rig.fy**2 * height_m / 2.0 / below
        normal += design.T @ (design * line.weights[:, None])
        right_side += design.T @ (line.weights * line.columns)
        blocks.append(design)
    solution, *_ = np.linalg.lstsq(normal, right_side, rcond=None)
    squares = sum(
        float(line.weights @ (line.columns - design @ solution) ** 2)
        for line, design in zip(lines, blocks, strict=True)
    )
    freedom = max(1, sum(len(line.rows) for line in lines) - n_parameters)
    variances = np.diag(np.linalg.pinv(normal))[-2:] * squares / freedom
    std = np.sqrt(np.maximum(variances, 0.0))
    return Bends(float(solution[-2]), float(std[0]), float(solution[-1]), float(std[1]))
