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

"""How a car moves, by its frames: a process whose size and memory are known here; outliers; stops."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal.core.drive.frame_series import FrameSeries
from stereo_selfcal.core.drive.motion import (
    mark_outliers,
    measure_motion,
    settled_outliers,
    weights_of_mean,
    without_outliers,
)
from stereo_selfcal.core.road import priors

STANDING_STD = np.array(priors.STANDING_STD)
NOISE = np.array([1e-3, math.radians(0.02), math.radians(0.03)])
# What brakes and springs do to cars on usual roads: millimetres, and tenths of a degree.
MOTION = np.array([0.005, math.radians(0.15), math.radians(0.2)])
POSE = np.array([1.4, 0.05, 0.01])


def ride(rng, n, step_s=0.5, motion=MOTION, memory_s=1.5, noise=NOISE):
    """Return frames of a car whose motion forgets its state after a time."""
    keep = math.exp(-step_s / memory_s)
    states, now = np.empty((n, 3)), rng.normal(size=3)
    for i in range(n):
        states[i] = now
        now = keep * now + math.sqrt(1.0 - keep**2) * rng.normal(size=3)
    values = POSE + states * motion + rng.normal(size=(n, 3)) * noise
    return FrameSeries.of(100.0 + step_s * np.arange(n), values, np.tile(noise**2, (n, 1)))


def standing(series, first, end):
    """Return the series of a car that stood from one frame to another one, which it shows again and again."""
    stood, values = series.stood.copy(), series.values.copy()
    stood[first + 1 : end] = True
    rng = np.random.default_rng(9)
    values[first:end] = POSE + 0.5 * STANDING_STD + rng.normal(size=(end - first, 3)) * NOISE
    return replace(series, stood=stood, values=values)


def test_before_the_first_frame_a_car_moves_as_cars_do():
    usual = measure_motion()
    # A ride of twice the usual motion is as probable as one of half of it; so the variance is larger.
    assert np.all(np.sqrt(usual.variance) > MOTION) and np.all(np.sqrt(usual.variance) < 2.5 * MOTION)
    assert np.all(usual.memory_s > 1.0) and np.all(usual.memory_s < 5.0)
    one = measure_motion(ride(np.random.default_rng(0), 1))
    np.testing.assert_array_equal(one.probability, usual.probability)


@pytest.mark.parametrize(("factor", "memory_s"), [(0.2, 0.5), (0.2, 4.0), (1.0, 1.5), (3.0, 0.5), (3.0, 4.0)])
def test_a_long_ride_shows_size_and_memory(factor, memory_s):
    # 300 memories: so many moments, half of them independent, tell the size to a tenth.
    n = round(300 * memory_s / 0.5)
    found = measure_motion(ride(np.random.default_rng(1), n, motion=factor * MOTION, memory_s=memory_s))
    np.testing.assert_allclose(np.sqrt(found.variance), factor * MOTION, rtol=0.3)
    assert np.all(found.memory_s > 0.5 * memory_s) and np.all(found.memory_s < 2.0 * memory_s)


def test_each_of_height_pitch_and_roll_has_a_motion_of_its_own():
    motion = MOTION * [4.0, 0.1, 1.0]
    found = measure_motion(ride(np.random.default_rng(2), 1000, motion=motion))
    np.testing.assert_allclose(np.sqrt(found.variance), motion, rtol=0.25)


def test_levels_of_two_parts_are_no_motion():
    first, second = (ride(np.random.default_rng(seed), 300) for seed in (3, 4))
    apart = measure_motion(first, replace(second, values=second.values + 1.0))
    together = measure_motion(first, second)
    np.testing.assert_allclose(apart.probability, together.probability, atol=1e-9)


@pytest.mark.parametrize("step_s", [0.1, 1.0])
def test_hours_show_the_same_motion_as_minutes(step_s):
    """Neither size nor memory depends on how many frames there are of it."""
    series = ride(np.random.default_rng(5), 12_000, step_s=step_s)
    found = measure_motion(series)
    np.testing.assert_allclose(np.sqrt(found.variance), MOTION, rtol=0.2)
    _, std = std_by_motion(series)
    kept = math.exp(-step_s / 1.5)
    expected = MOTION * math.sqrt((1.0 + kept) / (1.0 - kept) / 12_000)
    # Of 1200 frames at 10 Hz, two minutes, which hold some forty moments.
    np.testing.assert_allclose(std, expected, rtol=0.45)


def errors_over_std(n, n_drives, seed, **options):
    """Return the errors of means over what motion and noise leave in them, (n_drives, 3)."""
    rng, ratios = np.random.default_rng(seed), []
    for _ in range(n_drives):
        series = ride(rng, n, **options)
        motion = measure_motion(series)
        weights, _ = weights_of_mean(series, series.variances, motion)
        of_motion, _ = motion.of_mean(series, weights)
        std = np.sqrt(of_motion + (weights**2 * series.variances).sum(axis=0))
        ratios.append(((weights * series.values).sum(axis=0) - POSE) / std)
    return np.array(ratios)


@pytest.mark.parametrize(
    ("n", "step_s", "memory_s"), [(1, 0.5, 1.5), (30, 0.2, 1.5), (30, 1.0, 0.5), (60, 0.5, 3.0)]
)
def test_means_of_short_drives_are_off_by_what_is_said(n, step_s, memory_s):
    """Of usual rides. 60 drives of three numbers tell the ratio to 6 %; the prior is wider than one ride."""
    ratios = errors_over_std(n, 60, 6, step_s=step_s, memory_s=memory_s)
    assert 0.6 < math.sqrt(np.mean(ratios**2)) < 1.3


def test_means_of_rides_as_different_as_the_prior_has_them_are_off_by_what_is_said():
    rng = np.random.default_rng(7)
    ratios = []
    for _ in range(100):
        size, memory_s = np.exp(0.6 * rng.normal()), 1.5 * np.exp(0.8 * rng.normal())
        ratios.append(errors_over_std(24, 1, rng.integers(2**32), motion=size * MOTION, memory_s=memory_s)[0])
    assert 0.8 < math.sqrt(np.mean(np.square(ratios))) < 1.25


def test_what_motion_leaves_of_a_mean_is_the_mean_of_all_that_is_possible():
    """Against the covariance of every size and memory of the grid, as matrices."""
    series = standing(ride(np.random.default_rng(8), 12), 4, 8)
    motion = measure_motion(series)
    weights = np.random.default_rng(8).dirichlet(np.ones(12), size=3).T
    variance, spread = motion.of_mean(series, weights)
    # Before the stop, the stop, after it: these have nothing in common.
    part = np.repeat([0, 1, 2], 4)
    on_way_s, rest = np.where(part == 1, 0.0, 0.5 * np.arange(12)), part == 1
    sizes, memories = 2.0 ** np.arange(-5.0, 4.01, 0.125), 2.0 ** np.arange(-2.0, 5.01, 0.25)
    for k in range(3):
        each = []
        for memory_s in memories:
            kept = np.exp(-np.abs(on_way_s[:, None] - on_way_s) / memory_s) * (part[:, None] == part)
            for size in sizes:
                respond = weights[:, k] * np.where(rest, STANDING_STD[k], size * MOTION[k])
                each.append(respond @ kept @ respond)
        probability = motion.probability[:, k]
        assert variance[k] == pytest.approx(probability @ each, rel=1e-9)
        assert spread[k] == pytest.approx(
            math.sqrt(probability @ (np.array(each) - variance[k]) ** 2), rel=1e-6
        )


def std_by_motion(series):
    """Return the weights, and what motion leaves of the mean (3,)."""
    motion = measure_motion(series)
    weights, _ = weights_of_mean(series, series.variances, motion)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    return weights, np.sqrt(motion.of_mean(series, weights)[0])


def test_a_long_stop_is_one_moment():
    """Its frames add no more to a drive than two of them do, beside their noise."""
    series = standing(ride(np.random.default_rng(10), 80), 10, 70)
    _, of_all = std_by_motion(series)
    _, of_two = std_by_motion(series.part(np.concatenate([np.arange(11), np.arange(69, 80)])))
    np.testing.assert_allclose(of_all, of_two, rtol=0.1)


@pytest.mark.parametrize("rate_hz", [2.0, 10.0])
@pytest.mark.parametrize("driven_s", [5.0, 30.0])
def test_a_stop_makes_a_drive_better_and_does_not_outweigh_it(rate_hz, driven_s):
    driven, stopped = round(driven_s * rate_hz), round(20.0 * rate_hz)
    series = ride(np.random.default_rng(3), 2 * driven + stopped, step_s=1.0 / rate_hz)
    series = standing(series, driven, driven + stopped)
    weights, with_stop = std_by_motion(series)
    _, without = std_by_motion(series.part(~series.at_rest))
    assert np.all(with_stop < 1.1 * without)
    # The place is worth a few moments of driving, whatever came just before and after it.
    share = weights[series.at_rest].sum(axis=0)
    assert np.all(share > 0.0) and np.all(share < 0.75)
    assert np.all(weights > -0.05)


def test_places_of_a_creeping_car_are_no_more_than_the_road_between_them():
    """Stops of three frames each, some centimetres apart: as one long stop, not as twenty places."""
    series = standing(ride(np.random.default_rng(4), 60, step_s=0.1), 0, 60)
    creeping = replace(series, stood=np.arange(60) % 3 != 0)
    assert np.all(std_by_motion(creeping)[1] > 0.5 * std_by_motion(series)[1])


def test_the_first_frame_of_a_stop_is_at_rest_as_well():
    series = standing(ride(np.random.default_rng(11), 10), 3, 6)
    assert series.stood.tolist() == [False] * 4 + [True] * 2 + [False] * 4
    assert series.at_rest.tolist() == [False] * 3 + [True] * 3 + [False] * 4
    np.testing.assert_allclose(series.gaps_s[1:], [0.5, 0.5, 0.5, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5])
    assert not series.all_stood
    assert series.part(slice(3, 6)).all_stood
    assert not series.part(slice(3, 4)).all_stood  # of one frame nothing is known


@pytest.mark.parametrize("at", [3, 4, 5])
def test_an_outlier_does_not_end_a_stop(at):
    series = standing(ride(np.random.default_rng(12), 10), 2, 7)
    used = np.arange(10) != at
    good = replace(series, used=used).good()
    assert len(good) == 9 and good.used.all()
    assert good.stood.tolist() == [False] * 3 + [True] * 3 + [False] * 3
    first_out = replace(series, used=np.arange(10) != 2).good()
    assert first_out.stood.tolist() == [False] * 3 + [True] * 3 + [False] * 3


def test_outliers_before_and_after_a_stop_do_not_make_it_longer():
    series = standing(ride(np.random.default_rng(13), 10), 2, 5)
    good = replace(series, used=~np.isin(np.arange(10), [1, 5])).good()
    assert good.stood.tolist() == [False, False, True, True, False, False, False, False]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("at", [0, 1, 20, 39])
def test_a_frame_far_from_its_neighbours_is_an_outlier(axis, sign, at):
    series = ride(np.random.default_rng(14), 40)
    values = series.values.copy()
    values[at, axis] += sign * 12 * MOTION[axis]
    expected = np.arange(40) != at
    assert mark_outliers(replace(series, values=values)).tolist() == expected.tolist()
    left, motion = without_outliers(replace(series, values=values), series.variances)
    assert not left.used[at] and np.count_nonzero(left.used) >= 38
    assert np.all(np.sqrt(motion.variance) < 2.0 * MOTION)


def test_the_usual_motion_is_no_outlier_where_frames_agree_by_chance():
    values = np.tile(POSE, (12, 1))
    values[5] += 1.5 * MOTION
    series = FrameSeries.of(np.arange(12.0), values, np.tile(NOISE**2, (12, 1)))
    assert mark_outliers(series).all()
    assert without_outliers(series, series.variances)[0].used.all()


def test_of_three_frames_none_is_an_outlier():
    series = ride(np.random.default_rng(15), 3)
    values = series.values.copy()
    values[1] += 1.0
    assert without_outliers(replace(series, values=values), series.variances)[0].used.all()


def test_a_tenth_of_wild_frames_does_not_move_a_mean():
    rng = np.random.default_rng(16)
    ratios = []
    for _ in range(30):
        series = ride(rng, 60, step_s=0.5)
        wild = rng.random(60) < 0.1
        values = series.values + wild[:, None] * rng.normal(size=(60, 3)) * 30 * MOTION
        left, motion = without_outliers(replace(series, values=values), series.variances)
        good = left.good()
        weights, _ = weights_of_mean(good, good.variances, motion)
        std = np.sqrt(motion.of_mean(good, weights)[0])
        ratios.append(((weights * good.values).sum(axis=0) - POSE) / std)
        far = np.any(np.abs(values - POSE) > 10 * MOTION, axis=1)
        assert not np.any(left.used & far)
    assert math.sqrt(np.mean(np.square(ratios))) < 1.3


def test_a_few_deviating_frames_are_outliers_and_half_of_them_are_a_change():
    series = ride(np.random.default_rng(17), 60)
    values = series.values.copy()
    values[20:24] += 20 * MOTION
    expected = ~np.isin(np.arange(60), np.arange(20, 24))
    assert mark_outliers(replace(series, values=values)).tolist() == expected.tolist()
    values[20:] += 20 * MOTION
    values[20:24] -= 20 * MOTION
    assert mark_outliers(replace(series, values=values)).all()


def test_outliers_that_are_decided_stay_so():
    series = ride(np.random.default_rng(18), 40)
    values = series.values.copy()
    values[[7, 33]] += 20 * MOTION
    whole = replace(series, values=values)
    known = settled_outliers(36)
    assert 20 < known < 33
    before = mark_outliers(whole.part(slice(0, 36)))
    used = np.concatenate([before, np.ones(4, bool)])
    np.testing.assert_array_equal(mark_outliers(replace(whole, used=used), known), mark_outliers(whole))
    assert settled_outliers(3) == 0


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_frames_that_are_all_equal_are_no_division_by_zero(noise):
    for times_s in (np.arange(30.0), np.zeros(30)):
        series = FrameSeries.of(times_s, np.tile(POSE, (30, 1)), np.full((30, 3), noise**2))
        left, motion = without_outliers(series, series.variances)
        assert left.used.all()
        weights, off = weights_of_mean(series, series.variances, motion)
        of_motion, _ = motion.of_mean(series, weights)
        assert np.all(np.isfinite(weights)) and np.all(np.isfinite(off)) and np.all(of_motion >= 0.0)


def test_means_over_blocks_scatter_as_their_motion_does():
    """In the mean of many blocks: by the root of twice the memory over their length."""
    found = measure_motion(ride(np.random.default_rng(19), 2000, step_s=0.5, memory_s=1.0))
    rng = np.random.default_rng(20)
    rides = [ride(rng, 400, step_s=0.5, memory_s=1.0, noise=0.0 * NOISE).values for _ in range(100)]
    of_many = np.var(np.mean(rides, axis=1), axis=0) * 20  # 200 s are 20 blocks of ten seconds
    np.testing.assert_allclose(found.of_block(10.0), of_many, rtol=0.6)
