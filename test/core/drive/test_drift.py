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

"""The statistic of a change: on frames without scatter, where each of its parts stands alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal.core.drive.drift import Reference, Scatter, find_change, measure_scatter
from stereo_selfcal.core.drive.frame_series import FrameSeries
from stereo_selfcal.core.tolerances import WANDER_STD

STEP_S = 30.0  # farther apart than motion lasts
MOTION = np.array([0.004, 0.001, 0.002]) ** 2


def series(values, noise=1e-4, step_s=STEP_S):
    values = np.array(values, dtype=float)
    n = len(values)
    return FrameSeries.of(step_s * np.arange(n), values, np.full((n, 3), noise**2))


def still(n, value=0.0):
    return series(np.full((n, 3), value))


def known(variance=1e-12):
    return Reference(np.zeros(3), np.full(3, variance), moments=np.zeros(3))


def test_load_and_fuel_may_move_a_camera_however_many_frames_there_are():
    scatter = Scatter(np.full(3, 1e-14), np.ones(3), np.full(3, 10.0))
    change = find_change(series(np.zeros((2000, 3)), noise=1e-7), known(), scatter)
    np.testing.assert_allclose(change.std, WANDER_STD, rtol=0.01)


def test_the_deviation_is_that_of_both_means_inflated_by_what_repeats():
    scatter = Scatter(MOTION, np.array([1.0, 2.0, 4.0]), np.full(3, 10.0))
    n, variance = 40, 1e-8
    change = find_change(series(np.zeros((n, 3)), noise=math.sqrt(variance)), None, scatter)
    after, before = n - change.split, change.split
    # Frames that scatter less than they may be expected to do not make the road smoother.
    expected = (MOTION + variance) * scatter.inflation * (1.0 / after + 1.0 / before) + WANDER_STD**2
    np.testing.assert_allclose(change.std, np.sqrt(expected), rtol=1e-6)


@pytest.mark.parametrize(
    ("freedom", "t", "normal"), [(10.0, 2.228, 1.960), (10.0, 3.581, 2.807), (30.0, 2.042, 1.960)]
)
def test_a_scatter_that_is_known_little_makes_a_deviation_less_sure(freedom, t, normal):
    """Points of Student's distribution and of the normal one with the same tail, from tables."""
    scatter = Scatter(MOTION, np.ones(3), np.full(3, freedom))
    std = find_change(still(40), known(), scatter).std[0]
    for sign in (-1.0, 1.0):
        moved = np.zeros((40, 3))
        moved[:, 0] = sign * t * std
        change = find_change(series(moved), known(), scatter)
        # All of the frames, or those since a moment: the best is that of all.
        assert change.split == 0 and change.axis == 0
        assert change.z[0] == pytest.approx(sign * normal, abs=0.01)
        assert change.drift[0] / change.std[0] == pytest.approx(sign * t, rel=0.01)


def test_frames_that_alternate_are_no_more_than_independent():
    """Chance, or a road that is bent to and fro: it must not make a mean surer than so many frames do."""
    values = np.zeros((60, 3))
    values[::2], values[1::2] = 0.01, -0.01
    inflation = measure_scatter(series(values, step_s=1.0)).inflation
    assert np.all(inflation >= 1.0) and np.all(inflation < 1.2)


def wandering(n, kept, seed):
    values = np.zeros((n, 3))
    rng = np.random.default_rng(seed)
    now = rng.normal(size=3)
    for i in range(n):
        values[i] = now * [0.005, 0.003, 0.003]
        now = kept * now + math.sqrt(1.0 - kept**2) * rng.normal(size=3)
    return values


def test_frames_that_repeat_each_other_count_for_fewer():
    measured = [measure_scatter(series(wandering(400, 0.8, seed), step_s=1.0)) for seed in range(4)]
    # (1 + 0.8) / (1 - 0.8) is 9. In 400 frames are some forty moments, so that one drive tells it to a third.
    inflation = np.exp(np.mean([np.log(each.inflation) for each in measured]))
    assert 6.5 < inflation < 12.5
    far_apart = measure_scatter(series(wandering(400, 0.0, 0), step_s=1.0)).inflation
    assert np.all(far_apart < 1.4)


def test_a_change_is_no_scatter_about_the_means_before_and_after_it():
    values = wandering(200, 0.0, 1)
    values[120:] += 0.1
    scatter = measure_scatter(series(values, step_s=1.0), split=120)
    np.testing.assert_allclose(np.sqrt(scatter.motion), [0.005, 0.003, 0.003], rtol=0.2)
    assert np.all(measure_scatter(series(values, step_s=1.0)).motion > 10.0 * scatter.motion)


def test_the_more_frames_the_better_is_their_scatter_known():
    freedom = [measure_scatter(series(wandering(400, 0.0, 2)[:n], step_s=1.0)).freedom for n in (5, 40, 400)]
    assert np.all(freedom[0] < freedom[1]) and np.all(freedom[1] < freedom[2])
    # The size of a motion that the prior alone tells is known to a factor of two: one degree of freedom.
    assert np.all(freedom[0] < 4.0) and np.all(freedom[2] > 10.0)


def test_outliers_do_not_scatter():
    values = wandering(100, 0.0, 3)
    clean = series(values, step_s=1.0)
    values[::10] += 1.0
    used = np.arange(100) % 10 != 0
    wild = replace(series(values, step_s=1.0), used=used)
    np.testing.assert_allclose(
        measure_scatter(wild).motion, measure_scatter(clean.part(used)).motion, rtol=1e-9
    )
