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

"""The response of pixel and lens to an edge: against numerical integration over the pixel."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.estimators.edge_response import StepResponse


def covered(distance_px, slope, sigma_px, n=4001):
    """Return the blurred share of a unit pixel right of the edge, by integration over its height.

    The edge moves ``slope`` columns a row; the lens blurs it along the row by ``sigma_px``.
    """
    heights = (np.arange(n) + 0.5) / n - 0.5
    edge = distance_px[:, None] - slope * heights

    def integral(x):  # of the normal distribution, by parts
        z = x / sigma_px
        below = 0.5 * np.array([1.0 + math.erf(value / math.sqrt(2)) for value in z.ravel()]).reshape(z.shape)
        return x * below + sigma_px * np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)

    return (integral(edge + 0.5) - integral(edge - 0.5)).mean(axis=1)


def look_up(slopes, variances, distances_px):
    """Return share, density and bend of each edge at single pixels, (E, N) each."""
    edges = np.arange(len(slopes))[:, None]
    response = StepResponse(np.array(slopes), np.array(variances), run_px=1)
    return [part[..., 0] for part in response.at(np.array(distances_px)[None], edges)]


DISTANCES = np.array([-5.3, -1.7, -0.51, -0.2, 0.0, 0.013, 0.49, 1.1, 2.9, 6.0])


@pytest.mark.parametrize("slope", [0.1, -0.4, 1.25, -3.0])
@pytest.mark.parametrize("sigma_px", [0.2, 0.6, 2.0])
def test_share_is_the_area_of_the_pixel(slope, sigma_px):
    share, *_ = look_up([slope], [sigma_px**2], DISTANCES)
    np.testing.assert_allclose(share[0], covered(DISTANCES, slope, sigma_px, 201), atol=1e-4)


def test_every_edge_has_its_own_table():
    slopes, variances = [0.2, 1.5], [0.1, 0.9]
    both = look_up(slopes, variances, DISTANCES)
    for i in range(2):
        alone = look_up(slopes[i : i + 1], variances[i : i + 1], DISTANCES)
        for one, other in zip(both, alone, strict=True):
            np.testing.assert_allclose(one[i], other[0], atol=1e-6)


@pytest.mark.parametrize("first_px", [-400.3, -9.7, -3.2, 0.1, 2.6, 55.5])
def test_a_run_is_the_same_pixel_by_pixel(first_px):
    response = StepResponse(np.array([0.7, -1.2]), np.array([0.3, 0.8]), run_px=11)
    for edge in range(2):
        run = response.at(np.array([first_px]), np.array([edge]))
        pixels = look_up([0.7, -1.2], [0.3, 0.8], first_px + np.arange(11.0))
        for one, other in zip(run, pixels, strict=True):
            np.testing.assert_allclose(one[0], other[edge], rtol=0, atol=1e-12)


@pytest.mark.parametrize("slope", [0.3, -2.0])
def test_derivatives_are_those_of_the_share(slope):
    variance, step = 0.5, 1e-4

    def share(distance, variance):
        return look_up([slope], [variance], distance)[0][0]

    _, density, bend = (part[0] for part in look_up([slope], [variance], DISTANCES))
    by_distance = (share(DISTANCES + 0.01, variance) - share(DISTANCES - 0.01, variance)) / 0.02
    by_variance = (share(DISTANCES, variance + step) - share(DISTANCES, variance - step)) / (2 * step)
    np.testing.assert_allclose(density, by_distance, atol=1e-3)
    np.testing.assert_allclose(bend, by_variance, atol=6e-3)


def test_far_from_the_edge_a_pixel_is_on_one_side():
    share, density, bend = look_up([1.0], [0.5], [-1e4, 1e4])
    np.testing.assert_allclose(share[0], [0.0, 1.0], atol=1e-5)
    np.testing.assert_allclose(density[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(bend[0], 0.0, atol=1e-6)
