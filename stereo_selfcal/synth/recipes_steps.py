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

"""Ingredients with another height than the road: kerbs of all kinds, edges of new asphalt, railways."""

from __future__ import annotations

from dataclasses import replace

from .ingredients import Band, Kerb, Paint, Ridge, RoadStep, WorldScene
from .recipe_tools import (
    Rng,
    border,
    outermost,
    own_line,
    side_of_choice,
    straight_without_kerb,
    without_paint,
)
from .world import LaneLine

RAIL_HEAD_M = 0.07  # width of the head of a rail of a railway
TRACK_M = 1.435 + RAIL_HEAD_M  # from the middle of a rail to that of the other, standard gauge
SLEEPER_M, SLEEPER_WIDTH_M, SLEEPER_EVERY_M = 2.6, 0.26, 0.6


def _stone(face_m: float, height_m: float, rng: Rng) -> Kerb:
    """Return a kerb with a dark or a bright face, and a top of any grey."""
    dark, bright = float(rng.uniform(30, 70)), float(rng.uniform(150, 210))
    face = dark if rng.random() < 0.5 else bright
    top = bright if rng.random() < 0.7 else float(rng.uniform(100, 150))
    return Kerb(
        face_m,
        height_m,
        float(rng.uniform(0.10, 0.30)),
        face,
        top,
        float(rng.uniform(80, 150)),
        float(rng.uniform(2, 10)),
    )


def _height(rng: Rng) -> float:
    """Return the height of a kerb: lowered at an entrance to that of a bus stop [m]."""
    return float(rng.uniform(0.06, 0.20))


def high_kerb(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A kerb of 6 to 20 cm with a dark or a bright face, beyond the line of one side."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    face = outermost(scene, side) + side * float(rng.uniform(0.15, 0.8))
    return replace(scene, kerbs=(*scene.kerbs, _stone(face, _height(rng), rng)))


def kerbs_both(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Kerbs of one make and one height beyond the lines of both sides."""
    if not all(straight_without_kerb(scene, side) for side in (-1, 1)):
        return None
    stone = _stone(0.0, _height(rng), rng)
    apart = float(rng.uniform(0.15, 0.6))
    faces = [outermost(scene, side) + side * apart for side in (-1, 1)]
    return replace(scene, kerbs=tuple(replace(stone, face_m=face) for face in faces))


def high_kerb_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A kerb of 6 to 20 cm with a dark or a bright face, where the line of one side should be."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    stone = _stone(border(scene, side) + side * float(rng.uniform(-0.1, 0.3)), _height(rng), rng)
    return replace(without_paint(scene, side), kerbs=(*scene.kerbs, stone))


def kerbs_for_lines(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """Kerbs of one make and one height where the lines of both sides should be: no roll tells of them."""
    if not all(straight_without_kerb(scene, side) for side in (-1, 1)):
        return None
    stone = _stone(0.0, _height(rng), rng)
    kerbs = tuple(replace(stone, face_m=border(scene, side)) for side in (-1, 1))
    bare = without_paint(without_paint(scene, -1), 1)
    return replace(bare, kerbs=kerbs)


def low_shoulder(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """The edge of the asphalt beyond the line of one side, and a verge 3 to 12 cm lower."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    edge = outermost(scene, side) + side * float(rng.uniform(0.10, 0.5))
    drop = float(rng.uniform(0.03, 0.12))
    step = RoadStep(edge, -drop, float(rng.uniform(70, 140)), float(rng.uniform(4, 14)))
    return replace(scene, steps=(*scene.steps, step))


def edge_drop(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """New asphalt on the own lane ends right beside the line of one side, 3 to 9 cm above it, or below it."""
    side = side_of_choice(rng)
    if not straight_without_kerb(scene, side):
        return None
    line = scene.paints[own_line(scene, side)].line
    edge = line.offset_m - side * (line.width_m / 2 + float(rng.uniform(0.03, 0.35)))
    # A lane is laid on an old road more often than milled off it.
    up = 1 if rng.random() < 0.25 else -1
    height, face = up * float(rng.uniform(0.03, 0.09)), float(rng.uniform(40, 80))
    old = scene.asphalt_grey + float(rng.uniform(-15, 30))
    step = RoadStep(edge, height, old, scene.texture_amplitude, face)
    return replace(scene, steps=(*scene.steps, step))


def train_rails(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """No paint but two rails 10 to 19 cm high, on ballast with sleepers or beside each other on asphalt."""
    if not all(straight_without_kerb(scene, side) for side in (-1, 1)):
        return None
    middle = sum(scene.lane_m) / 2
    height, top, face = (float(rng.uniform(*range_)) for range_ in ((0.10, 0.19), (150, 220), (35, 80)))
    rails = tuple(Ridge(middle + at * TRACK_M / 2, height, RAIL_HEAD_M, top, face) for at in (-1, 1))
    bare = replace(scene, paints=(), arrows=(), ridges=rails)
    if rng.random() < 0.3:
        return bare
    half = float(rng.uniform(1.6, 2.2))
    bed = Band(middle - half, middle + half, float(rng.uniform(85, 125)), float(rng.uniform(8, 18)))
    gap = SLEEPER_EVERY_M - SLEEPER_WIDTH_M
    grey = bed.grey + float(rng.uniform(-30, 45))
    sleepers = LaneLine(middle, SLEEPER_M, SLEEPER_WIDTH_M, gap, float(rng.uniform(0, SLEEPER_EVERY_M)), grey)
    return replace(bare, bands=(*scene.bands, bed), paints=(Paint(sleepers),))
