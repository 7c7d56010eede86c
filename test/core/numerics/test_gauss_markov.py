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

"""A wandering series: what a filter finds in one pass, against the matrices that it never builds."""

import numpy as np
import pytest

from stereo_selfcal.core.numerics.gauss_markov import likelihood, linear_mean, variance_of_mean

# A pause of no length, as between frames of one moment, and a long one are among them.
GAPS = np.array([7.0, 0.3, 0.0, 1.1, 0.2, 40.0, 0.5, 0.5, 2.0])
TIMES = np.cumsum(np.concatenate([[0.0], GAPS[1:]]))
N = len(GAPS)
COLUMNS = 2
SIZES = np.array([[0.5, 2.0], [1.5, 0.1], [0.01, 1.0]])
MEMORIES = np.array([[0.4, 3.0], [10.0, 0.2], [1.0, 1.0]])


def a_series(seed):
    """Return values and variances of noise (N, 2), sizes for each value (N, 2)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(N, COLUMNS)), rng.uniform(0.05, 2.0, (N, COLUMNS)), rng.uniform(0.2, 3.0, (N, 2))


def dense(noise, size, memory):
    """Return the covariance (N, N) of a column."""
    kept = np.exp(-np.abs(TIMES[:, None] - TIMES) / memory)
    return np.diag(noise) + kept * np.outer(size, size)


@pytest.mark.parametrize("seed", range(3))
def test_likelihood_is_that_of_the_whole_covariance(seed):
    values, noise, each = a_series(seed)
    for size in (SIZES[None], each[:, None, :] * SIZES):
        found = likelihood(GAPS, values, noise, size, MEMORIES)
        log = np.empty(SIZES.shape)
        for g, k in np.ndindex(*SIZES.shape):
            of_each = np.broadcast_to(size, (N, *SIZES.shape))[:, g, k]
            covariance = dense(noise[:, k], of_each, MEMORIES[g, k])
            inverse, ones = np.linalg.inv(covariance), np.ones(N)
            information = ones @ inverse @ ones
            mean = ones @ inverse @ values[:, k] / information
            off = values[:, k] - mean
            log[g, k] = -0.5 * (np.linalg.slogdet(covariance)[1] + np.log(information) + off @ inverse @ off)
            assert found.mean[g, k] == pytest.approx(mean, rel=1e-9)
            assert found.variance[g, k] == pytest.approx(1.0 / information, rel=1e-9)
        # Candidates are compared: what all have in common does not matter.
        np.testing.assert_allclose(found.log - found.log[0], log - log[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_mean_weights_and_residuals_are_those_of_the_whole_covariance(seed):
    values, noise, size = a_series(seed)
    memory = MEMORIES[0]
    found = linear_mean(GAPS, values, noise, size, memory)
    np.testing.assert_allclose(found.weights.sum(axis=0), 1.0, rtol=1e-12)
    for k in range(COLUMNS):
        covariance = dense(noise[:, k], size[:, k], memory[k])
        solved = np.linalg.solve(covariance, np.ones(N))
        weights = solved / solved.sum()
        np.testing.assert_allclose(found.weights[:, k], weights, rtol=1e-8)
        assert found.mean[k] == pytest.approx(weights @ values[:, k], rel=1e-8)
        for i in range(N):  # each value is left out, and predicted by all others about the same mean
            others = np.arange(N) != i
            among, to = covariance[np.ix_(others, others)], covariance[i, others]
            gain = np.linalg.solve(among, to)
            predicted = found.mean[k] + gain @ (values[others, k] - found.mean[k])
            std = np.sqrt(covariance[i, i] - gain @ to)
            assert found.residuals[i, k] == pytest.approx((values[i, k] - predicted) / std, rel=1e-6)


def test_variance_of_a_weighted_mean_is_that_of_the_whole_covariance():
    weights = np.random.default_rng(4).normal(size=(N, COLUMNS))
    found = variance_of_mean(GAPS, weights, MEMORIES)
    for g, k in np.ndindex(*MEMORIES.shape):
        of_state = dense(np.zeros(N), np.ones(N), MEMORIES[g, k])
        assert found[g, k] == pytest.approx(weights[:, k] @ of_state @ weights[:, k], rel=1e-9)


def test_no_weights_vary_less_than_those_of_the_best_mean():
    values, noise, size = a_series(5)
    best = linear_mean(GAPS, values, noise, size, MEMORIES[0]).weights[:, 0]
    covariance = dense(noise[:, 0], size[:, 0], MEMORIES[0, 0])
    rng = np.random.default_rng(6)
    for _ in range(20):
        change = rng.normal(size=N)
        other = best + 0.1 * (change - change.mean())
        assert other @ covariance @ other > best @ covariance @ best


@pytest.mark.parametrize("noise", [0.0, 1e-30])
def test_values_without_noise_are_no_division_by_zero(noise):
    """Two values of one moment tell the same thing twice."""
    values = np.arange(N, dtype=float)[:, None]
    found = linear_mean(GAPS, values, np.full((N, 1), noise), np.ones((1, 1)), np.ones(1))
    assert np.all(np.isfinite(found.residuals))
    np.testing.assert_allclose(found.weights.sum(axis=0), 1.0)
    assert found.weights[1, 0] == pytest.approx(found.weights[2, 0])


def test_one_value_is_its_mean():
    found = linear_mean(GAPS[:1], np.full((1, 1), 3.0), np.ones((1, 1)), np.ones((1, 1)), np.ones(1))
    assert (found.mean[0], found.weights[0, 0], found.residuals[0, 0]) == (3.0, 1.0, 0.0)
