"""Roads on which something that is no paint on the road looks like its lines."""

from __future__ import annotations

import math

import numpy as np

from . import objects
from .cameras import Turn
from .drafts import SIDES, Draft, kerb, ordinary, sign
from .kinds import Kind, textured


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
    road = draft.alignment()
    for side in SIDES if rng.random() < 0.25 else (SIDES[int(rng.random() < 0.6)],):
        draft.lines[side] = []
        draft.others = [line for line in draft.others if line.t_m * sign(side) < 0]
        objects.guard_rail(draft.builder, road, sign(side) * draft.half_m, rng)
        draft.scenery[side] = False
    return draft


def train_rails(rng: np.random.Generator) -> Draft:
    """Rails that stand on the ground, and no lines."""
    draft = _trap(rng)
    draft.lines = {}
    draft.others = []
    height = float(rng.uniform(0.04, 0.17))
    objects.train_rails(draft.builder, draft.alignment(), float(rng.uniform(-0.3, 0.3)), height, rng)
    return draft


TRAPS = (
    Kind("kerb_for_line", 5, kerb_for_line),
    Kind("kerb_both", 4, kerb_both),
    Kind("rail_for_line", 4, rail_for_line),
    Kind("train_rails", 3, train_rails),
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
