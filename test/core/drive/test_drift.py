"""The statistic of a change: on frames without scatter, where each of its parts stands alone."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.drive.drift import FrameSeries, Reference, Scatter, find_change, measure_scatter
from stereo_selfcal.core.tolerances import WANDER_STD

STEP_S = 30.0  # farther apart than motion lasts
MOTION = np.array([0.004, 0.001, 0.002]) ** 2


def series(values, noise=1e-4):
    values = np.array(values, dtype=float)
    n = len(values)
    return FrameSeries(STEP_S * np.arange(n), values, np.full((n, 3), noise**2), np.ones(n, bool))


def still(n, value=0.0):
    return series(np.full((n, 3), value))


def known(variance=1e-12):
    return Reference(np.zeros(3), np.full(3, variance), moments=0.0)


def test_load_and_fuel_may_move_a_camera_however_many_frames_there_are():
    scatter = Scatter(np.full(3, 1e-14), np.ones(3), 10.0)
    change = find_change(series(np.zeros((2000, 3)), noise=1e-7), known(), scatter)
    np.testing.assert_allclose(change.std, WANDER_STD, rtol=0.01)


def test_the_deviation_is_that_of_both_means_inflated_by_what_repeats():
    scatter = Scatter(MOTION, np.array([1.0, 2.0, 4.0]), 10.0)
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
    scatter = Scatter(MOTION, np.ones(3), freedom)
    std = find_change(still(40), known(), scatter).std[0]
    for sign in (-1.0, 1.0):
        moved = np.zeros((40, 3))
        moved[:, 0] = sign * t * std
        change = find_change(series(moved), known(), scatter)
        # All of the frames, or those since a moment: the best is that of all.
        assert change.split == 0 and change.axis == 0
        assert change.z[0] == pytest.approx(sign * normal, abs=0.01)
        assert change.drift[0] / change.std[0] == pytest.approx(sign * t, rel=0.01)


def a_second_apart(values):
    slow = series(values)
    return FrameSeries(slow.times_s / STEP_S, slow.values, slow.variances, slow.used)


def test_frames_that_alternate_are_no_more_than_independent():
    """Chance, or a road that is bent to and fro: it must not make a mean surer than so many frames do."""
    n, values = 60, np.zeros((60, 3))
    values[::2], values[1::2] = 0.01, -0.01
    # 30 frames of a braking that lasts for 3 s are assumed beforehand.
    repeated = math.exp(-1.0 / 3.0)
    assumed = (1.0 + repeated) / (1.0 - repeated)
    inflation = measure_scatter(a_second_apart(values)).inflation
    np.testing.assert_allclose(inflation, (30.0 * assumed + n) / (30.0 + n))


def test_frames_that_repeat_each_other_count_for_fewer():
    values = np.zeros((400, 3))
    now, rng = np.zeros(3), np.random.default_rng(0)
    for i in range(400):
        now = 0.8 * now + 0.6 * rng.normal(size=3)
        values[i] = 0.01 * now
    inflation = measure_scatter(a_second_apart(values)).inflation
    # (1 + 0.8) / (1 - 0.8) is 9; the window of 24 s and what was assumed beforehand, 6, take some of it.
    assert np.all(inflation > 5.0) and np.all(inflation < 11.0)
