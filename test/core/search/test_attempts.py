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

"""What a frame went through: each hypothesis that was solved is in the result, with verdict and reason."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, RejectReason
from stereo_selfcal.core.estimators.coarse_road import find_coarse_road
from stereo_selfcal.core.evidence import camera_turn, road_surface
from stereo_selfcal.core.evidence.frame_evidence import FoundBy, FrameObservations, Hypothesis
from stereo_selfcal.core.lanes import frame_checks
from stereo_selfcal.core.lanes.hypotheses import NoPattern
from stereo_selfcal.core.rejection import Bound, NotFitted
from stereo_selfcal.core.reservations import ReservationKind
from stereo_selfcal.core.search import solve, strategy
from stereo_selfcal.core.search.attempt import Verdict
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

LINES_ALONE = CalibratorConfig.from_mapping({"texture.check": 0})


@pytest.fixture(scope="module")
def textured():
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    return scene, render(scene, np.random.default_rng(0))


def raise_lines(monkeypatch, height_m):
    """Move every estimate from stripes up, as kerbs would: a gate refuses them all."""
    refine = solve.refine

    def kerb(*arguments):
        fit = refine(*arguments)
        return replace(fit, extrinsics=replace(fit.extrinsics, height_m=fit.extrinsics.height_m + height_m))

    monkeypatch.setattr(solve, "refine", kerb)


def test_lines_on_the_road_that_are_accepted_are_the_only_attempt(textured):
    scene, images = textured
    result = Calibrator(scene.rig).add(*images)
    (attempt,) = result.attempts
    assert attempt.accepted and attempt.verdict is Verdict.ACCEPTED and attempt.found_by is FoundBy.ROAD
    assert attempt.stages == result.stages and attempt.readings == result.gates
    assert list(attempt.stages) == ["coarse", "genetic", "closed_form", "refined", "textured", "combined"]
    assert attempt.estimate.pose == result.extrinsics == attempt.stages["combined"]
    assert attempt.message == "" and attempt.reason is None


def test_what_was_refused_before_is_told_with_pattern_readings_and_reason(textured, monkeypatch):
    """Where the fits of the lines differ, it is not known which one is right: the surface is still asked."""
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    *before, last = result.attempts
    assert before and last.accepted and last.found_by is FoundBy.SURFACE and last.pattern is None
    assert list(last.stages) == ["coarse", "textured"]
    for attempt in before:
        assert attempt.verdict is Verdict.REFUSED and attempt.found_by is FoundBy.ROAD
        assert attempt.reason is RejectReason.STAGES_DISAGREE
        assert attempt.message == attempt.rejection.message
        assert attempt.pattern is not None and "refined" in attempt.stages
        assert not attempt.readings[-1].passed and all(each.passed for each in attempt.readings[:-1])


def test_where_the_road_under_the_car_is_not_aligned_lines_are_found_without_it(textured, monkeypatch):
    """What is beside the car may be a pavement. The refusal is that of the lines of the whole image."""
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    align = road_surface.align_texture
    unseen = NotFitted("cells whose height is known", 3, Bound.LEAST, 6)
    monkeypatch.setattr(
        road_surface,
        "align_texture",
        lambda *args, **more: unseen if "limits_m" in more else align(*args, **more),
    )
    result = Calibrator(scene.rig).add(*images)
    assert not result.accepted and result.pattern is not None and result.gates
    assert {attempt.found_by for attempt in result.attempts} == {FoundBy.HOUGH}
    coarse, _ = find_coarse_road(images, scene.rig, CalibratorConfig().search, 0)
    surface = road_surface.find_road_surface(images, scene.rig, coarse)
    assert surface.seen is not None and surface.located is None
    assert surface.described == (
        "the road surface under the car alone does not align: "
        "cells whose height is known: 3, at least 6 needed"
    )


def test_rows_that_are_not_compared_leave_the_surface_alone_open(textured, monkeypatch):
    """One of the cameras may have turned. With points all over the images, it is known before."""
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    few = NotFitted("cells that tell the rows", 3, Bound.LEAST, 6)
    for module, compare in ((solve, "vertical_offset"), (camera_turn, "vertical_offset")):
        monkeypatch.setattr(module, compare, lambda *_: few)
    monkeypatch.setattr(camera_turn, "align_rows", lambda *_: few)
    result = Calibrator(scene.rig).add(*images)
    assert not result.accepted
    (surface,) = (each for each in result.attempts if each.found_by is FoundBy.SURFACE)
    assert surface.verdict is Verdict.NOT_FITTED
    assert surface.message.startswith("the rows of both images are not compared; cells that tell the rows: 3")


def test_lines_that_the_surface_contradicts_are_refused_and_nothing_else_is_asked(textured, monkeypatch):
    """A kerb and its face would be 0.1 m higher than the road, in every estimate from the lines."""
    scene, images = textured
    raise_lines(monkeypatch, 0.1)
    search = solve._search

    def raised(fitness, config):
        found = search(fitness, config)
        return replace(found, best=found.best + np.array([0.1, 0.0, 0.0]))

    monkeypatch.setattr(solve, "_search", raised)
    result = Calibrator(scene.rig).add(*images)
    (attempt,) = result.attempts
    assert attempt.refused_by == "surface_agrees" and result.reason is RejectReason.TEXTURE_DISAGREES
    assert result.rejection.value == pytest.approx(100.0, abs=5.0)


def surface_alone(scene, images, monkeypatch):
    """Return the result without any pair of lines on the road."""
    of_lines = strategy.lines_on_road

    def no_pair(*arguments):
        return replace(of_lines(*arguments), patterns=NoPattern(frame_checks.no_pair_on_road(1, 0)))

    monkeypatch.setattr(strategy, "lines_on_road", no_pair)
    return Calibrator(scene.rig).add(*images)


def test_a_road_without_lines_is_an_estimate_of_its_own(textured, monkeypatch):
    scene, images = textured
    result = surface_alone(scene, images, monkeypatch)
    (attempt,) = result.attempts
    assert attempt.accepted and attempt.found_by is FoundBy.SURFACE
    error = np.abs(result.extrinsics.as_array() - scene.extrinsics.as_array())
    assert np.all(error < 4.0 * result.std.as_array())
    assert result.lane_yaw_rad == pytest.approx(scene.lane_yaw_rad, abs=np.radians(0.2))
    assert [each.kind for each in result.reservations] == [ReservationKind.ONE_LINE_ONLY]
    # What no disparity can see is in it.
    assert {"vergence", "rectification"} < {term.name for term in result.uncertainty}


def test_without_any_line_the_yaw_is_unknown(textured, monkeypatch):
    scene, images = textured
    monkeypatch.setattr(solve, "yaw_of_line", lambda *_: None)
    result = surface_alone(scene, images, monkeypatch)
    assert result.accepted and result.lane_yaw_rad is None
    assert [each.kind for each in result.reservations] == [ReservationKind.NO_LINE_CONFIRMS]
    assert result.notes == ("from the road surface alone, without a lane line",)


def test_the_paper_alone_is_its_algorithm_and_nothing_else(textured):
    """No surface and no grey values of stripes: the genetic algorithm on lines by Hough."""
    scene, images = textured
    config = CalibratorConfig.from_mapping({"texture.check": 0, "refinement.stripes": 0})
    result = Calibrator(scene.rig, config).add(*images)
    assert result.accepted
    assert list(result.stages) == ["genetic", "closed_form"]
    assert result.extrinsics == result.stages["genetic"]
    notes = {each.kind: each.detail for each in result.reservations}
    assert notes[ReservationKind.NOT_REFINED].startswith("refinement.stripes: 0")
    error = np.abs(result.extrinsics.as_array() - scene.extrinsics.as_array())
    assert np.all(error < 4.0 * result.std.as_array())


def test_a_hypothesis_needs_lines_or_the_surface(textured):
    scene, images = textured
    frame = FrameObservations.from_images(images, scene.rig, LINES_ALONE)
    with pytest.raises(ValueError, match="pair of lines or the texture"):
        solve.solve(Hypothesis(FoundBy.SURFACE, None), frame, scene.rig, CalibratorConfig())


def test_what_is_remembered_of_a_frame_is_light(textured):
    scene, images = textured
    calibrator = Calibrator(scene.rig)
    result = calibrator.add(*images)
    assert calibrator.estimate.attempts == ()
    names = [[term.name for term in each.uncertainty] for each in (result, calibrator.estimate)]
    assert names[1] == [*names[0], "motion", "lean"]
    slim = result.attempts[0].slim()
    assert slim.pattern is None and slim.genetic is None
    assert slim.hypothesis.other_lines == ([], []) and slim.hypothesis.texture is None
    assert slim.verdict is Verdict.ACCEPTED and slim.readings == result.gates


def test_lines_alone_make_one_attempt_for_each_pair_of_the_first_choice(textured, monkeypatch):
    scene, images = textured
    raise_lines(monkeypatch, 0.07)
    result = Calibrator(scene.rig, LINES_ALONE).add(*images)
    assert {attempt.found_by for attempt in result.attempts} == {FoundBy.HOUGH}
    assert result.reason is RejectReason.STAGES_DISAGREE
