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

"""The ingredients of worlds, and the expected verdict for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from . import recipes_beside as beside
from . import recipes_road as road
from . import recipes_steps as steps
from . import recipes_view as view
from .recipe_tools import Change

Expected = Literal["accept", "either", "refuse"]


@dataclass(frozen=True, slots=True)
class Ingredient:
    """Something that may be in a world.

    Attributes:
        name: Its name, as tables show it.
        expected: "accept": a calibration is expected all the same; "either": one is welcome if right;
            "refuse": none is expected, a wrong one is the fault to be avoided.
        change: Puts it into a scene.
        weight: How often it is drawn, against the others of its kind.
        part: Property that it sets as a whole ("course", "grade", ...); a world has one ingredient for each.
    """

    name: str
    expected: Expected
    change: Change
    weight: float = 1.0
    part: str = ""


# Properties that more than one recipe sets as a whole.
_PARTS = {"crown": "crown", "crown_in_lane": "crown", "opposite_lane_only": "crown"}
_EXPOSURE = ("exposures_differ", "over_exposed", "under_exposed")
_PARTS |= dict.fromkeys(("fine_texture", "no_line_textured", "one_line_textured"), "texture")
_PARTS |= {"night": "weather", "wet": "weather", "rain": "weather", "night_rain": "weather"}
_PARTS |= dict.fromkeys(("misaligned", "slightly_misaligned"), "rows")
_PARTS |= dict.fromkeys(_EXPOSURE, "exposure") | dict.fromkeys(("soft_focus", "blurred"), "focus")


def _all(expected: Expected, *changes: Change) -> tuple[Ingredient, ...]:
    """Return one ingredient per recipe, under its name."""
    names = [str(getattr(change, "__name__", "")) for change in changes]
    return tuple(
        Ingredient(name, expected, change, part=_PARTS.get(name, ""))
        for name, change in zip(names, changes, strict=True)
    )


GOOD: tuple[Ingredient, ...] = (
    *_all(
        "accept",
        road.double_line,
        road.worn_paint,
        road.arrows,
        road.crown,
        beside.grass,
        beside.kerb,
        beside.guard_rail,
        beside.foliage,
        beside.car_ahead,
        view.shadows_across,
        view.shadow_along,
        view.dappled,
        view.exposures_differ,
        view.soft_focus,
    ),
    Ingredient("far_grade", "accept", road.grade_ahead((45.0, 80.0), (0.005, 0.03)), part="grade"),
    Ingredient("slight_bend", "accept", road.bend_of((2500.0, 8000.0)), part="course"),
)

UNSURE: tuple[Ingredient, ...] = (
    *_all(
        "either",
        road.ruined_paint,
        beside.bright_verge,
        road.tram_rails,
        road.crown_in_lane,
        beside.parked_cars,
        view.glare,
    ),
    Ingredient("bend", "either", road.bend_of((80.0, 1000.0)), 2.0, "course"),
    Ingredient("grade", "either", road.grade_ahead((20.0, 45.0), (0.005, 0.03)), part="grade"),
)

BAD: tuple[Ingredient, ...] = (
    *_all(
        "refuse",
        road.missing_line,
        road.no_paint,
        road.shadow_for_line,
        beside.kerb_for_line,
        road.opposite_lane_only,
        view.over_exposed,
        view.under_exposed,
        view.blurred,
        view.misaligned,
        view.turned,
        view.swapped,
    ),
    Ingredient("near_grade", "refuse", road.grade_ahead((6.0, 15.0), (0.01, 0.03)), part="grade"),
)

# Added since the first worlds.
NEWER_GOOD: tuple[Ingredient, ...] = (
    *_all(
        "accept",
        road.yellow_paint,
        view.bayer,
        view.jpeg,
        view.slightly_misaligned,
        view.night,
        view.wet,
        view.rain,
        beside.rail_with_posts,
        beside.wire_barrier,
        beside.overhead_cables,
        beside.facades,
        steps.high_kerb,
        steps.kerbs_both,
        steps.low_shoulder,
    ),
    Ingredient("fine_texture", "accept", road.fine_texture, 4.0, "texture"),
)

NEWER_UNSURE: tuple[Ingredient, ...] = (
    *_all(
        "either",
        road.no_line_textured,
        road.one_line_textured,
        view.rolling_shutter,
        view.night_rain,
    ),
)

NEWER_BAD: tuple[Ingredient, ...] = (
    *_all(
        "refuse",
        beside.rail_for_line,
        beside.wires_for_line,
        steps.high_kerb_for_line,
        steps.kerbs_for_lines,
        steps.edge_drop,
        steps.train_rails,
        view.slightly_turned,
        view.looks_aside,
    ),
)


@dataclass(frozen=True, slots=True)
class Catalogue:
    """What random worlds are drawn from.

    Attributes:
        rigs: Name of a rig -> how often it is drawn; they sum to one.
        good: Ingredients a calibration is expected with.
        unsure: Those with which one is welcome if it is right.
        bad: Those with which none is expected.
    """

    rigs: Mapping[str, float]
    good: tuple[Ingredient, ...]
    unsure: tuple[Ingredient, ...]
    bad: tuple[Ingredient, ...]

    @property
    def ingredients(self) -> tuple[Ingredient, ...]:
        """All of them."""
        return (*self.good, *self.unsure, *self.bad)


# The worlds of old faults were drawn from these: what is added to them draws other worlds.
FIRST = Catalogue({"paper": 0.6, "kitti": 0.25, "hd": 0.15}, GOOD, UNSURE, BAD)

# Those, and all that was added since.
ALL = Catalogue(
    {
        "paper": 0.28,
        "kitti": 0.22,
        "hd": 0.08,
        "short": 0.08,
        "compact": 0.08,
        "robot": 0.14,
        "truck": 0.08,
        "full_hd": 0.04,
    },
    (*FIRST.good, *NEWER_GOOD),
    (*FIRST.unsure, *NEWER_UNSURE),
    (*FIRST.bad, *NEWER_BAD),
)

INGREDIENTS: dict[str, Ingredient] = {item.name: item for item in ALL.ingredients}
