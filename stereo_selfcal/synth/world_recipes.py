"""The ingredients of worlds: each changes a scene, and says what a calibrator should make of it.

A recipe takes the scene so far and a generator, and returns the scene with its ingredient; None where
the ingredient does not fit into it (no kerb in a bend, say).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from .ingredients import (
    Arrow,
    Band,
    Car,
    Glare,
    GuardRail,
    Kerb,
    Paint,
    Shadow,
    Wall,
    WorldScene,
)
from .world import LaneLine

Expected = Literal["accept", "either", "refuse"]
Rng = np.random.Generator
Change = Callable[[WorldScene, Rng], WorldScene | None]

# A strip without end, as far as anybody sees.
ENDLESS_M = 1e4
RAIL_GAUGE_M = 1.435  # standard gauge of tramways


@dataclass(frozen=True, slots=True)
class Ingredient:
    """Something that may be in a world.

    Attributes:
        name: Its name, as tables show it.
        expected: "accept": a calibration is expected all the same; "either": one is welcome if right;
            "refuse": none is expected, a wrong one is the fault to be avoided.
        change: Puts it into a scene.
        weight: How often it is drawn, against the others of its kind.
    """

    name: str
    expected: Expected
    change: Change
    weight: float = 1.0


def _side(rng: Rng) -> int:
    return 1 if rng.random() < 0.5 else -1


def _own(scene: WorldScene, side: int) -> int:
    """Return the index of the own lane's line on one side (1 left, -1 right)."""
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    return min(range(len(scene.paints)), key=lambda i: abs(scene.paints[i].line.offset_m - border))


def _outermost(scene: WorldScene, side: int) -> float:
    """Return the outer edge of the paint on one side [m]."""
    edges = [side * paint.line.offset_m + paint.line.width_m / 2 for paint in scene.paints]
    return side * max(edges)


def _strip(edge_m: float, side: int, width_m: float = ENDLESS_M) -> tuple[float, float]:
    return (edge_m, edge_m + width_m) if side > 0 else (edge_m - width_m, edge_m)


def _with_own(scene: WorldScene, side: int, paint: Paint | None) -> WorldScene:
    index = _own(scene, side)
    rest = (*scene.paints[:index], *scene.paints[index + 1 :])
    return replace(scene, paints=rest if paint is None else (*rest, paint))


def _without(scene: WorldScene, side: int) -> WorldScene:
    """Return the scene without the paint on one side of the rig, tram rails apart."""
    kept = tuple(p for p in scene.paints if (p.line.offset_m - scene.lateral_offset_m) * side < 0)
    return replace(scene, paints=kept)


def _straight_without_kerb(scene: WorldScene, side: int) -> bool:
    return scene.shape.curvature_per_m == 0 and not any(kerb.face_m * side > 0 for kerb in scene.kerbs)


# --- paint ---


def double_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A second line beside one of the own lane's, a line's width apart; the outer may be dashed."""
    side = _side(rng)
    old = scene.paints[_own(scene, side)].line
    apart_m = old.width_m + float(rng.uniform(0.10, 0.18))
    return replace(scene, paints=(*scene.paints, Paint(LaneLine(old.offset_m + side * apart_m, old.width_m))))


def worn_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """15 to 40 % of all paint gone in patches, the rest paler."""
    share, pale = float(rng.uniform(0.15, 0.4)), float(rng.uniform(150, 200))
    return replace(scene, paints=tuple(Paint(replace(p.line, grey=pale), share) for p in scene.paints))


def ruined_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """60 to 85 % of one of the own lane's lines gone, the rest hardly brighter than asphalt."""
    side = _side(rng)
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
    """All lines on one side of the rig missing."""
    return _without(scene, _side(rng))


def no_paint(scene: WorldScene, rng: Rng) -> WorldScene:
    """Asphalt between two grass verges, without paint."""
    del rng
    right, left = scene.lane_m
    verges = (Band(*_strip(left + 0.1, 1)), Band(*_strip(right - 0.1, -1)))
    return replace(scene, paints=(), bands=(*scene.bands, *verges))


def shadow_for_line(scene: WorldScene, rng: Rng) -> WorldScene:
    """No paint on one side: there, sun between two hard shadows looks like a stripe, not quite parallel."""
    side = _side(rng)
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    edge = border + float(rng.uniform(-0.3, 0.3))
    sun_m, light = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.35, 0.6))
    strips = (_strip(edge + side * sun_m / 2, side, 1.5), _strip(edge - side * sun_m / 2, -side, 1.5))
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


def _grade(begin_m: tuple[float, float], change: tuple[float, float]) -> Change:
    def grade(scene: WorldScene, rng: Rng) -> WorldScene:
        size = float(rng.uniform(*change)) * _side(rng)
        length_m = float(rng.uniform(10, 30))
        shape = replace(
            scene.shape,
            grade_change=size,
            grade_begins_m=float(rng.uniform(*begin_m)),
            grade_length_m=length_m,
        )
        return replace(scene, shape=shape)

    return grade


def _bend(radius_m: tuple[float, float]) -> Change:
    def bend(scene: WorldScene, rng: Rng) -> WorldScene:
        curvature = _side(rng) / float(rng.uniform(*radius_m))
        return replace(scene, shape=replace(scene.shape, curvature_per_m=curvature))

    return bend


# --- beside the road ---


def grass(scene: WorldScene, rng: Rng) -> WorldScene:
    """Grass beyond the outermost line of one side."""
    side = _side(rng)
    edge = _outermost(scene, side) + side * float(rng.uniform(0.1, 1.0))
    verge = Band(*_strip(edge, side), float(rng.uniform(80, 125)), float(rng.uniform(8, 18)))
    return replace(scene, bands=(*scene.bands, verge))


def bright_verge(scene: WorldScene, rng: Rng) -> WorldScene:
    """Concrete or dry gravel directly beside a line: only the inner edge of the line stands out."""
    side = _side(rng)
    edge = _outermost(scene, side) - side * 0.02
    verge = Band(*_strip(edge, side), float(rng.uniform(170, 205)), float(rng.uniform(2, 8)))
    return replace(scene, bands=(*scene.bands, verge))


def kerb(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb 8 cm high beyond the line of one side."""
    side = _side(rng)
    if not _straight_without_kerb(scene, side):
        return None
    face = _outermost(scene, side) + side * float(rng.uniform(0.15, 0.6))
    return replace(scene, kerbs=(*scene.kerbs, _kerb(face, rng)))


def kerb_for_line(scene: WorldScene, rng: Rng) -> WorldScene | None:
    """A bright kerb where the line of one side should be."""
    side = _side(rng)
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
    side = _side(rng)
    if scene.pose.height_m < 0.9:
        return None
    at = _outermost(scene, side) + side * float(rng.uniform(0.5, 1.5))
    return replace(scene, rails=(*scene.rails, GuardRail(at, grey=float(rng.uniform(140, 190)))))


def foliage(scene: WorldScene, rng: Rng) -> WorldScene:
    """Trees ahead, and along a straight road a hedge on one side: clutter above the horizon."""
    walls = [Wall(float(rng.uniform(130, 250)), False, float(rng.uniform(4, 10)))]
    if scene.shape.curvature_per_m == 0 and not scene.kerbs:
        side = _side(rng)
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
    side = _side(rng)
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    first = float(rng.uniform(9, 16))
    cars = tuple(
        Car(first + 6.5 * i, border + side * float(rng.uniform(0.3, 0.7)), grey=_car_grey(rng))
        for i in range(int(rng.integers(1, 5)))
    )
    return replace(scene, cars=(*scene.cars, *cars))


def _car_grey(rng: Rng) -> float:
    return float(rng.choice([40.0, 90.0, 140.0, 200.0]))


# --- light ---


def shadows_across(scene: WorldScene, rng: Rng) -> WorldScene:
    """Shadows of poles and trees across the road, hard or soft, straight across or oblique."""
    soft_m = float(rng.choice([0.02, 0.3, 1.0]))
    begin, shadows = float(rng.uniform(4, 9)), []
    for _ in range(int(rng.integers(1, 5))):
        end = begin + float(rng.uniform(0.3, 5))
        skew = float(rng.uniform(-1.0, 1.0))
        shadows.append(Shadow("across", begin, end, float(rng.uniform(0.35, 0.7)), soft_m, skew))
        begin = end + float(rng.uniform(1, 10))
    return replace(scene, shadows=(*scene.shadows, *shadows))


def shadow_along(scene: WorldScene, rng: Rng) -> WorldScene:
    """The shadow of a wall or a hedge over one side of the road; its edge lies in the own lane or beside."""
    side = _side(rng)
    edge = sum(scene.lane_m) / 2 + side * float(rng.uniform(-0.5, 2.5))
    soft_m = float(rng.choice([0.03, 0.2, 0.8]))
    shadow = Shadow("along", *_strip(edge, side), float(rng.uniform(0.35, 0.7)), soft_m)
    return replace(scene, shadows=(*scene.shadows, shadow))


def dappled(scene: WorldScene, rng: Rng) -> WorldScene:
    """Sun through leaves."""
    return replace(scene, shadows=(*scene.shadows, Shadow("dappled", light=float(rng.uniform(0.5, 0.75)))))


def glare(scene: WorldScene, rng: Rng) -> WorldScene:
    """A saturated patch on the road towards the sun, of its own place and size in each camera."""
    rig = scene.rig
    u, v = rig.width * float(rng.uniform(0.3, 0.7)), rig.height * float(rng.uniform(0.55, 0.85))
    wide, high = rig.height * rng.uniform(0.05, 0.15), rig.height * rng.uniform(0.05, 0.2)

    def patch() -> Glare:
        factor = rng.uniform(0.8, 1.25, size=3)
        shift = rng.uniform(-0.02, 0.02, size=2) * rig.height
        return Glare(
            u + float(shift[0]),
            v + float(shift[1]),
            float(wide * factor[0]),
            float(high * factor[1]),
            220.0 * float(factor[2]),
        )

    return replace(scene, left=replace(scene.left, glare=patch()), right=replace(scene.right, glare=patch()))


# --- cameras ---


def _photometry(scene: WorldScene, left: dict[str, float], right: dict[str, float]) -> WorldScene:
    return replace(
        scene,
        left=replace(scene.left, photometry=replace(scene.left.photometry, **left)),
        right=replace(scene.right, photometry=replace(scene.right.photometry, **right)),
    )


def exposures_differ(scene: WorldScene, rng: Rng) -> WorldScene:
    """One camera 15 to 40 % darker, another black level."""
    gain, offset = float(rng.uniform(0.6, 0.85)), float(rng.uniform(0, 12))
    return _photometry(scene, {}, {"gain": gain, "offset": offset})


def over_exposed(scene: WorldScene, rng: Rng) -> WorldScene:
    """Asphalt and paint both white."""
    gain = float(rng.uniform(3.0, 5.0))
    return _photometry(scene, {"gain": gain}, {"gain": gain})


def under_exposed(scene: WorldScene, rng: Rng) -> WorldScene:
    """Paint a few grey levels above black."""
    gain = float(rng.uniform(0.015, 0.04))
    return _photometry(scene, {"gain": gain}, {"gain": gain})


def blurred(scene: WorldScene, rng: Rng) -> WorldScene:
    """Out of focus: 5 to 9 px."""
    sigma = float(rng.uniform(5, 9)) * scene.rig.height / 480
    return _photometry(scene, {"psf_sigma_px": sigma}, {"psf_sigma_px": sigma})


def soft_focus(scene: WorldScene, rng: Rng) -> WorldScene:
    """Hardly out of focus: 0.8 to 1.5 px, not the same in both."""
    left, right = rng.uniform(0.8, 1.5, size=2)
    return _photometry(scene, {"psf_sigma_px": float(left)}, {"psf_sigma_px": float(right)})


def misaligned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right picture 1 to 4 px too low or too high."""
    lower_px = _side(rng) * float(rng.choice([1.0, 1.0, 2.0, 4.0]))
    return replace(scene, right=replace(scene.right, lower_px=lower_px))


def turned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right camera turned about its own axis by 0.3 to 1.5 deg."""
    turned_rad = _side(rng) * math.radians(float(rng.uniform(0.3, 1.5)))
    return replace(scene, right=replace(scene.right, turned_rad=turned_rad))


def swapped(scene: WorldScene, rng: Rng) -> WorldScene:
    """The pictures of the cameras exchanged."""
    del rng
    return replace(scene, swapped=True)


GOOD: tuple[Ingredient, ...] = tuple(
    Ingredient(change.__name__, "accept", change)
    for change in (
        double_line,
        worn_paint,
        arrows,
        crown,
        grass,
        bright_verge,
        kerb,
        guard_rail,
        foliage,
        car_ahead,
        shadows_across,
        shadow_along,
        dappled,
        exposures_differ,
        soft_focus,
    )
) + (
    Ingredient("far_grade", "accept", _grade((45.0, 80.0), (0.005, 0.03))),
    Ingredient("slight_bend", "accept", _bend((2500.0, 8000.0))),
)

UNSURE: tuple[Ingredient, ...] = (
    *(
        Ingredient(change.__name__, "either", change)
        for change in (ruined_paint, tram_rails, crown_in_lane, parked_cars, glare)
    ),
    Ingredient("bend", "either", _bend((80.0, 1000.0)), weight=2.0),
    Ingredient("grade", "either", _grade((20.0, 45.0), (0.005, 0.03))),
)

BAD: tuple[Ingredient, ...] = (
    *(
        Ingredient(change.__name__, "refuse", change)
        for change in (
            missing_line,
            no_paint,
            shadow_for_line,
            kerb_for_line,
            opposite_lane_only,
            over_exposed,
            under_exposed,
            blurred,
            misaligned,
            turned,
            swapped,
        )
    ),
    Ingredient("near_grade", "refuse", _grade((6.0, 15.0), (0.01, 0.03))),
)

INGREDIENTS: dict[str, Ingredient] = {item.name: item for item in (*GOOD, *UNSURE, *BAD)}
