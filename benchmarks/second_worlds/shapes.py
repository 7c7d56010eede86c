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

"""Roads of all shapes: bends, crowns, falls, slopes, unevenness; and roads with few lines."""

from __future__ import annotations

import math

import numpy as np

from .drafts import SIDES, Draft, dashes, ordinary, roof
from .kinds import Kind, repairs

_FLAT_ENOUGH = 0.45  # strength of a texture that shows the whole road
_WIDE_BEND_M = 250.0  # a bend that leaves its tangent by 0.5 m within 15 m


def curve(rng: np.random.Generator) -> Draft:
    """A bend of 80 to 700 m, which may lean inwards; a tight one on bare asphalt is not fair."""
    strength = float(rng.uniform(0.05, 0.9))
    draft = ordinary(rng, strength)
    radius = math.exp(rng.uniform(math.log(80), math.log(700)))
    draft.fair = radius > _WIDE_BEND_M or strength > _FLAT_ENOUGH
    draft.curvature_per_m = float(rng.choice([-1, 1])) / radius
    lean = float(rng.choice([0.0, rng.uniform(0.01, 0.05)]))
    draft.crown = roof(draft, lean, -50.0 if draft.curvature_per_m > 0 else 50.0)
    if rng.random() < 0.3:
        draft.lines["left"] = [dashes(draft, draft.lines["left"][0])]
    return draft


def crown(rng: np.random.Generator) -> Draft:
    """A crown of 1 to 3 %, its ridge anywhere, sharp or round."""
    draft = ordinary(rng)
    fall = float(rng.uniform(0.01, 0.03))
    ridge = float(rng.choice([draft.half_m, 0.0, rng.uniform(-1.0, 4.0)]))
    draft.crown = roof(draft, fall, ridge)
    if rng.random() < 0.5:
        draft.crown = _round(draft.crown, ridge, float(rng.uniform(0.8, 2.5)))
    return draft


def _round(section: list[tuple[float, float]], ridge_m: float, reach_m: float) -> list[tuple[float, float]]:
    """Return a cross-section of which the ridge is a parabola."""
    places, heights = np.array(section).T
    right, left = max(places[0], ridge_m - reach_m), min(places[-1], ridge_m + reach_m)
    if left <= right:
        return section
    inner = np.linspace(right, left, 13)
    fall = (np.interp(ridge_m, places, heights) - np.interp(right, places, heights)) / max(
        ridge_m - right, 1e-9
    )
    curved = np.interp(ridge_m, places, heights) - abs(fall) * (
        reach_m / 2 + (inner - ridge_m) ** 2 / (2 * reach_m)
    )
    kept = [(t, z) for t, z in section if t < right - 1e-9 or t > left + 1e-9]
    points = sorted([*kept, *zip(inner.tolist(), curved.tolist(), strict=True)])
    middle = float(np.interp(0.0, *np.array(points).T))
    return [(t, z - middle) for t, z in points]


def cross_fall(rng: np.random.Generator) -> Draft:
    """A fall of 2 to 6 % to one side."""
    draft = ordinary(rng)
    draft.crown = roof(draft, float(rng.uniform(0.02, 0.06)), float(rng.choice([-50.0, 50.0])))
    return draft


def slope_ahead(rng: np.random.Generator) -> Draft:
    """A slope that changes 8 to 25 m ahead, at once or over some metres."""
    draft = ordinary(rng)
    change = float(rng.uniform(0.008, 0.04) * rng.choice([-1, 1]))
    place = float(rng.uniform(8, 25))
    steps = int(rng.choice([1, 4, 8]))
    draft.kinks = [(place + 2.0 * step, change / steps) for step in range(steps)]
    return draft


def uneven(rng: np.random.Generator) -> Draft:
    """Waves of a few millimetres along the road."""
    draft = ordinary(rng)
    places = np.arange(1.0, 60.0, float(rng.uniform(1.5, 4)))
    heights = rng.normal(0, rng.uniform(0.0005, 0.003), len(places))
    heights[0] = heights[-1] = 0.0
    slopes = np.concatenate([[0.0], np.diff(heights) / np.diff(places), [0.0]])
    draft.kinks = [(float(s), float(k)) for s, k in zip(places, np.diff(slopes), strict=True)]
    return draft


def one_line(rng: np.random.Generator) -> Draft:
    """A line on one side only. Where the asphalt shows enough, it has to be answered."""
    strength = float(rng.choice([0.03, rng.uniform(0.1, 1.2)]))
    draft = ordinary(rng, strength)
    draft.lines[SIDES[int(rng.random() < 0.5)]] = []
    draft.others = []
    draft.one_side = strength > _FLAT_ENOUGH
    draft.tags.add("one_line")
    return draft


def no_line(rng: np.random.Generator) -> Draft:
    """No line at all, on asphalt with a texture: an answer is welcome."""
    strength = float(rng.uniform(0.1, 1.2))
    draft = ordinary(rng, strength)
    draft.lines, draft.others = {}, []
    if rng.random() < 0.5:
        repairs(draft)
    draft.tags.add("no_line")
    return draft


SHAPES = (
    Kind("curve", 3, curve),
    Kind("crown", 3, crown),
    Kind("cross_fall", 2, cross_fall),
    Kind("slope_ahead", 4, slope_ahead),
    Kind("uneven", 2, uneven),
    Kind("one_line", 3, one_line),
    Kind("no_line", 3, no_line),
)
