"""How a car moves, by means over ten seconds: their scatter, and the standard error of a mean over all."""

import numpy as np
import pytest

from stereo_selfcal.core.drive.motion import BLOCK_S, TimeBlocks, measure_motion, standard_error

NOISE = np.array([0.02, 0.003, 0.004])


def series(values):
    """Return stamps and poses (N, 3), one in the middle of each block, all three alike."""
    stamps = (np.arange(len(values)) + 0.5) * BLOCK_S
    return stamps, np.repeat(np.asarray(values, dtype=float)[:, None], 3, axis=1)


def test_what_does_not_move_scatters_by_the_noise_of_its_frames():
    blocks = TimeBlocks(np.arange(30), np.zeros((30, 3)))
    noise = np.broadcast_to(NOISE, (120, 3))
    np.testing.assert_allclose(measure_motion(blocks, noise, per_block=4.0).sigma, NOISE / 2.0)


def test_independent_means_scatter_by_their_standard_deviation():
    values = np.random.default_rng(0).normal(size=(4000, 3)) * [1.0, 2.0, 0.5]
    sigma = measure_motion(TimeBlocks(np.arange(4000), values), np.zeros((1, 3)), 1.0).sigma
    np.testing.assert_allclose(sigma, [1.0, 2.0, 0.5], rtol=0.1)


def test_means_that_repeat_each_other_scatter_more_over_a_long_time():
    """As an autoregression of first order: by the root of (1 + c) / (1 - c) more."""
    rng, now, values = np.random.default_rng(1), np.zeros(3), []
    for _ in range(20_000):
        now = 0.4 * now + np.sqrt(1.0 - 0.4**2) * rng.normal(size=3)
        values.append(now)
    sigma = measure_motion(TimeBlocks(np.arange(20_000), np.array(values)), np.zeros((1, 3)), 1.0).sigma
    np.testing.assert_allclose(sigma, np.sqrt(1.4 / 0.6), rtol=0.08)


def test_of_few_means_one_degree_of_freedom_is_the_mean_itself():
    """What alternates does not repeat itself: the variance of six, over their number."""
    covariance = standard_error(*series([1.0, -1.0] * 3))
    np.testing.assert_allclose(covariance, 6.0 / 5.0 / 6.0)


def test_repetition_is_counted_about_the_mean_that_was_taken():
    """Of residuals the mean product is smaller by 1 / n than of what scatters about the true mean."""
    n = 24
    values = np.sin(2.0 * np.pi * (np.arange(n) + 0.25) / 6.0)  # half of it is repeated by the next one
    variance = np.mean(values**2)
    repeated = np.mean(values[1:] * values[:-1]) / variance + 1.0 / n
    assert repeated == pytest.approx(0.5, abs=0.1)
    expected = np.sum(values**2) / (n - 1) / n * (1.0 + repeated) / (1.0 - repeated)
    np.testing.assert_allclose(standard_error(*series(values)), expected, rtol=1e-9)


def test_two_means_show_no_error():
    assert standard_error(*series([0.0, 1.0])) is None
    assert standard_error(*series([0.0, 1.0, 0.5])) is not None
