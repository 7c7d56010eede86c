"""Ingredients beside and on the road: strips, kerbs, rails, foliage, cars."""

from __future__ import annotations

from dataclasses import replace

from .ingredients import Band, Car, GuardRail, Kerb, Wall, WorldScene
from .recipe_tools import Rng, outermost, side_of_choice, straight_without_kerb, strip, without_paint


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
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    return replace(without_paint(scene, side), kerbs=(*scene.kerbs, _kerb(border, rng)))


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
    border = scene.lane_m[1] if side > 0 else scene.lane_m[0]
    first = float(rng.uniform(9, 16))
    cars = tuple(
        Car(first + 6.5 * i, border + side * float(rng.uniform(0.3, 0.7)), grey=_car_grey(rng))
        for i in range(int(rng.integers(1, 5)))
    )
    return replace(scene, cars=(*scene.cars, *cars))


def _car_grey(rng: Rng) -> float:
    return float(rng.choice([40.0, 90.0, 140.0, 200.0]))
