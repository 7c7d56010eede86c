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

"""Fitness: its greatest value at the truth, what it does not depend on, and one call for a population."""

from dataclasses import replace

import numpy as np
import pytest
from independent_camera import ideal_pattern

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.core.config import FitnessConfig
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.synth.scenes import PAPER_RIG

CONFIG = FitnessConfig()
LEAST = np.array([0.3, -0.35, -0.26])
GREATEST = np.array([4.0, 0.35, 0.26])
CASES = [
    (Extrinsics(1.4, 0.05, 0.02), 0.0, 0.0),
    (Extrinsics(1.2, 0.10, -0.03), 0.02, 0.3),
    (Extrinsics(2.0, -0.05, 0.10), -0.03, -0.4),
]


def population(n, seed=0):
    return np.random.default_rng(seed).uniform(LEAST, GREATEST, (n, 3))


def row(pose):
    return pose.as_array()[None]


def measured(case=CASES[1], std_px=0.3):
    """Return a pattern with errors: each line a little displaced and turned."""
    errors = np.random.default_rng(4).normal(0, std_px, (2, 2, 2))

    def added(i, j, rows):
        return errors[i, j, 0] + errors[i, j, 1] * (rows - rows.mean()) / 100

    return ideal_pattern(PAPER_RIG, case[0], lane_yaw_rad=case[1], lateral_m=case[2], columns=added)


@pytest.mark.parametrize("case", CASES)
def test_truth_has_the_greatest_fitness_there_is(case):
    pose, yaw, lateral = case
    fitness = PatternFitness(ideal_pattern(PAPER_RIG, pose, (1.75, -1.75), yaw, lateral), PAPER_RIG, CONFIG)
    assert fitness(row(pose))[0] == pytest.approx(1 / CONFIG.k, rel=1e-6)
    others = fitness(population(500))
    assert others.max() < 0.5 / CONFIG.k


def test_rectangular_pixels():
    rig = StereoRig(640, 480, 516.6, 774.9, 312.0, 247.0, 0.1481)
    pose = CASES[1][0]
    fitness = PatternFitness(ideal_pattern(rig, pose, lane_yaw_rad=0.02), rig, CONFIG)
    assert fitness(row(pose))[0] == pytest.approx(1 / CONFIG.k, rel=1e-6)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("case", CASES)
def test_fitness_falls_to_every_side_of_the_truth(case, axis, sign):
    pose, yaw, lateral = case
    fitness = PatternFitness(ideal_pattern(PAPER_RIG, pose, (1.75, -1.75), yaw, lateral), PAPER_RIG, CONFIG)
    step = sign * np.array([0.01, 0.001, 0.01])[axis] * np.eye(3)[axis]
    near, far = fitness(row(pose) + step)[0], fitness(row(pose) + 3 * step)[0]
    assert far < near < 0.9 / CONFIG.k


def test_every_fitness_is_above_zero_and_at_most_one_over_k():
    for k in (1e-4, 1e-2):
        values = PatternFitness(measured(), PAPER_RIG, replace(CONFIG, k=k))(population(2000))
        assert np.all((values > 0) & (values <= 1 / k))


def test_fitness_is_the_smaller_of_both_terms():
    """min(1 / (E1 + K), 1 / (E2 + K)), section 2.3."""
    fitness = PatternFitness(measured(), PAPER_RIG, CONFIG)
    candidates = population(200)
    matching, parallelism = fitness.errors(candidates)
    assert (matching > parallelism).any()
    assert (matching < parallelism).any()
    expected = np.minimum(1 / (matching + CONFIG.k), 1 / (parallelism + CONFIG.k))
    np.testing.assert_allclose(fitness(candidates), expected, rtol=1e-12)


def test_whole_population_in_one_call_is_the_same_as_one_by_one():
    fitness = PatternFitness(measured(), PAPER_RIG, CONFIG)
    candidates = population(100)
    one_by_one = np.concatenate([fitness(candidate[None]) for candidate in candidates])
    # Matrix products of other sizes add up in another order.
    np.testing.assert_allclose(fitness(candidates), one_by_one, rtol=1e-9)


def test_evaluations_are_counted():
    fitness = PatternFitness(measured(), PAPER_RIG, CONFIG)
    assert fitness.evaluations == 0
    fitness(population(100))
    fitness(population(7))
    assert fitness.evaluations == 107


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("factor", [0.9, 0.5, 0.25, 0.1])
def test_lowering_the_height_gains_nothing(case, factor):
    """In metres every distance shrinks with the height; in pixels the misfit grows."""
    fitness = PatternFitness(measured(case), PAPER_RIG, CONFIG)
    truth, lower = row(case[0]), row(replace(case[0], height_m=factor * case[0].height_m))
    at_truth, at_lower = fitness.errors(truth)[0][0], fitness.errors(lower)[0][0]
    assert at_lower > at_truth
    assert fitness(lower)[0] <= fitness(truth)[0]
    # From any other candidate, too: what matters is the pose, not the scale. (A tenth may even help one
    # whose pitch is wrong: it brings the predicted disparities closer on average.)
    if factor == 0.9:
        return
    wrong = row(case[0]) * [1.0, 1.5, 1.0]
    assert fitness.errors(wrong * [factor, 1, 1])[0][0] > 0.5 * fitness.errors(wrong)[0][0]


def test_a_world_twice_as_large_looks_the_same():
    """Baseline and height doubled: the same pictures, hence the same errors of every candidate."""
    pattern = measured()
    large = replace(PAPER_RIG, baseline_m=2 * PAPER_RIG.baseline_m)
    # Near the truth, where all points lie on the road: those in the sky are put at a fixed distance.
    near = CASES[1][0].as_array() + np.random.default_rng(0).uniform(-0.01, 0.01, (50, 3))
    small_errors = PatternFitness(pattern, PAPER_RIG, CONFIG).errors(near)
    large_errors = PatternFitness(pattern, large, CONFIG).errors(near * [2, 1, 1])
    for one, other in zip(small_errors, large_errors, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-9)


@pytest.mark.parametrize("straight", [0, 1])
def test_one_camera_that_sees_parallel_lines_is_enough(straight):
    """E2 is the minimum over the cameras: turn a line of one of them, and the other one decides."""

    def added(i, j, rows):
        return 0.2 * (rows - rows.mean()) if (i, j) == (1 - straight, 0) else 0.0 * rows

    pose = CASES[0][0]
    fitness = PatternFitness(ideal_pattern(PAPER_RIG, pose, columns=added), PAPER_RIG, CONFIG)
    matching, parallelism = fitness.errors(row(pose))
    assert parallelism[0] < 1e-12
    assert matching[0] > 1.0
    angles = fitness.linear_terms(pose.as_array())[1]
    assert abs(angles[straight]) < 1e-6 < abs(angles[1 - straight])


def test_both_cameras_with_turned_lines_are_not_parallel():
    pose = CASES[0][0]
    pattern = ideal_pattern(PAPER_RIG, pose, columns=lambda i, j, rows: 0.02 * j * (rows - rows.mean()))
    assert PatternFitness(pattern, PAPER_RIG, CONFIG).errors(row(pose))[1][0] > 1.0


def test_parallel_weight_multiplies_the_angle():
    pattern, candidates = measured(), population(20)
    light, heavy = (
        PatternFitness(pattern, PAPER_RIG, replace(CONFIG, parallel_weight=weight)).errors(candidates)
        for weight in (1.0, 10.0)
    )
    np.testing.assert_array_equal(heavy[0], light[0])
    np.testing.assert_allclose(heavy[1], 100 * light[1])


def test_linear_terms_are_what_the_errors_are_made_of():
    fitness = PatternFitness(measured(), PAPER_RIG, CONFIG)
    for candidate in population(20):
        distances, angles = fitness.linear_terms(candidate)
        matching, parallelism = fitness.errors(candidate[None])
        assert np.mean(distances**2) == pytest.approx(matching[0])
        assert (CONFIG.parallel_weight * np.abs(angles).min()) ** 2 == pytest.approx(parallelism[0])


def test_candidates_that_see_points_above_the_horizon_stay_finite():
    """Nose far up: all the sampled points would lie in the sky, and the fitness still has to rank them."""
    fitness = PatternFitness(measured(), PAPER_RIG, CONFIG)
    skyward = np.array([[1.4, pitch, roll] for pitch in (-0.6, -0.3, 0.3, 0.6) for roll in (-0.5, 0.0, 0.5)])
    values = fitness(skyward)
    assert np.all(np.isfinite(values))
    assert np.all((values > 0) & (values < 1.0))


def test_misfit_is_in_pixels():
    """A disparity wrong by d px everywhere is a misfit of about d px near the truth."""
    pose = CASES[0][0]
    for wrong_px in (0.1, 1.0):
        pattern = ideal_pattern(PAPER_RIG, pose, columns=lambda i, j, rows, d=wrong_px: i * d + 0 * rows)
        distances = PatternFitness(pattern, PAPER_RIG, CONFIG).linear_terms(pose.as_array())[0]
        sideways = distances[len(distances) // 2 :]
        assert np.median(np.abs(sideways)) == pytest.approx(wrong_px, rel=0.05)
