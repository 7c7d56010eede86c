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

"""Where the surface between two lines lies, from its wheel tracks: the mean across the lane in both images.

Where a road has no texture, it still has tracks, seams and stains along it. The grey values of the lane are
averaged along it, so that a tenth of a grey level is seen. Where the surface lies in the plane of the lines,
both images have the same mean at the same place of that plane. Where it lies lower, the mean of the right
image is shifted by a share of the baseline.
"""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.rays import pixel_rays
from ..rejection import Bound, NotFitted
from ..types import Array, Image, Indices
from .lane_sweep import LaneSamples, LaneSweep, lane_samples, ratios_under

_BIN_M, _SMOOTH_BINS = 0.02, 3  # across the lane; what is smoothed counts as one
_LEAST_BINS = 30
_LEAST_PER_BIN = 30  # pixels, for a mean to a tenth of a grey level in strong noise
# Disparities that are tried, over those of the lines: the lowest and the highest that leave most of the lane.
_RATIOS, _N_RATIOS = (0.75, 1.25), 101
_ROLL_RAD, _ROLL_STEPS = float(np.radians(6.0)), 25
# Neighbouring pixels share their noise where their colours are interpolated: the variance of a mean is twice
# that of independent pixels. Whatever their number, JPEG and rounding leave a part of a grey level.
_CORRELATED_PIXELS, _FLOOR_GREY = 2.0, 0.05
_SHADE_DEGREE = 2  # of the polynomial across the lane that a lens or a sun may add
_GAINS = (0.7, 1.4)  # contrast of one image over that of the other


def profile_lane(
    images: tuple[Image, Image],
    rig: StereoRig,
    pose: Extrinsics,
    lane_yaw_rad: float,
    limits_m: tuple[float, float],
    samples: LaneSamples | None = None,
) -> LaneSweep | NotFitted:
    """Compare the mean across the lane in both images under planes through the vanishing point of two lines.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        pose: Pose over the plane of the lines.
        lane_yaw_rad: Heading of the camera against them [rad].
        limits_m: Right and left limit of the part of that plane that is looked at [m], left positive.
        samples: The pixels of that part, where they are known.

    Returns:
        How well both agree under the planes; or why that is not known.
    """
    plane = plane_from_pose(pose, rig, PlaneCamera.LEFT)
    rows, columns, disparity, _, aside = samples or lane_samples(rig, plane, lane_yaw_rad, limits_m)
    n_bins = int((limits_m[1] - limits_m[0]) / _BIN_M)
    reach = (1.0 - _RATIOS[0]) * rig.baseline_m
    skipped = int(np.ceil(reach / _BIN_M)) + _SMOOTH_BINS
    n_inner = n_bins - 2 * skipped
    if n_inner < _LEAST_BINS:
        return NotFitted("bins across the lane", n_inner, Bound.LEAST, _LEAST_BINS)
    index = np.clip(((aside - limits_m[0]) / _BIN_M).astype(np.intp), 0, n_bins - 1)
    fewest = int(np.bincount(index, minlength=n_bins).min())
    if fewest < _LEAST_PER_BIN:
        return NotFitted("pixels of a bin across the lane", fewest, Bound.LEAST, _LEAST_PER_BIN)
    in_right = np.rint(columns - disparity).astype(np.intp)
    left, of_left = _mean_across(images[0][rows, columns], rows, index, n_bins)
    right, of_right = _mean_across(images[1][rows, in_right], rows, index, n_bins)
    inner = np.arange(skipped, n_bins - skipped)
    variance = (of_left + of_right)[inner] * _CORRELATED_PIXELS + _FLOOR_GREY**2
    heights = pose.height_m / np.linspace(*_RATIOS, _N_RATIOS)
    rolls = pose.roll_rad + np.linspace(-_ROLL_RAD, _ROLL_RAD, _ROLL_STEPS)
    order = np.argsort(aside)[np.linspace(0, len(aside) - 1, 9).astype(np.intp)[1:-1]]
    at = ratios_under(heights, rolls, pixel_rays(rig, columns[order], rows[order]), pose, lane_yaw_rad, rig)
    # The ratio is linear across the lane.
    design = np.column_stack([np.ones(len(order)), aside[order]])
    fits = at @ np.linalg.pinv(design).T  # (H, R, 2)
    middles = limits_m[0] + (inner + 0.5) * _BIN_M
    shift = (fits[..., :1] + fits[..., 1:] * middles - 1.0) * rig.baseline_m
    gained = _likelihoods(left, right, inner, shift / _BIN_M, variance)
    return LaneSweep(heights, rolls, np.sqrt(np.maximum(gained / _SMOOTH_BINS, 0.0)), alike=1.0)


def _mean_across(grey: Image, rows: Indices, index: Indices, n_bins: int) -> tuple[Array, Array]:
    """Return the mean grey value of each bin across the lane, smoothed, without shades; and its variance."""
    values = grey.astype(np.float64)
    of_rows = np.bincount(rows, values) / np.maximum(np.bincount(rows), 1)
    values -= of_rows[rows]
    count = np.bincount(index, minlength=n_bins)
    mean = np.bincount(index, values, minlength=n_bins) / count
    variance = np.bincount(index, (values - mean[index]) ** 2, minlength=n_bins) / count**2
    kernel = np.full(_SMOOTH_BINS, 1.0 / _SMOOTH_BINS)
    return np.convolve(mean, kernel, "same"), np.convolve(variance, kernel, "same") / _SMOOTH_BINS


def _likelihoods(left: Array, right: Array, inner: Indices, shift_bins: Array, variance: Array) -> Array:
    """Return by how much the right mean, shifted, explains the left one: chi-squared that is gained, (H, R).

    It is over what remains under the best plane, where that is more than noise.
    """
    position = np.clip(inner + shift_bins, 0.0, len(right) - 1.001)
    below = position.astype(np.intp)
    moved = right.take(below) + (position - below) * np.diff(right).take(below)
    root = 1.0 / np.sqrt(variance)
    moved *= root
    shades = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(inner)), _SHADE_DEGREE)
    basis, _ = np.linalg.qr(shades * root[:, None])
    target = left[inner] * root
    target = target - (target @ basis) @ basis.T
    # What is left of the right mean without shades is not written out: its products are enough.
    products = moved @ np.column_stack([basis, target])
    squares = np.einsum("...n,...n", moved, moved) - np.einsum(
        "...n,...n", products[..., :-1], products[..., :-1]
    )
    gain = np.clip(products[..., -1] / np.maximum(squares, 1e-9), *_GAINS)
    remaining = target @ target - 2.0 * gain * products[..., -1] + gain**2 * squares
    free = len(inner) - _SHADE_DEGREE - 2
    inside = (np.abs(shift_bins).max(axis=-1) <= inner[0] - 1) & (position.max(axis=-1) < len(right) - 1)
    remaining = np.where(inside, remaining, target @ target)
    gained: Array = (target @ target - remaining) / max(float(remaining.min()) / free, 1.0)
    return gained
