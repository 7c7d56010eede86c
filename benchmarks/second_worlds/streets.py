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

"""Streets: houses, cars, shadows, markings across the lane, seams, tramways."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from . import objects
from .drafts import SIDES, Draft, kerb, ordinary, sign
from .kinds import Kind, dashed_both, dashed_solid, plain
from .scenes import Shade, Stripe


def _street(rng: np.random.Generator) -> Draft:
    """Return a road of any pattern of lines."""
    draft: Draft = [plain, dashed_solid, dashed_both, ordinary][int(rng.integers(4))](rng)
    return draft


def facades(rng: np.random.Generator) -> Draft:
    """Houses close to both sides, with many upright and level lines."""
    draft = _street(rng)
    for side in SIDES:
        stone = draft.surface.albedo * float(rng.uniform(1.0, 1.8))
        draft.sides[side] = kerb(rng, float(rng.uniform(0.08, 0.15)), stone, stone * 0.8)
        place = sign(side) * (draft.edges_m[side] + float(rng.uniform(2.0, 4.5)))
        objects.houses(draft.builder, draft.beside(side), place, rng, (float(rng.uniform(-2, 6)), 120.0))
        if rng.random() < 0.5:
            near = sign(side) * (draft.edges_m[side] + 0.6)
            objects.masts(draft.builder, draft.beside(side), near, float(rng.uniform(8, 25)), rng)
        draft.scenery[side] = False
    return draft


def parked(rng: np.random.Generator) -> Draft:
    """Cars at the side, and oncoming ones."""
    draft = _street(rng)
    for side in SIDES:
        if side == "left" and rng.random() < 0.4:
            continue
        draft.edges_m[side] += 2.2
        s = float(rng.uniform(2, 8))
        while s < 70:
            if rng.random() < 0.75:
                _car(draft, s, sign(side) * (draft.edges_m[side] - float(rng.uniform(1.0, 1.2))))
            s += float(rng.uniform(5.2, 7.5))
    _oncoming(draft)
    return draft


def _car(draft: Draft, s_m: float, t_m: float, *, truck: bool = False) -> None:
    """Put a car on the carriageway, with the shadow below it."""
    objects.car(draft.builder, draft.at(t_m), s_m, t_m, draft.rng, truck=truck)
    length, width = (8.2, 2.5) if truck else (4.4, 1.8)
    below = Stripe(
        t_m, width, draft.surface.albedo * 0.4, start_m=s_m - length / 2 - 0.1, end_m=s_m + length / 2 + 0.1
    )
    draft.seams.append(below)
    light = draft.light
    if light.sun_strength and not draft.curvature_per_m:
        reach = 1.2 / max(light.sun[2], 0.3)
        centre = (s_m - light.sun[0] * reach / 2, t_m - light.sun[1] * reach / 2)
        half = (length / 2 + abs(light.sun[0]) * reach / 2, width / 2 + abs(light.sun[1]) * reach / 2)
        draft.light = replace(light, shades=(*light.shades, Shade(centre, half, 0.0, 0.06)))


def _oncoming(draft: Draft) -> None:
    """Put cars into the lanes on the left."""
    rng = draft.rng
    place = draft.half_m + 1.7
    if place + 1.2 > draft.edges_m["left"]:
        return
    for s in rng.uniform(9, 80, int(rng.integers(0, 3))):
        _car(draft, float(s), place + float(rng.uniform(-0.2, 0.2)), truck=bool(rng.random() < 0.15))


def car_ahead(rng: np.random.Generator) -> Draft:
    """A car in the own lane, 8 to 35 m ahead."""
    draft = _street(rng)
    truck = bool(rng.random() < 0.2)
    s = float(rng.uniform(8, 35)) + 4.0 * truck
    _car(draft, s, float(rng.uniform(-0.3, 0.3)), truck=truck)
    draft.view_m = s - (4.2 if truck else 2.4)
    _oncoming(draft)
    return draft


def dapples(rng: np.random.Generator) -> Draft:
    """Shadows of leaves on the road."""
    draft = _street(rng)
    strength = 0.75
    sun = draft.light.sun
    start = float(rng.uniform(-3, 12))
    draft.light = replace(
        draft.light,
        sun_strength=strength / sun[2],
        ambient=1 - strength,
        dapple=float(rng.uniform(0.5, 0.95)),
        dapple_m=float(rng.uniform(4, 10)),
        dapple_reach_m=(start, start + float(rng.uniform(6, 60))),
    )
    for side in SIDES:
        for s in np.cumsum(rng.uniform(5, 12, 7)):
            place = sign(side) * (draft.edges_m[side] + rng.uniform(1.5, 4))
            foot = draft.beside(side).world(np.array(s), place, 0.0)
            objects.tree(draft.builder, foot, rng)
        draft.scenery[side] = False
    return draft


def shadows(rng: np.random.Generator) -> Draft:
    """Sharp shadows of houses and masts: bands across the road or along it."""
    draft = _street(rng)
    strength = 0.7
    shades: list[Shade] = []
    for _ in range(int(rng.integers(1, 4))):
        along = rng.random() < 0.4
        soft = float(rng.uniform(0.03, 0.3))
        if along:
            edge = float(rng.uniform(-3.5, 3.5))
            out = float(rng.choice([-1, 1]))
            shades.append(Shade((40.0, edge + out * 15), (60.0, 15.0), float(rng.normal(0, 0.02)), soft))
        else:
            turn = float(rng.uniform(-0.7, 0.7))
            shades.append(
                Shade((float(rng.uniform(3, 30)), 0.0), (float(rng.uniform(0.1, 5)), 40.0), turn, soft)
            )
    sun = draft.light.sun
    draft.light = replace(
        draft.light, sun_strength=strength / sun[2], ambient=1 - strength, shades=tuple(shades)
    )
    return draft


def markings(rng: np.random.Generator) -> Draft:
    """Crosswalks, stop lines, arrows and letters in the lane."""
    draft = _street(rng)
    albedo = min(draft.surface.albedo * float(rng.uniform(2.0, 3.2)), 0.85)
    base = Stripe(0.0, 0.5, albedo, wear=float(rng.choice([0.0, 0.2, 0.4])), reflects=True)
    what = set(rng.choice(["crosswalk", "stop", "arrow", "letters"], int(rng.integers(1, 4)), replace=False))
    start = float(rng.uniform(4, 14))
    if "arrow" in what or "letters" in what:
        where = start - 3 if start > 9 else start + 7
        _arrow(draft, base, where) if "arrow" in what else _letters(draft, base, where)
    if "stop" in what:
        wide = replace(base, width_m=draft.lane_width_m - 0.3, start_m=start, end_m=start + 0.4)
        draft.others.append(wide)
    if "crosswalk" in what:
        bar, length = float(rng.uniform(0.4, 0.6)), float(rng.uniform(2.5, 4))
        low, high = -draft.edges_m["right"] + 0.4, draft.edges_m["left"] - 0.4
        for t in np.arange(low, high, 2 * bar):
            one = replace(base, t_m=float(t), width_m=bar, start_m=start + 1.2, end_m=start + 1.2 + length)
            draft.others.append(one)
        _interrupt(draft, start, start + 1.5 + length)
    return draft


def _interrupt(draft: Draft, start_m: float, end_m: float) -> None:
    """Take the lines away between two places."""
    for side in SIDES:
        kept: list[Stripe] = []
        for line in draft.lines.get(side, []):
            kept += [replace(line, end_m=start_m), replace(line, start_m=end_m)]
        draft.lines[side] = kept


def _arrow(draft: Draft, base: Stripe, start_m: float) -> None:
    shaft = replace(base, width_m=0.15, start_m=start_m, end_m=start_m + 2.4)
    head = replace(base, width_m=0.5, start_m=start_m + 2.4, end_m=start_m + 3.6, taper=True)
    draft.others += [shaft, head]


def _letters(draft: Draft, base: Stripe, start_m: float) -> None:
    rng = draft.rng
    for number in range(3):
        t = 0.7 * (number - 1)
        for offset in (-0.2, 0.2):
            upright = replace(base, t_m=t + offset, width_m=0.12, start_m=start_m, end_m=start_m + 1.6)
            draft.others.append(upright)
        for share in rng.choice([0.0, 0.7, 1.4], 2, replace=False):
            level = replace(base, t_m=t, width_m=0.5, start_m=start_m + share, end_m=start_m + share + 0.25)
            draft.others.append(level)


def seams(rng: np.random.Generator) -> Draft:
    """Joints and cracks filled with tar, along the road and across it."""
    draft = _street(rng)
    dark = draft.surface.albedo * float(rng.uniform(0.3, 0.6))
    for _ in range(int(rng.integers(1, 5))):
        place = float(rng.uniform(-draft.edges_m["right"], draft.edges_m["left"]))
        wobble = float(rng.choice([0.0, rng.uniform(0.01, 0.12)]))
        phase = float(rng.uniform(0, 6))
        draft.seams.append(
            Stripe(place, float(rng.uniform(0.03, 0.12)), dark, phase_m=phase, wobble_m=wobble)
        )
    for s in np.cumsum(rng.uniform(1.5, 9, int(rng.integers(1, 8)))):
        middle = (draft.edges_m["left"] - draft.edges_m["right"]) / 2
        wide = draft.edges_m["left"] + draft.edges_m["right"]
        draft.seams.append(Stripe(middle, wide, dark, start_m=float(s), end_m=float(s) + 0.06))
    return draft


def tram(rng: np.random.Generator) -> Draft:
    """Rails of a tramway that lie in the road, wires above; with lines or, unfairly, without."""
    draft = _street(rng)
    bright = draft.surface.albedo * float(rng.uniform(1.5, 3.0))
    middle = float(rng.choice([0.0, draft.half_m + 1.6])) + float(rng.uniform(-0.2, 0.2))
    for out in (-0.7175, 0.7175):
        head = Stripe(middle + out, 0.056, min(bright, 0.8))
        groove = Stripe(middle + out - math.copysign(0.045, out), 0.036, draft.surface.albedo * 0.25)
        draft.others += [head, groove]
    _wires(draft, middle)
    if rng.random() < 0.35:
        draft.lines = {}
        draft.fair = False
    return draft


def wires(rng: np.random.Generator) -> Draft:
    """Cables above the road."""
    draft = _street(rng)
    for place in rng.uniform(-6, 6, int(rng.integers(1, 5))):
        _wires(draft, float(place))
    return draft


def _wires(draft: Draft, middle_m: float) -> None:
    rng = draft.rng
    for _ in range(int(rng.integers(1, 3))):
        objects.cable(
            draft.builder,
            draft.alignment(),
            middle_m + float(rng.normal(0, 0.3)),
            float(rng.uniform(4.2, 6.5)),
            float(rng.uniform(0.012, 0.05)),
            float(rng.choice([0.03, 0.1, 0.4])),
        )


STREETS = (
    Kind("facades", 3, facades),
    Kind("parked", 3, parked),
    Kind("car_ahead", 3, car_ahead),
    Kind("dapples", 3, dapples),
    Kind("shadows", 2, shadows),
    Kind("markings", 3, markings),
    Kind("seams", 2, seams),
    Kind("tram", 2, tram),
    Kind("wires", 2, wires),
)
