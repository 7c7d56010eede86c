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

"""Where the surface between two lines lies, from the faintest texture: a sweep of planes.

Lines that are parallel to the road vanish where the road does, however high above it they lie. So of a road
surface below two lines, only height and roll are unknown. On every line of the image through the vanishing
point, the disparity of such a surface is in proportion to that of the plane of the lines. So the lane is cut
into strips that meet in the vanishing point, and in each strip both images are correlated at many ratios of
the disparities. A strip has thousands of pixels, so that a texture far below the noise of a pixel is found.
The sum over the strips tells under which planes both images agree, and how surely that excludes others.

It is too coarse for an estimate, but it tells kerbs, rails and cables from paint.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.rays import pixel_rays
from ..numerics.statistics import SIGMA_OVER_MAD
from ..rejection import Bound, NotFitted
from ..types import Array, Floats, Image, Indices, Mask

# Band of the texture: what is finer is noise, what is coarser is shade. Standard deviations [px].
_FINE_PX, _COARSE_PX = 1.0, 2.5
# The road up to where a disparity is twice the reach of the band.
_FAR_M, _LEAST_DISPARITY_PX = 25.0, 3.0
_N_STRIPS = 6  # as wide as a pattern of paint beside the lines; three would be enough for height and roll
_MOST_SAMPLES, _LEAST_SAMPLES = 50_000, 2_000
# Grey values count up to so many standard deviations of their rows. Beyond the second limit, they are those
# of an edge and not of a surface, and are left out.
_MOST_SIGMAS, _EDGE_SIGMAS = 3.0, 5.0
_ROWS_OF_BAND = 8
_ROWS_PX = 600  # in images of more rows, by so many times fewer are enough
# Disparities that are tried, over those of the lines: from a surface as far below the lines as they are below
# the camera, and half as much again, to one above the lines by a fifth of their distance. The step [px] is
# that of the pixels.
_RATIOS, _STEP_PX = (0.4, 1.25), 0.7
# Rolls that are tried: a line half a metre above the road on one side of a lane, and the steps.
_ROLL_RAD, _ROLL_STEPS = float(np.radians(9.0)), 37
_BORDER_PX = 4  # beyond it, the band sees the border of the image
_LEAST_SPREAD_GREY = 1e-3
_ALIKE = 0.5  # of the best correlation
_AT_LEAST = 1e-9  # of what is divided by

# Rows, columns, disparities [px], strips and positions aside [m] of pixels of the left image, (N,) each.
LaneSamples = tuple[Indices, Indices, Array, Indices, Array]


@dataclass(frozen=True, slots=True, eq=False)
class LaneSweep:
    """How well both images agree under planes through the vanishing point of two lines.

    Attributes:
        heights_m: (H,) heights of the rig over the planes.
        rolls_rad: (R,) rolls.
        sigmas: (H, R) correlation of both images, over its standard deviation where they have no texture in
            common.
        alike: Share of the best correlation from which on another one may be the right one: texture may be
            taken for other texture that looks like it.
    """

    heights_m: Array
    rolls_rad: Array
    sigmas: Array
    alike: float = _ALIKE

    @property
    def best(self) -> tuple[float, float]:
        """Height [m] and roll [rad] of the plane under which the images agree best."""
        height, roll = np.unravel_index(int(np.argmax(self.sigmas)), self.sigmas.shape)
        return float(self.heights_m[height]), float(self.rolls_rad[roll])

    def excluding_sigmas(self, pose: Extrinsics, reach: Array) -> float:
        """Return by how many standard deviations the best plane excludes all planes near a pose.

        It is the root of twice the logarithm of the ratio of their likelihoods. It is 0 where one of
        them agrees half as well: the best one may have taken one pattern for another that looks like it.

        Args:
            pose: The pose.
            reach: Differences of height [m], pitch and roll [rad] up to which a plane is near to it.
        """
        return self._surpassing(self._near(pose, reach))

    def confirming_sigmas(self, pose: Extrinsics, reach: Array) -> float:
        """Return by how many standard deviations a plane near a pose excludes all that are not near to it.

        Args:
            pose: The pose.
            reach: Differences of height [m], pitch and roll [rad] up to which a plane is near to it.
        """
        return self._surpassing(~self._near(pose, reach))

    def _near(self, pose: Extrinsics, reach: Array) -> Mask:
        near: Mask = (np.abs(self.heights_m - pose.height_m)[:, None] <= reach[0]) & (
            np.abs(self.rolls_rad - pose.roll_rad) <= reach[2]
        )
        return near

    def _surpassing(self, which: Mask) -> float:
        """Return by how many standard deviations the best plane surpasses the best one of some."""
        of_these = max(float(self.sigmas[which].max(initial=0.0)), 0.0)
        most = float(self.sigmas.max())
        return 0.0 if of_these > self.alike * most else float(np.sqrt(max(most, 0.0) ** 2 - of_these**2))


def sweep_lane(
    images: tuple[Image, Image],
    rig: StereoRig,
    pose: Extrinsics,
    lane_yaw_rad: float,
    limits_m: tuple[float, float],
    samples: LaneSamples | None = None,
) -> LaneSweep | NotFitted:
    """Correlate both images under planes through the vanishing point of two lines.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        pose: Pose over the plane of the lines.
        lane_yaw_rad: Heading of the camera against them [rad].
        limits_m: Right and left limit of the part of that plane that is looked at [m], left positive.
        samples: The pixels of that part, where they are known.

    Returns:
        The correlations; or why there are none.
    """
    plane = plane_from_pose(pose, rig, PlaneCamera.LEFT)
    rows, columns, disparity, strip, _ = samples or lane_samples(rig, plane, lane_yaw_rad, limits_m)
    fewest = int(np.bincount(strip, minlength=_N_STRIPS).min())
    if fewest < _LEAST_SAMPLES / _N_STRIPS:
        return NotFitted("pixels of a strip of the lane", fewest, Bound.LEAST, _LEAST_SAMPLES // _N_STRIPS)
    step = _STEP_PX / float(np.quantile(disparity, 0.75))
    log_ratios = np.arange(np.log(_RATIOS[0]), np.log(_RATIOS[1]), step)
    curves = _correlations(images, rows, columns, disparity, strip, np.exp(log_ratios))
    heights = pose.height_m * np.exp(-log_ratios)
    rolls = pose.roll_rad + np.linspace(-_ROLL_RAD, _ROLL_RAD, _ROLL_STEPS)
    firsts = np.searchsorted(strip, np.arange(_N_STRIPS + 1))
    middles = (firsts[:-1] + firsts[1:]) // 2
    rays = pixel_rays(rig, columns[middles], rows[middles])
    at = np.log(ratios_under(heights, rolls, rays, pose, lane_yaw_rad, rig))
    of_strips = [np.interp(at[..., i], log_ratios, curves[i], 0.0, 0.0) for i in range(_N_STRIPS)]
    return LaneSweep(heights, rolls, np.sum(of_strips, axis=0) / np.sqrt(_N_STRIPS))


def ratios_under(
    heights_m: Array, rolls_rad: Array, rays: Array, pose: Extrinsics, lane_yaw_rad: float, rig: StereoRig
) -> Array:
    """Return the disparities under planes along a lane, over those of the plane of its lines, (H, R, N).

    Args:
        heights_m: (H,) heights over the planes.
        rolls_rad: (R,) rolls over them.
        rays: (N, 3) rays of the left camera.
        pose: Pose over the plane of the lines.
        lane_yaw_rad: Heading of the camera against them [rad].
        rig: Intrinsics and baseline.
    """
    planes = _planes_along(_lane_direction(pose, lane_yaw_rad), heights_m[:, None], rolls_rad[None], rig)
    ratios: Array = planes @ rays.T / plane_from_pose(pose, rig, PlaneCamera.LEFT).disparities(rays)
    return np.maximum(ratios, _AT_LEAST)


def _lane_direction(pose: Extrinsics, lane_yaw_rad: float) -> Array:
    """Return the ray (1, y, z) along the lane."""
    along = np.array([np.cos(lane_yaw_rad), -np.sin(lane_yaw_rad), 0.0])
    ray = along @ road_from_camera_rotation(pose.pitch_rad, pose.roll_rad)
    direction: Array = ray / ray[0]
    return direction


def _planes_along(ahead: Array, heights_m: Array, rolls_rad: Array, rig: StereoRig) -> Array:
    """Return planes (..., 3) of the left camera whose disparity vanishes along a ray."""
    pitch = np.arctan(np.sin(rolls_rad) * ahead[1] + np.cos(rolls_rad) * ahead[2])
    aside, up = np.cos(pitch) * np.sin(rolls_rad), np.cos(pitch) * np.cos(rolls_rad)
    normals = np.stack([-np.sin(pitch), aside, up], axis=-1)
    # A positive roll lifts the left camera over the middle of the baseline.
    of_left_m = heights_m + aside * rig.baseline_m / 2.0
    planes: Array = -rig.fx * rig.baseline_m / of_left_m[..., None] * normals
    return planes


def lane_samples(
    rig: StereoRig, plane: DisparityPlane, lane_yaw_rad: float, limits_m: tuple[float, float]
) -> LaneSamples:
    """Return rows, columns, disparities [px], strips and positions aside [m] of pixels of the left image.

    Args:
        rig: Intrinsics and baseline.
        plane: Plane of the lines, of the left camera.
        lane_yaw_rad: Heading of the camera against them [rad].
        limits_m: Right and left limit of the part of the plane that is looked at [m], left positive.

    Returns:
        (N,) each, strip by strip.
    """
    # Rows whose disparities are all too small are left out; the rest is written out row by column, as a ray
    # is (1, y, z) with y by the column and z by the row.
    least = max(_LEAST_DISPARITY_PX, rig.fx * rig.baseline_m / _FAR_M)
    ends = plane.disparities(
        pixel_rays(rig, np.array([0.0, rig.width - 1.0]), np.arange(rig.height)[:, None])
    )
    near = np.flatnonzero(ends.max(axis=1) > least)
    first, last = (int(near[0]), int(near[-1]) + 1) if len(near) else (0, 0)
    first, last = max(first, _BORDER_PX), min(last, rig.height - _BORDER_PX)
    # In large images, every few rows hold more samples than are taken.
    row_step = max(1, round(rig.height / _ROWS_PX))
    u, v = np.arange(rig.width), np.arange(first, max(first, last), row_step)
    by_column, by_row = pixel_rays(rig, u, rig.cy), pixel_rays(rig, rig.cx, v)
    disparity = plane.disparities(by_row)[:, None] + plane.coefficients[1] * by_column[:, 1]
    ahead = rig.fx * rig.baseline_m / np.maximum(disparity, _LEAST_DISPARITY_PX)
    aside = (by_column[:, 1] + np.tan(lane_yaw_rad)) * ahead + rig.baseline_m / 2.0
    right_m, left_m = limits_m
    inside = (disparity > least) & (right_m < aside) & (aside < left_m)
    inside &= np.minimum(u, rig.width - 1 - u) >= _BORDER_PX
    inside &= u - _RATIOS[1] * disparity >= _BORDER_PX
    rows, columns = np.nonzero(inside)
    thinning = max(1, -(-len(rows) // _MOST_SAMPLES))
    rows, columns = rows[::thinning], columns[::thinning]
    aside, disparity = aside[rows, columns], disparity[rows, columns]
    rows = rows * row_step + first
    share = (aside - right_m) / (left_m - right_m)
    strip = np.clip((share * _N_STRIPS).astype(np.intp), 0, _N_STRIPS - 1)
    order = np.argsort(strip, kind="stable")
    rows, columns = rows[order], columns[order]
    return rows, columns, disparity[order], strip[order], aside[order]


def _correlations(
    images: tuple[Image, Image],
    rows: Indices,
    columns: Indices,
    disparity: Array,
    strip: Indices,
    ratios: Array,
) -> Array:
    """Return the correlation of both images over its standard deviation, (strips, ratios)."""
    first, last = int(rows.min()), int(rows.max()) + 1
    bands = [_band_passed(image, first, last) for image in images]
    spread = _spread_of_rows(bands[0], rows - first, columns)
    left, right = (_normalised(band, spread) for band in bands)
    width = right.shape[1]
    of_left = left[rows - first, columns]
    row_start = ((rows - first) * width + columns).astype(np.float64) + 0.5
    starts = np.searchsorted(strip, np.arange(_N_STRIPS))
    flat = right.ravel()
    both, squares = np.empty((2, len(ratios), _N_STRIPS))
    position, at = np.empty_like(row_start), np.empty(len(row_start), np.intp)
    for i, ratio in enumerate(ratios):
        np.multiply(disparity, -ratio, out=position)
        position += row_start
        at[:] = position  # rounds down
        of_right = flat.take(at)
        both[i] = np.add.reduceat(of_left * of_right, starts)
        squares[i] = np.add.reduceat(of_right * of_right, starts)
    of_left_squares = np.add.reduceat(of_left * of_left, starts)
    # In white noise, each product has the variance of the product of the grey values.
    n = np.diff(np.append(starts, len(strip)))
    curves = both * np.sqrt(n) / np.sqrt(np.maximum(of_left_squares * squares, _AT_LEAST))
    # Texture correlates with other places of its own, and shades do so everywhere: what is typical of all
    # ratios is no agreement.
    middle = np.median(curves, axis=0)
    deviation = SIGMA_OVER_MAD * np.median(np.abs(curves - middle), axis=0)
    normalised: Array = ((curves - middle) / np.maximum(deviation, 1.0)).T
    return normalised


def _band_passed(image: Image, first: int, last: int) -> Floats:
    """Return the grey values of some rows of an image without noise and shades."""
    reach = _BORDER_PX * 2
    above, below = max(0, first - reach), last + reach
    grey = image[above:below].astype(np.float32)
    fine, coarse = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (_FINE_PX, _COARSE_PX))
    return np.asarray(cv2.subtract(fine, coarse)[first - above : last - above], np.float32)


def _spread_of_rows(band: Floats, rows: Indices, columns: Indices) -> Floats:
    """Return the standard deviation (H, 1) of the grey values of each row's samples, by their median."""
    blocks = rows // _ROWS_OF_BAND
    values = np.abs(band[rows, columns])
    # Sorted by block, and by value within each block.
    span = float(values.max()) + 1.0
    ordered = np.sort(blocks * span + values)
    counts = np.bincount(blocks, minlength=-(-len(band) // _ROWS_OF_BAND))
    starts = np.cumsum(counts) - counts
    medians = ordered[np.minimum(starts + counts // 2, len(values) - 1)] % span
    spread = np.maximum(SIGMA_OVER_MAD * medians, _LEAST_SPREAD_GREY)
    return np.repeat(spread, _ROWS_OF_BAND)[: len(band), None].astype(np.float32)


def _normalised(band: Floats, spread: Floats) -> Floats:
    """Return grey values over their standard deviation; zeros at edges."""
    relative = band / spread
    clipped = np.clip(relative, -_MOST_SIGMAS, _MOST_SIGMAS)
    normalised: Floats = np.where(np.abs(relative) < _EDGE_SIGMAS, clipped, np.float32(0.0))
    return normalised
