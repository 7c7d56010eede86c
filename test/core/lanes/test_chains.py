"""Chains of stripe points: what a stripe has and scattered points have not."""

import numpy as np
import pytest

from stereo_selfcal.core.lanes.chains import chain_points
from stereo_selfcal.core.lanes.stripe_points import StripePoints

WIDTH = 640


def points_at(rows, columns, slopes, widths=8.0, contrast=60.0):
    n = len(rows)
    values = (rows, columns, widths, contrast, 1.0, slopes, 0.1, 1.0)
    full = [np.broadcast_to(np.asarray(value, float), n).copy() for value in values]
    return StripePoints(*full, 1.0, np.zeros((2, 2)))


def line(slope, first=200, last=400, start=100.0):
    rows = np.arange(first, last, 2)
    return rows, start + slope * (rows - first)


@pytest.mark.parametrize("slope", [-2.0, -0.4, 0.0, 1.3])
def test_a_line_is_one_chain_that_knows_its_direction(slope):
    """The points' own directions are off by 0.3; the chain's is that of its points."""
    rows, columns = line(slope, start=420.0 if slope < 0 else 100.0)
    noise = np.random.default_rng(0).normal(0.0, 0.1, len(rows))
    chains = chain_points(points_at(rows, columns + noise, slope + 0.3), WIDTH)
    assert np.all(chains.length >= 0.9 * np.ptp(rows))
    np.testing.assert_allclose(chains.slope, slope, atol=0.03)
    assert np.all(chains.slope_std < 0.05)


def test_scattered_points_make_no_chains():
    rng = np.random.default_rng(1)
    rows = 2 * rng.integers(100, 240, 800)
    columns, slopes = rng.uniform(5, WIDTH - 5, 800), rng.normal(0.0, 1.0, 800)
    chains = chain_points(
        points_at(rows, columns, slopes, rng.uniform(2, 30, 800), rng.uniform(9, 90, 800)), WIDTH
    )
    assert np.mean(chains.length >= 8) < 0.05


@pytest.mark.parametrize("change", [{"widths": 2.0}, {"contrast": 2.5}])
def test_a_chain_ends_where_the_stripe_becomes_another(change):
    rows, columns = line(0.5)
    values = {"widths": np.full(len(rows), 8.0), "contrast": np.full(len(rows), 60.0)}
    for name, factor in change.items():
        values[name][len(rows) // 2 :] *= factor
    chains = chain_points(points_at(rows, columns, 0.5, **values), WIDTH)
    assert np.all(chains.length < 0.6 * np.ptp(rows))


def test_what_two_filters_mark_is_one_chain():
    """Both points of each row get the chain, and neither breaks it."""
    rows, columns = line(0.5)
    twice = points_at(np.repeat(rows, 2), np.repeat(columns, 2) + np.tile([0.0, 0.6], len(rows)), 0.5)
    assert np.all(chain_points(twice, WIDTH).length >= 0.9 * np.ptp(rows))


@pytest.mark.parametrize("n", [0, 1])
def test_nothing_to_chain(n):
    rows, columns = line(0.5)
    chains = chain_points(points_at(rows[:n], columns[:n], 0.5), WIDTH)
    assert len(chains.length) == n and not chains.length.any()
