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

"""The Cramér-Rao bound of (height, pitch, roll) for a rendered scene.

For independent Gaussian pixel noise the information is ``D D^T / sigma^2``, where the rows of D are the
derivatives of both noise-free images by the unknowns: height, pitch, roll, the lane's yaw, place and
width of each line, grey levels of paint and asphalt. The renderer itself is differentiated, so blur,
pixel area, gain and vignetting are in it. Only ground counts: the horizon's edge shows the pitch as
well, but no lane line. Neither clipping nor rounding nor the asphalt's texture is in the model, so
the bound is a little lower than what such frames allow, most of all at 20 % noise, where paint clips.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stereo_selfcal import Extrinsics
from stereo_selfcal.synth.renderer import RayCaster
from stereo_selfcal.synth.world import Scene

from .frames import FULL_SCALE, Array, noise_free

# Steps of the central differences: small beside a pixel, large beside the rounding of float32.
POSE_STEPS = (1e-4, 1e-5, 1e-5, 1e-5)  # height [m], pitch, roll, lane yaw [rad]
LINE_STEP_M = 1e-4
GREY_STEP = 0.1

# Rows below the horizon that are left out beside the reach of the blur.
HORIZON_MARGIN_PX = 2
BLUR_REACH_SIGMA = 4.0


def bound_std(scene: Scene, noise_fraction: float) -> Array:
    """Return the least standard deviations of height [m], pitch and roll [rad] at a noise level."""
    unit: Array = bound_per_noise(scene) * noise_fraction
    return unit


def bound_per_noise(scene: Scene) -> Array:
    """Return the bound divided by the noise, to which it is proportional, shape (3,)."""
    bare = replace(scene, road=replace(scene.road, texture_amplitude=0.0))
    values, steps = _unknowns(bare)
    ground = _ground(bare)
    derivatives = np.empty((len(values), np.count_nonzero(ground)))
    for i, step in enumerate(steps):
        change = np.zeros(len(values))
        change[i] = step
        difference = _images(_with(bare, values + change)) - _images(_with(bare, values - change))
        derivatives[i] = difference[ground] / (2 * step)
    # Unknowns of very different size: scaled to unit diagonal before the inverse.
    scale = np.linalg.norm(derivatives, axis=1)
    derivatives /= scale[:, None]
    covariance = np.linalg.inv(derivatives @ derivatives.T) / np.outer(scale, scale)
    std: Array = np.sqrt(np.diag(covariance)[:3]) * FULL_SCALE
    return std


def _unknowns(scene: Scene) -> tuple[Array, Array]:
    """Return all unknowns of a scene and the step of each."""
    pose, lines = scene.extrinsics, scene.road.lines
    values = [pose.height_m, pose.pitch_rad, pose.roll_rad, scene.lane_yaw_rad]
    values += [line.offset_m for line in lines] + [line.width_m for line in lines]
    values += [lines[0].grey, scene.road.asphalt_grey]
    steps = [*POSE_STEPS, *[LINE_STEP_M] * (2 * len(lines)), GREY_STEP, GREY_STEP]
    return np.array(values), np.array(steps)


def _with(scene: Scene, values: Array) -> Scene:
    """Return the scene with other values of the unknowns; all lines have one grey level."""
    n_lines = len(scene.road.lines)
    offsets, widths = values[4 : 4 + n_lines], values[4 + n_lines : 4 + 2 * n_lines]
    paint, asphalt = values[-2:]
    lines = tuple(
        replace(line, offset_m=float(offset), width_m=float(width), grey=float(paint))
        for line, offset, width in zip(scene.road.lines, offsets, widths, strict=True)
    )
    road = replace(scene.road, lines=lines, asphalt_grey=float(asphalt))
    pose = Extrinsics(*(float(value) for value in values[:3]))
    return replace(scene, extrinsics=pose, lane_yaw_rad=float(values[3]), road=road)


def _images(scene: Scene) -> Array:
    return np.stack(noise_free(scene)).astype(np.float64)


def _ground(scene: Scene) -> np.ndarray:
    """Return which pixels of both images show ground and nothing of the horizon, (2, H, W)."""
    reach = max(BLUR_REACH_SIGMA * camera.psf_sigma_px for camera in (scene.left, scene.right))
    u = np.arange(scene.rig.width)
    v = np.arange(scene.rig.height)[:, None] - math.ceil(reach) - HORIZON_MARGIN_PX
    return np.stack([RayCaster(scene, side).slope(u, v) < 0 for side in ("left", "right")])
