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

"""What the benchmark of random worlds calls wrong, and that it measures the same every time."""

import numpy as np
import pytest

from benchmarks.worlds import WorldVerdict, by_ingredient, judge_world, world
from stereo_selfcal.synth.world_recipes import INGREDIENTS
from stereo_selfcal.synth.world_rigs import RIGS

NOTHING = np.empty(0)


def verdict(error, std, reason=""):
    return WorldVerdict(0, "accept", (), reason, np.array(error), np.array(std))


@pytest.mark.parametrize(
    ("error", "std", "wrong", "gross"),
    [
        ((29.0, 0.29, 0.79), (1.0, 0.01, 0.01), False, False),  # far off by its own measure only
        ((31.0, 0.0, 0.0), (7.0, 1.0, 1.0), False, False),  # beyond the limit, and it says so
        ((31.0, 0.0, 0.0), (6.0, 1.0, 1.0), True, False),
        ((0.0, -0.31, 0.0), (1.0, 0.01, 1.0), True, False),
        ((0.0, 0.0, 1.3), (1.0, 1.0, 1.0), False, True),
    ],
)
def test_wrong_is_off_by_both_measures(error, std, wrong, gross):
    assert (verdict(error, std).wrong, verdict(error, std).gross) == (wrong, gross)


def test_refused_is_never_wrong():
    refused = verdict([], [], "no_lines_found")
    assert not (refused.accepted or refused.wrong or refused.gross)


@pytest.mark.slow
def test_world_is_judged_the_same_every_time():
    assert world(12) == world(12) != world(13)
    first, again = judge_world(12), judge_world(12)
    assert first.accepted
    assert (first.names, first.reason) == (again.names, again.reason)
    np.testing.assert_array_equal(first.error, again.error)


@pytest.mark.slow
def test_worlds_are_drawn_from_all_ingredients_and_reported_by_each():
    drawn = [world(index) for index in range(1200)]
    names = {name for each in drawn for name in each.ingredients}
    assert names == set(INGREDIENTS)
    verdicts = [
        WorldVerdict(
            i, each.expected, (*each.ingredients, f"rig {each.rig_name}"), "no_lines_found", NOTHING, NOTHING
        )
        for i, each in enumerate(drawn)
    ]
    table = by_ingredient(verdicts)
    rows = {row[0]: row for row in table.rows}
    assert set(rows) - {"nothing else"} == names | {f"rig {name}" for name in RIGS}
    assert rows["train_rails"][1] == "refuse"
