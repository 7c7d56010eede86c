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

"""Unevenness of a road: likelihoods against those of the covariance itself, and draws with a known size."""

from dataclasses import astuple

import numpy as np
import pytest

from stereo_selfcal.core.road import unevenness as module

RNG = np.random.default_rng(5)


@pytest.fixture
def road():
    """Heights of cells of a road that is rough and bends across."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.geomspace(4.0, 20.0, 9), np.linspace(-2.0, 2.0, 5)))
    design = np.column_stack([np.ones_like(x), x, y])
    kernel, profile = module.unit_covariances(np.column_stack([x, y]))
    metres = 0.005 * x
    noise = (0.1 * metres) ** 2
    heights = RNG.multivariate_normal(np.zeros(len(x)), 1e-5 * kernel + profile + np.diag(noise))
    return heights, design, noise, profile, kernel, metres


def test_likelihoods_of_road_and_profile_are_those_of_their_covariance(road):
    heights, design, noise, profile, kernel, metres = road
    basis = np.linalg.qr(design, mode="complete")[0][:, 3:]
    tried = [
        (mismatch, roughness, bend)
        for mismatch in module._MISMATCH_PX
        for roughness in module._ROUGHNESS
        for bend in module._CAMBERS
    ]

    def log_likelihood(mismatch, roughness, bend):
        covariance = np.diag(noise + (mismatch * metres) ** 2) + roughness * kernel + bend**2 * profile
        contrast = basis.T @ heights
        of_contrast = basis.T @ covariance @ basis
        _, log_determinant = np.linalg.slogdet(of_contrast)
        return -0.5 * (contrast @ np.linalg.solve(of_contrast, contrast) + log_determinant)

    expected = np.array([log_likelihood(*each) for each in tried])
    posterior = np.exp(expected - expected.max())
    means = posterior / posterior.sum() @ np.array(tried) ** [2, 1, 2]
    plane = max(log_likelihood(mismatch, 0.0, 0.0) for mismatch in module._MISMATCH_OF_PLANE_PX)
    found = module.estimate_unevenness(heights, design, noise, profile, kernel, metres)
    assert found.roughness == pytest.approx(means[1], rel=1e-6)
    assert found.mismatch_px == pytest.approx(np.sqrt(means[0]), rel=1e-6)
    assert found.camber == pytest.approx(np.sqrt(means[2]), rel=1e-6)
    assert found.log_likelihood_ratio == pytest.approx(expected.max() - plane, rel=1e-6)


def test_heights_of_a_plane_without_any_noise_have_a_likelihood(road):
    _, design, noise, profile, kernel, metres = road
    found = module.estimate_unevenness(np.zeros(len(metres)), design, noise, profile, kernel, metres)
    assert np.all(np.isfinite(astuple(found)))


def test_deviation_is_zero_under_the_camera_and_camber_along_its_path():
    kernel, profile = module.unit_covariances(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 2.0], [10.0, -2.0]]))
    assert not kernel[0].any() and not profile[:2].any()
    # Squared differences of heights grow with the distance to the power of 1.5.
    apart = kernel[2, 2] + kernel[3, 3] - 2.0 * kernel[2, 3]
    assert apart == pytest.approx(4.0**1.5)
    assert kernel[1, 1] == pytest.approx(10.0**1.5)
    # 2.5 % at the edge of a road of two lanes, which begins to fall in its middle.
    assert np.sqrt(profile[2, 2]) == pytest.approx(0.025 / 2.0 / 3.5 * 2.0**2, rel=0.02)


@pytest.mark.parametrize("roughness", [1.1e-5, 4.3e-5])
def test_roughness_of_drawn_roads_is_found(road, roughness):
    """The median of 30 roads to a factor of two; the tried values are apart by two."""
    _, design, noise, profile, kernel, metres = road
    rng = np.random.default_rng(7)
    drawn = rng.multivariate_normal(np.zeros(len(noise)), roughness * kernel + np.diag(noise), size=30)
    found = [
        module.estimate_unevenness(heights, design, noise, profile, kernel, metres).roughness
        for heights in drawn
    ]
    assert 0.5 < np.median(found) / roughness < 2.0


def found_on_cells(heights, noise_m, metres):
    """Return the unevenness that heights of cells a metre apart show."""
    x, y = cells_a_metre_apart()
    design = np.column_stack([np.ones_like(x), x, y])
    kernel, profile = module.unit_covariances(np.column_stack([x, y]))
    return module.estimate_unevenness(heights, design, np.full(x.size, noise_m**2), profile, kernel, metres)


def cells_a_metre_apart():
    return [grid.ravel() for grid in np.meshgrid(np.arange(6.0, 26.0), np.arange(-2.0, 2.1))]


@pytest.mark.parametrize(("bump_m", "uneven"), [(0.0, False), (0.02, True)])
def test_a_plane_is_told_from_a_road(bump_m, uneven):
    """Cells a metre apart, 2 mm of noise; a hump of 2 cm that is 8 m long is no noise."""
    x, _ = cells_a_metre_apart()
    rng = np.random.default_rng(0)
    heights = 0.002 * rng.standard_normal(x.size) + bump_m * np.exp(-0.5 * ((x - 12.0) / 2.0) ** 2)
    assert found_on_cells(heights, 0.002, np.full(x.size, 0.05)).uneven == uneven


@pytest.mark.parametrize(("bump_m", "uneven"), [(0.0, False), (0.02, True)])
def test_interpolation_does_not_make_a_plane_a_road(bump_m, uneven):
    """Hardly any noise, and disparities that interpolation between pixels leaves 0.02 px off."""
    x, _ = cells_a_metre_apart()
    metres = 0.002 * x  # a pixel of disparity is 5 cm of height 25 m ahead
    for seed in range(5):
        rng = np.random.default_rng(seed)
        heights = 0.02 * metres * rng.standard_normal(x.size)
        heights += bump_m * np.exp(-0.5 * ((x - 12.0) / 2.0) ** 2)
        assert found_on_cells(heights, 0.0001, metres).uneven == uneven
