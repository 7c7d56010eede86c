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

"""Streets along roads: what stands beside them, what drives on them, and how much of it is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..second_worlds import objects
from ..second_worlds.cameras import Array
from ..second_worlds.drafts import asphalt
from ..second_worlds.mesh import Look, Material, Mesh, MeshBuilder
from ..second_worlds.roads import Alignment
from ..second_worlds.scenes import Light, Stripe, Surface
from .ways import Way

SEEN_M = (-3.0, 65.0)  # of what stands beside the road, behind and before the camera
_LEAST_SIZE = 0.04  # of what is drawn, for each metre of distance: ten pixels or so
_GROUND_M = 140.0  # of the road itself
_LANE_M = 3.5
_HILLS_M = 4000.0
_DETAIL_EVERY = 4  # one parked car out of so many has wheels and lamps


class Surroundings(Enum):
    """What a street runs through."""

    TOWN = "town"  # houses, parked cars, poles
    SUBURB = "suburb"  # trees, hedges, some houses
    COUNTRY = "country"  # grass, a few masts and trees far apart
    BARE = "bare"  # nothing but a road of little texture and hills


class Hour(Enum):
    """The light."""

    DAY = "day"
    NIGHT = "night"  # street lamps, and a sensor full of noise


@dataclass(frozen=True, eq=False)
class Street:
    """All that stands still, and the light on it.

    Attributes:
        way: The road.
        mesh: All polygons.
        along_m: Where each is along the road, shape (n,); NaN: it is seen from everywhere.
        surface: The asphalt.
        stripes: What is painted on it.
        light: The light.
    """

    way: Way
    mesh: Mesh
    along_m: Array
    surface: Surface
    stripes: tuple[Stripe, ...]
    light: Light

    @cached_property
    def size_m(self) -> Array:
        """Greatest side of the box about each polygon, shape (n,)."""
        corners = self.mesh.corners_m
        size: Array = (corners.max(axis=1) - corners.min(axis=1)).max(axis=1)
        return size

    def seen_from(self, s_m: float) -> Mesh:
        """Return what can be seen from a place along the road."""
        with np.errstate(invalid="ignore"):
            reach = np.where(self.mesh.material <= Material.GROUND, _GROUND_M, SEEN_M[1])
            near = (self.along_m > s_m + SEEN_M[0] - 4.0) & (self.along_m < s_m + reach)
            near &= self.size_m > _LEAST_SIZE * (self.along_m - s_m)
        return part_of(self.mesh, near | np.isnan(self.along_m))


def part_of(mesh: Mesh, chosen: npt.NDArray[np.bool_]) -> Mesh:
    """Return some polygons of a mesh."""
    return Mesh(*(getattr(mesh, each.name)[chosen] for each in fields(mesh)))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one, whose surfaces stay apart."""
    parts, groups = [], 0
    for mesh in meshes:
        if len(mesh.group):
            parts.append(replace(mesh, group=mesh.group + np.int32(groups)))
            groups += int(mesh.group.max()) + 1
    return Mesh(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Mesh)))


@dataclass(frozen=True, eq=False)
class OtherCar:
    """A car in a lane.

    Attributes:
        shape: Its polygons about the origin; it has no texture, as textures stand still in the world.
        start_m: Where it is along the road at first.
        speed_mps: How fast it goes, < 0: it comes towards the camera.
        across_m: Its lane.
    """

    shape: Mesh
    start_m: float
    speed_mps: float
    across_m: float

    def at(self, way: Way, along_m: float) -> Mesh:
        """Return it somewhere along a road."""
        heading = float(way.at(way.heading_rad, along_m))
        cos, sin = math.cos(heading), math.sin(heading)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        place = way.world(np.array(along_m), self.across_m, 0.0)
        return replace(self.shape, corners_m=self.shape.corners_m @ turn.T + place)


def other_car(start_m: float, speed_mps: float, across_m: float, rng: np.random.Generator) -> OtherCar:
    """Return any car, one in eight of them a lorry."""
    builder = MeshBuilder()
    straight = Alignment(0.0, (), _LANE_M, ((-2.0, 0.0), (2.0, 0.0)))
    objects.car(builder, straight, 0.0, 0.0, rng, truck=bool(rng.random() < 0.125))
    mesh = builder.build()
    return OtherCar(replace(mesh, texture=0.0 * mesh.texture), start_m, speed_mps, across_m)


def street(
    way: Way, surroundings: Surroundings, hour: Hour, length_m: float, rng: np.random.Generator
) -> Street:
    """Return a street.

    Args:
        way: Its road.
        surroundings: What it runs through.
        hour: The light.
        length_m: How far the car comes.
        rng: Source of everything.
    """
    builder = MeshBuilder()
    end_m = length_m + _GROUND_M
    _ground(builder, way, surroundings, end_m, rng)
    for side in (-1.0, 1.0):
        _beside(builder, way, surroundings, side, end_m, rng)
    near = builder.build()
    far = MeshBuilder()
    _hills(far, way, rng)
    middle = near.corners_m.mean(axis=1).astype(np.float32)
    along, _, _, _ = way.lane(middle[:, 0], middle[:, 1])
    hills = far.build()
    strength = float(rng.uniform(0.05, 0.15) if surroundings is Surroundings.BARE else rng.uniform(0.25, 0.9))
    surface = asphalt(rng, strength)
    return Street(
        way,
        joined([near, hills]),
        np.concatenate([along.astype(np.float64), np.full(len(hills.group), np.nan)]),
        surface,
        _lines(surface, end_m, rng),
        _light(hour, rng),
    )


def _ground(
    builder: MeshBuilder, way: Way, surroundings: Surroundings, end_m: float, rng: np.random.Generator
) -> None:
    """Add carriageway, verges and what is behind them."""
    grass = Look(Material.GROUND, float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.15, 0.4)), 0.012, 0.2)
    if surroundings is Surroundings.BARE:
        grass = replace(grass, texture=0.05)
    paved = Look(Material.GROUND, float(rng.uniform(0.2, 0.4)), float(rng.uniform(0.05, 0.2)), 0.01)
    verge = paved if surroundings is Surroundings.TOWN else grass
    bend = float(np.abs(way.curvature_per_m).max())
    wide = min(40.0, 0.8 / max(bend, 1e-9))
    road = Look(Material.ROAD, 1.0)
    cuts = way.cuts(-12.0, end_m)
    if not way.curvature_per_m.any() and not way.gradient.any():
        cuts = cuts[::4]
    edges = (
        (-wide, verge if wide < 6 else grass),
        (-6.0, verge),
        (-2.4, road),
        (0.0, road),
        (6.0, verge),
        (9.0, grass),
    )
    places = [place for place, _ in edges] + [max(wide, 10.0)]
    for (right, look), left in zip(edges, places[1:], strict=True):
        one, two = way.world(cuts, right, 0.0), way.world(cuts, left, 0.0)
        builder.add(np.stack([one[:-1], one[1:], two[1:], two[:-1]], axis=1), look)


def _beside(
    builder: MeshBuilder,
    way: Way,
    surroundings: Surroundings,
    side: float,
    end_m: float,
    rng: np.random.Generator,
) -> None:
    """Add what stands on one side."""
    edge = 6.0 if side > 0 else 2.4
    if surroundings is Surroundings.TOWN:
        objects.houses(builder, way, side * (edge + float(rng.uniform(3.5, 7.0))), rng, (-10.0, end_m))
        _posts(builder, way, side * (edge + 2.6), 30.0, end_m, rng)
        s = float(rng.uniform(0, 8))
        while s < end_m:
            if rng.random() < 0.4:
                standing = other_car(s, 0.0, side * (edge + 1.2), rng).at(way, s)
                _add_mesh(builder, standing, detailed=rng.random() < 1 / _DETAIL_EVERY)
            s += float(rng.uniform(5.5, 9.0))
    elif surroundings is Surroundings.SUBURB:
        reach = (-10.0, end_m)
        if rng.random() < 0.6:
            wall = side * (edge + float(rng.uniform(3.5, 8.0)))
            objects.ragged_wall(builder, way, wall, rng, reach, float(rng.uniform(1.5, 5)))
        else:
            objects.houses(builder, way, side * (edge + float(rng.uniform(5.0, 9.0))), rng, reach)
        _trees(builder, way, side, edge, (9.0, 30.0), end_m, rng)
        _posts(builder, way, side * (edge + 1.5), 40.0, end_m, rng)
    elif surroundings is Surroundings.COUNTRY:
        _trees(builder, way, side, edge + 2.0, (25.0, 90.0), end_m, rng)
        # German reflector posts stand every 50 m.
        for s in np.arange(float(rng.uniform(0, 50)), end_m, 50.0):
            objects.posts(builder, way, float(s), side * (edge + 0.5), 0.12, 1.0, objects.solid(0.75, 0.05))
    else:
        for s in np.arange(float(rng.uniform(0, 50)), end_m, 50.0):
            objects.posts(builder, way, float(s), side * (edge + 0.5), 0.12, 1.0, objects.solid(0.75, 0.05))


def _add_mesh(builder: MeshBuilder, mesh: Mesh, *, detailed: bool) -> None:
    count = len(mesh.group) if detailed else min(10, len(mesh.group))
    for index in range(count):
        look = Look(Material(int(mesh.material[index])), float(mesh.albedo[index]), 0.05, 0.01)
        builder.add(mesh.corners_m[index], look, thin=bool(mesh.thin[index]), separate=True)


def _posts(
    builder: MeshBuilder, way: Way, t_m: float, every_m: float, end_m: float, rng: np.random.Generator
) -> None:
    look = objects.solid(float(rng.uniform(0.1, 0.5)), 0.08)
    width, height = float(rng.uniform(0.1, 0.2)), float(rng.uniform(4, 8))
    for s in np.arange(float(rng.uniform(0, every_m)), end_m, every_m * float(rng.uniform(0.6, 1.2))):
        objects.posts(builder, way, float(s), t_m, width, height, look)


def _trees(
    builder: MeshBuilder,
    way: Way,
    side: float,
    edge_m: float,
    every_m: tuple[float, float],
    end_m: float,
    rng: np.random.Generator,
) -> None:
    s = float(rng.uniform(0, every_m[1]))
    while s < end_m:
        foot = way.world(np.array(s), side * (edge_m + float(rng.uniform(3.0, 7.0))), 0.0)
        objects.tree(builder, foot, rng)
        s += float(rng.uniform(*every_m))


def _hills(builder: MeshBuilder, way: Way, rng: np.random.Generator) -> None:
    """Add what is at the horizon, all around."""
    middle = way.middle_m.mean(axis=0)
    angle = np.linspace(0.0, 2 * np.pi, 181)
    top = _HILLS_M * np.clip(0.02 + 0.006 * np.cumsum(rng.normal(0, 0.25, len(angle))), 0.006, 0.06)
    flat = middle[:2] + _HILLS_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.concatenate([flat, np.full((len(angle), 1), middle[2] - 60.0)], axis=1)
    high = np.concatenate([flat, (middle[2] + top)[:, None]], axis=1)
    look = objects.solid(float(rng.uniform(0.1, 0.35)), 0.06, 3.0, 0.1)
    builder.add(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1), look)


def _lines(surface: Surface, end_m: float, rng: np.random.Generator) -> tuple[Stripe, ...]:
    """Return a dashed line on the left, a solid one on the right, and the far edge's; some lack."""
    white = min(0.85, surface.albedo * float(rng.uniform(2.0, 3.4)))
    solid = Stripe(-_LANE_M / 2, 0.12, white, start_m=-10.0, end_m=end_m, reflects=True)
    left = replace(solid, t_m=_LANE_M / 2, dash_m=4.0, gap_m=8.0)
    far = replace(solid, t_m=1.5 * _LANE_M)
    kept = rng.random(3) < (0.9, 0.85, 0.8)
    return tuple(line for line, keep in zip((left, solid, far), kept, strict=True) if keep)


def _light(hour: Hour, rng: np.random.Generator) -> Light:
    high, turn = rng.uniform(0.4, 1.2), rng.uniform(0, 2 * math.pi)
    sun = (math.cos(high) * math.cos(turn), math.cos(high) * math.sin(turn), math.sin(high))
    if hour is Hour.NIGHT:
        # Street lamps without shadows: an even light, and a dark sky.
        return Light(sun, 0.0, 0.25, (0.01, 0.04), 0.0, 300.0)
    direct = float(rng.choice([0.0, 0.35, 0.6]))
    sky = (float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.6, 1.0)))
    return Light(
        sun, direct / sun[2], 1 - direct, sky, float(rng.uniform(0, 0.15)), float(rng.uniform(400, 1500))
    )
