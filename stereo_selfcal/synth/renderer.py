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

"""Anti-aliased pictures of a synthetic road, one ray per sample.

The geometry is derived anew from REP-103's axes, on purpose without any code of the estimator:
two derivations, so that a wrong sign cannot cancel. A ray leaves the camera through a point of
the image and meets the road plane ``z = 0``; everything else is a question of how much of a
pixel's area a stripe covers.

The bytes of a picture depend on no release of OpenCV: sums and products are numpy's.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import get_args

import cv2
import numpy as np
import numpy.typing as npt

from stereo_selfcal.core.errors import ConfigError

from .world import LaneLine, Photometry, Scene, Side

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Picture = npt.NDArray[np.float32]
Frame = npt.NDArray[np.uint8]

# Sub-rows of a pixel. The area under a straight edge is exact with any number; four follow the
# bends of a curve and the change of perspective within one pixel near the horizon.
SUB_ROWS = 4

# Rays that fall by less than this per unit of length end here: 10 000 camera heights away, where
# a whole lane is far below a hundredth of a pixel wide.
MIN_FALL = 1e-4

# Cells of the texture's octaves [m]: from coarse aggregate to patches of old road surface.
TEXTURE_CELLS_M = (0.02, 0.045, 0.1, 0.22, 0.47, 1.0)
TEXTURE_TILE_CELLS = 256

# An octave is drawn in full up to this footprint of a pixel, in cells, and not at all from one
# cell on: bilinear interpolation of cells smaller than a pixel would alias.
TEXTURE_FADE_START = 0.5

# A bend is painted for a quarter of its circle: a closed one would come back along the horizon.
MAX_ARC_RAD = math.pi / 2

# A Gaussian is cut off here: what lies beyond is below a grey level at the strongest edge.
BLUR_REACH_SIGMA = 4.0

# Keeps a division by the width of a pixel on the road finite where both its edges coincide.
TINY_M = 1e-12

# An edge that moves by less between two sub-rows [px] counts as upright, and one farther away than
# this has no effect: both keep the quotient of differences in _clipped_mean exact to 1e-9.
UPRIGHT_PX = 1e-5
FAR_EDGE_PX = 1e3


class RayCaster:
    """Rays of one camera of the rig and where they meet the road.

    Args:
        scene: Rig, pose and road.
        side: Which camera.
    """

    def __init__(self, scene: Scene, side: Side) -> None:
        if side not in get_args(Side):
            raise ConfigError(f"side is {side!r}, it must be one of {', '.join(get_args(Side))}")
        rig, pose = scene.rig, scene.extrinsics
        lane_from_camera = (
            rotation(0.0, 0.0, scene.lane_yaw_rad)
            @ rotation(0.0, pose.pitch_rad, 0.0)
            @ rotation(pose.roll_rad, 0.0, 0.0)
        )
        forward, left, up = lane_from_camera.T
        half_baseline_m = rig.baseline_m / 2 if side == "left" else -rig.baseline_m / 2
        self.centre_m = np.array([0.0, scene.lateral_offset_m, pose.height_m]) + half_baseline_m * left
        # direction(u, v) = forward - (u - cx) / fx * left - (v - cy) / fy * up, affine in u and v.
        self._per_u = -left / rig.fx
        self._per_v = -up / rig.fy
        self._at_origin = forward - rig.cx * self._per_u - rig.cy * self._per_v
        self._curvature_per_m = scene.road.curvature_per_m
        self._travelled_m = scene.travelled_m

    def slope(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return the rise of the rays per unit of depth: > 0 is sky, < 0 is ground."""
        return self._direction(2, np.asarray(u, np.float64), np.asarray(v, np.float64))

    @property
    def slope_per_row(self) -> float:
        """Change of the slope from one row to the next below it, negative."""
        return float(self._per_v[2])

    def road_coordinates(self, u: npt.ArrayLike, v: npt.ArrayLike) -> tuple[Array, Array, Mask]:
        """Intersect rays with the road.

        Args:
            u: Columns of the samples [px].
            v: Rows of the samples [px], broadcast with ``u``.

        Returns:
            Arrays of the broadcast shape: position along the road [m], lateral position [m], and
            whether the ray meets the road at all; where it does not, the positions are those of
            the most distant point drawn.
        """
        u, v = np.asarray(u, np.float64), np.asarray(v, np.float64)
        fall = -self.slope(u, v)
        depth = self.centre_m[2] / np.maximum(fall, MIN_FALL)
        x = depth * self._direction(0, u, v)
        y = depth * self._direction(1, u, v) + self.centre_m[1]
        x += self.centre_m[0]
        meets = fall > 0
        curvature = self._curvature_per_m
        if curvature != 0:
            # Polar coordinates about the centre of the arc, (0, 1 / curvature); the lateral
            # position is written so that it does not cancel for a slight curve.
            reach = np.sqrt((curvature * x) ** 2 + (1 - curvature * y) ** 2)
            lateral = (2 * y - curvature * (x * x + y * y)) / (1 + reach)
            arc_rad = np.arctan2(curvature * x, 1 - curvature * y)
            x, y = arc_rad / curvature, lateral
        return x + self._travelled_m, y, meets

    def arc_rad(self, along_m: Array) -> Array:
        """Return how far the road has turned between the rig and a position along it [rad]."""
        return np.abs((along_m - self._travelled_m) * self._curvature_per_m)

    def _direction(self, axis: int, u: Array, v: Array) -> Array:
        """Return one component of the rays, scaled to unit depth."""
        component: Array = self._at_origin[axis] + u * self._per_u[axis] + v * self._per_v[axis]
        return component


class _Ground:
    """The part of an image that may show ground, with the road coordinates of its pixel corners."""

    def __init__(self, rays: RayCaster, width: int, height: int) -> None:
        u_edges = np.arange(width + 1) - 0.5
        v_edges = np.arange(height + 1) - 0.5
        rows = np.flatnonzero((rays.slope(u_edges[[0, -1]], v_edges[1:, None]) < 0).any(axis=1))
        self.rays = rays
        self.first_row = int(rows[0]) if rows.size else height
        self.u = np.arange(width)
        self.v = np.arange(self.first_row, height)[:, None]
        along, lateral, meets = rays.road_coordinates(u_edges, v_edges[self.first_row :, None])
        self.inside = meets[:-1, :-1] & meets[:-1, 1:] & meets[1:, :-1] & meets[1:, 1:]
        self.touched = meets[1:, :-1] | meets[1:, 1:] | meets[:-1, :-1] | meets[:-1, 1:]
        self.paintable = rays.arc_rad(along[1:, 1:]) < MAX_ARC_RAD
        across_low = np.minimum(lateral[:, :-1], lateral[:, 1:])
        across_high = np.maximum(lateral[:, :-1], lateral[:, 1:])
        self.lateral_low = np.minimum(across_low[:-1], across_low[1:])
        self.lateral_high = np.maximum(across_high[:-1], across_high[1:])
        # Longest side of a pixel on the road; perspective stretches it along the road.
        self.footprint_m = np.maximum(
            np.abs(along[1:, :-1] - along[:-1, :-1]), np.abs(lateral[1:, 1:] - lateral[1:, :-1])
        )

    def share(self) -> Array:
        """Return how much of each pixel lies below the horizon, shape (rows, width)."""
        # The horizon is nearly level, so the share along the pixel's middle column is its area.
        return np.clip(0.5 + self.rays.slope(self.u, self.v) / self.rays.slope_per_row, 0.0, 1.0)

    def band_share(self, right_m: float, left_m: float) -> Array:
        """Return how much of each pixel an endless band along the road covers, shape (rows, width)."""
        share = np.zeros(self.inside.shape)
        share[self.inside & (self.lateral_low >= right_m) & (self.lateral_high <= left_m)] = 1.0
        overlaps = self.touched & (self.lateral_low < left_m) & (self.lateral_high > right_m)
        rows, columns = np.nonzero(overlaps & (share == 0.0))
        share[rows, columns] = self._band_samples(rows, columns, right_m, left_m).mean(axis=1)
        return share

    def line_share(self, line: LaneLine) -> Array:
        """Return how much of each pixel a painted line covers, shape (rows, width)."""
        right_m, left_m = line.right_edge_m, line.left_edge_m
        if line.dash_m is None or line.gap_m is None:
            return np.where(self.paintable, self.band_share(right_m, left_m), 0.0)
        share = np.zeros(self.inside.shape)
        overlaps = self.touched & (self.lateral_low < left_m) & (self.lateral_high > right_m)
        rows, columns = np.nonzero(overlaps & self.paintable)
        samples = self._band_samples(rows, columns, right_m, left_m)
        # The ends of a dash cross the rows: its share is taken between the two edges of a sub-row.
        along, _, _ = self.rays.road_coordinates(*self._sub_rows(rows, columns))
        painted = np.diff(_painted_length(along, line), axis=1)
        samples *= painted / np.minimum(np.diff(along, axis=1), -TINY_M)
        share[rows, columns] = samples.mean(axis=1)
        return share

    def _sub_rows(self, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> tuple[Array, Array]:
        """Return columns (n, 1) and the edges of the sub-rows (n, SUB_ROWS + 1) of n pixels [px]."""
        edges = np.arange(SUB_ROWS + 1) / SUB_ROWS - 0.5
        return columns[:, None].astype(np.float64), (rows + self.first_row)[:, None] + edges

    def _band_samples(
        self, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp], right_m: float, left_m: float
    ) -> Array:
        """Return how much of each sub-row of n pixels a band covers, shape (n, SUB_ROWS)."""
        u, v = self._sub_rows(rows, columns)
        _, begin, meets = self.rays.road_coordinates(u - 0.5, v)
        _, end, meets_too = self.rays.road_coordinates(u + 0.5, v)
        low = np.minimum(begin, end)
        span = np.maximum(np.abs(end - begin), TINY_M)
        # A difference of two edges: a line thinner than a pixel keeps its brightness.
        covered = _clipped_mean((left_m - low) / span) - _clipped_mean((right_m - low) / span)
        on_road = meets & meets_too
        return np.where(on_road[:, :-1] & on_road[:, 1:], covered, 0.0)

    def texture(self, seed: int) -> Array:
        """Return the texture of the ground at the pixel centres, of unit variance from near."""
        along, lateral, _ = self.rays.road_coordinates(self.u, self.v)
        texture = np.zeros(self.inside.shape)
        for octave, cell_m in enumerate(TEXTURE_CELLS_M):
            rows = np.flatnonzero((self.footprint_m < cell_m).any(axis=1))
            if not rows.size:
                continue
            part = slice(int(rows[0]), int(rows[-1]) + 1)
            noise = sample_tile(texture_tile(seed, octave), lateral[part] / cell_m, along[part] / cell_m)
            fade = np.clip((1 - self.footprint_m[part] / cell_m) / (1 - TEXTURE_FADE_START), 0.0, 1.0)
            texture[part] += noise * fade
        texture /= math.sqrt(len(TEXTURE_CELLS_M))
        return texture


def render(scene: Scene, rng: np.random.Generator) -> tuple[Frame, Frame]:
    """Render a stereo frame with noise, as the cameras deliver it.

    Args:
        scene: The scene to render.
        rng: Source of the noise; the left image draws first.

    Returns:
        Left and right image, (H, W) uint8 each. Same scene and state of ``rng``: same bytes.
    """
    left = quantise(render_camera(scene, "left"), scene.left, rng)
    right = quantise(render_camera(scene, "right"), scene.right, rng)
    return left, right


def render_camera(scene: Scene, side: Side) -> Picture:
    """Render one camera without noise and before quantisation.

    Args:
        scene: The scene to render.
        side: Which camera.

    Returns:
        (H, W) float32 grey levels, not clipped.
    """
    rig, photometry = scene.rig, scene.photometry(side)
    picture = _world_picture(scene, RayCaster(scene, side)).astype(np.float32)
    if photometry.psf_sigma_px > 0:
        picture = blur(blur(picture, photometry.psf_sigma_px, axis=0), photometry.psf_sigma_px, axis=1)
    if photometry.vignetting > 0:
        picture *= vignette(rig.width, rig.height, rig.cx, rig.cy, photometry.vignetting)
    picture *= np.float32(photometry.gain)
    picture += np.float32(photometry.offset)
    return picture


def _world_picture(scene: Scene, rays: RayCaster) -> Array:
    """Return the grey levels an ideal camera with square pixels sees, shape (H, W)."""
    road, width, height = scene.road, scene.rig.width, scene.rig.height
    slope = rays.slope(np.arange(width), np.arange(height)[:, None])
    picture = scene.sky_grey + scene.sky_gradient * np.maximum(slope, 0.0)
    ground = _Ground(rays, width, height)
    if ground.first_row == height:
        return picture
    below = picture[ground.first_row :]
    below += ground.share() * (road.asphalt_grey - below)
    # Lines and verge do not overlap: their shares of a pixel add up.
    amplitude: Array | float = road.texture_amplitude
    if road.verge is not None:
        verge = ground.band_share(road.verge.left_m, math.inf)
        verge += ground.band_share(-math.inf, road.verge.right_m)
        below += verge * (road.verge.grey - road.asphalt_grey)
        amplitude = amplitude + verge * (road.verge.texture_amplitude - road.texture_amplitude)
    for line in road.lines:
        below += ground.line_share(line) * (line.grey - road.asphalt_grey)
    if np.any(amplitude):
        below += amplitude * ground.texture(road.texture_seed)
    return picture


def quantise(picture: Picture, photometry: Photometry, rng: np.random.Generator) -> Frame:
    """Return the picture with noise as uint8, shape (H, W)."""
    if photometry.noise_fraction > 0:
        noise = rng.standard_normal(picture.shape, dtype=np.float32)
        picture = picture + noise * np.float32(255 * photometry.noise_fraction)
    return np.rint(np.clip(picture, 0, 255)).astype(np.uint8)


def rotation(x_rad: float, y_rad: float, z_rad: float) -> Array:
    """Return the rotation about an axis by the length of (x, y, z), right-handed, shape (3, 3)."""
    matrix, _ = cv2.Rodrigues(np.array([x_rad, y_rad, z_rad]))
    return np.asarray(matrix, np.float64)


def blur(picture: Picture, sigma_px: float, axis: int) -> Picture:
    """Blur along one axis with a Gaussian; the border is repeated beyond the image."""
    # Plain numpy, as cv2.GaussianBlur rounds differently from release to release.
    radius = math.ceil(BLUR_REACH_SIGMA * sigma_px)
    weights = [math.exp(-0.5 * (i / sigma_px) ** 2) for i in range(radius + 1)]
    total = weights[0] + 2 * sum(weights[1:])
    size = picture.shape[axis]
    padding = [(radius, radius) if i == axis else (0, 0) for i in range(2)]
    padded = np.pad(picture, padding, mode="edge").swapaxes(0, axis)
    blurred = padded[radius : radius + size] * np.float32(weights[0] / total)
    for i in range(1, radius + 1):
        pair = padded[radius - i : radius - i + size] + padded[radius + i : radius + i + size]
        blurred += pair * np.float32(weights[i] / total)
    return np.ascontiguousarray(blurred.swapaxes(0, axis))


def _clipped_mean(edge_px: Array) -> Array:
    """Return the area on one side of an edge in each sub-row of a pixel, as a fraction.

    Args:
        edge_px: Place of the edge at the edges of the sub-rows, 0 ... 1 inside the pixel,
            shape (n, SUB_ROWS + 1); straight between two of them.

    Returns:
        Mean of clip(edge_px, 0, 1) over each sub-row, shape (n, SUB_ROWS).
    """
    edge_px = np.clip(edge_px, -FAR_EDGE_PX, FAR_EDGE_PX)
    inside = np.clip(edge_px, 0.0, 1.0)
    # Integral of clip(x, 0, 1): x^2 / 2 inside the pixel, x - 1/2 beyond it.
    integral = 0.5 * inside * inside + np.maximum(edge_px - 1.0, 0.0)
    step = np.diff(edge_px, axis=1)
    upright = np.abs(step) < UPRIGHT_PX
    mean = np.diff(integral, axis=1) / np.where(upright, 1.0, step)
    return np.where(upright, 0.5 * (inside[:, 1:] + inside[:, :-1]), mean)


def _painted_length(along_m: Array, line: LaneLine) -> Array:
    """Return the length of paint of a dashed line from its phase to ``along_m`` [m]."""
    assert line.dash_m is not None and line.gap_m is not None
    period_m = line.dash_m + line.gap_m
    periods = np.floor((along_m - line.phase_m) / period_m)
    rest_m = along_m - line.phase_m - periods * period_m
    return periods * line.dash_m + np.minimum(rest_m, line.dash_m)


@lru_cache(maxsize=32)
def vignette(width: int, height: int, cx: float, cy: float, loss: float) -> Picture:
    """Return the factor on each pixel, 1 at the principal point, 1 - loss in the far corner."""
    square = (np.arange(width) - cx) ** 2 + ((np.arange(height) - cy) ** 2)[:, None]
    return np.asarray(1 - loss * square / square.max(), np.float32)


@lru_cache(maxsize=64)
def texture_tile(seed: int, octave: int) -> Picture:
    """Return one periodic tile of band-limited noise, unit variance, with its border repeated."""
    n = TEXTURE_TILE_CELLS
    tile = np.random.default_rng([seed, octave]).standard_normal((n, n))
    # A binomial filter takes away what bilinear interpolation would show as facets.
    for axis in (0, 1):
        tile = 0.5 * tile + 0.25 * (np.roll(tile, 1, axis) + np.roll(tile, -1, axis))
    tile -= tile.mean()
    tile /= tile.std()
    # Border enough for the neighbours of a position that rounding puts at the very end.
    return np.asarray(np.pad(tile, (0, 2), mode="wrap"), np.float32)


def sample_tile(tile: Picture, column: Array, row: Array) -> Picture:
    """Interpolate a periodic tile bilinearly at positions in cells, all of one shape."""
    # Plain numpy, as cv2.remap interpolates differently from release to release.
    column_px, row_px = _wrapped(column), _wrapped(row)
    left, top = column_px.astype(np.intp), row_px.astype(np.intp)
    to_right, to_below = column_px - left.astype(np.float32), row_px - top.astype(np.float32)
    flat, stride = tile.ravel(), tile.shape[1]
    here = top * stride + left
    above = flat[here]
    above += to_right * (flat[here + 1] - above)
    here += stride
    below = flat[here]
    below += to_right * (flat[here + 1] - below)
    return np.asarray(above + to_below * (below - above), np.float32)


def _wrapped(position: Array) -> Picture:
    """Return positions modulo the size of a tile; reduced in double precision, far from zero."""
    tiles = position * (1 / TEXTURE_TILE_CELLS)
    tiles -= np.floor(tiles)
    return np.asarray(tiles * TEXTURE_TILE_CELLS, np.float32)
