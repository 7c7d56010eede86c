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

"""A mount that was moved, told from a car that moves on its suspension."""

import math

import numpy as np
import pytest
from drive_making import MOTION, NOISE, POSE, make_drive, series_of

from stereo_selfcal.core.drive.changes import BLOCK_S, MountHistory
from stereo_selfcal.core.drive.changes import find_changes as find_in_series
from stereo_selfcal.core.tolerances import LEAST_SHIFT

BUMP = np.array([0.0, math.radians(0.8), 0.0])


def find_changes(stamps, poses, covariances) -> MountHistory:
    return find_in_series(series_of(stamps, poses, covariances))


def changes_of(*args, **kwargs):
    return find_changes(*make_drive(*args, **kwargs))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("correlation_s", [0.5, 5.0])
def test_nothing_is_found_where_nothing_was_moved(seed, correlation_s):
    course = changes_of(seed=seed, correlation_s=correlation_s)
    assert course.judged
    assert course.changes == ()
    assert len(course.segments) == 1


@pytest.mark.parametrize("seed", range(5))
def test_a_bump_is_found_when_it_was(seed):
    course = changes_of(seed=seed, steps=((1500.0, BUMP),))
    (change,) = course.changes
    assert change.at_s == pytest.approx(1600.0, abs=5.0)
    assert change.shift[1] == pytest.approx(BUMP[1], abs=math.radians(0.1))
    assert change.sigmas[1] > 5.5
    before, after = course.segments
    assert before.end == after.first == change.index
    for segment, truth in ((before, POSE), (after, POSE + BUMP)):
        # As of frames two seconds apart: a state of the motion lasts for one or two of them.
        n = segment.end - segment.first
        assert np.all(np.abs(segment.mean - truth) < 4 * np.hypot(2.0 * MOTION, NOISE) / math.sqrt(n))


@pytest.mark.parametrize("index", range(3))
def test_every_parameter_is_watched(index):
    step = np.zeros(3)
    step[index] = -8 * LEAST_SHIFT[index]
    (change,) = changes_of(seed=index, steps=((2000.0, step),)).changes
    assert change.at_s == pytest.approx(2100.0, abs=5.0)


def test_a_shift_below_what_a_load_does_is_none():
    stamps, poses, covariances = make_drive()
    # So little motion that either would stand out of it.
    calm = POSE + np.random.default_rng(0).normal(size=poses.shape) * MOTION / 50
    for factor, n_changes in ((0.8, 0), (1.2, 1)):
        moved = calm.copy()
        moved[stamps >= 1900.0] += factor * LEAST_SHIFT
        assert len(find_changes(stamps, moved, covariances * 1e-4).changes) == n_changes


def test_what_comes_back_is_motion_and_what_stays_is_the_mount():
    away = ((1500.0, BUMP), (1580.0, -BUMP))
    assert changes_of(seed=1, steps=away).changes == ()
    longer = ((1500.0, BUMP), (1900.0, -BUMP))
    first, second = changes_of(seed=1, steps=longer).changes
    assert (first.at_s, second.at_s) == (pytest.approx(1600.0, abs=5.0), pytest.approx(2000.0, abs=5.0))


def test_a_slow_drift_is_not_cut_into_stairs():
    stamps, poses, covariances = make_drive(seed=2)
    drift = (stamps - stamps[0])[:, None] / 3600.0 * [0.01, math.radians(0.4), 0.0]
    assert find_changes(stamps, poses + drift, covariances).changes == ()


def test_braking_is_motion():
    stamps, poses, covariances = make_drive(seed=3, rate_hz=2.0)
    poses = poses.copy()
    for start_s in range(250, 3500, 200):
        poses[(stamps > start_s) & (stamps < start_s + 10)] += [-0.02, math.radians(1.0), 0.0]
    assert find_changes(stamps, poses, covariances).changes == ()


def test_four_minutes_are_needed():
    too_short = changes_of(duration_s=23 * BLOCK_S, rate_hz=10.0, steps=((120.0, 5 * BUMP),))
    assert not too_short.judged
    assert too_short.changes == ()
    assert len(too_short.segments) == 1
    long_enough = changes_of(duration_s=24 * BLOCK_S, rate_hz=10.0, steps=((120.0, 5 * BUMP),))
    assert long_enough.judged
    assert [change.at_s for change in long_enough.changes] == [pytest.approx(220.0, abs=5.0)]


def test_a_change_in_a_gap_is_known_no_better_than_the_gap_is_long():
    stamps, poses, covariances = make_drive(seed=4, steps=((1500.0, 2 * BUMP),))
    seen = (stamps < 1500.0) | (stamps > 1700.0)
    (change,) = find_changes(stamps[seen], poses[seen], covariances[seen]).changes
    assert change.at_s == pytest.approx(1600.0, abs=5.0)
    assert change.within_s >= 100.0


def test_of_one_frame_there_is_a_segment():
    stamps, poses, covariances = make_drive(duration_s=2.0)
    course = find_changes(stamps[:1], poses[:1], covariances[:1])
    (segment,) = course.segments
    assert (segment.first, segment.end) == (0, 1)
    np.testing.assert_allclose(segment.mean, poses[0])
    np.testing.assert_array_equal(segment.spread, 0)


def test_frames_without_any_noise_are_no_change():
    stamps, poses, covariances = make_drive()
    course = find_changes(stamps, np.broadcast_to(POSE, poses.shape), covariances)
    assert course.judged
    assert course.changes == ()


def test_spread_is_that_of_the_frames():
    (segment,) = changes_of(seed=5, outliers=0.0).segments
    expected = np.hypot(MOTION, NOISE)
    np.testing.assert_allclose(segment.spread, expected, rtol=0.1)


def test_no_frames_are_no_drive():
    with pytest.raises(ValueError, match="no frames"):
        changes_of(duration_s=0.0)


@pytest.mark.parametrize("seed", range(6))
def test_what_comes_back_is_motion_also_after_the_mount_was_moved(seed):
    """The first shift stays; of the two neighbours behind it the camera was away for a minute only."""
    stamps, poses, covariances = make_drive()
    poses = POSE + np.random.default_rng(seed).normal(size=poses.shape) * MOTION / 5
    for at_s, step in ((900.0, BUMP), (2100.0, BUMP), (2160.0, -BUMP)):
        poses[stamps >= at_s] += step
    (change,) = find_changes(stamps, poses, covariances * 1e-2).changes
    assert change.at_s == pytest.approx(900.0, abs=5.0)


@pytest.mark.parametrize("factor", [-20.0, 20.0])
def test_a_wild_frame_beside_a_move_does_not_shift_it(factor):
    """Beyond the size of the move it says no more than on which side it is."""
    stamps, poses, covariances = make_drive(seed=6, steps=((1500.0, 2 * BUMP),), outliers=0.0)
    (expected,) = find_changes(stamps, poses, covariances).changes
    assert expected.at_s == pytest.approx(1600.0, abs=5.0)
    for at in (expected.index - 8, expected.index + 8):
        wild = poses.copy()
        wild[at] += factor * BUMP
        (change,) = find_changes(stamps, wild, covariances).changes
        assert change.index == expected.index


def test_a_small_move_is_placed_less_surely():
    """By the square of its size; beside half the time between two frames."""
    within = {}
    for size in (1, 2):
        (change,) = changes_of(seed=7, steps=((1500.0, size * BUMP),)).changes
        within[size] = change.within_s - 1.0  # a frame every two seconds
        assert abs(change.at_s - 1600.0) < change.within_s
    assert within[1] / within[2] == pytest.approx(4.0, rel=0.35)
    assert within[2] > 0.5


def test_outliers_are_left_out_of_mean_and_spread():
    stamps, poses, covariances = make_drive(outliers=0.0)
    (clean,) = find_changes(stamps, poses, covariances).segments
    wild = poses.copy()
    wild[100::50] += [0.3, 0.1, 0.1]
    (segment,) = find_changes(stamps, wild, covariances).segments
    np.testing.assert_allclose(segment.mean, clean.mean, atol=0.1 * clean.spread.min())
    np.testing.assert_allclose(segment.spread, clean.spread, rtol=0.05)
