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

"""Ingredients beside and on the road: strips, kerbs, rails, foliage, cars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .ingredients import Band, Barrier, Car, Facade, GuardRail, House, Kerb, Posts, Strand, Wall, WorldScene
from .recipe_tools import Rng, border, outermost, side_of_choice, straight_without_kerb, strip, without_paint

RAIL_BAND_M = 0.31  # height of the band of a W-beam rail
HOUSES_TO_M = 120.0  # farther houses are a texture
ROPE_M = 0.019  # thickness of a rope of a wire barrier


def grass(scene: WorldScene, rng: Rng) -> WorldScene:
    """Grass beyond the outermost line of one side."""
    side = side_of_choice(rng)
    edge = outermost(scene, side) + side * float(rng.uniform(0.1, 1.0))
    verge = Band(*strip(edge, side), float(rng.uniform(80, 125)), float(rng.uniform(8, 18)))
    return replace(scene, bands=(*scene.bands, verge))


def bright_verge(scene: WorldScene, rng: Rng) -> WorldScene:
    """Concrete or dry gravel directly beside a line: only the inner edge of the line stands out."""
    side = side_of_choice(rng)
    edge = outermost(scene, side) - side * 0.02
    verge = Band(*strip(edge, side), float(rng.uniform(170, 205)), float(rng.uniform(2, 8)))
    return replace(scene, bands=(*scene.bands, verge))


def kerb(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb 8 cm high beyond the line of one side."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    face = outermost(scene, side) + side * float(rng.uniform(0.15, 0.6))
    return replace(scene, kerbs=(*scene.kerbs, _kerb(face, rng)))


def kerb_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb where the line of one side should be."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    return replace(without_paint(scene, side), kerbs=(*scene.kerbs, _kerb(border(scene, side), rng)))


def _kerb(face_m: float, rng: Rng) -> Kerb:
    return Kerb(
        face_m,
        0.08,
        float(rng.uniform(0.12, 0.2)),
        float(rng.uniform(110, 170)),
        float(rng.uniform(180, 220)),
        float(rng.uniform(95, 135)),
    )


def guard_rail(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A guard rail beyond the outermost line."""
    side = side_of_choice(rng)
    if scene.pose.height_m < 0.9:
        return None
    at = outermost(scene, side) + side * float(rng.uniform(0.5, 1.5))
    return replace(scene, rails=(*scene.rails, GuardRail(at, grey=float(rng.uniform(140, 190)))))


def _rail(d_m: float, side: int, rng: Rng) -> Barrier:
    """Return a guard rail: a band of steel with a bright upper and lower third, on posts behind it."""
    top, wide = float(rng.uniform(0.65, 0.80)), RAIL_BAND_M
    grey, relief = float(rng.uniform(130, 200)), float(rng.uniform(10, 50))
    strands = tuple(
        Strand(top - wide * (3 - i) / 3, top - wide * (2 - i) / 3, grey + lift * relief)
        for i, lift in enumerate((0.5, -0.5, 0.5))
    )
    every = float(rng.choice([2.0, 4.0]))
    at = d_m + side * 0.10
    return Barrier(d_m, strands, Posts(at, top - 0.05, every, float(rng.uniform(0, every)), grey=0.8 * grey))


def _wires(d_m: float, rng: Rng) -> Barrier:
    """Return a barrier of three or four steel ropes on thin posts between them."""
    top, ropes = float(rng.uniform(0.65, 0.85)), int(rng.integers(3, 5))
    grey = float(rng.uniform(140, 210))
    strands = [Strand(z, z + ROPE_M, grey) for z in np.linspace(top - 0.35, top - 0.03, ropes)]
    posts = Posts(d_m, top, 3.0, float(rng.uniform(0, 3)), 0.08, 0.7 * grey)
    return Barrier(d_m, tuple(strands), posts)


def rail_with_posts(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A guard rail on posts beyond the outermost line of one side."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    at = outermost(scene, side) + side * float(rng.uniform(0.5, 1.5))
    return replace(scene, barriers=(*scene.barriers, _rail(at, side, rng)))


def wire_barrier(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Steel ropes on thin posts beyond the outermost line of one side."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    at = outermost(scene, side) + side * float(rng.uniform(0.4, 1.2))
    return replace(scene, barriers=(*scene.barriers, _wires(at, rng)))


def overhead_cables(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Wires along the road above it, as of a tramway or of lamps, on poles beside it."""
    if scene.shape.curvature_per_m != 0:
        return None
    side = side_of_choice(rng)
    pole = outermost(scene, side) + side * float(rng.uniform(0.8, 2.5))
    every, height = float(rng.uniform(25, 45)), float(rng.uniform(6.0, 8.0))
    posts = Posts(pole, height, every, float(rng.uniform(5, every)), 0.22, float(rng.uniform(50, 130)))
    at, grey = float(rng.uniform(-2.5, 1.0)), float(rng.uniform(25, 70))
    barriers = []
    for i in range(int(rng.integers(1, 4))):
        bottom, thick = float(rng.uniform(4.8, height - 0.3)), float(rng.uniform(0.012, 0.04))
        sag = float(rng.uniform(0, 0.5))
        strand = Strand(bottom, bottom + thick, grey, sag, every, posts.first_m)
        # They hang on brackets that are not drawn.
        barriers.append(Barrier(at, (strand,), None if i else posts))
        at += float(rng.uniform(0.8, 1.6))
    return replace(scene, barriers=(*scene.barriers, *barriers))


def rail_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A guard rail on posts, and no paint on its side: it converges with the other line as a line would."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    at = border(scene, side) + side * float(rng.uniform(0.0, 0.8))
    bare = without_paint(scene, side)
    return replace(bare, barriers=(*scene.barriers, _rail(at, side, rng)))


def wires_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Single ropes on one side or on both, low above the road, and no paint there."""
    if scene.shape.curvature_per_m != 0 or scene.kerbs:
        return None
    sides = (-1, 1) if rng.random() < 0.5 else (side_of_choice(rng),)
    height = float(rng.uniform(0.3, 0.9))
    barriers = list(scene.barriers)
    for side in sides:
        scene = without_paint(scene, side)
        at = border(scene, side) + side * float(rng.uniform(-0.2, 0.5))
        thick = float(rng.uniform(0.03, 0.12))
        barriers.append(Barrier(at, (Strand(height, height + thick, float(rng.uniform(170, 220))),)))
    return replace(scene, barriers=tuple(barriers))


def facades(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Houses side by side along one side of the road or both: upright and level edges, more than lines."""
    if scene.shape.curvature_per_m != 0:
        return None
    sides = (-1, 1) if rng.random() < 0.6 else (side_of_choice(rng),)
    rows = []
    for side in sides:
        at = outermost(scene, side) + side * float(rng.uniform(1.5, 5.0))
        sun, houses, begin = float(rng.uniform(0.6, 1.3)), [], float(rng.uniform(-5, 8))
        while begin < HOUSES_TO_M:
            end, floor = begin + float(rng.uniform(7, 18)), float(rng.uniform(2.7, 3.6))
            height = floor * int(rng.integers(2, 5)) + float(rng.uniform(0.5, 1.5))
            grey = min(sun * float(rng.uniform(80, 180)), 230.0)
            window = float(rng.uniform(25, 80)) if rng.random() < 0.8 else min(1.4 * grey, 240.0)
            every, texture = float(rng.uniform(1.8, 3.5)), float(rng.uniform(1, 10))
            houses.append(House(begin, end, height, grey, window, floor, every, texture))
            begin = end + (float(rng.uniform(2, 6)) if rng.random() < 0.2 else 0.0)
        rows.append(Facade(at, tuple(houses)))
    return replace(scene, facades=(*scene.facades, *rows))


def foliage(scene: WorldScene, rng: Rng) -> WorldScene:
    """Trees ahead, and along a straight road a hedge on one side: clutter above the horizon."""
    walls = [Wall(float(rng.uniform(130, 250)), False, float(rng.uniform(4, 10)))]
    if scene.shape.curvature_per_m == 0 and not scene.kerbs:
        side = side_of_choice(rng)
        at = side * float(rng.uniform(7, 12))
        if side * at > side * outermost(scene, side) + 1.5:
            walls.append(Wall(at, True, float(rng.uniform(1.5, 8)), 0.6, float(rng.uniform(60, 100))))
    return replace(scene, walls=(*scene.walls, *walls))


def car_ahead(scene: WorldScene, rng: Rng) -> WorldScene:
    """A car in the own lane, 15 to 35 m ahead."""
    at = sum(scene.lane_m) / 2 + float(rng.uniform(-0.3, 0.3))
    return replace(scene, cars=(*scene.cars, Car(float(rng.uniform(15, 35)), at, grey=_car_grey(rng))))


def parked_cars(scene: WorldScene, rng: Rng) -> WorldScene:
    """A row of cars parked on the own lane's line of one side, which hides much of it."""
    side = side_of_choice(rng)
    line = border(scene, side)
    first = float(rng.uniform(9, 16))
    cars = tuple(
        Car(first + 6.5 * i, line + side * float(rng.uniform(0.3, 0.7)), grey=_car_grey(rng))
        for i in range(int(rng.integers(1, 5)))
    )
    return replace(scene, cars=(*scene.cars, *cars))


def _car_grey(rng: Rng) -> float:
    return float(rng.choice([40.0, 90.0, 140.0, 200.0]))
