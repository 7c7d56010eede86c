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

"""Random worlds that were calibrated wrongly once, under names that say what is in them.

Each is drawn from the first catalogue, so that what is added since changes none of them. A change of an old
recipe draws another one: the ingredients beside its numbers show whether it still is what its name says.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WorldDraw:
    """Which world was drawn.

    Attributes:
        seed: Of a run of many worlds.
        index: Of the world in this run.
        rig_name: Rig it was drawn with.
        ingredients: What is in it beyond painted lines on a plane.
    """

    seed: int
    index: int
    rig_name: str
    ingredients: tuple[str, ...]


REGRESSION_WORLDS: dict[str, WorldDraw] = {
    "cameras_exchanged_with_four_lines": WorldDraw(706130, 13, "kitti", ("swapped",)),
    "cameras_exchanged_with_arrows": WorldDraw(706130, 242, "kitti", ("arrows", "crown", "swapped")),
    "kerb_for_left_line": WorldDraw(253494, 1375, "kitti", ("kerb_for_line",)),
    "kerb_for_left_line_and_trees": WorldDraw(730233, 31238, "kitti", ("foliage", "kerb_for_line")),
    "kerb_behind_car_in_dappled_light": WorldDraw(
        699186, 1726, "paper", ("dappled", "car_ahead", "exposures_differ", "crown", "kerb_for_line")
    ),
    "kerb_beside_line_in_glare": WorldDraw(378577, 339, "kitti", ("kerb", "car_ahead", "glare")),
    "kerb_and_rail_out_of_focus": WorldDraw(
        730233, 43716, "paper", ("guard_rail", "grass", "foliage", "soft_focus", "kerb_for_line")
    ),
    "kerbs_on_both_sides_in_shadows": WorldDraw(
        55001, 8672, "paper", ("dappled", "shadows_across", "kerb", "kerb_for_line")
    ),
    "rail_beside_double_line": WorldDraw(
        766679, 745, "kitti", ("slight_bend", "guard_rail", "double_line", "foliage")
    ),
    "rail_for_missing_line": WorldDraw(982991, 11460, "kitti", ("far_grade", "guard_rail", "missing_line")),
    "road_rises_right_ahead": WorldDraw(378577, 647, "kitti", ("near_grade",)),
    "road_falls_right_ahead": WorldDraw(55001, 7582, "hd", ("foliage", "kerb", "near_grade")),
    "road_rises_in_dappled_light": WorldDraw(55001, 7606, "paper", ("grass", "dappled", "near_grade")),
    "road_rises_under_worn_lines": WorldDraw(
        88123, 8064, "hd", ("foliage", "double_line", "worn_paint", "near_grade")
    ),
    "worn_double_line_in_dappled_light": WorldDraw(
        772962, 190, "paper", ("worn_paint", "dappled", "double_line")
    ),
    "arrow_in_shadows_across": WorldDraw(41002, 285, "kitti", ("arrows", "shadows_across", "crown", "grass")),
    "arrow_beside_lines": WorldDraw(70000, 25, "kitti", ("arrows",)),
}
