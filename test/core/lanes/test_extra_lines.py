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

"""Lines beside the two boundaries of a lane: which of them are taken, and what they are good for."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.estimators.stripe_fit import refine
from stereo_selfcal.core.lanes.closed_form import point_weights
from stereo_selfcal.core.lanes.extra_lines import find_extra_lines
from stereo_selfcal.core.lanes.hypotheses import find_hypotheses
from stereo_selfcal.core.lanes.lane_pair import ExtraLine
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.search import strategy
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

CONFIG = CalibratorConfig()
POSE = Extrinsics(1.4, 0.05, 0.01)


def with_lines(seed, *beside_m, noise=0.05, **changes):
    """Return a random scene with more solid lines, so far to the left of the left one, and its images."""
    scene = random_scene(np.random.default_rng(seed), noise)
    boundary = scene.road.lines[0]
    others = [replace(boundary, offset_m=boundary.offset_m + beside, **changes) for beside in beside_m]
    scene = replace(scene, road=replace(scene.road, lines=(*scene.road.lines, *others)))
    return scene, render(scene, np.random.default_rng(100 + seed))


@cache
def found(*beside_m, **changes):
    """Return the scene, its images, the boundaries and the lines that are found beside them."""
    scene, images = with_lines(1, *beside_m, **changes)
    points = tuple(find_stripe_points(image, CONFIG.extraction) for image in images)
    seen = find_hypotheses(points, images, scene.rig, CONFIG)
    boundaries = seen.patterns[0]
    return scene, images, boundaries, find_extra_lines(boundaries, seen.matches, points, scene.rig, CONFIG)


def test_a_lane_of_two_lines_has_no_others():
    assert found()[3] == ()


@pytest.mark.parametrize("beside_m", [0.35, 1.2])
def test_a_line_beside_is_found_once(beside_m):
    _, _, boundaries, lines = found(beside_m)
    # The outermost of the three makes the plane or is the one beside it: all are in the pattern.
    joined = boundaries.joined(lines)
    assert len(lines) == 1
    assert joined.columns.shape == (2, 3, len(joined.rows))
    np.testing.assert_allclose(joined.columns[0, 2], lines[0].left.column_at(joined.rows))
    np.testing.assert_array_equal(joined.boundaries.columns, boundaries.columns)


def test_a_line_of_another_direction_is_left_out():
    """The boundaries of the right camera are turned, so that those of both no longer meet where it does."""
    scene, images, boundaries, lines = found(0.35)
    assert lines
    points = tuple(find_stripe_points(image, CONFIG.extraction) for image in images)
    seen = find_hypotheses(points, images, scene.rig, CONFIG)
    moved = replace(boundaries, right=tuple(replace(r, slope=r.slope + 0.03) for r in boundaries.right))
    assert not find_extra_lines(moved, seen.matches, points, scene.rig, CONFIG)


def third(height_m=0.0, std_m=0.01, turn=0.0):
    """Return two perfect boundaries and a line 1 m beside them, at a height over the road."""
    pattern = ideal_pattern(PAPER_RIG, POSE)
    other = ideal_pattern(PAPER_RIG, replace(POSE, height_m=POSE.height_m - height_m), (2.75, -1.75))
    left, right = (replace(line, slope=line.slope + turn) for line in (other.left[0], other.right[0]))
    return pattern.joined((ExtraLine(left, right, std_m),))


def test_a_perfect_line_beside_changes_no_error():
    at = POSE.as_array()[None]
    for error in PatternFitness(third(), PAPER_RIG, CONFIG.fitness).errors(at):
        assert error[0] < 1e-12


def test_points_beside_the_plane_count_by_how_sure_they_are():
    """E1 is the weighted mean square of (disparity of the plane - measured disparity), point by point."""
    candidate = POSE.as_array() + np.array([0.02, 0.001, 0.002])
    for std_m in (0.001, 0.01, 0.1):
        pattern = third(height_m=0.05, std_m=std_m)
        fitness = PatternFitness(pattern, PAPER_RIG, CONFIG.fitness)
        misses = fitness.linear_terms(candidate)[0]
        weights = point_weights(pattern)
        expected = np.sum(weights * misses**2) / np.sum(weights)
        assert fitness.errors(candidate[None])[0][0] == pytest.approx(expected, rel=1e-9)
        n = len(pattern.rows)
        assert np.all(weights[: 2 * n] == 1.0)
        assert weights[-1] == pytest.approx(1.0 / (1.0 + (std_m / 0.01) ** 2))


def test_a_line_at_its_own_height_is_seen_parallel():
    """That is why it is worth having: 5 cm over the plane it says where the road leads all the same."""
    at = POSE.as_array()[None]
    assert PatternFitness(third(height_m=0.05), PAPER_RIG, CONFIG.fitness).errors(at)[1][0] < 1e-9


def test_angles_of_lines_beside_count_the_less_the_more_those_of_the_boundaries_count():
    at = POSE.as_array()[None]
    light, heavy = (
        PatternFitness(third(turn=0.01), PAPER_RIG, replace(CONFIG.fitness, parallel_weight=weight)).errors(
            at
        )[1][0]
        for weight in (1.0, 10.0)
    )
    assert light > 0.1
    assert heavy == pytest.approx(light / 100.0)


def test_refinement_is_surer_with_a_double_line_and_right():
    scene, images, boundaries, lines = found(0.35)
    start = Extrinsics.from_array(scene.extrinsics.as_array() + np.array([0.005, 0.0005, 0.001]))
    alone = refine(images, boundaries, scene.rig, start)
    more = refine(images, boundaries.joined(lines), scene.rig, start)
    assert alone.heights_m.tolist() == [0.0, 0.0]
    assert more.heights_m[:2].tolist() == [0.0, 0.0]
    assert abs(more.heights_m[2]) < 0.02
    assert more.covariance[1, 1] < 0.9 * alone.covariance[1, 1]
    error = more.extrinsics.as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(more.covariance)))


def test_a_line_of_unknown_height_says_nothing_of_the_height():
    scene, images, boundaries, lines = found(0.35)
    free = tuple(replace(line, height_std_m=10.0) for line in lines)
    fit = refine(images, boundaries.joined(free), scene.rig, scene.extrinsics)
    alone = refine(images, boundaries, scene.rig, scene.extrinsics)
    assert fit.extrinsics.height_m == pytest.approx(alone.extrinsics.height_m, abs=1e-3)
    assert math.sqrt(fit.covariance[0, 0]) == pytest.approx(math.sqrt(alone.covariance[0, 0]), rel=0.2)


def test_lines_that_spoil_the_fit_are_left_out(monkeypatch):
    scene, images = with_lines(1, 0.35)

    def raised(pattern, *_):
        left, right = pattern.left[0], pattern.right[0]
        return (ExtraLine(left, replace(right, slope=right.slope - 0.05), 1e-4),)

    monkeypatch.setattr(strategy, "find_extra_lines", raised)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    assert result.pattern.extra_lines == ()


def test_calibrator_takes_them_in_and_tells_the_others():
    scene, images = with_lines(1, 0.35)
    result = Calibrator(scene.rig).add(*images)
    assert result.accepted
    assert len(result.pattern.extra_lines) == 1
    assert not result.unused_lines
