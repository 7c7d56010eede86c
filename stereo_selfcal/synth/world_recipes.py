"""The ingredients of worlds, and the expected verdict for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from . import recipes_beside as beside
from . import recipes_road as road
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

INGREDIENTS: dict[str, Ingredient] = {item.name: item for item in (*GOOD, *UNSURE, *BAD)}
