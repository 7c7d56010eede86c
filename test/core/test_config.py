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

"""Settings: names, ranges on both sides, every way to write them, and messages that name what is wrong."""

import math
from dataclasses import FrozenInstanceError, replace

import pytest

from stereo_selfcal import CalibratorConfig, ConfigError
from stereo_selfcal.core.config import flatten

SETTINGS = {name: (value, setting) for name, value, setting in CalibratorConfig().settings()}
NUMBERS = [name for name, (_, setting) in SETTINGS.items() if not setting.choices]
WORDS = [name for name, (_, setting) in SETTINGS.items() if setting.choices]


def value_of(config, name):
    return {n: value for n, value, _ in config.settings()}[name]


def beyond(name):
    """Return a value below and one above the range of a setting, of the type of its default."""
    value, setting = SETTINGS[name]
    step = 1 if isinstance(value, int) else 1e-6
    return setting.low - step, setting.high + step


def test_names_are_unique_and_dotted_once_at_most():
    names = [name for name, _, _ in CalibratorConfig().settings()]
    assert len(names) == len(set(names))
    assert all(name.count(".") <= 1 for name in names)
    assert "seed" in names
    assert "search.height_min_m" in names


@pytest.mark.parametrize("name", SETTINGS)
def test_default_is_inside_its_range_and_described(name):
    value, setting = SETTINGS[name]
    assert value in setting.choices if setting.choices else setting.low <= value <= setting.high
    assert setting.description
    assert setting.description[0].isupper()
    assert not setting.description.endswith(".")


@pytest.mark.parametrize(
    ("suffix", "unit"), [("_m", "m"), ("_rad", "rad"), ("_px", "px"), ("_sigma", "sigma")]
)
def test_unit_is_the_one_in_the_name(suffix, unit):
    named = [setting for name, (_, setting) in SETTINGS.items() if name.endswith(suffix)]
    assert named
    assert {setting.unit for setting in named} == {unit}


def test_search_box_needs_no_initial_guess():
    """Issue 2: height 0.3-4 m, pitch within 20 degrees, roll within 15 degrees."""
    box = CalibratorConfig().search
    assert (box.height_min_m, box.height_max_m) == (0.3, 4.0)
    assert math.degrees(box.pitch_max_rad) == pytest.approx(20)
    assert math.degrees(box.roll_max_rad) == pytest.approx(15)


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        (name, limit)
        for name in NUMBERS
        for limit in (SETTINGS[name][1].low, SETTINGS[name][1].high)
        # Where one height must be below the other, the ends of the range cannot be reached.
        if (name, limit) not in (("search.height_min_m", 20), ("search.height_max_m", 0.05))
    ],
)
def test_both_ends_of_the_range_are_taken(name, limit):
    config = CalibratorConfig.from_mapping({name: limit})
    assert value_of(config, name) == limit
    assert type(value_of(config, name)) is type(SETTINGS[name][0])


@pytest.mark.parametrize("name", NUMBERS)
def test_beyond_either_end_is_refused_by_name(name):
    for value in beyond(name):
        with pytest.raises(ConfigError, match=rf"^{name} is .*: it must lie in .* \.\.\. "):
            CalibratorConfig.from_mapping({name: value})


@pytest.mark.parametrize("value", ["1", None, True, [1], math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["seed", "search.height_max_m", "genetic.population"])
def test_what_is_no_number_is_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=rf"^{name} is "):
        CalibratorConfig.from_mapping({name: value})


@pytest.mark.parametrize("name", WORDS)
def test_each_choice_is_taken_and_nothing_else(name):
    choices = SETTINGS[name][1].choices
    for word in choices:
        assert value_of(CalibratorConfig.from_mapping({name: word}), name) == word
    listed = ", ".join(choices)
    for wrong in ("", choices[0].upper(), "other", 1, None, True, [choices[0]]):
        with pytest.raises(ConfigError, match=rf"^{name} is .*: it must be one of {listed}$"):
            CalibratorConfig.from_mapping({name: wrong})


def test_switch_of_one_and_zero_may_be_written_as_true_and_false():
    config = CalibratorConfig.from_mapping({"texture.check": True, "texture.required": False})
    assert (config.texture.check, type(config.texture.check)) == (1, int)
    assert config == CalibratorConfig()


def test_texture_that_is_not_looked_for_cannot_be_required():
    with pytest.raises(ConfigError, match=r"^texture.required is 1, but texture.check is 0: .*; set texture"):
        CalibratorConfig.from_mapping({"texture.check": 0, "texture.required": 1})


def test_part_of_a_count_is_refused_and_a_whole_float_is_taken():
    with pytest.raises(ConfigError, match=r"^genetic.population is 100\.5: a whole number is needed"):
        CalibratorConfig.from_mapping({"genetic.population": 100.5})
    config = CalibratorConfig.from_mapping({"genetic.population": 60.0, "search.height_max_m": 3})
    assert (config.genetic.population, type(config.genetic.population)) == (60, int)
    assert (config.search.height_max_m, type(config.search.height_max_m)) == (3.0, float)


@pytest.mark.parametrize(
    "values",
    [
        {"seed": 5, "search.height_max_m": 2.5, "search.roll_max_rad": 0.1},
        {"seed": 5, "search": {"height_max_m": 2.5, "roll_max_rad": 0.1}},
        {"seed": 5, "search": {"height_max_m": 2.5}, "search.roll_max_rad": 0.1},
    ],
    ids=["flat", "nested", "mixed"],
)
def test_flat_nested_and_mixed_mappings_are_the_same(values):
    default = CalibratorConfig()
    search = replace(default.search, height_max_m=2.5, roll_max_rad=0.1)
    assert CalibratorConfig.from_mapping(values) == replace(default, seed=5, search=search)


def test_empty_mapping_gives_the_defaults():
    assert CalibratorConfig.from_mapping({}) == CalibratorConfig()
    assert CalibratorConfig.from_mapping({"search": {}}) == CalibratorConfig()


@pytest.mark.parametrize(
    "values", [{"hight": 1}, {"search.hight": 1}, {"search": {"hight": 1}}, {"search": 1}, {"search.a.b": 1}]
)
def test_unknown_name_is_refused_with_the_known_ones(values):
    (name,) = flatten(values)
    with pytest.raises(
        ConfigError, match=rf"unknown setting '{name}': the settings are seed, search\.height"
    ):
        CalibratorConfig.from_mapping(values)


@pytest.mark.parametrize("low", [2.0, 3.0])
def test_heights_out_of_order_are_refused(low):
    with pytest.raises(
        ConfigError, match=r"height_min_m is .*height_max_m is 2\.0: the first must be the smaller"
    ):
        CalibratorConfig.from_mapping({"search.height_min_m": low, "search.height_max_m": 2.0})


def test_heights_may_move_beyond_the_old_limits_together():
    config = CalibratorConfig.from_mapping({"search.height_min_m": 5, "search.height_max_m": 6})
    assert (config.search.height_min_m, config.search.height_max_m) == (5.0, 6.0)


def test_settings_are_frozen():
    with pytest.raises(FrozenInstanceError):
        CalibratorConfig().seed = 1


def test_flatten():
    assert flatten({"a": 1, "b": {"c": 2, "d": {"e": 3}}}) == {"a": 1, "b.c": 2, "b.d.e": 3}
