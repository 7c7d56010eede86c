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

"""Cross-check by the texture: agreement, no texture, and lines that lie in another plane."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, RejectReason
from stereo_selfcal.core.evidence import cross_checks, road_surface
from stereo_selfcal.core.rejection import Bound, NotFitted
from stereo_selfcal.core.search import solve
from stereo_selfcal.core.tolerances import AGREEMENT
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

LINES_ALONE = CalibratorConfig.from_mapping({"texture.check": 0})


def coarse_asphalt(texture_amplitude):
    """Return a scene and its frame without noise: what the texture says is clear, or there is none."""
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    return scene, render(scene, np.random.default_rng(0))


def test_the_asphalt_agrees_and_is_a_stage():
    scene, images = coarse_asphalt(12.0)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    assert list(result.stages)[-2:] == ["textured", "combined"]
    assert result.extrinsics == result.stages["combined"]
    assert not any("texture of the road surface" in note for note in result.notes)
    difference = result.stages["textured"].as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(difference) < [0.030, math.radians(0.25), math.radians(0.8)])


def test_without_texture_the_lines_stand_alone_and_say_so():
    scene, images = coarse_asphalt(0.0)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    assert "textured" not in result.stages
    assert "not checked against the texture of the road surface" in result.message


def test_without_texture_nothing_is_accepted_where_it_is_required():
    scene, images = coarse_asphalt(0.0)
    result = Calibrator(scene.rig, CalibratorConfig.from_mapping({"texture.required": 1})).add(*images)
    assert result.reason is RejectReason.ROAD_WITHOUT_TEXTURE
    assert result.extrinsics is None
    assert "refined" in result.stages
    assert [gate.name for gate in result.gates if not gate.passed] == ["texture_sufficient"]


def test_with_texture_it_makes_no_difference_that_it_is_required():
    scene, images = coarse_asphalt(12.0)
    free = Calibrator(scene.rig).add(*images)
    required = Calibrator(scene.rig, CalibratorConfig.from_mapping({"texture.required": 1})).add(*images)
    assert required.accepted
    assert required.extrinsics == free.extrinsics


def raised(monkeypatch, height_m):
    """Move the estimate from lines up, as kerbs would."""
    refine = solve.refine

    def kerb(*arguments):
        fit = refine(*arguments)
        return replace(fit, extrinsics=replace(fit.extrinsics, height_m=fit.extrinsics.height_m + height_m))

    monkeypatch.setattr(solve, "refine", kerb)


@pytest.mark.parametrize("beyond_too", [True, False])
def test_lines_on_another_plane_than_the_asphalt_are_refused(monkeypatch, beyond_too):
    """Than that between them alone, or than all of it; where the surface did not show the way to them."""
    scene, images = coarse_asphalt(12.0)
    align = cross_checks.align_texture

    def lower(*arguments, limits_m, **settings):
        fit = align(*arguments, limits_m=limits_m, **settings)
        beyond = limits_m[1] > max(line.offset_m for line in scene.road.lines) - scene.lateral_offset_m
        down_m = 0.07 * (beyond == beyond_too)
        return replace(fit, extrinsics=replace(fit.extrinsics, height_m=fit.extrinsics.height_m + down_m))

    monkeypatch.setattr(cross_checks, "align_texture", lower)
    few = NotFitted("cells whose height is known", 3, Bound.LEAST, 6)
    monkeypatch.setattr(road_surface, "align_texture", lambda *_, **__: few)
    assert Calibrator(scene.rig, LINES_ALONE).add(*images).accepted
    result = Calibrator(scene.rig).add(*images)
    assert result.reason is RejectReason.TEXTURE_DISAGREES
    assert result.extrinsics is None
    assert {"genetic", "refined"} <= set(result.stages)
    assert ("textured" in result.stages) == beyond_too  # else that of the lane says otherwise
    assert "road surface" in result.message
    assert not result.gates[-1].passed and all(gate.passed for gate in result.gates[:-1])


def test_grey_values_that_lead_away_from_the_lines_are_refused(monkeypatch):
    scene, images = coarse_asphalt(12.0)
    raised(monkeypatch, 0.07)
    assert Calibrator(scene.rig, LINES_ALONE).add(*images).reason is RejectReason.STAGES_DISAGREE


def test_the_asphalt_stands_with_one_line_where_two_contradict_it(monkeypatch):
    """The accepted pose is that of the road surface alone; the raised lines add nothing to it."""
    scene, images = coarse_asphalt(12.0)
    raised(monkeypatch, 0.07)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    assert list(result.stages) == ["coarse", "textured"]
    assert "one line only" in result.message
    difference = result.extrinsics.as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(difference) < AGREEMENT)
    assert abs(result.lane_yaw_rad - scene.lane_yaw_rad) < math.radians(0.5)


@pytest.mark.parametrize("gone", [0, 1])
def test_one_line_and_asphalt_are_a_road(gone):
    """One line alone does not determine the roll; with the texture beside it, the pose is right."""
    scene, _ = coarse_asphalt(12.0)
    left = tuple(line for i, line in enumerate(scene.road.lines) if i != gone)
    scene = replace(scene, road=replace(scene.road, lines=left))
    images = render(scene, np.random.default_rng(0))
    assert not Calibrator(scene.rig, LINES_ALONE).add(*images).accepted
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted, result.message
    difference = result.extrinsics.as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(difference) < AGREEMENT)


def test_a_road_without_any_line_is_an_estimate_whose_yaw_is_unknown():
    """Where a road leads is known by its lines alone."""
    scene, _ = coarse_asphalt(12.0)
    scene = replace(scene, road=replace(scene.road, lines=()))
    result = Calibrator(scene.rig).add(*render(scene, np.random.default_rng(0)))
    assert result.accepted, result.message
    assert result.lane_yaw_rad is None and result.pattern is None
    assert list(result.stages) == ["coarse", "textured"]
    assert result.notes == ("from the road surface alone, without a lane line",)
    difference = np.abs(result.extrinsics.as_array() - scene.extrinsics.as_array())
    assert np.all(difference < AGREEMENT) and np.all(difference < 4.0 * result.std.as_array())


def test_a_bare_road_without_any_line_is_not_seen():
    scene, _ = coarse_asphalt(0.0)
    scene = replace(scene, road=replace(scene.road, lines=()))
    result = Calibrator(scene.rig).add(*render(scene, np.random.default_rng(0)))
    assert result.reason is RejectReason.ROAD_NOT_SEEN
    assert "neither the road surface nor a lane line is seen" in result.message
    assert result.attempts == ()
