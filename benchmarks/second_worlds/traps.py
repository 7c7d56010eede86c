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

"""Roads on which something that is no paint on the road looks like its lines."""

from __future__ import annotations

import math

import numpy as np

from . import objects
from .cameras import Turn
from .drafts import SIDES, Draft, ground, kerb, ordinary, sign, verge
from .kinds import Kind, textured
from .mesh import Look, Material
from .scenes import Stripe
from .weather import snow


def _trap(rng: np.random.Generator) -> Draft:
    """Return a road on bare or textured asphalt that nobody has to answer for."""
    draft = ordinary(rng, float(rng.choice([0.0, 0.05, rng.uniform(0.1, 1.2)])))
    draft.fair = False
    return draft


def _kerb_at(draft: Draft, side: str, height_m: float, face: float) -> None:
    """Put a bright kerb where the line of a side was."""
    rng = draft.rng
    draft.lines[side] = []
    draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
    draft.edges_m[side] = draft.half_m
    stone = min(draft.surface.albedo * float(rng.uniform(1.8, 3.2)), 0.85)
    draft.sides[side] = kerb(rng, height_m, stone, face)


def _face(draft: Draft) -> float:
    """Return the grey of a face: dark, as the road, or bright."""
    return draft.surface.albedo * float(draft.rng.choice([0.3, 0.6, 1.0, 1.6, 2.4]))


def kerb_for_line(rng: np.random.Generator) -> Draft:
    """A bright kerb instead of one line."""
    draft = _trap(rng)
    _kerb_at(draft, SIDES[int(rng.random() < 0.65)], float(rng.uniform(0.06, 0.2)), _face(draft))
    return draft


def kerb_both(rng: np.random.Generator) -> Draft:
    """Bright kerbs instead of both lines, of one height or of two."""
    draft = _trap(rng)
    height, face = float(rng.uniform(0.06, 0.2)), _face(draft)
    equal = rng.random() < 0.6
    for side in SIDES:
        _kerb_at(draft, side, height if equal else float(rng.uniform(0.06, 0.2)), face)
    return draft


def rail_for_line(rng: np.random.Generator) -> Draft:
    """A guard rail where a line would be."""
    draft = _trap(rng)
    for side in SIDES if rng.random() < 0.25 else (SIDES[int(rng.random() < 0.6)],):
        draft.lines[side] = []
        draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
        place = sign(side) * draft.half_m
        objects.guard_rail(draft.builder, draft.at(place), place, rng)
        draft.scenery[side] = False
    return draft


def train_rails(rng: np.random.Generator) -> Draft:
    """Rails that stand on the ground, and no lines."""
    draft = _trap(rng)
    draft.lines = {}
    draft.others = []
    draft.crown = []
    height = float(rng.uniform(0.04, 0.17))
    objects.train_rails(draft.builder, draft.alignment(), float(rng.uniform(-0.3, 0.3)), height, rng)
    return draft


def kerb_shadow(rng: np.random.Generator) -> Draft:
    """A kerb as grey as the road, with a dark shadow along it, instead of one line or both."""
    draft = _trap(rng)
    for side in SIDES if rng.random() < 0.4 else (SIDES[int(rng.random() < 0.65)],):
        _kerb_at(
            draft, side, float(rng.uniform(0.06, 0.2)), draft.surface.albedo * float(rng.uniform(0.4, 1.0))
        )
        grey = draft.surface.albedo * float(rng.uniform(0.8, 1.3))
        draft.sides[side] = kerb(rng, draft.sides[side][0][1], grey, grey * float(rng.uniform(0.3, 0.8)))
        width = float(rng.uniform(0.05, 0.35))
        place = sign(side) * (draft.half_m - width / 2)
        draft.seams.append(Stripe(place, width, draft.surface.albedo * float(rng.uniform(0.25, 0.6))))
    return draft


def kerb_curve(rng: np.random.Generator) -> Draft:
    """A bright kerb instead of a line, in a bend."""
    draft = kerb_for_line(rng)
    radius = math.exp(rng.uniform(math.log(60), math.log(400)))
    draft.curvature_per_m = float(rng.choice([-1, 1])) / radius
    draft.crown = []
    return draft


def wall_for_line(rng: np.random.Generator) -> Draft:
    """A low wall of concrete with a bright top, or a barrier, where a line would be."""
    draft = _trap(rng)
    for side in SIDES if rng.random() < 0.4 else (SIDES[int(rng.random() < 0.6)],):
        draft.lines[side] = []
        draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
        draft.edges_m[side] = draft.half_m
        height, width = float(rng.uniform(0.25, 0.9)), float(rng.uniform(0.15, 0.5))
        grey = draft.surface.albedo * float(rng.uniform(0.7, 1.5))
        top = ground(min(grey * float(rng.uniform(1.3, 2.5)), 0.85), 0.08, 0.006)
        face = Look(Material.SOLID, grey, 0.1, 0.005)
        draft.sides[side] = [(0.02, height, face), (width, 0.0, top), (0.02, -height, face), *verge(rng)]
    return draft


def rope_for_line(rng: np.random.Generator) -> Draft:
    """Ropes, cables or thin rails at both sides, between the road and the camera's height."""
    draft = _trap(rng)
    most = 0.85 * draft.mount.height_m
    height = float(rng.uniform(0.25, 0.8)) * most
    for side in SIDES if rng.random() < 0.7 else (SIDES[int(rng.random() < 0.6)],):
        draft.lines[side] = []
        draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
        draft.edges_m[side] = max(draft.edges_m[side], draft.half_m + 1.0)
        place = sign(side) * draft.half_m
        road, width = draft.at(place), float(rng.uniform(0.03, 0.12))
        look = objects.solid(min(draft.surface.albedo * float(rng.uniform(2, 3.2)), 0.85), 0.03)
        for z in (height, height * 0.5)[: int(rng.integers(1, 3))]:
            outline = [(place - width / 2, z), (place, z + width / 2), (place + width / 2, z)]
            objects.band(draft.builder, road, outline, look, (-3.0, 150.0), thin=True)
        for s in np.arange(float(rng.uniform(3, 8)), 70, float(rng.uniform(4, 12))):
            objects.posts(draft.builder, road, float(s), place, 0.08, height, objects.solid(0.2))
    return draft


def edge_drop(rng: np.random.Generator) -> Draft:
    """New asphalt in the lane or beside it: a line lies some centimetres below the lane, or above it."""
    draft = _trap(rng)
    draft.crown = []
    sides = SIDES if rng.random() < 0.3 else (SIDES[int(rng.random() < 0.7)],)
    step = float(rng.uniform(0.03, 0.09) * rng.choice([-1, 1], p=[0.7, 0.3]))
    gap = float(rng.uniform(0.03, 0.25))
    section = [(-draft.edges_m["right"], 0.0), (draft.edges_m["left"], 0.0)]
    for side in sides:
        line = draft.lines[side][0]
        edge = draft.half_m - line.width_m / 2 - gap
        out = sign(side)
        foot = [(out * edge, 0.0), (out * (edge + 0.01), step)]
        end = (out * draft.edges_m[side], step)
        _old_asphalt(draft, out * edge, out * draft.edges_m[side])
        section = [*section[:-1], *foot, end] if side == "left" else [end, *foot[::-1], *section[1:]]
    draft.crown = section
    # The lane itself ends at the step: its plane is that of the asphalt between.
    draft.narrow_m = 2 * (gap + 0.2)
    return draft


def _old_asphalt(draft: Draft, from_m: float, to_m: float) -> None:
    """Give the asphalt between two places across the road another grey, and its border a dark edge."""
    rng = draft.rng
    grey = draft.surface.albedo
    if rng.random() < 0.8:
        other = grey * float(rng.choice([rng.uniform(0.7, 0.9), rng.uniform(1.1, 1.4)]))
        draft.seams.append(Stripe((from_m + to_m) / 2, abs(to_m - from_m), other))
    draft.seams.append(Stripe(from_m, 0.02, grey * float(rng.uniform(0.4, 0.9)), wobble_m=0.01))


def pavement_edge(rng: np.random.Generator) -> Draft:
    """No paint at one side or both: a bright gutter of concrete that dips, or the edge towards gravel."""
    draft = _trap(rng)
    for side in SIDES if rng.random() < 0.5 else (SIDES[int(rng.random() < 0.65)],):
        draft.lines[side] = []
        draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
        draft.edges_m[side] = draft.half_m
        width = float(rng.uniform(0.12, 0.45))
        bright = ground(min(draft.surface.albedo * float(rng.uniform(1.5, 2.8)), 0.8), 0.08, 0.006)
        drop = -float(rng.uniform(0.0, 0.06))
        rest = kerb(rng, float(rng.uniform(0.03, 0.12)), 0.3, 0.25) if rng.random() < 0.5 else verge(rng)
        draft.sides[side] = [(0.01, -float(rng.uniform(0.0, 0.05)), bright), (width, drop, bright), *rest]
    return draft


def snow_for_line(rng: np.random.Generator) -> Draft:
    """Banks of snow on both sides and no paint."""
    draft = snow(rng)
    draft.lines, draft.others = {}, []
    draft.fair = False
    return draft


TRAPS = (
    Kind("kerb_for_line", 8, kerb_for_line),
    Kind("kerb_both", 8, kerb_both),
    Kind("kerb_shadow", 5, kerb_shadow),
    Kind("kerb_curve", 3, kerb_curve),
    Kind("rail_for_line", 7, rail_for_line),
    Kind("rope_for_line", 5, rope_for_line),
    Kind("wall_for_line", 5, wall_for_line),
    Kind("train_rails", 6, train_rails),
    Kind("edge_drop", 8, edge_drop),
    Kind("pavement_edge", 5, pavement_edge),
    Kind("snow_for_line", 3, snow_for_line),
)


def _angle(rng: np.random.Generator, least_deg: float, most_deg: float) -> float:
    """Return an angle of either sign, small ones as often as large ones."""
    size = math.exp(rng.uniform(math.log(least_deg), math.log(most_deg)))
    return math.radians(size) * float(rng.choice([-1, 1]))


def _turned(rng: np.random.Generator, turn: Turn) -> Draft:
    draft = ordinary(rng) if rng.random() < 0.5 else textured(rng)
    draft.turn = turn
    draft.tags.add("turned")
    draft.fair = False
    return draft


def row_offset(rng: np.random.Generator) -> Draft:
    """Rows of the right image lie a fraction of a pixel off."""
    return _turned(rng, Turn(row_px=float(rng.uniform(0.1, 0.3) * rng.choice([-1, 1]))))


def turned_yaw(rng: np.random.Generator) -> Draft:
    """The right camera is turned about the vertical."""
    return _turned(rng, Turn(yaw_rad=_angle(rng, 0.03, 0.4)))


def turned_pitch(rng: np.random.Generator) -> Draft:
    """The right camera is pitched."""
    return _turned(rng, Turn(pitch_rad=_angle(rng, 0.03, 0.4)))


def turned_roll(rng: np.random.Generator) -> Draft:
    """The right camera is rolled."""
    return _turned(rng, Turn(roll_rad=_angle(rng, 0.03, 0.4)))


def turned_all(rng: np.random.Generator) -> Draft:
    """The right camera is turned about all axes."""
    return _turned(rng, Turn(*(_angle(rng, 0.02, 0.2) for _ in range(3))))


TURNED = (
    Kind("row_offset", 2, row_offset, turned=True),
    Kind("turned_yaw", 2, turned_yaw, turned=True),
    Kind("turned_pitch", 2, turned_pitch, turned=True),
    Kind("turned_roll", 2, turned_roll, turned=True),
    Kind("turned_all", 2, turned_all, turned=True),
)
