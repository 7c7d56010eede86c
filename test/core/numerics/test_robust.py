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

import math

import numpy as np
import pytest

from stereo_selfcal.core.numerics.robust import (
    TUKEY_SIGMAS,
    Reweighting,
    fit_reweighted,
    scale_by_median,
    tukey_weights,
)
from stereo_selfcal.core.numerics.statistics import median
from stereo_selfcal.core.rejection import Bound, NotFitted

SCALE = scale_by_median(1e-9)
UNDETERMINED = NotFitted("numbers that are determined", 1, Bound.LEAST, 2)


def line_fit(x, y):
    """Return the weighted least squares fit of y = a + b x, as fit_reweighted takes it."""
    design = np.column_stack([np.ones_like(x), x])

    def fit(weights, _):
        normal = (design.T * weights) @ design
        if np.linalg.matrix_rank(normal) < 2:
            return UNDETERMINED
        solution = np.linalg.solve(normal, (design.T * weights) @ y)
        return solution, y - design @ solution

    return fit


def test_weight_is_one_without_a_residual_and_none_from_the_limit_on():
    assert tukey_weights(np.array([0.0, 0.25, 1.0, 9.0])).tolist() == [1.0, 0.75**2, 0.0, 0.0]


def test_an_outlier_keeps_the_least_weight():
    assert tukey_weights(np.array([0.0, 1.0, 1e6]), 1e-4).tolist() == [1.0, 1e-4, 1e-4]


def test_weights_are_of_the_precision_of_the_residuals_and_leave_them_alone():
    squares = np.array([0.5, 2.0], np.float32)
    assert tukey_weights(squares).dtype == np.float32
    assert squares.tolist() == [0.5, 2.0]


def test_scale_is_the_standard_deviation_of_normal_residuals_whatever_a_few_outliers_are():
    residuals = 0.3 * np.random.default_rng(0).standard_normal(20_001)
    assert scale_by_median(0.0)(residuals) == pytest.approx(0.3, rel=0.02)
    residuals[:500] = 1e9
    assert scale_by_median(0.0)(residuals) == pytest.approx(0.3, rel=0.06)


def test_scale_is_not_less_than_the_least_and_uses_the_median_given():
    assert scale_by_median(0.5)(np.array([0.1, -0.1, 0.1])) == 0.5
    residuals = np.array([0.0, 0.0, 1.0, 1.0])
    assert scale_by_median(0.0)(residuals) == pytest.approx(1.4826)
    assert scale_by_median(0.0, median)(residuals) == pytest.approx(0.7413)


def test_without_outliers_the_fit_is_exact():
    x = np.linspace(-1.0, 1.0, 9)
    found = fit_reweighted(line_fit(x, 2.0 - 3.0 * x), 9, Reweighting(rounds=4), SCALE)
    assert found.solution == pytest.approx([2.0, -3.0])
    assert np.all(found.weights > 0.99)
    assert found.scale == 1e-9


def test_outliers_lose_all_of_their_weight():
    x = np.linspace(-1.0, 1.0, 21)
    y = 2.0 - 3.0 * x + 0.01 * np.cos(40.0 * x)
    outliers = [3, 10, 17]
    y[outliers] += [5.0, 7.0, 4.0]
    found = fit_reweighted(line_fit(x, y), 21, Reweighting(rounds=10), SCALE)
    assert found.solution == pytest.approx([2.0, -3.0], abs=0.01)
    assert np.flatnonzero(found.weights == 0.0).tolist() == outliers
    assert found.scale < 0.02


def test_least_absolute_deviations_first_bear_outliers_that_least_squares_do_not():
    """A third of the points lies ten higher: squares take them for a part of a broad scatter."""
    x = np.linspace(0.0, 1.0, 30)
    y = 0.01 * np.sin(50.0 * x)
    y[::3] += 10.0
    squares, absolute = (
        fit_reweighted(line_fit(x, y), 30, Reweighting(rounds=3, absolute_rounds=n), SCALE) for n in (0, 8)
    )
    assert np.abs(absolute.solution).max() < 0.02
    assert np.abs(squares.solution).max() > 1.0


def test_efficient_for_normal_errors():
    """95 % of the efficiency of the mean, which is best for them."""
    rng = np.random.default_rng(1)
    means, robust = [], []
    for _ in range(2000):
        y = rng.standard_normal(50)

        def fit(weights, _, y=y):
            mean = float(np.average(y, weights=weights))
            return mean, y - mean

        means.append(y.mean())
        robust.append(fit_reweighted(fit, 50, Reweighting(rounds=10), SCALE).solution)
    assert np.var(means) / np.var(robust) == pytest.approx(0.95, abs=0.03)


def test_an_undetermined_fit_says_why():
    x = np.ones(5)
    assert fit_reweighted(line_fit(x, x), 5, Reweighting(rounds=3), SCALE) is UNDETERMINED


def test_a_fit_whose_outliers_leave_too_little_says_why():
    """All points but one are on one place; without that one, which is an outlier, there is no slope."""
    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    calls = []

    def fit(weights, _):
        calls.append(weights)
        found = line_fit(x, x)(weights, 1.0)
        if found is UNDETERMINED:
            return found
        return found[0], np.array([0.1, -0.1, 0.1, -0.1, 0.1, 50.0])

    assert fit_reweighted(fit, 6, Reweighting(rounds=3), SCALE) is UNDETERMINED
    assert [weights[-1] for weights in calls] == [1.0, 0.0]


def test_weights_returned_are_those_of_the_last_residuals():
    x = np.linspace(-1.0, 1.0, 11)
    y = np.sin(9.0 * x)
    found = fit_reweighted(line_fit(x, y), 11, Reweighting(rounds=3), SCALE)
    assert found.weights == pytest.approx(tukey_weights((found.residuals / TUKEY_SIGMAS / found.scale) ** 2))


def test_ends_when_the_scale_has_settled_but_not_in_the_first_round():
    rounds = []

    def fit(weights, _):
        rounds.append(weights)
        return UNDETERMINED if len(rounds) > 40 else (0.0, np.array([1.0, -1.0, 1.0]) / 1.4826)

    fit_reweighted(fit, 3, Reweighting(rounds=40, settled=1e-3), SCALE)  # a scale of 1, as is assumed before
    assert len(rounds) == 2
    rounds.clear()
    fit_reweighted(fit, 3, Reweighting(rounds=7), SCALE)
    assert len(rounds) == 7


def test_every_observation_may_have_a_scale_of_its_own():
    """Two groups about zero, one scatters ten times as much: none of it is an outlier."""
    y = np.concatenate([np.tile([0.1, -0.1], 5), np.tile([1.0, -1.0], 5)])
    scales = []

    def fit(weights, scale):
        scales.append(scale)
        return 0.0, y

    def scale_of(residuals):
        return np.repeat([SCALE(residuals[:10]), SCALE(residuals[10:])], 10)

    found = fit_reweighted(fit, 20, Reweighting(rounds=2), scale_of)
    assert found.weights == pytest.approx((1.0 - (1.0 / 1.4826 / TUKEY_SIGMAS) ** 2) ** 2)
    assert scales[0] == 1.0
    assert scales[1] == pytest.approx(np.repeat([0.14826, 1.4826], 10))


def test_residuals_may_come_as_squares():
    """Of deviances, limit and scale are those of squares."""

    def fit(weights, _):
        return 0.0, np.array([1.0, 4.0, 9.0, 40.0])

    found = fit_reweighted(fit, 4, Reweighting(rounds=1, limit=10.0, of_squares=True), lambda _: 2.0)
    assert found.weights == pytest.approx([0.95**2, 0.8**2, 0.55**2, 0.0])
    assert found.residuals.tolist() == [1.0, 4.0, 9.0, 40.0]


def test_limit_can_be_another_one():
    def fit(weights, _):
        return 0.0, np.array([1.0, 1.0, 3.0, 5.0])

    found = fit_reweighted(fit, 4, Reweighting(rounds=1, limit=4.0), lambda _: 1.0)
    assert found.weights == pytest.approx([(1 - 1 / 16) ** 2, (1 - 1 / 16) ** 2, (1 - 9 / 16) ** 2, 0.0])
    assert math.isclose(found.scale, 1.0)
