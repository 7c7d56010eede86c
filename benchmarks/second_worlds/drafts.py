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

"""A world while it is drawn: an ordinary road, which its kind then changes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from stereo_selfcal import StereoRig

from . import objects
from .cameras import Mount, Turn
from .mesh import Look, Material, MeshBuilder
from .rigs import draw_rig
from .roads import Alignment, add_section
from .scenes import Light, Scene, Stripe, Surface
from .sensors import Sensor

SIDES = ("left", "right")
ROAD_LOOK = Look(Material.ROAD, 1.0, 0.0)
# A piece of the cross-section beyond the carriageway's edge: by how much it goes out and up, and its look.
Step = tuple[float, float, Look]


# How many roads fall to a side so that water runs off, and how much: guidelines ask for 1.5 to 2.5 %.
_FALLING, _FALL = 0.6, (0.005, 0.03)


def sign(side: str) -> float:
    """Return on which side of zero a side lies across the lane."""
    return 1.0 if side == "left" else -1.0


def ground(albedo: float, texture: float, texel_m: float, warmth: float = 0.0) -> Look:
    """Return the look of something that lies flat."""
    return Look(Material.GROUND, albedo, texture, texel_m, warmth)


@dataclass
class Draft:
    """A world that can still be changed. Places are across (t) and along (s) the own lane [m].

    Attributes:
        rng: Source of everything that is drawn.
        rig_name: Name of the rig.
        rig: The rig.
        mount: Where it is.
        lane_width_m: Width of the own lane.
        narrow_m: By how much the strip is narrower of which the plane is the truth.
        lines: The own lane's lines by side.
        others: Stripes of other lanes.
        seams: Stripes below the paint.
        edges_m: Edges of the carriageway by side, as distances from zero.
        sides: What follows beyond the edges.
        crown: Heights across the carriageway, from right to left.
        curvature_per_m: One over the radius.
        kinks: Changes of the slope.
        surface: The asphalt.
        builder: What stands.
        light: The light.
        wet: How wet it is.
        sensor: The sensor.
        turn: How the right camera is turned.
        tags: Words about it.
        fair: Whether a calibration must answer, if the lines and the shape allow it.
        view_m: How far the own lane is seen.
        near_m: From where on it is seen.
        scenery: Whether scenery may be put beside the road, by side.
        one_side: Whether the paint of one side is enough, as the asphalt shows the rest.
    """

    rng: np.random.Generator
    rig_name: str
    rig: StereoRig
    mount: Mount
    lane_width_m: float
    surface: Surface
    light: Light
    sensor: Sensor
    edges_m: dict[str, float]
    sides: dict[str, list[Step]]
    lines: dict[str, list[Stripe]] = field(default_factory=dict)
    others: list[Stripe] = field(default_factory=list)
    seams: list[Stripe] = field(default_factory=list)
    crown: list[tuple[float, float]] = field(default_factory=list)
    curvature_per_m: float = 0.0
    kinks: list[tuple[float, float]] = field(default_factory=list)
    builder: MeshBuilder = field(default_factory=MeshBuilder)
    wet: float = 0.0
    turn: Turn = field(default_factory=Turn)
    tags: set[str] = field(default_factory=set)
    fair: bool = True
    view_m: float = 60.0
    near_m: float = 0.3
    one_side: bool = False
    narrow_m: float = 0.0
    scenery: dict[str, bool] = field(default_factory=lambda: {"left": True, "right": True})

    @property
    def half_m(self) -> float:
        """Half the width of the own lane."""
        return self.lane_width_m / 2

    def alignment(self) -> Alignment:
        """Return the shape of the road."""
        ends = [(-self.edges_m["right"], 0.0), (self.edges_m["left"], 0.0)]
        crown = tuple(self.crown or ends)
        return Alignment(self.curvature_per_m, tuple(self.kinks), self.lane_width_m - self.narrow_m, crown)

    def at(self, t_m: float) -> Alignment:
        """Return the shape of the road for what stands on the carriageway at a place across it."""
        road = self.alignment()
        return replace(road, base_m=float(road.section_m(np.array(t_m))))

    def beside(self, side: str) -> Alignment:
        """Return the shape of the road for what stands beyond an edge of the carriageway."""
        return replace(self.alignment(), base_m=self.edge_height_m(side))

    def edge_height_m(self, side: str) -> float:
        """Return the height of the carriageway at its edge."""
        return float(self.alignment().section_m(np.array(sign(side) * self.edges_m[side])))

    def scene(self) -> Scene:
        """Return the finished world."""
        road = self.alignment()
        points = [(t, z) for t, z in road.crown if -self.edges_m["right"] < t < self.edges_m["left"]]
        ends = {side: (sign(side) * self.edges_m[side], self.edge_height_m(side)) for side in SIDES}
        chain = [ends["right"], *points, ends["left"]]
        add_section(self.builder, road, chain, [ROAD_LOOK] * (len(chain) - 1))
        for side in SIDES:
            outer = [ends[side]]
            looks = []
            for out, up, look in self.sides[side]:
                t, z = outer[-1]
                outer.append((t + sign(side) * out, z + up))
                looks.append(look)
            add_section(self.builder, road, outer, looks)
        stripes = [*self.seams, *self.others, *(line for side in SIDES for line in self.lines.get(side, []))]
        return Scene(
            self.rig,
            self.mount,
            self.turn,
            road,
            self.surface,
            tuple(stripes),
            self.builder.build(),
            self.light,
            self.wet,
            self.sensor,
        )


def paint(draft: Draft, t_m: float, **changes: float | bool) -> Stripe:
    """Return a white line of the width and grey this road has."""
    rng = draft.rng
    albedo = draft.surface.albedo * float(rng.uniform(2.0, 3.4))
    line = Stripe(t_m, float(rng.uniform(0.1, 0.2)), min(albedo, 0.85), reflects=True)
    # The fields have many types; a name that does not exist fails at once.
    return replace(line, **changes)  # type: ignore[arg-type]


def dashes(draft: Draft, line: Stripe) -> Stripe:
    """Return a line as dashes."""
    dash, gap = [(3.0, 6.0), (6.0, 12.0), (3.0, 3.0), (2.0, 4.0), (4.0, 8.0), (6.0, 6.0)][
        int(draft.rng.integers(6))
    ]
    return replace(line, dash_m=dash, gap_m=gap, phase_m=float(draft.rng.uniform(0, dash + gap)))


def asphalt(rng: np.random.Generator, strength: float) -> Surface:
    """Return asphalt of which the texture is so strong: 0 none, 1 strong."""
    return Surface(
        albedo=float(rng.uniform(0.12, 0.3)),
        grain=0.28 * strength * float(rng.uniform(0.5, 1.2)),
        grain_texel_m=float(rng.uniform(0.0025, 0.007)),
        cloud=0.13 * strength * float(rng.uniform(0.4, 1.2)),
        blotch=float(rng.uniform(0.0, 0.08)) * min(1.0, 0.3 + strength),
        cracks=0.0,
        tracks=float(rng.uniform(-0.08, 0.08)),
        origin_m=(float(rng.uniform(0, 90)), float(rng.uniform(0, 90))),
    )


def daylight(rng: np.random.Generator) -> Light:
    """Return the light of some hour and weather of a day."""
    high, turn = rng.uniform(0.35, 1.2), rng.uniform(0, 2 * math.pi)
    sun = (math.cos(high) * math.cos(turn), math.cos(high) * math.sin(turn), math.sin(high))
    direct = float(rng.choice([0.0, 0.35, 0.6, 0.75]))
    return Light(
        sun=sun,
        sun_strength=direct / sun[2],
        ambient=1 - direct,
        sky=(float(rng.uniform(0.5, 0.9)), float(rng.uniform(0.7, 1.2))),
        clouds=float(rng.uniform(0.0, 0.15)),
        haze_m=float(rng.uniform(400, 2500)),
    )


def verge(rng: np.random.Generator) -> list[Step]:
    """Return grass or gravel that lies flat beside the road."""
    if rng.random() < 0.3:
        first = ground(float(rng.uniform(0.25, 0.45)), 0.2, 0.008, 0.15)
        return [(float(rng.uniform(0.4, 1.5)), -0.03, first), (120.0, -1.0, _grass(rng))]
    return [(3.0, -0.05, _grass(rng)), (120.0, float(rng.uniform(-2.0, 3.0)), _grass(rng))]


def _grass(rng: np.random.Generator) -> Look:
    return ground(float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.15, 0.4)), 0.012, 0.25)


def kerb(
    rng: np.random.Generator, height_m: float, stone: float, face: float, wide_m: float | None = None
) -> list[Step]:
    """Return a kerb with a pavement behind it.

    Args:
        rng: Source of what is not given.
        height_m: Height of its face.
        stone: Grey of the top of its stone.
        face: Grey of its face.
        wide_m: Width of the stone.
    """
    width = wide_m or float(rng.uniform(0.12, 0.2))
    batter = float(rng.uniform(0.0, 0.02))
    pavement = ground(float(rng.uniform(0.2, 0.4)), float(rng.uniform(0.05, 0.2)), 0.01)
    return [
        (batter, height_m, Look(Material.SOLID, face, 0.06, 0.004)),
        (width, 0.0, ground(stone, 0.06, 0.004)),
        (float(rng.uniform(1.5, 3.5)), 0.03, pavement),
        (100.0, 0.5, _grass(rng)),
    ]


def ordinary(rng: np.random.Generator, strength: float | None = None) -> Draft:
    """Return an ordinary road with a solid line on either side.

    Args:
        rng: Source of everything.
        strength: How strong its texture is, None: any.
    """
    name, rig, mount = draw_rig(rng)
    surface = asphalt(rng, float(rng.uniform(0.05, 0.9)) if strength is None else strength)
    width = float(rng.uniform(2.9, 3.75))
    draft = Draft(
        rng=rng,
        rig_name=name,
        rig=rig,
        mount=mount,
        lane_width_m=width,
        surface=surface,
        light=daylight(rng),
        sensor=Sensor(),
        edges_m={},
        sides={side: verge(rng) for side in SIDES},
    )
    draft.sensor = everyday_sensor(draft)
    for side in SIDES:
        draft.lines[side] = [paint(draft, sign(side) * width / 2)]
    _neighbours(draft)
    if rng.random() < _FALLING:
        draft.crown = roof(draft, float(rng.uniform(*_FALL)), float(rng.choice([draft.half_m, 50.0, -50.0])))
    return draft


def roof(draft: Draft, fall: float, ridge_m: float) -> list[tuple[float, float]]:
    """Return a cross-section that falls to both sides of a ridge; the middle of the lane is at height 0."""
    ends = [-draft.edges_m["right"], draft.edges_m["left"]]
    places = sorted({*ends, *([ridge_m] if ends[0] < ridge_m < ends[1] else [])})
    return [(place, fall * (abs(ridge_m) - abs(place - ridge_m))) for place in places]


def _neighbours(draft: Draft) -> None:
    """Draw the lanes beside the own one, and where the carriageway ends."""
    rng = draft.rng
    for side in SIDES:
        lanes = int(rng.choice([0, 1, 2], p=[0.25, 0.6, 0.15])) if side == "left" else int(rng.random() < 0.2)
        place = draft.half_m
        for number in range(lanes):
            place += float(rng.uniform(2.9, 3.7))
            line = paint(draft, sign(side) * place)
            draft.others.append(line if number == lanes - 1 else dashes(draft, line))
        draft.edges_m[side] = place + float(rng.uniform(0.25, 1.6))


def everyday_sensor(draft: Draft) -> Sensor:
    """Return a sensor without a fault, exposed for this road."""
    rng = draft.rng
    grey = float(rng.uniform(55, 120))
    gamma = float(rng.choice([1.0, 1.0, 0.7, 0.55]))
    gain = 255 * (grey / 255) ** (1 / gamma) / draft.surface.albedo
    right = gain * float(rng.uniform(0.985, 1.015))
    return Sensor(
        gain=(gain, right),
        gamma=gamma,
        noise=float(rng.uniform(0.6, 2.0)),
        blur_px=float(rng.uniform(0.35, 0.6)),
        vignette=float(rng.uniform(0.0, 0.15)),
    )


def furnish(draft: Draft) -> None:
    """Put scenery beside the road where the kind has left room for it."""
    rng = draft.rng
    objects.hills(draft.builder, rng, float(rng.uniform(3, 40)))
    for side in SIDES:
        road = draft.beside(side)
        if not draft.scenery[side]:
            continue
        edge = draft.edges_m[side]
        out = sign(side)
        what = rng.choice(
            ["nothing", "wood", "trees", "houses", "masts", "rail"], p=[0.22, 0.22, 0.2, 0.12, 0.14, 0.1]
        )
        if what == "wood":
            start = float(rng.uniform(0, 30))
            reach = (start, start + float(rng.uniform(60, 200)))
            objects.ragged_wall(
                draft.builder, road, out * (edge + rng.uniform(2.5, 9)), rng, reach, float(rng.uniform(2, 9))
            )
        elif what == "trees":
            for s in np.cumsum(rng.uniform(5, 16, int(rng.integers(3, 9)))) + 4:
                foot = road.world(np.array(s), np.array(out * (edge + rng.uniform(2, 7))), np.array(0.0))
                objects.tree(draft.builder, foot, rng)
        elif what == "houses":
            objects.houses(
                draft.builder, road, out * (edge + rng.uniform(3, 9)), rng, (rng.uniform(2, 15), 110.0)
            )
        elif what == "masts":
            objects.masts(
                draft.builder, road, out * (edge + rng.uniform(0.8, 3)), float(rng.uniform(10, 40)), rng
            )
        elif what == "rail":
            objects.guard_rail(draft.builder, road, out * (edge + rng.uniform(0.5, 1.5)), rng)
