"""Ingredients of the road: paint, its shape, and what stands beside and on it.

A recipe takes the scene so far and a generator, and returns the scene with its ingredient; None where
the ingredient does not fit into it (no kerb in a bend, say).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .ingredients import Arrow, Band, Car, GuardRail, Kerb, Paint, Shadow, Wall, WorldScene
from .world import LaneLine

Rng = np.random.Generator
Change = Callable[[WorldScene, Rng], WorldScene | None]

# A strip without end, as far as anybody sees.
ENDLESS_M = 1e4
RAIL_GAUGE_M = 1.435  # standard gauge of tramways


def side_of_choice(rng: Rng) -> int:
    """Return 1 (left) or -1 (right)."""
    return 1 if rng.random() < 0.5 else -1


def _own(scene: WorldScene, side: int) -> int:
    """Return the index of the own lane's line on one side (1 left, -1 right)."""
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    return min(range(len(scene.paints)), key=lambda i: abs(scene.paints[i].line.offset_m - border))


def _outermost(scene: WorldScene, side: int) -> float:
    """Return the outer edge of the paint on one side [m]."""
    edges = [side * paint.line.offset_m + paint.line.width_m / 2 for paint in scene.paints]
    return side * max(edges)


def strip(edge_m: float, side: int, width_m: float = ENDLESS_M) -> tuple[float, float]:
    """Return the right and the left border of a strip that begins at an edge and goes to one side [m]."""
    return (edge_m, edge_m + width_m) if side > 0 else (edge_m - width_m, edge_m)


def _with_own(scene: WorldScene, side: int, paint: Paint | None) -> WorldScene:
    index = _own(scene, side)
    others = (*scene.paints[:index], *scene.paints[index + 1 :])
    return replace(scene, paints=others if paint is None else (*others, paint))


def _without(scene: WorldScene, side: int) -> WorldScene:
    """Return the scene without the paint on one side of the rig, tram rails apart."""
    kept = tuple(p for p in scene.paints if (p.line.offset_m - scene.lateral_offset_m) * side < 0)
    return replace(scene, paints=kept)


def _straight_without_kerb(scene: WorldScene, side: int) -> bool:
    return scene.shape.curvature_per_m == 0 and not any(kerb.face_m * side > 0 for kerb in scene.kerbs)


# --- paint ---


def double_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A second line beside one of the own lane's, a line's width apart; the outer may be dashed."""
    side = side_of_choice(rng)
    old = scene.paints[_own(scene, side)].line
    apart_m = old.width_m + float(rng.uniform(0.10, 0.18))
    return replace(scene, paints=(*scene.paints, Paint(LaneLine(old.offset_m + side * apart_m, old.width_m))))


def worn_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """15 to 40 % of all paint is missing in patches, and the remaining paint is paler."""
    share, pale = float(rng.uniform(0.15, 0.4)), float(rng.uniform(150, 200))
    return replace(scene, paints=tuple(Paint(replace(p.line, grey=pale), share) for p in scene.paints))


def ruined_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """60 to 85 % of a line of the own lane is missing; its remainder is little brighter than the road."""
    side = side_of_choice(rng)
    line = scene.paints[_own(scene, side)].line
    grey = scene.asphalt_grey + float(rng.uniform(20, 45))
    return _with_own(scene, side, Paint(replace(line, grey=grey), float(rng.uniform(0.6, 0.85))))


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
    return _without(scene, side_of_choice(rng))


def no_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """A road surface without paint between two grass verges."""
    del rng
    right, left = scene.lane_m
    verges = (Band(*strip(left + 0.1, 1)), Band(*strip(right - 0.1, -1)))
    return replace(scene, paints=(), bands=(*scene.bands, *verges))


def shadow_for_line(scene: WorldScene, rng: Rng) -> WorldScene:
    """No paint on one side: there, sun between two hard shadows looks like a stripe, not quite parallel."""
    side = side_of_choice(rng)
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    edge = border + float(rng.uniform(-0.3, 0.3))
    sun_m, light = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.35, 0.6))
    strips = (strip(edge + side * sun_m / 2, side, 1.5), strip(edge - side * sun_m / 2, -side, 1.5))
    shadows = tuple(Shadow("along", *strip, light, 0.03) for strip in strips)
    return replace(_without(scene, side), shadows=(*scene.shadows, *shadows))


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
    bare = _without(scene, -1)
    right, left = scene.lane_m
    far = Paint(LaneLine(left + (left - right), 0.12))
    if _outermost(scene, 1) > far.line.offset_m - 0.3:
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


# --- beside the road ---


def grass(scene: WorldScene, rng: Rng) -> WorldScene:
    """Grass beyond the outermost line of one side."""
    side = side_of_choice(rng)
    edge = _outermost(scene, side) + side * float(rng.uniform(0.1, 1.0))
    verge = Band(*strip(edge, side), float(rng.uniform(80, 125)), float(rng.uniform(8, 18)))
    return replace(scene, bands=(*scene.bands, verge))


def bright_verge(scene: WorldScene, rng: Rng) -> WorldScene:
    """Concrete or dry gravel directly beside a line: only the inner edge of the line stands out."""
    side = side_of_choice(rng)
    edge = _outermost(scene, side) - side * 0.02
    verge = Band(*strip(edge, side), float(rng.uniform(170, 205)), float(rng.uniform(2, 8)))
    return replace(scene, bands=(*scene.bands, verge))


def kerb(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb 8 cm high beyond the line of one side."""
    side = side_of_choice(rng)
    if not _straight_without_kerb(scene, side):
        return None
    face = _outermost(scene, side) + side * float(rng.uniform(0.15, 0.6))
    return replace(scene, kerbs=(*scene.kerbs, _kerb(face, rng)))


def kerb_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb where the line of one side should be."""
    side = side_of_choice(rng)
    if not _straight_without_kerb(scene, side):
        return None
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    return replace(_without(scene, side), kerbs=(*scene.kerbs, _kerb(border, rng)))


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
    at = _outermost(scene, side) + side * float(rng.uniform(0.5, 1.5))
    return replace(scene, rails=(*scene.rails, GuardRail(at, grey=float(rng.uniform(140, 190)))))


def foliage(scene: WorldScene, rng: Rng) -> WorldScene:
    """Trees ahead, and along a straight road a hedge on one side: clutter above the horizon."""
    walls = [Wall(float(rng.uniform(130, 250)), False, float(rng.uniform(4, 10)))]
    if scene.shape.curvature_per_m == 0 and not scene.kerbs:
        side = side_of_choice(rng)
        at = side * float(rng.uniform(7, 12))
        if side * at > side * _outermost(scene, side) + 1.5:
            walls.append(Wall(at, True, float(rng.uniform(1.5, 8)), 0.6, float(rng.uniform(60, 100))))
    return replace(scene, walls=(*scene.walls, *walls))


def car_ahead(scene: WorldScene, rng: Rng) -> WorldScene:
    """A car in the own lane, 15 to 35 m ahead."""
    at = sum(scene.lane_m) / 2 + float(rng.uniform(-0.3, 0.3))
    return replace(scene, cars=(*scene.cars, Car(float(rng.uniform(15, 35)), at, grey=_car_grey(rng))))


def parked_cars(scene: WorldScene, rng: Rng) -> WorldScene:
    """A row of cars parked on the own lane's line of one side, which hides much of it."""
    side = side_of_choice(rng)
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    first = float(rng.uniform(9, 16))
    cars = tuple(
        Car(first + 6.5 * i, border + side * float(rng.uniform(0.3, 0.7)), grey=_car_grey(rng))
        for i in range(int(rng.integers(1, 5)))
    )
    return replace(scene, cars=(*scene.cars, *cars))


def _car_grey(rng: Rng) -> float:
    return float(rng.choice([40.0, 90.0, 140.0, 200.0]))
