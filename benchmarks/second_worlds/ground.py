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

"""Light of what lies flat: the carriageway with its paint, and the ground beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .cameras import Array32
from .lighting import light_on
from .points import Points
from .scenes import Scene, Stripe
from .textures import SIZE, stack

Ints = npt.NDArray[np.intp]
_CLOUD_TILE_M = 9.0
_BLOTCH_TILE_M = 61.0
_CRACK_TILE_M = 11.0
_WEAR_TILE_M = 2.3
_TRACK_M = 0.75  # of either wheel from the middle of the lane
_TRACK_WIDTH_M = 0.3
_RETURN = 1.9  # how much brighter paint is in headlamps: beads of glass


@dataclass(frozen=True)
class _Lane:
    """Where samples are in the lane, and how far it goes on in one column and in one row."""

    s: Array32
    t: Array32
    long_m: tuple[Array32, Array32]
    wide_m: tuple[Array32, Array32]


def shade_ground(scene: Scene, points: Points, road: npt.NDArray[np.bool_]) -> tuple[Array32, Array32]:
    """Return light and warmth of samples that lie flat.

    Args:
        scene: The world.
        points: Where the samples are.
        road: Which of them are the carriageway.
    """
    albedo, warmth = points.albedo.copy(), points.warmth.copy()
    grain = points.texture
    texel = points.texel_m
    surface = scene.surface
    own = np.flatnonzero(road)
    rest = np.flatnonzero(~road)
    if len(rest):
        _ground_texture(scene, points, rest, albedo, grain[rest], texel[rest])
    retro = np.zeros(0, np.float32)
    if len(own):
        part = points.take(own)
        lane = _lane(scene, part)
        albedo[own] *= np.float32(surface.albedo) * _asphalt(scene, part, lane)
        warmth[own] = surface.warmth
        own_albedo, own_warmth = albedo[own], warmth[own]
        retro = _paint(scene, part, lane, own_albedo, own_warmth)
        albedo[own], warmth[own] = own_albedo, own_warmth
    sun, lamps = light_on(scene, points.x, points.y, points.z, np.float32(scene.light.sun[2]))
    if len(own) and len(scene.light.lamps):
        lamps[own] *= 1 + np.float32(_RETURN - 1) * retro
    light = albedo * (sun + lamps)
    return light, warmth * light


def _heading(scene: Scene, points: Points) -> tuple[Array32, Array32]:
    """Return places along and across the camera's heading, or the lane: the axes of the textures."""
    u, v = scene.surface.origin_m
    if scene.along_lane:
        s, t, _, _ = scene.road.lane(points.x, points.y)
        return s + np.float32(u), t + np.float32(v)
    yaw = scene.mount.yaw_rad
    cos, sin = np.float32(math.cos(yaw)), np.float32(math.sin(yaw))
    return cos * points.x + sin * points.y + np.float32(u), cos * points.y - sin * points.x + np.float32(v)


def _floor(
    scene: Scene, name: str, along: Array32, across: Array32, pixel_m: Array32, tile_m: float
) -> Array32:
    """Return a texture of the floor."""
    texel = tile_m / SIZE
    offset = round(math.log2(texel * scene.rig.fx / scene.mount.height_m))
    scale = np.float32(1 / tile_m)
    level = np.log2(pixel_m * np.float32(1 / texel))
    return stack(name, 2, offset).sample(along * scale, across * scale, level)


def _ground_texture(
    scene: Scene, points: Points, rest: Ints, albedo: Array32, grain: Array32, texel: Array32
) -> None:
    part = points.take(rest)
    along, across = _heading(scene, part)
    for size in np.unique(texel):
        same = np.flatnonzero(texel == size)
        u, v, pixel = along[same], across[same], part.pixel_m[same]
        fine = _floor(scene, "cloud", u, v, pixel, float(size) * SIZE)
        coarse = _floor(scene, "cloud", u, v, pixel, float(size) * SIZE * 7.3)
        albedo[rest[same]] *= np.clip(1 + grain[same] * (fine + 0.7 * coarse), 0.15, 3)


def _lane(scene: Scene, points: Points) -> _Lane:
    s, t, cos, sin = scene.road.lane(points.x, points.y)
    steps = (points.step_x, points.step_y)
    long_m = tuple(np.abs(cos * step[0] + sin * step[1]) for step in steps)
    wide_m = tuple(np.abs(cos * step[1] - sin * step[0]) for step in steps)
    return _Lane(s, t, (long_m[0], long_m[1]), (wide_m[0], wide_m[1]))


def _asphalt(scene: Scene, points: Points, lane: _Lane) -> Array32:
    surface = scene.surface
    along, across = _heading(scene, points)
    pixel = points.pixel_m
    value = np.ones(len(along), np.float32)
    if surface.grain:
        value += np.float32(surface.grain) * _floor(
            scene, "grain", along, across, pixel, surface.grain_texel_m * SIZE
        )
    if surface.cloud:
        value += np.float32(surface.cloud) * _floor(scene, "cloud", along, across, pixel, _CLOUD_TILE_M)
    if surface.blotch:
        value += np.float32(surface.blotch) * _floor(scene, "cloud", across, along, pixel, _BLOTCH_TILE_M)
    if surface.tracks:
        for side in (-_TRACK_M, _TRACK_M):
            value += np.float32(surface.tracks) * np.exp(
                -(((lane.t - np.float32(side)) / np.float32(_TRACK_WIDTH_M)) ** 2)
            )
    if surface.cracks:
        value *= 1 - np.float32(surface.cracks) * np.clip(
            1.5 * _floor(scene, "crack", along, across, pixel, _CRACK_TILE_M), 0, 1
        )
    clipped: Array32 = np.clip(value, 0.1, 4)
    return clipped


def _paint(scene: Scene, points: Points, lane: _Lane, albedo: Array32, warmth: Array32) -> Array32:
    """Mix the stripes into the asphalt; return how much of each sample gives headlamps' light back."""
    retro = np.zeros(len(albedo), np.float32)
    worn: Array32 | None = None
    for stripe in scene.stripes:
        chosen = _candidates(stripe, lane)
        if not len(chosen):
            continue
        cover = _cover(stripe, lane, chosen)
        if stripe.wear:
            if worn is None:
                worn = _wear(scene, points)
            cover = cover * np.clip(0.5 + 1.6 * (worn[chosen] - np.float32(_quantile(stripe.wear))), 0, 1)
        albedo[chosen] += cover * (np.float32(stripe.albedo) - albedo[chosen])
        warmth[chosen] += cover * (np.float32(stripe.warmth) - warmth[chosen])
        if stripe.reflects:
            retro[chosen] = np.maximum(retro[chosen], cover)
    return retro


def _quantile(share: float) -> float:
    """Return below which value so large a share of a normal distribution lies, roughly."""
    return 1.7 * math.tan(1.9 * (min(max(share, 0.01), 0.99) - 0.5)) / math.tan(0.95)


def _wear(scene: Scene, points: Points) -> Array32:
    along, across = _heading(scene, points)
    spots = _floor(scene, "leaf", along, across, points.pixel_m, _WEAR_TILE_M)
    larger = _floor(scene, "cloud", across, along, points.pixel_m, 5 * _WEAR_TILE_M)
    mixed: Array32 = 0.8 * spots + 0.6 * larger
    return mixed


def _candidates(stripe: Stripe, lane: _Lane) -> Ints:
    reach = np.float32(stripe.width_m / 2 + stripe.wobble_m)
    wide, long = (np.maximum(*size) for size in (lane.wide_m, lane.long_m))
    near = np.abs(_from_middle(stripe, lane.s, lane.t)) < reach + wide
    near &= lane.s > np.float32(stripe.start_m) - long
    near &= lane.s < np.float32(stripe.end_m) + long
    return np.flatnonzero(near)


def _from_middle(stripe: Stripe, s: Array32, t: Array32) -> Array32:
    """Return how far left of the middle of a stripe places of the lane are."""
    away: Array32 = t - np.float32(stripe.t_m)
    return away - np.float32(stripe.slope) * s if stripe.slope else away


def _cover(stripe: Stripe, lane: _Lane, chosen: Ints) -> Array32:
    """Return the share of each pixel that a stripe covers."""
    s = lane.s[chosen]
    t = _from_middle(stripe, s, lane.t[chosen])
    long_m, wide_m = ((size[0][chosen], size[1][chosen]) for size in (lane.long_m, lane.wide_m))
    if stripe.wobble_m:
        t = t - np.float32(stripe.wobble_m) * (np.sin(s * 1.1 + stripe.phase_m) + np.sin(s * 0.37)) / 2
    half = np.full(len(s), stripe.width_m / 2, np.float32)
    if stripe.taper:
        half *= np.clip((np.float32(stripe.end_m) - s) / np.float32(stripe.end_m - stripe.start_m), 0, 1)
    cover = _overlap(t, half, wide_m)
    middle, length = (stripe.start_m + stripe.end_m) / 2, stripe.end_m - stripe.start_m
    cover *= _overlap(s - np.float32(middle), np.float32(length / 2), long_m)
    if stripe.dash_m:
        period = np.float32(stripe.dash_m + stripe.gap_m)
        place = s - np.float32(stripe.phase_m + stripe.dash_m / 2)
        place = place - period * np.round(place / period)
        dashes = _overlap(place, np.float32(stripe.dash_m / 2), long_m)
        many = np.maximum(*long_m) > period / 2
        cover *= np.where(many, np.float32(stripe.dash_m) / period, dashes)
    return cover


def _overlap(place: Array32, half: Array32 | np.float32, pixel: tuple[Array32, Array32]) -> Array32:
    """Return the share of pixels about places that lies within a half width about zero.

    Args:
        place: Places of the pixels' middles.
        half: The half width.
        pixel: How far the place goes on within one column and within one row.
    """
    share: Array32 = _below(place + half, pixel) - _below(place - half, pixel)
    return share


def _below(place: Array32, pixel: tuple[Array32, Array32]) -> Array32:
    """Return the share of a square pixel that lies on the positive side of a straight edge.

    Args:
        place: How far the middle of the pixel is on that side.
        pixel: As in :func:`_overlap`.
    """
    large = np.maximum(np.maximum(*pixel), np.float32(1e-5))
    small = np.clip(np.minimum(*pixel) / large, 0.02, 1)
    x = np.clip(place / large, -1.1, 1.1)
    outer, inner = (1 + small) / 2, (1 - small) / 2
    sums = (_ramp(x + outer) - _ramp(x + inner)) - (_ramp(x - inner) - _ramp(x - outer))
    share: Array32 = np.clip(sums / small, 0, 1)
    return share


def _ramp(x: Array32) -> Array32:
    """Return the integral of the integral of a step."""
    positive = np.clip(x, 0, None)
    ramp: Array32 = 0.5 * positive * positive
    return ramp
