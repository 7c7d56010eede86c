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

"""Lamps, the mirror of a wet road, rain before a lens."""

from __future__ import annotations

import numpy as np

from .ingredients import Rain, WorldScene
from .renderer import Picture, blur
from .world_rays import Layer, WorldRays
from .world_surface import noise_pattern

# A lamp is no smaller than the lens makes it, and has a halo: so many times larger, so much weaker.
LEAST_LAMP_PX = 0.8
HALO_SIZE, HALO_LIGHT = 7.0, 0.005
LAMP_REACH = 4.0  # standard deviations

# Reflection of water that is looked at from above: Schlick's approximation.
WATER_MIRROR = 0.02
PUDDLE_CELLS_M = (0.4, 1.0, 2.5)
PUDDLE_SEED = 5_000_011
STREAK_WIDTH_PX = 0.7


def draw_lamps(picture: Picture, scene: WorldScene, rays: WorldRays) -> None:
    """Add the light of lamps, each with its halo."""
    for lamp in scene.lamps:
        u, v = rays.project([(lamp.s_m, lamp.d_m, lamp.z_m)])[0]
        if not np.isfinite(u + v):
            continue
        size_px = max(lamp.radius_m * rays.rig.fx / lamp.s_m, LEAST_LAMP_PX)
        for sigma, grey in ((size_px, lamp.grey), (HALO_SIZE * size_px, HALO_LIGHT * lamp.grey)):
            _add_spot(picture, float(u), float(v), sigma, grey)


def _add_spot(picture: Picture, u: float, v: float, sigma_px: float, grey: float) -> None:
    height, width = picture.shape
    reach = LAMP_REACH * sigma_px
    columns = np.arange(max(int(u - reach), 0), min(int(u + reach) + 2, width))
    rows = np.arange(max(int(v - reach), 0), min(int(v + reach) + 2, height))
    if not (columns.size and rows.size):
        return
    across, down = (np.exp(-0.5 * np.square((at - to) / sigma_px)) for at, to in ((columns, u), (rows, v)))
    part = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    part += (grey * down[:, None] * across).astype(np.float32)


def wetted(surface: Picture, mirrored: Picture, scene: WorldScene, rays: WorldRays, layer: Layer) -> Picture:
    """Return the ground with water on it.

    Args:
        surface: The dry ground, (rows, W).
        mirrored: What is above the road, as the mirror z = 0 shows it, the same shape.
        scene: The world.
        rays: The camera's.
        layer: The ground as the camera sees it.
    """
    wet = scene.wet
    if wet is None:
        return surface
    s, d, size = layer.pixels()
    height_m = rays.centre_m[2]
    distance = np.sqrt(np.square(s - rays.centre_m[0]) + np.square(d - rays.centre_m[1]) + height_m**2)
    share = WATER_MIRROR + (1 - WATER_MIRROR) * np.power(1 - height_m / distance, 5)
    puddles = noise_pattern(scene.texture_seed + PUDDLE_SEED, PUDDLE_CELLS_M, d, s, size)
    share = share * wet.mirror * (1 - wet.patches * np.clip(0.5 - puddles, 0, 1))
    smeared = blur(mirrored, wet.rough_rows * rays.rig.height, axis=0)
    result: Picture = (surface * (1 - wet.darker) * (1 - share) + smeared * share).astype(np.float32)
    return result


def rain_streaks(rain: Rain, shape: tuple[int, ...]) -> Picture:
    """Return the light that drops before one camera add, (H, W)."""
    rng = np.random.default_rng(rain.seed)
    height, width = shape
    added = np.zeros(shape, np.float32)
    for _ in range(rain.streaks):
        u, v = rng.uniform(0, width), rng.uniform(-rain.length_px, height)
        length, grey = rain.length_px * rng.uniform(0.4, 1.6), rain.grey * rng.uniform(0.3, 1.7)
        rows = np.arange(max(int(v), 0), min(int(v + length) + 1, height))
        if not rows.size:
            continue
        middle = u + (rain.slant + rng.normal(0, 0.02)) * (rows - v)
        first, last = max(int(middle.min()) - 3, 0), min(int(middle.max()) + 4, width)
        off = (np.arange(first, last) - middle[:, None]) / STREAK_WIDTH_PX
        added[rows[0] : rows[-1] + 1, first:last] += (grey * np.exp(-0.5 * off * off)).astype(np.float32)
    return added
