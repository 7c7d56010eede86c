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

"""Uncertainty: the claimed covariance against many draws, the yaw of the lane, and the test for a bend."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import drawn, ideal_pattern, of_turned_camera

from stereo_selfcal import Calibrator, Extrinsics
from stereo_selfcal.core.config import FitnessConfig, GeneticConfig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.estimators.line_covariance import measure_bends, propagate
from stereo_selfcal.core.evidence.rig_unknowns import RigStd, changes_of_lines
from stereo_selfcal.core.numerics.genetic import maximise
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

CONFIG = FitnessConfig()
POSE = Extrinsics(1.2, 0.10, -0.03)
YAW = 0.02


def pattern_of(pose=POSE, yaw=YAW, **kwargs):
    return ideal_pattern(PAPER_RIG, pose, lane_yaw_rad=yaw, **kwargs)


def solve(pattern, pose):
    """Return the genetic result, searched near the pose: the optimum is the same, and sooner reached."""
    reach = np.array([0.2, 0.02, 0.1])
    config = GeneticConfig(tolerance=1e-4)  # of a box a twentieth as wide as usual
    fitness = PatternFitness(pattern, PAPER_RIG, CONFIG)
    centre = pose.as_array()
    return maximise(fitness, centre - reach, centre + reach, config, np.random.default_rng(0)).best


@pytest.mark.parametrize(("pose", "yaw"), [(POSE, YAW), (Extrinsics(1.6, 0.03, 0.02), -0.01)])
def test_claimed_covariance_is_that_of_many_solutions(pose, yaw):
    """Between 0.7 and 1.5: the claim takes one camera's E2, the minimum over both is a little better."""
    pattern, rng = pattern_of(pose, yaw), np.random.default_rng(1)
    claimed = propagate(pattern, PAPER_RIG, pose, CONFIG).covariance
    solutions = np.array([solve(drawn(pattern, rng), pose) for _ in range(60)])
    # 60 draws give a standard deviation to 9 %.
    ratio = np.sqrt(np.diag(claimed)) / solutions.std(axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.5)), ratio
    # A mean of 60 lies within three of its own standard deviations.
    bias = np.abs(solutions.mean(axis=0) - pose.as_array()) / (solutions.std(axis=0) / np.sqrt(60))
    assert np.all(bias < 3.0), bias


def test_covariance_is_symmetric_and_positive():
    covariance = propagate(pattern_of(), PAPER_RIG, POSE, CONFIG).covariance
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_twice_the_error_of_the_lines_is_twice_that_of_the_pose():
    one, two = (
        propagate(pattern_of(std=std), PAPER_RIG, POSE, CONFIG).covariance
        for std in ((0.02, 2e-4), (0.04, 4e-4))
    )
    # Numerical derivatives with steps of 1e-6.
    np.testing.assert_allclose(two, 4 * one, rtol=1e-6)


@pytest.mark.parametrize("yaw", [-0.03, -0.01, 0.0, 0.01, 0.03])
@pytest.mark.parametrize("lateral", [-0.4, 0.0, 0.4])
def test_yaw_is_positive_when_the_camera_points_left_of_the_lane(yaw, lateral):
    fit = propagate(pattern_of(yaw=yaw, lateral_m=lateral), PAPER_RIG, POSE, CONFIG)
    assert fit.lane_yaw_rad == pytest.approx(yaw, abs=1e-9)


def test_perfect_lines_leave_nothing_over():
    assert propagate(pattern_of(), PAPER_RIG, POSE, CONFIG).chi2 < 1e-9


def test_lines_that_agree_as_promised_leave_two():
    """chi2 of two degrees of freedom: mean 2, and a standard deviation of 2 for a single one."""
    rng, pattern = np.random.default_rng(0), pattern_of()
    values = [propagate(drawn(pattern, rng), PAPER_RIG, POSE, CONFIG).chi2 for _ in range(200)]
    # 200 draws: 2 / sqrt(200) = 0.14; three of them.
    assert np.mean(values) == pytest.approx(2.0, abs=0.45)


def test_lines_of_a_camera_as_little_turned_as_is_known_leave_two_as_well():
    """Right cameras drawn as the rig's standard deviations have it: a tenth of a pixel of the rows."""
    rng, pattern = np.random.default_rng(0), pattern_of()
    std = RigStd(math.radians(0.01), math.radians(0.03), math.radians(0.02), distortion_px=0.0)
    of_rig = changes_of_lines(pattern, PAPER_RIG, std)
    fits = []
    for _ in range(100):
        pitch, roll, yaw = rng.normal(size=3) * [std.pitch_rad, std.roll_rad, std.yaw_rad]
        turned = of_turned_camera(pattern, PAPER_RIG, pitch_rad=pitch, roll_rad=roll, yaw_rad=yaw)
        moved = drawn(turned, rng)
        fits.append([propagate(moved, PAPER_RIG, POSE, CONFIG, known) for known in (None, of_rig)])
    believed, known = np.array([[fit.chi2 for fit in pair] for pair in fits]).T
    assert believed.mean() > 20.0
    assert known.mean() == pytest.approx(2.0, abs=0.6)
    # The covariance is that of the lines alone: what is unknown of the rig is a term of its own.
    noise = propagate(pattern, PAPER_RIG, POSE, CONFIG).covariance
    np.testing.assert_allclose(propagate(pattern, PAPER_RIG, POSE, CONFIG, of_rig).covariance, noise)


def test_lines_that_disagree_enlarge_the_covariance():
    """One camera's lines 1 px lower: 50 times what they claim, and the covariance says so (Birge)."""

    def added(i, j, rows):
        return i * (1.0 if j else -1.0) + 0 * rows

    good, bad = (propagate(p, PAPER_RIG, POSE, CONFIG) for p in (pattern_of(), pattern_of(columns=added)))
    assert bad.chi2 > 100
    growth = np.sqrt(np.diag(bad.covariance) / np.diag(good.covariance))
    # The derivatives at another place differ by a little.
    np.testing.assert_allclose(growth, np.sqrt(bad.chi2 / 2), rtol=0.2)


def test_lines_that_coincide_leave_the_pose_undetermined():
    assert isinstance(
        propagate(pattern_of(positions_m=(1.75, 1.7500001)), PAPER_RIG, POSE, CONFIG), NotFitted
    )


@pytest.mark.parametrize("curvature_per_m", [1 / 800, -1 / 800, 1 / 300, -1 / 300])
@pytest.mark.parametrize("seed", [0, 1])
def test_curvature_of_a_bend_with_its_sign(seed, curvature_per_m):
    """Positive to the left; within 15 %, as the points were chosen by the fit of a straight line."""
    scene = random_scene(np.random.default_rng(seed), 0.01)
    scene = replace(scene, road=replace(scene.road, curvature_per_m=curvature_per_m))
    pattern = Calibrator(scene.rig).extract(*render(scene, np.random.default_rng(seed)))
    bends = measure_bends(pattern, scene.rig, scene.extrinsics.height_m)
    measured, std = bends.lateral_per_m, bends.lateral_std_per_m
    assert measured == pytest.approx(curvature_per_m, rel=0.15)
    # A bend stands out: the check asks for four standard deviations.
    assert abs(measured) > 4 * std


@pytest.mark.parametrize(("noise", "limit_per_m"), [(0.0, 1 / 10_000), (0.05, 1 / 2000), (0.10, 1 / 1000)])
def test_curvature_of_a_straight_road_is_nearly_zero(rendered, noise, limit_per_m):
    for seed in range(4):
        scene, left, right = rendered(seed, noise)
        pattern = Calibrator(scene.rig).extract(left, right)
        bends = measure_bends(pattern, scene.rig, scene.extrinsics.height_m)
        measured, std = bends.lateral_per_m, bends.lateral_std_per_m
        # The limits are multiples of the radius from which the calibrator refuses, 1000 m.
        assert abs(measured) < limit_per_m
        assert std < limit_per_m


def test_curvature_of_perfect_arcs():
    """A road point at distance x is k x^2 / 2 to the left, x from the row by the height of the camera."""
    pose, curvature = Extrinsics(1.4, 0.0, 0.0), 1 / 500
    horizon = PAPER_RIG.cy

    def added(_i, _j, rows):
        distance = PAPER_RIG.fy * pose.height_m / (rows - horizon)
        return -PAPER_RIG.fx * (curvature * distance**2 / 2) / distance

    pattern = pattern_of(pose, 0.0, columns=added)
    bends = measure_bends(pattern, PAPER_RIG, pose.height_m)
    assert bends.lateral_per_m == pytest.approx(curvature, rel=1e-6)
    assert bends.vertical_per_m == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("curvature", [1 / 20_000, -1 / 20_000])
def test_vertical_curvature_of_perfect_profiles(curvature):
    """A road point at distance x is c x^2 / 2 higher: seen in the row of a plane's point that is farther."""
    pose, lines_m = Extrinsics(1.4, 0.0, 0.0), (1.75, -1.75)
    horizon = PAPER_RIG.cy

    def added(i, j, rows):
        below = (rows - horizon) / PAPER_RIG.fy
        # below = (h - c x^2 / 2) / x, solved for x.
        distance = (-below + np.sqrt(below**2 + 2 * curvature * pose.height_m)) / curvature
        side = lines_m[j] - (0.5 - i) * PAPER_RIG.baseline_m
        return -PAPER_RIG.fx * side * (1 / distance - below / pose.height_m)

    bends = measure_bends(pattern_of(pose, 0.0, columns=added), PAPER_RIG, pose.height_m)
    # To first order in the rise over the height of the camera.
    assert bends.vertical_per_m == pytest.approx(curvature, rel=0.1)
    assert abs(bends.lateral_per_m) < 1e-6
