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

"""Random and named worlds: what they are made of, and what is expected of them."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal.core.calibrator import calibrate
from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.synth.regression_worlds import REGRESSION_WORLDS
from stereo_selfcal.synth.world_recipes import ALL, FIRST, INGREDIENTS
from stereo_selfcal.synth.worlds import (
    BAD_SHARE,
    DASHES,
    RIGS,
    named_world,
    painted_rows,
    random_world,
    render_named_world,
    render_world,
)

N_DRAWS = 1200


@pytest.fixture(scope="module")
def worlds():
    return [random_world(np.random.default_rng([1, index])) for index in range(N_DRAWS)]


def test_shares_of_good_and_bad_are_as_stated(worlds):
    count = Counter(world.expected for world in worlds)
    assert count["refuse"] / N_DRAWS == pytest.approx(BAD_SHARE, abs=0.07)
    assert 0.45 < count["accept"] / N_DRAWS < 0.65


def test_every_ingredient_rig_and_dash_occurs(worlds):
    assert {name for world in worlds for name in world.ingredients} == set(INGREDIENTS)
    assert {world.rig_name for world in worlds} == set(RIGS)
    roads = [
        world.scene for world in worlds if not world.scene.ridges
    ]  # sleepers of a railway are dashes too
    dashes = {(p.line.dash_m, p.line.gap_m) for scene in roads for p in scene.paints if p.line.dash_m}
    assert dashes == {lengths for lengths in DASHES.values() if lengths is not None}


def test_drawn_values_are_in_their_ranges(worlds):
    for world in worlds:
        scene = world.scene
        least_m, most_m = RIGS[world.rig_name].height_m
        assert least_m <= scene.pose.height_m <= most_m
        assert scene.left.photometry.noise_fraction <= 0.10
        assert scene.truth() == world.truth
        worst = {INGREDIENTS[name].expected for name in world.ingredients}
        assert world.expected == "refuse" if "refuse" in worst else world.expected in ("accept", "either")


def test_what_sets_the_same_is_in_a_world_once(worlds):
    for world in worlds:
        parts = [INGREDIENTS[name].part for name in world.ingredients if INGREDIENTS[name].part]
        assert len(parts) == len(set(parts))


def test_what_is_added_since_changes_no_world_of_the_first_catalogue():
    for name, drawn in REGRESSION_WORLDS.items():
        rng = np.random.default_rng([drawn.seed, drawn.index])
        assert named_world(name) == random_world(rng, FIRST)
    assert {item.name for item in FIRST.ingredients} <= set(INGREDIENTS)
    assert sum(ALL.rigs.values()) == pytest.approx(1.0)
    assert set(FIRST.rigs) < set(ALL.rigs) == set(RIGS)


def test_same_seed_same_world_and_same_bytes():
    first, again = (random_world(np.random.default_rng(3)) for _ in range(2))
    assert first == again
    for one, other in zip(
        render_world(first, np.random.default_rng(0)),
        render_world(again, np.random.default_rng(0)),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


def half_size(world):
    """Return a world as cameras of half as many rows and columns see it."""
    rig = world.scene.rig
    centre = {"cx": (rig.cx - 0.5) / 2, "cy": (rig.cy - 0.5) / 2}
    size = {"width": rig.width // 2, "height": rig.height // 2}
    return replace(
        world, scene=replace(world.scene, rig=replace(rig, **size, **centre, fx=rig.fx / 2, fy=rig.fy / 2))
    )


@cache
def plain_images():
    return render_world(half_size(named_world("plain")), np.random.default_rng(0))


@pytest.mark.parametrize("name", ["plain", *INGREDIENTS])
def test_named_worlds_show_their_ingredient(name):
    world = named_world(name)
    assert world.ingredients == (() if name == "plain" else (name,))
    assert world.expected == ("accept" if name == "plain" else INGREDIENTS[name].expected)
    left, right = render_world(half_size(world), np.random.default_rng(0))
    assert left.dtype == right.dtype == np.uint8
    assert left.shape == (240, 320)
    if name != "plain":
        plain = plain_images()
        assert (left != plain[0]).any() or (right != plain[1]).any()


@pytest.mark.parametrize("name", REGRESSION_WORLDS)
def test_worlds_of_old_faults_still_have_in_them_what_their_names_say(name):
    assert name not in INGREDIENTS
    drawn, world = REGRESSION_WORLDS[name], named_world(name)
    assert (world.rig_name, world.ingredients) == (drawn.rig_name, drawn.ingredients)


def test_a_world_of_an_old_fault_has_the_noise_it_had():
    world, *images = render_named_world("kerb_for_left_line")
    drawn = REGRESSION_WORLDS["kerb_for_left_line"]
    assert world.scene.left.photometry.noise_fraction > 0.0
    for one, other in zip(
        images,
        render_world(world, np.random.default_rng([drawn.seed, drawn.index, 1])),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


def test_unknown_world_is_refused():
    with pytest.raises(ConfigError, match="kerb_for_line"):
        named_world("volcano")


@pytest.mark.parametrize("name", ["plain", "double_line", "kerb", "shadows_across", "crown"])
def test_plain_good_worlds_calibrate_to_their_truth(name):
    world = named_world(name)
    result = calibrate(*render_world(world, np.random.default_rng(0)), world.scene.rig)
    assert result.accepted, result.message
    error = np.abs(result.extrinsics.as_array() - world.truth.as_array())
    assert (error < [0.01, np.radians(0.05), np.radians(0.25)]).all()


def test_rows_of_paint_are_counted():
    plain = named_world("plain")
    left, right = render_world(plain, np.random.default_rng(0))
    # To 80 m: the last rows before the horizon are not counted.
    rows = [(image[260:] > 150).any(axis=1).sum() + 260 - 220 for image in (left, right)]
    assert painted_rows(plain.scene) == pytest.approx(min(rows), abs=60)
    assert painted_rows(named_world("missing_line").scene) == 0
    bad = [random_world(np.random.default_rng([2, index])) for index in range(40)]
    assert all(painted_rows(world.scene) > 30 for world in bad if world.expected == "accept")
