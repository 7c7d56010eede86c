"""The response of pixel and lens to an edge: against numerical integration over the pixel."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.step_response import StepResponse


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


DISTANCES = np.array([-5.3, -1.7, -0.51, -0.2, 0.0, 0.013, 0.49, 1.1, 2.9, 6.0])


@pytest.mark.parametrize("slope", [0.1, -0.4, 1.25, -3.0])
@pytest.mark.parametrize("sigma_px", [0.2, 0.6, 2.0])
def test_share_is_the_area_of_the_pixel(slope, sigma_px):
    share, *_ = StepResponse(np.array([slope]), np.array([sigma_px**2])).at(DISTANCES[None])
    np.testing.assert_allclose(share[0], covered(DISTANCES, slope, sigma_px, 201), atol=1e-4)


def test_every_edge_has_its_own_table():
    slopes, variances = np.array([0.2, 1.5]), np.array([0.1, 0.9])
    both = StepResponse(slopes, variances).at(np.stack([DISTANCES, DISTANCES]))
    for i in range(2):
        alone = StepResponse(slopes[i : i + 1], variances[i : i + 1]).at(DISTANCES[None])
        for one, other in zip(both, alone, strict=True):
            np.testing.assert_array_equal(one[i], other[0])


@pytest.mark.parametrize("slope", [0.3, -2.0])
def test_derivatives_are_those_of_the_share(slope):
    variance, step = 0.5, 1e-4
    slopes = np.array([slope])

    def share(distance, variance):
        return StepResponse(slopes, np.array([variance])).at(distance[None])[0][0]

    _, density, bend = (part[0] for part in StepResponse(slopes, np.array([variance])).at(DISTANCES[None]))
    by_distance = (share(DISTANCES + 0.01, variance) - share(DISTANCES - 0.01, variance)) / 0.02
    by_variance = (share(DISTANCES, variance + step) - share(DISTANCES, variance - step)) / (2 * step)
    np.testing.assert_allclose(density, by_distance, atol=1e-3)
    np.testing.assert_allclose(bend, by_variance, atol=6e-3)


def test_far_from_the_edge_a_pixel_is_on_one_side():
    share, density, bend = StepResponse(np.array([1.0]), np.array([0.5])).at(np.array([[-1e4, 1e4]]))
    np.testing.assert_allclose(share[0], [0.0, 1.0], atol=1e-5)
    np.testing.assert_allclose(density[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(bend[0], 0.0, atol=1e-6)
