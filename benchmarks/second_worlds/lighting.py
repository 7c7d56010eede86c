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

"""How much light falls on a point."""

from __future__ import annotations

import math

import numpy as np

from .cameras import Array32
from .scenes import Lamp, Light, Scene, Shade
from .textures import SIZE, stack

# A low beam: half widths of its light, and how far below the horizon it is cut off.
_BEAM_WIDE_RAD = 0.28
_BEAM_HIGH_RAD = 0.10
_BEAM_CUT_RAD = -0.012


def light_on(
    scene: Scene, x: Array32, y: Array32, z: Array32, facing: Array32 | np.float32
) -> tuple[Array32, Array32]:
    """Return the light of sun and sky, and the light of lamps, on points.

    Args:
        scene: The world.
        x: Places [m].
        y: Places [m].
        z: Places [m].
        facing: Cosine between the surfaces' normals and the sun, not negative.
    """
    light = scene.light
    day = np.full(len(x), light.ambient, np.float32)
    if light.sun_strength:
        day += np.float32(light.sun_strength) * facing * _sunlit(light, x, y, z)
    lamps = np.zeros(len(x), np.float32)
    for lamp in light.lamps:
        lamps += _lamp(lamp, x, y, z)
    return day, lamps


def _sunlit(light: Light, x: Array32, y: Array32, z: Array32) -> Array32:
    """Return the share of the sun that reaches points."""
    share = np.ones(len(x), np.float32)
    if not light.shades and not light.dapple:
        return share
    steep = max(light.sun[2], 0.1)
    ground_x = x - z * np.float32(light.sun[0] / steep)
    ground_y = y - z * np.float32(light.sun[1] / steep)
    for shade in light.shades:
        share *= 1 - _covered(shade, ground_x, ground_y)
    if light.dapple:
        share *= 1 - np.float32(light.dapple) * _dapple(light, ground_x, ground_y)
    return share


def _covered(shade: Shade, x: Array32, y: Array32) -> Array32:
    cos, sin = np.float32(math.cos(shade.yaw_rad)), np.float32(math.sin(shade.yaw_rad))
    dx, dy = x - np.float32(shade.centre_m[0]), y - np.float32(shade.centre_m[1])
    along = np.abs(cos * dx + sin * dy) - np.float32(shade.half_m[0])
    across = np.abs(cos * dy - sin * dx) - np.float32(shade.half_m[1])
    soft = np.float32(1 / shade.soft_m)
    covered: Array32 = np.clip(0.5 - along * soft, 0, 1) * np.clip(0.5 - across * soft, 0, 1)
    return covered


def _dapple(light: Light, x: Array32, y: Array32) -> Array32:
    texel = light.dapple_m / SIZE
    # The edges of leaves' shadows are soft: the sun is half a degree wide, some metres above.
    level = np.log2(np.maximum(np.float32(0.0004) * x * x, np.float32(0.035)) / np.float32(texel))
    scale = np.float32(1 / light.dapple_m)
    leaves = stack("leaf", 1, 0).sample(x * scale, y * scale, level)
    start, end = light.dapple_reach_m
    reach = np.clip((x - np.float32(start)) / 2, 0, 1) * np.clip((np.float32(end) - x) / 2, 0, 1)
    covered: Array32 = np.clip(0.55 + 1.5 * leaves, 0, 1) * reach
    return covered


def _lamp(lamp: Lamp, x: Array32, y: Array32, z: Array32) -> Array32:
    dx, dy, dz = (each - np.float32(place) for each, place in zip((x, y, z), lamp.place_m, strict=True))
    squared = dx * dx + dy * dy + dz * dz + np.float32(0.5)
    light = np.float32(lamp.strength) / squared
    if not lamp.beam:
        around: Array32 = light * np.clip(-dz, 0, None) / np.sqrt(squared)
        return around
    ahead = np.maximum(dx, np.float32(0.05))
    wide, high = dy / ahead, dz / ahead
    shape = np.exp(-(np.abs(wide / np.float32(_BEAM_WIDE_RAD)) ** 1.5)) * (dx > 0)
    above = np.clip((high - np.float32(_BEAM_CUT_RAD)) / np.float32(0.02), 0, 1)
    shape *= (1 - np.float32(0.97) * above) * np.exp(-(np.abs(high / np.float32(_BEAM_HIGH_RAD)) ** 1.2))
    # The grazing angle on the road is not taken off: bitumen gives more light back towards the lamp.
    result: Array32 = light * shape
    return result
