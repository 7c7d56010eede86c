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

"""Ingredients of the road: paint, and its shape."""

from __future__ import annotations

from dataclasses import replace

from .ingredients import Arrow, Band, Paint, Shadow, WorldScene
from .recipe_tools import (
    Change,
    Rng,
    border,
    outermost,
    own_line,
    side_of_choice,
    strip,
    with_own_line,
    without_paint,
)
from .world import LaneLine

RAIL_GAUGE_M = 1.435  # standard gauge of tramways

# --- paint ---


def double_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A second line beside one of the own lane's, a line's width apart; the outer may be dashed."""
    side = side_of_choice(rng)
    old = scene.paints[own_line(scene, side)].line
    apart_m = old.width_m + float(rng.uniform(0.10, 0.18))
    return replace(scene, paints=(*scene.paints, Paint(LaneLine(old.offset_m + side * apart_m, old.width_m))))


def worn_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """15 to 40 % of all paint is missing in patches, and the remaining paint is paler."""
    share, pale = float(rng.uniform(0.15, 0.4)), float(rng.uniform(150, 200))
    return replace(scene, paints=tuple(Paint(replace(p.line, grey=pale), share) for p in scene.paints))


def ruined_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """60 to 85 % of a line of the own lane is missing; its remainder is little brighter than the road."""
    side = side_of_choice(rng)
    line = scene.paints[own_line(scene, side)].line
    grey = scene.asphalt_grey + float(rng.uniform(20, 45))
    return with_own_line(scene, side, Paint(replace(line, grey=grey), float(rng.uniform(0.6, 0.85))))


def yellow_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """Yellow paint, as for American centre lines and European road works: in grey 35 to 75 above the road."""
    grey = scene.asphalt_grey + float(rng.uniform(35, 75))
    lines = (
        replace(paint, line=replace(paint.line, grey=grey)) if paint.line.grey > grey else paint
        for paint in scene.paints
    )
    return replace(scene, paints=tuple(lines))


def fine_texture(scene: WorldScene, rng: Rng) -> WorldScene:
    """Asphalt whose grains are seen as far as a camera resolves them."""
    return replace(scene, texture_amplitude=float(rng.uniform(2, 12)), fine_texture=True)


def no_line_textured(scene: WorldScene, rng: Rng) -> WorldScene:
    """No line at all, but asphalt with texture, mostly between grass verges."""
    scene = fine_texture(replace(scene, paints=(), arrows=()), rng)
    if rng.random() < 0.3:
        return scene
    verges = tuple(Band(*strip(border(scene, side) + side * 0.3, side)) for side in (-1, 1))
    return replace(scene, bands=(*scene.bands, *verges))


def one_line_textured(scene: WorldScene, rng: Rng) -> WorldScene:
    """Lines on one side only, on asphalt with texture."""
    return fine_texture(without_paint(scene, side_of_choice(rng)), rng)


def arrows(scene: WorldScene, rng: Rng) -> WorldScene:
    """Arrows in the middle of the own lane."""
    middle = sum(scene.lane_m) / 2 + float(rng.uniform(-0.2, 0.2))
    first = float(rng.uniform(4, 14))
    return replace(scene, arrows=(Arrow(first, middle), Arrow(first + float(rng.uniform(12, 20)), middle)))


def tram_rails(scene: WorldScene, rng: Rng) -> WorldScene:
    """Two tram rails flush with the road, bright head beside a dark groove, in the own lane or beside it."""
    middle = sum(scene.lane_m) / 2 + float(rng.choice([0.0, 0.0, 3.2])) + float(rng.uniform(-0.3, 0.3))
    lines = []
    for side in (-1, 1):
        at = middle + side * RAIL_GAUGE_M / 2
        lines.append(LaneLine(at + side * 0.03, 0.06, grey=float(rng.uniform(140, 190))))
        lines.append(LaneLine(at - side * 0.02, 0.04, grey=35.0))
    # Below the paint: a line is painted over rails, not under them.
    return replace(scene, paints=(*(Paint(line) for line in lines), *scene.paints))


def missing_line(scene: WorldScene, rng: Rng) -> WorldScene:
    """All lines on one side of the rig are missing."""
    return without_paint(scene, side_of_choice(rng))


def no_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """A road surface without paint between two grass verges."""
    del rng
    right, left = scene.lane_m
    verges = (Band(*strip(left + 0.1, 1)), Band(*strip(right - 0.1, -1)))
    return replace(scene, paints=(), bands=(*scene.bands, *verges))


def shadow_for_line(scene: WorldScene, rng: Rng) -> WorldScene:
    """No paint on one side: there, sun between two hard shadows looks like a stripe, not quite parallel."""
    side = side_of_choice(rng)
    edge = border(scene, side) + float(rng.uniform(-0.3, 0.3))
    sun_m, light = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.35, 0.6))
    strips = (strip(edge + side * sun_m / 2, side, 1.5), strip(edge - side * sun_m / 2, -side, 1.5))
    shadows = tuple(Shadow("along", *strip, light, 0.03) for strip in strips)
    return replace(without_paint(scene, side), shadows=(*scene.shadows, *shadows))


# --- shape of the road ---


def crown(scene: WorldScene, rng: Rng) -> WorldScene:
    """A crown where the lanes meet, at the left border of the own lane: 1.5 to 3 % to both sides."""
    fall_right, fall_left = rng.uniform(0.015, 0.03, size=2)
    shape = replace(
        scene.shape, crown_at_m=scene.lane_m[1], fall_right=float(fall_right), fall_left=float(fall_left)
    )
    return replace(scene, shape=shape)


def crown_in_lane(scene: WorldScene, rng: Rng) -> WorldScene:
    """A crown in the middle of the own lane, 1.5 to 3 % to both sides: the lane is no plane."""
    fall = float(rng.uniform(0.015, 0.03))
    shape = replace(scene.shape, crown_at_m=sum(scene.lane_m) / 2, fall_right=fall, fall_left=fall)
    return replace(scene, shape=shape)


def opposite_lane_only(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """The own lane's right line missing, both lines of the opposite lane there, which falls the other way."""
    bare = without_paint(scene, -1)
    right, left = scene.lane_m
    far = Paint(LaneLine(left + (left - right), 0.12))
    if outermost(scene, 1) > far.line.offset_m - 0.3:
        return None
    crowned = crown(bare, rng)
    return replace(crowned, paints=(*bare.paints, far))


def grade_ahead(begin_m: tuple[float, float], change: tuple[float, float]) -> Change:
    """Return the recipe of a crest or dip that begins within a range, by a change within a range."""

    def grade(scene: WorldScene, rng: Rng) -> WorldScene:
        size = float(rng.uniform(*change)) * side_of_choice(rng)
        length_m = float(rng.uniform(10, 30))
        shape = replace(
            scene.shape,
            grade_change=size,
            grade_begins_m=float(rng.uniform(*begin_m)),
            grade_length_m=length_m,
        )
        return replace(scene, shape=shape)

    return grade


def bend_of(radius_m: tuple[float, float]) -> Change:
    """Return the recipe of a bend to either side with a radius within a range."""

    def bend(scene: WorldScene, rng: Rng) -> WorldScene:
        curvature = side_of_choice(rng) / float(rng.uniform(*radius_m))
        return replace(scene, shape=replace(scene.shape, curvature_per_m=curvature))

    return bend
