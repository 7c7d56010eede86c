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

"""Closed form: the road plane from the disparities of the sampled lines, by linear least squares.

The disparity of a plane is linear in the image, so two lines are enough. The source is Labayrade, Aubert and
Tarel, "Real time obstacle detection in stereovision on non flat road geometry through v-disparity
representation", IV 2002, for a road without roll. The closed form uses only the paper's matching term E1. It
does not use that the lines are parallel, and so not the vanishing point; its pitch is therefore less accurate
than that of the other stages. It needs no search and no initial guess, so it is an independent check of the
genetic algorithm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, PlaneCamera, jacobian_pose_wrt_plane, pose_from_plane
from ..geometry.pose import POSE_COMPONENTS, Extrinsics
from ..geometry.rays import pixel_rays
from ..numerics.linear import invert, rank_of
from ..rejection import Bound, NotFitted
from ..reservations import Reservation, ReservationKind
from ..road.priors import LINE_HEIGHT_STD_M
from ..types import Array
from .lane_pair import LanePattern

_DETERMINED = "numbers of the plane that the lines determine"
_CONTRADICTION_SIGMAS = 4.0  # one false note in 15 000 frames for normal errors


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """Extrinsics of the plane, and their covariance (3, 3), propagated from that of the measured lines."""

    extrinsics: Extrinsics
    covariance: Array


def solve_plane(pattern: LanePattern, rig: StereoRig) -> ClosedForm | NotFitted:
    """Fit a plane to the disparities of the sampled points.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.

    Returns:
        The extrinsics, or why not: the points lie on one line, or the plane is no road below the rig.
    """
    design, disparity = disparity_model(pattern, rig)
    weighted = design.T * point_weights(pattern)
    normal = weighted @ design
    rank = rank_of(normal)
    if rank < len(normal):
        return NotFitted(_DETERMINED, rank, Bound.LEAST, len(normal))
    inverse = invert(normal, _DETERMINED)
    if isinstance(inverse, NotFitted):
        return inverse
    solve = inverse @ weighted
    plane = DisparityPlane(solve @ disparity, PlaneCamera.LEFT)
    growth_px = -float(plane.coefficients[2]) / rig.fy
    if growth_px <= 0.0:
        return NotFitted("growth of the disparity a row downwards", growth_px, Bound.LEAST, 0.0, "px")
    jac_pose_disparity = jacobian_pose_wrt_plane(plane, rig) @ solve
    covariance = np.zeros((3, 3))
    n_rows = len(pattern.rows)
    for camera, lines in zip((1.0, -1.0), pattern.lines, strict=True):
        for i, line in enumerate(lines):
            jac_disparity_line = np.zeros((len(design), 2))
            jac_disparity_line[i * n_rows : (i + 1) * n_rows] = camera * np.column_stack(
                [np.ones(n_rows), pattern.rows - line.v_mid]
            )
            if camera > 0.0:
                # Moving a point of the left image also moves where the plane is evaluated.
                jac_disparity_line *= 1.0 + plane.coefficients[1] / rig.fx
            jac_pose_line = jac_pose_disparity @ jac_disparity_line
            covariance += jac_pose_line @ line.covariance @ jac_pose_line.T
    return ClosedForm(pose_from_plane(plane, rig), covariance)


def contradictions(closed: ClosedForm, fittest: Extrinsics, covariance: Array) -> tuple[Reservation, ...]:
    """Return where the closed form contradicts the pose of the greatest fitness.

    Args:
        closed: The closed form.
        fittest: The pose of the greatest fitness of the same lines, by the genetic algorithm or from the
            closed form on.
        covariance: (3, 3) of it.

    Returns:
        A reservation for each of height, pitch and roll that differs by more than both uncertainties.
    """
    difference = closed.extrinsics.as_array() - fittest.as_array()
    # Both are estimated from the same lines, so the sum of their variances is an upper bound.
    std = np.sqrt(np.diag(closed.covariance) + np.diag(covariance))
    return tuple(
        Reservation(
            ReservationKind.CLOSED_FORM_DIFFERS,
            f"{component.label} by "
            f"{component.unit.text(delta, '+', fine=True)}, {abs(delta) / sigma:.0f} standard deviations, "
            f"at most {_CONTRADICTION_SIGMAS:g} expected",
        )
        for component, delta, sigma in zip(POSE_COMPONENTS, difference, std, strict=True)
        if abs(delta) > _CONTRADICTION_SIGMAS * sigma
    )


def point_weights(pattern: LanePattern) -> Array:
    """Return the weights of the sampled points, (L N,).

    The weight of a boundary is 1. An extra line whose height may deviate from the plane by the unevenness of
    a road has a weight of 1/2.
    """
    weights = 1.0 / (1.0 + (pattern.height_stds_m / LINE_HEIGHT_STD_M) ** 2)
    return np.repeat(weights, len(pattern.rows))


def disparity_model(pattern: LanePattern, rig: StereoRig) -> tuple[Array, Array]:
    """Return the rays (1, y, z) of the left camera's points, (L N, 3), and their disparities [px], (L N,).

    The disparity of a plane is linear in the ray.
    """
    rays = pixel_rays(rig, pattern.columns[0], pattern.rows).reshape(-1, 3)
    return rays, (pattern.columns[0] - pattern.columns[1]).ravel()
