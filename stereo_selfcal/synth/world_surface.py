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

"""Grey level of the ground of a world: road surface, strips, worn paint, arrows, shadows, textures."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from .ingredients import Arrow, Paint, Shadow, WorldScene
from .renderer import TEXTURE_CELLS_M, TEXTURE_FADE_START, sample_tile, texture_tile
from .world import LaneLine
from .world_light import lit
from .world_rays import Layer, Single, pixel_mean

# Patches of missing paint, and patches of sun among leaves [m].
WEAR_CELLS_M = (0.08, 0.2, 0.5)
DAPPLE_CELLS_M = (0.25, 0.6, 1.5)

# Edges of such patches, in standard deviations of the pattern.
WEAR_SOFT = 0.35
DAPPLE_SOFT = 0.8
DAPPLED_SHARE = 0.5  # as much shade as sun

# The seeds of the patterns differ from those of the road surface.
WEAR_SEED, DAPPLE_SEED, WALL_SEED, FACADE_SEED = 1_000_003, 2_000_003, 3_000_017, 4_000_037


def noise_pattern(
    seed: int, cells_m: tuple[float, ...], column_m: Single, row_m: Single, size_m: Single
) -> Single:
    """Return band-limited noise of unit variance from near, which fades where pixels are too large.

    Args:
        seed: Same seed, same pattern.
        cells_m: Sizes of its octaves [m].
        column_m: Positions one way [m].
        row_m: Positions the other way [m].
        size_m: Size of a pixel there [m].
    """
    total = np.zeros(column_m.shape, np.float32)
    for octave, cell_m in enumerate(cells_m):
        near = size_m < cell_m
        rows = np.flatnonzero(near.any(axis=1))
        if not rows.size:
            continue
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        tile = texture_tile(seed, octave)
        noise = sample_tile(
            tile, column_m[part].astype(np.float64) / cell_m, row_m[part].astype(np.float64) / cell_m
        )
        fade = np.clip((1 - size_m[part] / cell_m) / (1 - TEXTURE_FADE_START), 0.0, 1.0)
        total[part] += noise * fade
    total /= np.float32(math.sqrt(len(cells_m)))
    return total


def ground(scene: WorldScene, layer: Layer) -> Single:
    """Return the grey levels of the road's surface, whole pixels."""
    grey = np.full(layer.s.shape, scene.asphalt_grey, np.float32)
    amplitude = np.float32(scene.texture_amplitude) * np.ones_like(pixel_mean(grey))
    for band in scene.bands:
        share = layer.between(band.right_m, band.left_m)
        grey += share * (np.float32(band.grey) - grey)
        amplitude = amplitude + pixel_mean(share) * (np.float32(band.texture_amplitude) - amplitude)
    s, d, size = layer.pixels()
    wear = None
    for paint in scene.paints:
        share = painted(layer, paint.line)
        if paint.worn > 0:
            if wear is None:
                wear = noise_pattern(scene.texture_seed + WEAR_SEED, WEAR_CELLS_M, d, s, size)
            share *= np.repeat(_left_of_paint(wear, paint, size), layer.s.shape[0] // s.shape[0], axis=0)
        grey += share * (np.float32(paint.line.grey) - grey)
    for arrow in scene.arrows:
        grey += _arrow(layer, arrow) * (np.float32(arrow.grey) - grey)
    picture = pixel_mean(grey)
    if np.any(amplitude):
        if scene.fine_texture:
            grain = np.maximum(layer.span, layer.length)
            samples = noise_pattern(scene.texture_seed, TEXTURE_CELLS_M, layer.d, layer.s, grain)
            picture += amplitude * pixel_mean(samples)
        else:
            picture += amplitude * noise_pattern(scene.texture_seed, TEXTURE_CELLS_M, d, s, size)
    picture *= light(scene, layer)
    for car in scene.cars:
        # The sun never reaches the road below a car.
        half_m = car.width_m / 2
        under = layer.between(car.d_m - half_m, car.d_m + half_m, soft_m=0.3)
        under *= layer.beyond(car.s_m - 0.1, 0.3) - layer.beyond(car.s_m + car.length_m, 0.3)
        picture *= 1 - np.float32(0.75) * pixel_mean(under)
    return picture


def light(scene: WorldScene, layer: Layer) -> Single:
    """Return the share of the light that every pixel of a surface gets in the shadows."""
    left = np.ones_like(pixel_mean(layer.span))
    for shadow in scene.shadows:
        left *= 1 - (1 - np.float32(shadow.light)) * _shade(scene, layer, shadow)
    if scene.headlights is not None:
        s, d, _ = layer.pixels()
        left *= lit(scene, s, d)
    return left


def painted(layer: Layer, line: LaneLine) -> Single:
    """Return how much of every sample a line covers."""
    share = layer.between(line.right_edge_m, line.left_edge_m)
    if line.dash_m is None or line.gap_m is None:
        return share
    half = layer.length * np.float32(0.5)
    length = _painted_length(layer.s + half, line) - _painted_length(layer.s - half, line)
    dashed: Single = share * np.clip(length / layer.length, 0.0, 1.0)
    return dashed


def _painted_length(s: Single, line: LaneLine) -> Single:
    """Return the length of paint of a dashed line up to ``s`` [m]."""
    assert line.dash_m is not None and line.gap_m is not None
    period = np.float32(line.dash_m + line.gap_m)
    periods = np.floor((s - np.float32(line.phase_m)) / period)
    in_period = s - np.float32(line.phase_m) - periods * period
    length: Single = periods * np.float32(line.dash_m) + np.minimum(in_period, np.float32(line.dash_m))
    return length


def _left_of_paint(wear: Single, paint: Paint, size: Single) -> Single:
    """Return the share of the paint that remains in every pixel."""
    threshold = NormalDist().inv_cdf(min(max(1 - paint.worn, 1e-3), 1 - 1e-3))
    left = np.clip((threshold - wear) / WEAR_SOFT + 0.5, 0.0, 1.0)
    # Patches smaller than a pixel are seen as their mean.
    fade = np.clip(size / WEAR_CELLS_M[-1], 0.0, 1.0)
    mixed: Single = (left + fade * (1 - paint.worn - left)).astype(np.float32)
    return mixed


def _arrow(layer: Layer, arrow: Arrow) -> Single:
    """Return how much of every sample an arrow covers."""
    neck_m, tip_m = arrow.s_m + arrow.length_m - arrow.head_m, arrow.s_m + arrow.length_m
    before_neck, before_tip = 1 - layer.beyond(neck_m), 1 - layer.beyond(tip_m)
    half_m = arrow.shaft_width_m / 2
    shaft = layer.between(arrow.d_m - half_m, arrow.d_m + half_m) * (
        layer.beyond(arrow.s_m) - 1 + before_neck
    )
    half_width = np.maximum((tip_m - layer.s) / arrow.head_m, 0) * (arrow.head_width_m / 2)
    inside = np.clip((half_width - np.abs(layer.d - arrow.d_m)) / layer.span + 0.5, 0.0, 1.0)
    head = inside * np.clip(before_tip - before_neck, 0.0, 1.0)
    covered: Single = np.clip(shaft + head, 0.0, 1.0).astype(np.float32)
    return covered


def _shade(scene: WorldScene, layer: Layer, shadow: Shadow) -> Single:
    """Return how much of every pixel lies in a shadow."""
    if shadow.kind == "dappled":
        s, d, size = layer.pixels()
        leaves = noise_pattern(scene.texture_seed + DAPPLE_SEED, DAPPLE_CELLS_M, d, s, size)
        shade = np.clip(leaves / DAPPLE_SOFT + DAPPLED_SHARE, 0.0, 1.0)
        return np.asarray(shade, np.float32)
    if shadow.kind == "along":
        return pixel_mean(layer.between(shadow.begin_m, shadow.end_m, shadow.soft_m))
    moved = layer.d * np.float32(shadow.skew)
    # An oblique edge is crossed along the row as well: its footprint is the sum of both.
    soft = shadow.soft_m
    return pixel_mean(layer.beyond(shadow.begin_m + moved, soft) - layer.beyond(shadow.end_m + moved, soft))
