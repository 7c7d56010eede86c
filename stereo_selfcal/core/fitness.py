"""Fitness of candidate extrinsics (paper section 2.3), for a whole population in one call.

The paper says "E1 and E2 are normalised" without saying how. Here both are squared pixels:

* E1 divides the distance of a point seen by both cameras by the size that one pixel has on the
  road there. So a distant point counts no more than the pixels it was measured with, and
  lowering the height, which shrinks every distance in metres, gains nothing.
* E2 is the angle between the two lines on the road in units of one pixel's angle, 1 / f,
  times ``parallel_weight``: the vanishing point of two lines is known about ten times better than
  where the plane through their disparities has its horizon (peers' comparison: 0.002 against
  0.025 degrees of pitch at 5 % noise), and the smaller term of the two must not hide that.
"""

from __future__ import annotations

import numpy as np

from .config import FitnessConfig
from .extrinsics import Array
from .geometry import SIDES, camera_centre_m
from .pattern import LanePattern
from .rig import StereoRig

# Points at or above a candidate's horizon are put this far away [1/m]: their misfit then is
# their whole disparity, finite, so that even absurd candidates can be ranked.
_FARTHEST_INVERSE_DEPTH = 1e-4


class PatternFitness:
    """Fitness of (height_m, pitch_rad, roll_rad) for one pattern.

    Attributes:
        evaluations: Number of candidates evaluated so far.
    """

    def __init__(self, pattern: LanePattern, rig: StereoRig, config: FitnessConfig) -> None:
        self._config = config
        self._focal_px = float(np.sqrt(rig.fx * rig.fy))
        self._offsets_m = [float(camera_centre_m(rig, side)[1]) for side in SIDES]
        # Rays (1, y, z) in the body frame of every point: (2 cameras, 2 lines, N rows).
        self._ray_y = -(pattern.columns - rig.cx) / rig.fx
        self._ray_z = np.broadcast_to(-(pattern.rows - rig.cy) / rig.fy, self._ray_y.shape)
        # Flat (4 N,) copies, the left camera first, for one matrix product per generation.
        self._rays = np.stack([self._ray_y.ravel(), self._ray_z.ravel()])
        # Normal of the plane through camera and line, from the first and last point: (4, 3).
        first = np.stack(np.broadcast_arrays(1.0, self._ray_y[..., 0], self._ray_z[..., 0]), axis=-1)
        last = np.stack(np.broadcast_arrays(1.0, self._ray_y[..., -1], self._ray_z[..., -1]), axis=-1)
        self._normals = np.cross(first, last).reshape(4, 3)
        self.evaluations = 0

    def __call__(self, population: Array) -> Array:
        """Return the fitness of (P, 3) candidates, shape (P,), in (0, 1 / K]."""
        matching, parallelism = self.errors(population)
        return 1.0 / (np.maximum(matching, parallelism) + self._config.k)

    def errors(self, population: Array) -> tuple[Array, Array]:
        """Return the normalised E1 and E2 of (P, 3) candidates [px^2], each of shape (P,)."""
        self.evaluations += len(population)
        pitch, roll = population[:, 1], population[:, 2]
        trig = (np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll))
        return self._matching_error(population[:, 0], *trig), self._parallelism_error(*trig)

    def _matching_error(self, height: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """E1: mean squared distance on the road of the points both cameras see, in pixels."""
        forward, sideways = self._distances(height, cp, sp, cr, sr)
        squares = np.einsum("ij,ij->i", forward, forward) + np.einsum("ij,ij->i", sideways, sideways)
        error: Array = squares / forward.shape[1]
        return error

    def _distances(self, height: Array, cp: Array, sp: Array, cr: Array, sr: Array) -> tuple[Array, Array]:
        """Return how far apart the cameras put each point on the road, forward and sideways [px].

        Returns:
            Two arrays (P, 2 N): distance over the size of a pixel on the road there.
        """
        n_points = self._rays.shape[1] // 2
        # Roll acts on (y, z), then pitch on (x, z): rays in road axes, each (P, 4 N).
        rolled_z = np.column_stack([sr, cr]) @ self._rays
        road_y = np.column_stack([cr, -sr]) @ self._rays
        road_x = sp[:, None] * rolled_z
        road_x += cp[:, None]
        drop = cp[:, None] * rolled_z
        drop -= sp[:, None]
        # Camera centres in the road frame, and inverse depth (per unit ray) of every road point.
        centre_x = np.outer(self._offsets_m, sp * sr)
        centre_y = np.outer(self._offsets_m, cr)
        centre_z = np.outer(self._offsets_m, cp * sr) + height
        inverse = [
            np.maximum(drop[:, :n_points] * (-1.0 / centre_z[0])[:, None], _FARTHEST_INVERSE_DEPTH),
            np.maximum(drop[:, n_points:] * (-1.0 / centre_z[1])[:, None], _FARTHEST_INVERSE_DEPTH),
        ]
        # Distance times f sqrt(inverse_left inverse_right): metres over metres a pixel.
        ratio = np.sqrt(inverse[1] / inverse[0])
        scale = ratio * inverse[0]
        forward = road_x[:, :n_points] * ratio - road_x[:, n_points:] / ratio
        forward += scale * (centre_x[0] - centre_x[1])[:, None]
        sideways = road_y[:, :n_points] * ratio - road_y[:, n_points:] / ratio
        sideways += scale * (centre_y[0] - centre_y[1])[:, None]
        return forward * self._focal_px, sideways * self._focal_px

    def _parallelism_error(self, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """E2: angle between the lines on the road in the camera that sees them more parallel."""
        difference = np.abs(self._angles_between(cp, sp, cr, sr)).min(axis=1)
        error: Array = (self._config.parallel_weight * difference) ** 2
        return error

    def _angles_between(self, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """Return the angle between the two lines as each camera puts them on the road, (P, 2) [px]."""
        angles = self._line_angles(cp, sp, cr, sr)
        difference = angles[:, 0::2] - angles[:, 1::2]
        # Lines have no direction: angles differ by at most a right angle.
        wrapped: Array = (difference + np.pi / 2) % np.pi - np.pi / 2
        return wrapped * self._focal_px

    def linear_terms(self, candidate: Array) -> tuple[Array, Array]:
        """Return what the fitness is made of, before squares and minimum are taken.

        Args:
            candidate: (3,) height_m, pitch_rad, roll_rad.

        Returns:
            distances (4 N,) of the points and angles (2,) between the lines by camera, both [px].
        """
        height, pitch, roll = candidate[:, None]
        trig = (np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll))
        return np.concatenate(self._distances(height, *trig), axis=1)[0], self._angles_between(*trig)[0]

    def _line_angles(self, cp: Array, sp: Array, cr: Array, sr: Array) -> Array:
        """Return the angles of the lines on the road against the x axis, modulo pi.

        Returns:
            (P, 4): left camera's left and right line, right camera's left and right line.
        """
        n = self._normals
        normal_x = np.outer(cp, n[:, 0]) + np.outer(sp * sr, n[:, 1]) + np.outer(sp * cr, n[:, 2])
        normal_y = np.outer(cr, n[:, 1]) - np.outer(sr, n[:, 2])
        angles: Array = np.arctan2(-normal_x, normal_y) % np.pi
        return angles
