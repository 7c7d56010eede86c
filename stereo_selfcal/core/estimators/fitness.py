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

"""Fitness of candidate extrinsics (paper section 2.3), for a whole population in one call.

The paper says "E1 and E2 are normalised" without saying how. Here both are squared pixels:

* E1 compares the two positions on the road at which the cameras locate a point. Their distance is divided by
  the size of a pixel there, along the row. A distant point therefore counts no more than the pixels it was
  measured with. Lowering the height shrinks every distance in metres, but gains nothing here. Both cameras
  see a point in the same row, so the quotient is the predicted disparity minus the measured one. The
  disparity of a plane is linear in the image. The sum over any number of points is therefore a quadratic form
  of three numbers.
  A line beside the boundaries of the lane may lie higher or lower than their plane. Its points are weighted
  by how well its height is known.
* E2 is the angle between the two lines on the road in units of one pixel's angle, 1 / f, times
  ``parallel_weight``. The vanishing point of two lines is known about ten times better than the horizon of
  the plane through their disparities (peers' comparison: 0.002 against 0.025 degrees of pitch at 5 % noise).
  The weight keeps E1 from hiding that.
  An extra line runs along the road as well. It is seen parallel to the others even where it lies above or
  below their plane. But it may have been painted another day, or be another kind of edge, and farther aside
  its direction is measured worse. Its angles are divided by that weight, so that they do not outweigh E1.
"""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..config import FitnessConfig
from ..geometry.plane import DisparityPlane, PlaneCamera
from ..lanes.closed_form import disparity_model, point_weights
from ..lanes.lane_pair import LanePattern
from ..numerics.derivatives import linearise
from ..types import Array

_STEP = 1e-6  # of numerical derivatives, in height [m], pitch and roll [rad]


class PatternFitness:
    """Fitness of (height_m, pitch_rad, roll_rad) for one pattern.

    Attributes:
        evaluations: Number of candidates evaluated so far.
    """

    def __init__(self, pattern: LanePattern, rig: StereoRig, config: FitnessConfig) -> None:
        self._config = config
        self._rig = rig
        self._focal_px = float(np.sqrt(rig.fx * rig.fy))
        self._design, self._disparity = disparity_model(pattern, rig)
        weights = point_weights(pattern)
        weighted = self._design.T * (weights / weights.sum())
        self._gram = weighted @ self._design
        self._moment = weighted @ self._disparity
        self._twice_moment = 2.0 * self._moment
        self._square = float(weights @ self._disparity**2 / weights.sum())
        self._normals = _normals_of(pattern.columns, pattern.rows, rig)
        # The first pair is that of the lane's boundaries.
        n_pairs = len(_pairs(self._normals.shape[-1]))
        self._pair_weights = np.full(n_pairs, self._focal_px**2 / config.parallel_weight**2)
        self._pair_weights[1:] /= max(n_pairs - 1, 1)
        self._pair_weights[0] = (self._focal_px * config.parallel_weight) ** 2
        self.evaluations = 0

    def __call__(self, population: Array) -> Array:
        """Return the fitness of (P, 3) candidates, shape (P,), in (0, 1 / K]."""
        return self._fitness(*self.errors(population))

    def fitness_in_camera(self, camera: int, population: Array) -> Array:
        """Return the fitness with the parallelism in one camera only, shape (P,).

        The paper's fitness is the greater one of those of both cameras: "at least one camera must see
        parallel lines". The fitness in one camera has one optimum. The greater of both may have two, close to
        each other and almost equally good.
        """
        self.evaluations += len(population)
        trig = _trigonometry(population)
        parallelism = self._parallelism(self._normals[camera], *trig)
        return self._fitness(self._matching_error(population[:, 0], *trig), parallelism)

    def fitness_in_each_camera(self, populations: Array) -> Array:
        """Return the fitness of one population a camera, (2, P, 3), by that camera's parallelism, (2, P)."""
        self.evaluations += populations.shape[0] * populations.shape[1]
        trig = _trigonometry(populations)
        parallelism = self._parallelism(self._normals, *trig)
        return self._fitness(self._matching_error(populations[..., 0], *trig), parallelism)

    def errors(self, population: Array) -> tuple[Array, Array]:
        """Return the normalised E1 and E2 of (P, 3) candidates [px^2], each of shape (P,)."""
        self.evaluations += len(population)
        trig = _trigonometry(population)
        parallelism = np.min([self._parallelism(normals, *trig) for normals in self._normals], axis=0)
        return self._matching_error(population[:, 0], *trig), parallelism

    def _fitness(self, matching: Array, parallelism: Array) -> Array:
        fitness: Array = 1.0 / (np.maximum(matching, parallelism) + self._config.k)
        return fitness

    def _parallelism(self, normals: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """E2: squared angles between the lines in units of one pixel's angle, weighted, (..., P)."""
        error: Array = _angles_between(normals, cp, sp, cr, sr) ** 2 @ self._pair_weights
        return error

    def _plane(self, height: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """Return the disparity [px] of the road by the ray (1, y, z) of the left camera, (..., 3)."""
        across = cp * sr
        left_height = height + across * (self._rig.baseline_m / 2.0)
        scale = self._rig.fx * self._rig.baseline_m / left_height
        # A point on the road has depth left_height / (sp - cp sr y - cp cr z).
        plane = np.empty((*np.shape(height), 3))
        plane[..., 0], plane[..., 1], plane[..., 2] = scale * sp, -scale * across, -scale * cp * cr
        return plane

    def _matching_error(self, height: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """E1: mean square of the predicted disparity minus the measured one [px^2], (..., P)."""
        plane = self._plane(height, cp, sp, cr, sr)
        square = ((plane @ self._gram - self._twice_moment) * plane).sum(axis=-1)
        # Rounding may leave a perfect fit just below zero.
        error: Array = np.maximum(square + self._square, 0.0)
        return error

    def normal_equations(
        self, camera: int, candidate: Array
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return the normal equations (3, 3) and (3,) of a step of a candidate (3,), of E1 and of E2.

        Args:
            camera: The camera of E2, 0 or 1.
            candidate: height_m, pitch_rad, roll_rad.
        """

        def planes(candidates: Array) -> Array:
            return self._plane(candidates[:, 0], *_trigonometry(candidates))

        def angles(candidates: Array) -> Array:
            return _angles_between(self._normals[camera], *_trigonometry(candidates))

        plane, jac_plane = linearise(planes, candidate, _STEP)
        angle, jac_angle = linearise(angles, candidate, _STEP)
        weighted = jac_angle * self._pair_weights
        return (
            (jac_plane @ self._gram @ jac_plane.T, jac_plane @ (self._moment - self._gram @ plane)),
            (weighted @ jac_angle.T, -weighted @ angle),
        )

    def plane(self, candidate: Array) -> DisparityPlane:
        """Return the road plane of a candidate (3,), by the rays of the left camera."""
        return DisparityPlane(self._plane(candidate[0], *_trigonometry(candidate)), PlaneCamera.LEFT)

    def linear_terms(self, candidates: Array) -> tuple[Array, Array]:
        """Return the residuals of both fitness terms for two lines, before they are squared.

        Args:
            candidates: (..., 3) height_m, pitch_rad, roll_rad.

        Returns:
            Distances (..., 2 N) of the points, and angles (2, ...) between the lines by camera, both [px].
        """
        trig = _trigonometry(candidates)
        planes = self._plane(candidates[..., 0], *trig)
        normals = self._normals.reshape(2, *[1] * (candidates.ndim - 2), *self._normals.shape[1:])
        angles: Array = self._focal_px * _angles_between(normals, *trig)[..., 0]
        return planes @ self._design.T - self._disparity, angles

    def angle_with(self, columns: Array, rows: Array, candidate: Array) -> float:
        """Return the angle of :meth:`linear_terms` [px] for lines with other columns (L, N) [px]."""
        normals = _normals_of(columns, rows, self._rig)
        return self._focal_px * float(_angles_between(normals, *_trigonometry(candidate))[0])


def _normals_of(columns: Array, rows: Array, rig: StereoRig) -> Array:
    """Return the normals of the planes through a camera and each line, as columns (..., 3, L)."""
    # The cross product of the rays (1, y, z) through both ends of a line.
    y0, y1 = ((rig.cx - columns[..., end]) / rig.fx for end in (0, -1))
    z0, z1 = ((rig.cy - float(rows[end])) / rig.fy for end in (0, -1))
    return np.stack([y0 * z1 - z0 * y1, np.full(y0.shape, z0 - z1), y1 - y0], axis=-2)


def _angles_between(normals: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
    """Return the angles on the road between all pairs of lines that a camera sees [rad], (..., P, pairs).

    Args:
        normals: (..., 3, L) normals of the planes through the camera and each line.
        cp: (..., P) cosine of pitch.
        sp: (..., P) sine of pitch.
        cr: (..., P) cosine of roll.
        sr: (..., P) sine of roll.
    """
    # A line on the road is perpendicular to the normal of its plane: its direction is (-n_y, n_x) in road
    # axes.
    rotation = np.empty((*cp.shape, 5))
    rotation[..., 0], rotation[..., 1], rotation[..., 2] = cp, sp * sr, sp * cr
    rotation[..., 3], rotation[..., 4] = cr, -sr
    towards, aside = rotation[..., :3] @ normals, rotation[..., 3:] @ normals[..., 1:, :]
    n_lines = normals.shape[-1]
    # Of two lines as slices, which copy nothing.
    first, second = (slice(0, 1), slice(1, 2)) if n_lines == 2 else _pairs(n_lines).T
    x0, x1, y0, y1 = towards[..., first], towards[..., second], aside[..., first], aside[..., second]
    dot = x0 * x1 + y0 * y1
    cross = x1 * y0 - x0 * y1
    # Lines have no direction: they differ by at most a right angle.
    angle: Array = np.arctan2(np.copysign(1.0, dot) * cross, np.abs(dot))
    return angle


@functools.cache
def _pairs(n_lines: int) -> npt.NDArray[np.intp]:
    """Return the numbers of the lines of each pair, (pairs, 2), the boundaries first."""
    return np.column_stack(np.triu_indices(n_lines, 1))


def _trigonometry(population: Array) -> tuple[Array, Array, Array, Array]:
    """Return cosine and sine of pitch, cosine and sine of roll, each (...)."""
    angles = population[..., 1:3]
    cosines, sines = np.cos(angles), np.sin(angles)
    return cosines[..., 0], sines[..., 0], cosines[..., 1], sines[..., 1]
