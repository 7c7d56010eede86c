"""Closed form: the road plane from the disparities of the sampled lines, by linear least squares.

The disparity of a plane is linear in the image (Labayrade, Aubert and Tarel, "Real time obstacle detection in
stereovision on non flat road geometry through v-disparity representation", IV 2002, for a road without
roll), so two lines are enough. It uses E1 only: not that the lines are parallel, hence not the
vanishing point, which is why its pitch is the weakest. It needs no search and no first guess, and is
the second opinion on what does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..road.priors import UNEVEN_STD_M
from ..types import Array
from .lane_pair import LanePattern

_CONTRADICTION_SIGMAS = 4.0  # one false word in 15 000 frames
_STEP = 1e-6  # relative, of the numerical derivative by the plane's coefficients


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """Extrinsics of the plane, and their covariance (3, 3) by that of the measured lines."""

    extrinsics: Extrinsics
    covariance: Array


def solve_plane(pattern: LanePattern, rig: StereoRig) -> ClosedForm | None:
    """Fit a plane to the disparities of the sampled points.

    Returns:
        The extrinsics, or None when the points lie on one line or the plane is no road below the rig.
    """
    design, disparity = disparity_model(pattern, rig)
    weighted = design.T * point_weights(pattern)
    normal = weighted @ design
    if np.linalg.matrix_rank(normal) < len(normal):
        return None
    solve = np.linalg.inv(normal) @ weighted
    plane = solve @ disparity
    if plane[2] >= 0.0:  # disparity must grow downwards
        return None
    by_plane = np.column_stack(
        [
            (_extrinsics(plane + step, rig) - _extrinsics(plane - step, rig)) / (2.0 * step.sum())
            for step in np.diag(_STEP * np.abs(plane).max() * np.ones(3))
        ]
    )
    covariance = np.zeros((3, 3))
    n_rows = len(pattern.rows)
    for camera, lines in zip((1.0, -1.0), pattern.lines, strict=True):
        for i, line in enumerate(lines):
            by_line = np.zeros((len(design), 2))
            by_line[i * n_rows : (i + 1) * n_rows] = camera * np.column_stack(
                [np.ones(n_rows), pattern.rows - line.v_mid]
            )
            if camera > 0.0:
                # Moving a point of the left image also moves where the plane is evaluated.
                by_line = by_line * (1.0 + plane[1] / rig.fx)
            chain = by_plane @ solve @ by_line
            covariance += chain @ line.covariance @ chain.T
    return ClosedForm(Extrinsics.from_array(_extrinsics(plane, rig)), covariance)


def contradictions(closed: ClosedForm, genetic: Extrinsics, covariance: Array) -> tuple[str, ...]:
    """Say where the closed form contradicts the genetic algorithm.

    Args:
        closed: The closed form.
        genetic: Result of the genetic algorithm, from the same lines.
        covariance: (3, 3) of it.

    Returns:
        A sentence for each of height, pitch and roll that differs by more than both uncertainties.
    """
    difference = closed.extrinsics.as_array() - genetic.as_array()
    # Both are made from the same lines, so the sum of their variances is an upper bound.
    std = np.sqrt(np.diag(closed.covariance) + np.diag(covariance))
    names = (("height", "m", 1.0), ("pitch", "deg", np.degrees(1.0)), ("roll", "deg", np.degrees(1.0)))
    return tuple(
        f"the closed form differs in {name} by {delta * unit:+.4f} {symbol}, "
        f"{abs(delta) / sigma:.0f} standard deviations"
        for (name, symbol, unit), delta, sigma in zip(names, difference, std, strict=True)
        if abs(delta) > _CONTRADICTION_SIGMAS * sigma
    )


def _extrinsics(plane: Array, rig: StereoRig) -> Array:
    """Return (height_m, pitch_rad, roll_rad) for disparity = plane @ (1, y, z) in the left camera."""
    roll = np.arctan2(-plane[1], -plane[2])
    pitch = np.arctan2(plane[0], np.hypot(plane[1], plane[2]))
    left_height = rig.fx * rig.baseline_m / np.linalg.norm(plane)
    # The left camera is half a baseline beside the middle, and roll lifts it.
    height = left_height - np.cos(pitch) * np.sin(roll) * rig.baseline_m / 2.0
    return np.array([height, pitch, roll])


def point_weights(pattern: LanePattern) -> Array:
    """Return the weights of the sampled points, (L N,).

    A boundary has 1, a line that may lie as far beside their plane as boundaries do themselves a half.
    """
    weights = 1.0 / (1.0 + (pattern.height_stds_m / UNEVEN_STD_M) ** 2)
    return np.repeat(weights, len(pattern.rows))


def disparity_model(pattern: LanePattern, rig: StereoRig) -> tuple[Array, Array]:
    """Return the rays (1, y, z) of the left camera's points, (L N, 3), and their disparities [px], (L N,).

    The disparity of a plane is linear in the ray.
    """
    ray_y, ray_z = _rays(pattern, rig)
    design = np.stack([np.ones_like(ray_y[0]), ray_y[0], ray_z[0]], axis=-1).reshape(-1, 3)
    return design, (pattern.columns[0] - pattern.columns[1]).ravel()


def _rays(pattern: LanePattern, rig: StereoRig) -> tuple[Array, Array]:
    """Return y and z of the rays (1, y, z) in the body frame, (2 cameras, L lines, N rows) each."""
    ray_y = -(pattern.columns - rig.cx) / rig.fx
    return ray_y, np.broadcast_to(-(pattern.rows - rig.cy) / rig.fy, ray_y.shape)
