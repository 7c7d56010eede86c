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

"""What stands beside, on and above a road, as polygons."""

from __future__ import annotations

import itertools

import numpy as np

from .cameras import Array
from .mesh import Look, Material, MeshBuilder
from .roads import Alignment, Strip, add_strips

_GAUGE_M = 1.435  # of railways: between the heads of the rails
_DETAIL_M = 35.0  # cars further away have no wheels and lamps


def solid(albedo: float, texture: float = 0.1, texel_m: float = 0.004, warmth: float = 0.0) -> Look:
    """Return the look of something that stands."""
    return Look(Material.SOLID, albedo, texture, texel_m, warmth)


def band(
    builder: MeshBuilder,
    road: Alignment,
    outline_m: list[tuple[float, float]],
    look: Look,
    reach_m: tuple[float, float],
    *,
    thin: bool = False,
) -> None:
    """Add a body along the road: its outline across the road, from place to place along it."""
    cuts = road.cuts(*reach_m)
    for (t0, z0), (t1, z1) in itertools.pairwise(outline_m):
        one = road.world(cuts, np.array(t0), np.array(z0))
        two = road.world(cuts, np.array(t1), np.array(z1))
        builder.add(np.stack([one[:-1], one[1:], two[1:], two[:-1]], axis=1), look, thin=thin)


def guard_rail(
    builder: MeshBuilder,
    road: Alignment,
    t_m: float,
    rng: np.random.Generator,
    reach_m: tuple[float, float] = (-3.0, 160.0),
) -> None:
    """Add a guard rail: a beam with a fold, on posts that stand behind it."""
    out = np.sign(t_m)
    albedo = float(rng.uniform(0.35, 0.8))
    low, high = 0.44 + rng.uniform(-0.04, 0.06), 0.75 + rng.uniform(-0.04, 0.06)
    middle = (low + high) / 2
    fold = [
        (t_m, low),
        (t_m - out * 0.04, low + 0.07),
        (t_m, middle),
        (t_m - out * 0.04, high - 0.07),
        (t_m, high),
    ]
    for part, grey in zip(itertools.pairwise(fold), (0.75, 1.05, 0.8, 1.1), strict=True):
        band(builder, road, list(part), solid(albedo * grey, 0.06), reach_m, thin=True)
    every = float(rng.choice([1.33, 2.0, 4.0]))
    post = solid(albedo * 0.7, 0.06)
    for s in np.arange(reach_m[0] + rng.uniform(0, every), min(reach_m[1], 70.0), every):
        posts(builder, road, float(s), t_m + out * 0.09, 0.1, high - 0.05, post)


def posts(
    builder: MeshBuilder, road: Alignment, s_m: float, t_m: float, width_m: float, height_m: float, look: Look
) -> None:
    """Add one upright post."""
    foot = road.world(np.array(s_m), np.array(t_m), np.array(-0.05))
    builder.box(foot, (width_m, width_m, height_m + 0.05), 0.0, look, thin=True)


def train_rails(
    builder: MeshBuilder, road: Alignment, middle_m: float, height_m: float, rng: np.random.Generator
) -> None:
    """Add two rails that stand on the ground."""
    bright = float(rng.uniform(0.5, 0.85))
    for t in (middle_m - _GAUGE_M / 2, middle_m + _GAUGE_M / 2):
        half, top = 0.036, height_m
        reach = (-3.0, 200.0)
        band(builder, road, [(t - half, top), (t + half, top)], solid(bright, 0.03), reach, thin=True)
        side = solid(float(rng.uniform(0.06, 0.16)), 0.1)
        for out in (-1.0, 1.0):
            web = [(t + out * half, top), (t + out * half, top - 0.035), (t + out * 0.01, top - 0.05)]
            foot = [(t + out * 0.01, min(0.03, top / 2)), (t + out * 0.07, 0.0)]
            band(builder, road, web + foot, side, reach)


def cable(
    builder: MeshBuilder, road: Alignment, t_m: float, height_m: float, width_m: float, albedo: float
) -> None:
    """Add a cable along the road, which hangs between its masts."""
    s = np.concatenate([np.arange(-3.0, 40.0, 3.9), np.arange(40.0, 180.0, 7.8)])
    sag = 0.25 * ((np.abs((s % 40.0) - 20.0) / 20.0) ** 2 - 1)
    left = road.world(s, t_m, height_m + sag)
    down = np.array([0.0, 0.0, -width_m])
    builder.add(
        np.stack([left[:-1], left[1:], left[1:] + down, left[:-1] + down], axis=1),
        solid(albedo, 0.02),
        thin=True,
    )


def car(
    builder: MeshBuilder,
    road: Alignment,
    s_m: float,
    t_m: float,
    rng: np.random.Generator,
    *,
    truck: bool = False,
) -> None:
    """Add a car, seen from behind or from the front."""
    foot = road.world(np.array(s_m), np.array(t_m), np.array(0.0))
    yaw = road.curvature_per_m * s_m
    grey = float(rng.choice([0.05, 0.1, 0.25, 0.45, 0.7]))
    paint, glass = solid(grey, 0.03), solid(0.06, 0.05)
    length, width = rng.uniform(3.7, 4.8), rng.uniform(1.68, 1.9)
    up = np.array([0.0, 0.0, 1.0])
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    left = np.array([-ahead[1], ahead[0], 0.0])
    if truck:
        builder.box(foot + 0.5 * up, (8.0, 2.45, 2.9), yaw, solid(grey + 0.1, 0.06))
        builder.box(foot + 0.3 * up, (7.6, 2.3, 0.25), yaw, solid(0.04))
    else:
        builder.box(foot + 0.28 * up, (length, width, 0.62), yaw, paint)
        _cabin(builder, foot + 0.9 * up, ahead, left, length, width, glass, paint)
        builder.box(foot + 0.12 * up, (length * 0.94, width * 0.9, 0.2), yaw, solid(0.03))
    if s_m > _DETAIL_M:
        return
    half = (3.9 if truck else length / 2) + 0.01
    for end in (-1, 1):
        for side in (-1, 1):
            wheel = foot + ahead * end * half * 0.62 + left * side * (width / 2 - 0.1)
            builder.box(wheel, (0.6, 0.24, 0.6), yaw, solid(0.03))
            lamp = foot + ahead * end * half + left * side * width * 0.38 + up * 0.62
            builder.box(lamp, (0.03, 0.28, 0.16), yaw, solid(0.35, 0.02, warmth=0.4), thin=True)
        plate = foot + ahead * end * half + up * 0.5
        builder.box(plate, (0.02, 0.52, 0.11), yaw, solid(0.8, 0.1), thin=True)


def _cabin(
    builder: MeshBuilder,
    foot: Array,
    ahead: Array,
    left: Array,
    length: float,
    width: float,
    glass: Look,
    paint: Look,
) -> None:
    def ring(long: float, wide: float, high: float, shift: float) -> Array:
        corners = [(long, wide), (-long, wide), (-long, -wide), (long, -wide)]
        return np.array([foot + ahead * (x + shift) + left * y + np.array([0, 0, high]) for x, y in corners])

    low, high = ring(length * 0.34, width * 0.47, 0.0, -0.15), ring(length * 0.2, width * 0.38, 0.55, -0.25)
    sides = [[low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]] for i in range(4)]
    builder.add(np.array(sides), glass, separate=True)
    builder.add(high, paint)


def houses(
    builder: MeshBuilder, road: Alignment, t_m: float, rng: np.random.Generator, reach_m: tuple[float, float]
) -> None:
    """Add a row of houses along the road, their walls at one place across it."""
    s = reach_m[0]
    out = np.sign(t_m)
    while s < reach_m[1]:
        length, height = rng.uniform(8, 20), rng.choice([7.0, 10.0, 13.0, 16.0])
        back = t_m + out * rng.uniform(0, 1.2)
        wall = Look(Material.FACADE, float(rng.uniform(0.15, 0.6)), 0.12, 0.008, 0.3)
        corners = [(s, back), (s + length, back), (s + length, back + out * 11), (s, back + out * 11)]
        low = np.array([road.world(np.array(a), np.array(b), np.array(-0.4)) for a, b in corners])
        high = low + np.array([0, 0, height + 0.4])
        builder.add(np.array([low[0], low[1], high[1], high[0]]), wall)
        builder.add(np.array([low[0], low[3], high[3], high[0]]), wall)
        s += length + (rng.uniform(2, 9) if rng.random() < 0.35 else 0.0)


def tree(builder: MeshBuilder, foot: Array, rng: np.random.Generator) -> None:
    """Add a tree: a trunk, and a crown of flat pieces."""
    trunk = rng.uniform(1.8, 3.5)
    builder.box(
        foot - np.array([0, 0, 0.2]), (0.3, 0.3, trunk + 1.2), 0.3, solid(0.1, 0.25, 0.006), thin=True
    )
    middle = foot + np.array([0, 0, trunk + rng.uniform(1.5, 2.5)])
    rounds, around = 3, 6
    high = np.linspace(-np.pi / 2, np.pi / 2, rounds + 1)
    turn = np.arange(around + 1) * 2 * np.pi / around
    size = rng.uniform(0.75, 1.2, (rounds + 1, around + 1)) * rng.uniform(1.6, 2.8)
    size[:, -1] = size[:, 0]
    crown = middle + size[..., None] * np.stack(
        [
            np.cos(high)[:, None] * np.cos(turn),
            np.cos(high)[:, None] * np.sin(turn),
            np.broadcast_to(1.1 * np.sin(high)[:, None], size.shape),
        ],
        axis=-1,
    )
    quads = np.stack([crown[:-1, :-1], crown[1:, :-1], crown[1:, 1:], crown[:-1, 1:]], axis=2).reshape(
        -1, 4, 3
    )
    first, second = quads.copy(), quads.copy()
    first[:, 3] = first[:, 2]
    second[:, 1], second[:, 2] = quads[:, 2], quads[:, 3]
    builder.add(np.concatenate([first, second]), solid(float(rng.uniform(0.07, 0.2)), 0.55, 0.02, 0.2))


def ragged_wall(
    builder: MeshBuilder,
    road: Alignment,
    t_m: float,
    rng: np.random.Generator,
    reach_m: tuple[float, float],
    height_m: float,
) -> None:
    """Add a wood or a hedge along the road: a wall with a ragged top, of which pieces stand out."""
    s = np.arange(reach_m[0], reach_m[1], 2.0)
    top = height_m * np.clip(0.75 + 0.25 * np.cumsum(rng.normal(0, 0.35, len(s))), 0.4, 1.5)
    top *= rng.uniform(0.9, 1.1, len(s))
    place = t_m + np.sign(t_m) * rng.uniform(0, 0.7, len(s))
    low, high = road.world(s, place, np.full(len(s), -0.5)), road.world(s, place, top)
    look = solid(float(rng.uniform(0.06, 0.18)), 0.5, 0.012, 0.2)
    builder.add(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1), look)


def hills(builder: MeshBuilder, rng: np.random.Generator, height_m: float) -> None:
    """Add what is at the horizon."""
    angle = np.linspace(-1.1, 1.1, 90)
    top = height_m * np.clip(0.5 + np.cumsum(rng.normal(0, 0.12, len(angle))), 0.1, 2.0)
    flat = np.stack([380 * np.cos(angle), 380 * np.sin(angle)], axis=1)
    low = np.concatenate([flat, np.full((len(angle), 1), -30.0)], axis=1)
    high = np.concatenate([flat, top[:, None]], axis=1)
    quads = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    builder.add(quads, solid(float(rng.uniform(0.1, 0.35)), 0.06, 0.31, 0.1))


def snow_bank(
    builder: MeshBuilder,
    road: Alignment,
    foot_m: float,
    height_m: float,
    width_m: float,
    rng: np.random.Generator,
) -> None:
    """Add a bank of snow along the road, of uneven height."""
    out = np.sign(foot_m)
    s = np.cumsum(0.7 * 1.055 ** np.arange(42)) - 3.7
    rows: list[Array] = []
    for share, high in ((0.0, -0.03), (0.25, 0.6), (0.5, 1.0), (0.8, 0.9), (1.0, 0.7), (6.0, 0.5)):
        t = foot_m + out * (share * width_m + (rng.normal(0, 0.05, len(s)) if share < 2 else 0.0))
        z = height_m * (high + (rng.normal(0, 0.12, len(s)) if high > 0 else 0.0))
        rows.append(road.world(s, t, z))
    look = solid(float(rng.uniform(0.45, 0.75)), 0.1, 0.01, -0.2)
    for one, two in itertools.pairwise(rows):
        first = np.stack([one[:-1], one[1:], two[1:], two[1:]], axis=1)
        second = np.stack([one[:-1], two[1:], two[:-1], two[:-1]], axis=1)
        builder.add(np.concatenate([first, second]), look)


def masts(
    builder: MeshBuilder, road: Alignment, t_m: float, every_m: float, rng: np.random.Generator
) -> None:
    """Add lamp posts or masts along the road."""
    look = solid(float(rng.uniform(0.1, 0.5)), 0.05)
    for s in np.arange(rng.uniform(4, 4 + every_m), 90.0, every_m):
        posts(builder, road, float(s), t_m, float(rng.uniform(0.1, 0.2)), float(rng.uniform(4, 8)), look)


def flat_strip(
    builder: MeshBuilder, road: Alignment, from_m: tuple[float, float], to_m: tuple[float, float], look: Look
) -> None:
    """Add one strip of ground over the whole length."""
    add_strips(builder, road, [Strip(from_m, to_m, look)])
