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

"""Night, rain, snow, fog, and light that is too strong or too weak."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import objects
from .drafts import SIDES, Draft, dashes, ground, ordinary, sign
from .kinds import Kind
from .mesh import Look, Material
from .scenes import Lamp, Light

_DARK = 0.012  # light of a sky at night, as a share of a day's on the same exposure


def wet(rng: np.random.Generator) -> Draft:
    """A wet road that mirrors what stands at its sides."""
    draft = ordinary(rng)
    _make_wet(draft)
    if rng.random() < 0.4:
        draft.lines["left"] = [dashes(draft, draft.lines["left"][0])]
    for side in SIDES:
        if rng.random() < 0.5:
            place = sign(side) * (draft.edges_m[side] + float(rng.uniform(1.5, 5)))
            objects.houses(draft.builder, draft.beside(side), place, rng, (float(rng.uniform(3, 12)), 90.0))
            draft.scenery[side] = False
    return draft


def _make_wet(draft: Draft) -> None:
    rng = draft.rng
    draft.wet = float(rng.uniform(0.3, 1.0))
    draft.surface = replace(
        draft.surface, albedo=draft.surface.albedo * 0.65, grain=draft.surface.grain * 0.7
    )
    light = draft.light
    if light.sun_strength:  # it rains: no sun
        draft.light = replace(light, sun_strength=0.0, ambient=1.0, haze_m=float(rng.uniform(80, 400)))


def night(rng: np.random.Generator) -> Draft:
    """Night, with headlamps, street lamps, other cars."""
    draft = ordinary(rng)
    _make_night(draft)
    return draft


def night_wet(rng: np.random.Generator) -> Draft:
    """A wet road at night."""
    draft = ordinary(rng)
    _make_wet(draft)
    _make_night(draft)
    return draft


def _make_night(draft: Draft) -> None:
    rng = draft.rng
    mount = draft.mount
    ahead = 0.3 if mount.height_m < 0.8 else 1.4
    low = min(0.65, mount.height_m * 0.8)
    strength = float(rng.uniform(25, 70))
    half = 0.25 if mount.height_m < 0.8 else 0.65
    lamps = [Lamp((ahead, mount.lateral_m + out, low), strength, True) for out in (-half, half)]
    if rng.random() < 0.4:
        out = sign(SIDES[int(rng.random() < 0.5)])
        every, first = float(rng.uniform(18, 35)), float(rng.uniform(0, 20))
        for s in first + every * np.arange(4):
            place = (float(s), out * (draft.edges_m["left"] + 1.0), float(rng.uniform(5.5, 8)))
            lamps.append(Lamp(place, float(rng.uniform(4, 14)), False))
            shine = Look(Material.LAMP, 6.0)
            draft.builder.box(place, (0.5, 0.25, 0.12), 0.0, shine, thin=True)
            objects.posts(
                draft.builder, draft.alignment(), place[0], place[1], 0.15, place[2], objects.solid(0.2)
            )
    _lights_of_cars(draft)
    draft.light = Light(
        sun=(0.0, 0.0, 1.0),
        sun_strength=0.0,
        ambient=_DARK * float(rng.uniform(0.5, 3)),
        sky=(0.002, 0.004),
        clouds=0.1,
        haze_m=3000.0,
        lamps=tuple(lamps),
    )
    draft.sensor = replace(draft.sensor, noise=float(rng.uniform(1, 4)), shot=float(rng.uniform(0.0, 0.08)))
    draft.view_m = 28.0


def _lights_of_cars(draft: Draft) -> None:
    rng = draft.rng
    for _ in range(int(rng.integers(0, 3))):
        oncoming = rng.random() < 0.6 and draft.edges_m["left"] > draft.half_m + 2.5
        s = float(rng.uniform(25, 90))
        t = draft.half_m + 1.7 if oncoming else float(rng.uniform(-0.3, 0.3))
        road = draft.at(t)
        objects.car(draft.builder, road, s + 2.3, t, rng)
        for out in (-0.65, 0.65):
            place = road.world(np.array(s - 0.05), t + out, 0.65)
            size = (0.05, 0.16, 0.13)
            shine = Look(Material.LAMP, float(rng.uniform(5, 15)) if oncoming else 0.8)
            draft.builder.box(place, size, 0.0, shine, thin=True)


def snow(rng: np.random.Generator) -> Draft:
    """Banks of snow at the sides of a road that was cleared, its lines in view."""
    draft = ordinary(rng)
    for side in SIDES:
        foot = sign(side) * (draft.edges_m[side] - float(rng.uniform(-0.3, 0.1)))
        height, width = float(rng.uniform(0.15, 0.7)), float(rng.uniform(0.5, 1.2))
        objects.snow_bank(draft.builder, draft.beside(side), foot, height, width, rng)
        white = ground(float(rng.uniform(0.45, 0.7)), 0.1, 0.01, -0.2)
        draft.sides[side] = [(3.0, -0.02, white), (120.0, 0.5, white)]
    return draft


def fog(rng: np.random.Generator) -> Draft:
    """Fog."""
    draft = ordinary(rng)
    seen = float(rng.uniform(25, 90))
    grey = float(rng.uniform(0.5, 0.8))
    draft.light = replace(
        draft.light, haze_m=seen, sky=(grey, grey), clouds=0.0, sun_strength=0.0, ambient=1.0
    )
    draft.view_m = min(60.0, 0.8 * seen)
    return draft


def exposure(rng: np.random.Generator) -> Draft:
    """Images that are too dark or too bright."""
    draft = ordinary(rng)
    grey = float(rng.choice([rng.uniform(14, 35), rng.uniform(140, 190)]))
    gain = grey / draft.surface.albedo
    draft.sensor = replace(draft.sensor, gamma=1.0, gain=(gain, gain * float(rng.uniform(0.97, 1.03))))
    return draft


def bonnet(rng: np.random.Generator) -> Draft:
    """The own bonnet at the bottom of the images, which mirrors the sky."""
    draft = ordinary(rng)
    x = np.linspace(0.55, 1.75, 9)
    y = np.linspace(-0.8, 0.8, 9)
    top = draft.mount.height_m - float(rng.uniform(0.28, 0.4)) * min(draft.mount.height_m, 1.6) / 1.4
    places_x, places_y = np.meshgrid(x, y, indexing="ij")
    height = top - 0.1 * ((places_x - 0.4) / 1.2) ** 2 - 0.06 * (places_y / 0.8) ** 2
    grid = np.stack([places_x, places_y + draft.mount.lateral_m, height], axis=-1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    first, second = quads.copy(), quads.copy()
    first[:, 3] = first[:, 2]
    second[:, 1], second[:, 2] = quads[:, 2], quads[:, 3]
    draft.builder.add(
        np.concatenate([first, second]), objects.solid(float(rng.uniform(0.05, 0.5)), 0.05, 0.01)
    )
    draft.near_m = x[-1] * draft.mount.height_m / (draft.mount.height_m - float(height[-1, 4]))
    draft.tags.add("bonnet")
    return draft


WEATHER = (
    Kind("wet", 3, wet),
    Kind("night", 2, night),
    Kind("night_wet", 2, night_wet),
    Kind("snow", 2, snow),
    Kind("fog", 1, fog),
    Kind("exposure", 2, exposure),
    Kind("bonnet", 1, bonnet),
)
