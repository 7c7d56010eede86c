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

from stereo_selfcal.core.drive.mean_over_time import Mean, MeanOverTime, mean_over_time


def mean(*args, **options):
    found = mean_over_time(*args, **options)
    assert isinstance(found, Mean), found.reason
    return found


def slow(rng, n, period_s, memory_s, scatter):
    keep = math.exp(-period_s / memory_s)
    values = [scatter * rng.standard_normal()]
    for _ in range(n - 1):
        values.append(keep * values[-1] + scatter * math.sqrt(1.0 - keep**2) * rng.standard_normal())
    return np.array(values)


def test_the_variance_of_the_mean_is_that_of_a_decaying_correlation():
    over = MeanOverTime(7.0, 1.5)
    times = np.linspace(0.0, 7.0, 1401)
    together = np.exp(-np.abs(times[:, None] - times) / 1.5).mean()
    assert over.of_mean == pytest.approx(together, rel=0.01)
    assert MeanOverTime(0.0, 1.5).of_mean == 1.0
    assert MeanOverTime(1e-2, 1.5).of_mean == pytest.approx(1.0, abs=0.01)


def test_noise_alone_averages_out_as_independent_values():
    rng = np.random.default_rng(1)
    n, noise = 400, 0.01
    values = 3.0 + math.sqrt(noise) * rng.standard_normal(n)
    found = mean(values, np.full(n, noise), MeanOverTime(1000.0, 1.0, 1e-6))
    assert found.variance == pytest.approx(noise / n, rel=0.5)
    assert abs(found.value - 3.0) < 4.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("prior", [0.5, 1.0, 2.0])
def test_a_long_series_shows_its_scatter_whatever_the_prior(prior):
    rng = np.random.default_rng(2)
    values = slow(rng, 4000, 0.1, 1.5, 1.0)
    found = mean(values, np.full(4000, 0.04), MeanOverTime(400.0, 1.5, prior))
    assert found.scatter == pytest.approx(1.0, rel=0.15)


def test_a_short_series_has_the_scatter_of_the_prior():
    found = mean(np.full(10, 2.0), np.full(10, 1e-6), MeanOverTime(1.0, 1.5, 0.3))
    assert found.scatter == pytest.approx(0.3)
    assert math.sqrt(found.variance) == pytest.approx(
        0.3 * math.sqrt(MeanOverTime(1.0, 1.5).of_mean), rel=0.01
    )


def test_errors_are_as_large_as_the_variance_says():
    rng = np.random.default_rng(3)
    n, ratios = 200, []
    for _ in range(150):
        factor = rng.standard_normal(n)
        by_factor = 0.5 * rng.standard_normal()
        noise = rng.uniform(0.01, 0.1, n)
        values = (
            1.0 + by_factor * factor + slow(rng, n, 0.1, 1.5, 0.5) + np.sqrt(noise) * rng.standard_normal(n)
        )
        found = mean(values, noise, MeanOverTime(20.0, 1.5, 0.5), slopes=[(factor, 0.5)])
        ratios.append((found.value - 1.0) / math.sqrt(found.variance))
    assert 0.8 < math.sqrt(np.mean(np.square(ratios))) < 1.2


def test_outliers_do_not_count():
    values, noise = np.full(50, 1.0), np.full(50, 0.01)
    values[::7] = 9.0
    found = mean(values, noise, MeanOverTime(50.0, 1.0, 0.1))
    assert found.value == pytest.approx(1.0, abs=1e-6)
    assert np.all(found.weights[::7] == 0.0)


def test_what_lasts_is_lessened_by_no_number_of_values():
    values, noise, over = np.full(400, 1.0), np.full(400, 0.01), MeanOverTime(400.0, 1.0)
    found = mean(values, noise, over, lasting=np.full(400, 0.3))
    assert math.sqrt(found.variance) == pytest.approx(math.hypot(0.3, 0.1 / 20), rel=1e-6)


def test_values_with_little_of_what_lasts_decide():
    rng = np.random.default_rng(6)
    lasting = np.where(np.arange(400) < 60, 0.0, 2.0)
    values = 1.0 + lasting + 0.1 * rng.standard_normal(400)
    found = mean(values, np.full(400, 0.01), MeanOverTime(400.0, 1.0), lasting=lasting)
    assert abs(found.value - 1.0) < 4.0 * 0.1 / math.sqrt(60)
    assert math.sqrt(found.variance) == pytest.approx(0.1 / math.sqrt(60), rel=0.1)


def test_more_of_what_lasts_never_makes_the_mean_more_certain():
    rng = np.random.default_rng(7)
    lasting = rng.uniform(0.0, 1.0, 300)
    values, noise = 1.0 + 0.1 * rng.standard_normal(300), np.full(300, 0.01)
    stds = [
        math.sqrt(mean(values, noise, MeanOverTime(300.0, 1.0), lasting=part * lasting).variance)
        for part in np.linspace(0.0, 1.0, 60)
    ]
    assert np.all(np.diff(stds) > -1e-9)
    assert np.max(np.diff(stds)) < 0.1 * stds[-1]
