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

"""Ordinary roads: kinds that a calibration must answer, if lines and shape allow it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from . import objects
from .drafts import SIDES, Draft, dashes, kerb, ordinary, sign
from .scenes import Stripe

Draw = Callable[[np.random.Generator], Draft]


@dataclass(frozen=True)
class Kind:
    """A kind of world.

    Attributes:
        name: Its name.
        share: How often it is drawn, relative to the others.
        draw: What draws it.
        turned: Whether its right camera is turned.
    """

    name: str
    share: float
    draw: Draw
    turned: bool = False


def plain(rng: np.random.Generator) -> Draft:
    """Bare asphalt with a solid line on either side."""
    return ordinary(rng, float(rng.choice([0.0, 0.02, 0.05])))


def textured(rng: np.random.Generator) -> Draft:
    """Asphalt of any strength of texture, with cracks and repairs."""
    draft = ordinary(rng, float(rng.uniform(0.1, 1.3)))
    if rng.random() < 0.5:
        draft.surface = replace(draft.surface, cracks=float(rng.uniform(0.2, 0.6)))
    if rng.random() < 0.5:
        repairs(draft)
    return draft


def repairs(draft: Draft) -> None:
    """Put patches of other asphalt on the road."""
    rng = draft.rng
    for _ in range(int(rng.integers(1, 5))):
        start = float(rng.uniform(2, 25))
        grey = draft.surface.albedo * float(rng.choice([0.65, 0.8, 1.2]))
        draft.seams.append(
            Stripe(
                float(rng.uniform(-1.5, 1.5)),
                float(rng.uniform(0.5, 2.0)),
                grey,
                start_m=start,
                end_m=start + float(rng.uniform(0.8, 6)),
            )
        )


def dashed_both(rng: np.random.Generator) -> Draft:
    """Dashes on both sides."""
    draft = ordinary(rng)
    pattern = dashes(draft, draft.lines["left"][0])
    for side in SIDES:
        same = replace(
            draft.lines[side][0], dash_m=pattern.dash_m, gap_m=pattern.gap_m, phase_m=pattern.phase_m
        )
        draft.lines[side] = [same if rng.random() < 0.7 else dashes(draft, same)]
    return draft


def dashed_solid(rng: np.random.Generator) -> Draft:
    """Dashes on one side, a solid line on the other."""
    draft = ordinary(rng)
    side = SIDES[int(rng.random() < 0.2)]
    draft.lines[side] = [dashes(draft, draft.lines[side][0])]
    return draft


def double(rng: np.random.Generator) -> Draft:
    """A double line on one side or on both."""
    draft = ordinary(rng)
    for side in SIDES if rng.random() < 0.3 else (SIDES[int(rng.random() < 0.3)],):
        line = draft.lines[side][0]
        apart = sign(side) * (line.width_m + float(rng.uniform(0.08, 0.2)))
        second = replace(line, t_m=line.t_m + apart)
        draft.lines[side].append(dashes(draft, second) if rng.random() < 0.3 else second)
    return draft


def yellow(rng: np.random.Generator) -> Draft:
    """Yellow paint of low contrast on brighter asphalt."""
    draft = ordinary(rng)
    draft.surface = replace(draft.surface, albedo=float(rng.uniform(0.25, 0.4)))
    contrast = float(rng.uniform(1.2, 1.6))
    for side in SIDES:
        line = replace(draft.lines[side][0], albedo=draft.surface.albedo * contrast, warmth=0.9)
        draft.lines[side] = [line]
    left, right = draft.sensor.gain
    draft.sensor = replace(draft.sensor, gain=(left * 0.6, right * 0.6))
    return draft


def worn(rng: np.random.Generator) -> Draft:
    """Paint of which much is gone."""
    draft = ordinary(rng)
    for side in SIDES:
        line = draft.lines[side][0]
        if rng.random() < 0.3:
            line = dashes(draft, line)
        draft.lines[side] = [replace(line, wear=float(rng.uniform(0.15, 0.65)))]
    return draft


def kerb_beside(rng: np.random.Generator) -> Draft:
    """Painted lines, and a kerb not far beyond one of them or both."""
    draft = ordinary(rng)
    for side in SIDES if rng.random() < 0.4 else (SIDES[int(rng.random() < 0.7)],):
        stone = draft.surface.albedo * float(rng.uniform(1.1, 2.5))
        draft.sides[side] = kerb(
            rng, float(rng.uniform(0.05, 0.16)), stone, stone * float(rng.uniform(0.5, 1.0))
        )
    return draft


def rail_beside(rng: np.random.Generator) -> Draft:
    """Painted lines, and a guard rail beyond one of them or both."""
    draft = ordinary(rng)
    for side in SIDES if rng.random() < 0.4 else (SIDES[int(rng.random() < 0.6)],):
        place = sign(side) * (draft.edges_m[side] + float(rng.uniform(0.1, 0.8)))
        objects.guard_rail(draft.builder, draft.beside(side), place, rng)
        draft.scenery[side] = False
    return draft


def noisy(rng: np.random.Generator) -> Draft:
    """Noise of some grey levels."""
    draft = ordinary(rng)
    draft.sensor = replace(
        draft.sensor, noise=float(rng.uniform(2, 6)), shot=float(rng.choice([0.0, 0.05, 0.1]))
    )
    return draft


def noise_20(rng: np.random.Generator) -> Draft:
    """Noise of 10 to 20 % of the range: an answer is welcome."""
    draft = ordinary(rng)
    draft.sensor = replace(draft.sensor, noise=float(rng.uniform(25, 51)))
    draft.tags.add("heavy_noise")
    draft.fair = False
    return draft


def bayer(rng: np.random.Generator) -> Draft:
    """A colour pattern, interpolated and made grey."""
    draft = ordinary(rng)
    draft.sensor = replace(draft.sensor, bayer=True, blur_px=float(rng.uniform(0.3, 0.6)))
    draft.surface = replace(draft.surface, warmth=float(rng.uniform(-0.1, 0.2)))
    return draft


def jpeg(rng: np.random.Generator) -> Draft:
    """JPEG compression."""
    draft = ordinary(rng)
    draft.sensor = replace(draft.sensor, jpeg=int(rng.integers(70, 96)))
    return draft


def lens(rng: np.random.Generator) -> Draft:
    """Vignetting, blur, other exposure left and right, few grey levels."""
    draft = ordinary(rng)
    left, right = draft.sensor.gain
    draft.sensor = replace(
        draft.sensor,
        vignette=float(rng.uniform(0.2, 0.6)),
        blur_px=float(rng.uniform(0.5, 1.4)),
        gain=(left, right * float(rng.uniform(0.75, 1.3))),
        step=int(rng.choice([1, 1, 2, 4])),
        black=float(rng.uniform(0, 12)),
    )
    return draft


def shutter(rng: np.random.Generator) -> Draft:
    """A rolling shutter on a shaking mount."""
    draft = ordinary(rng)
    draft.sensor = replace(
        draft.sensor,
        shake_px=float(rng.uniform(0.05, 0.35)),
        shake_periods=float(rng.uniform(0.5, 4)),
        shake_phase_rad=float(rng.uniform(0, 2 * math.pi)),
    )
    return draft


def mixed(rng: np.random.Generator) -> Draft:
    """Several small faults at once, as real cameras have them."""
    draft = [dashed_solid, worn, textured, kerb_beside][int(rng.integers(4))](rng)
    left, right = draft.sensor.gain
    draft.sensor = replace(
        draft.sensor,
        noise=float(rng.uniform(1, 4)),
        shot=0.03,
        vignette=float(rng.uniform(0.0, 0.4)),
        blur_px=float(rng.uniform(0.4, 1.0)),
        gain=(left, right * float(rng.uniform(0.9, 1.1))),
        jpeg=int(rng.choice([0, 80, 90])),
        bayer=bool(rng.random() < 0.3),
        shake_px=float(rng.choice([0.0, 0.1])),
        shake_periods=float(rng.uniform(1, 3)),
    )
    return draft


GOOD_KINDS = (
    Kind("plain", 4, plain),
    Kind("textured", 5, textured),
    Kind("dashed_both", 3, dashed_both),
    Kind("dashed_solid", 4, dashed_solid),
    Kind("double", 2, double),
    Kind("yellow", 2, yellow),
    Kind("worn", 2, worn),
    Kind("kerb_beside", 3, kerb_beside),
    Kind("rail_beside", 2, rail_beside),
    Kind("noisy", 2, noisy),
    Kind("noise_20", 1, noise_20),
    Kind("bayer", 2, bayer),
    Kind("jpeg", 2, jpeg),
    Kind("lens", 2, lens),
    Kind("shutter", 2, shutter),
    Kind("mixed", 3, mixed),
)
