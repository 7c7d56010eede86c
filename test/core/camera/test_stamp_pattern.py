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

"""Lost images are told from unequal stamps, and no tolerance that is suggested pairs different moments."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal.core.camera.pairing import StampPairer
from stereo_selfcal.core.camera.stamp_pattern import NoPairCause, stamp_pattern, suggest_tolerance_s

PERIOD_NS = 33_333_333
START_NS = 1_700_000_000_000_000_000


def frames(numbers, offset_ns=0, period_ns=PERIOD_NS):
    return [START_NS + int(number) * period_ns + offset_ns for number in numbers]


def losing(rng, n, share):
    """Return two lists of frame numbers that have no frame in common, as if ``share`` of both were lost."""
    numbers = np.arange(n)
    left = rng.random(n) >= share
    right = (rng.random(n) >= share) & ~left
    return numbers[left], numbers[right]


@pytest.mark.parametrize("share", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("seed", range(20))
def test_images_lost_at_random_are_never_called_cameras_out_of_step(seed, share):
    left, right = losing(np.random.default_rng(seed), 300, share)
    pattern = stamp_pattern(frames(left), frames(right))
    assert pattern.cause in (NoPairCause.LOST, NoPairCause.UNCLEAR)
    assert pattern.tolerance_s is None
    if share < 0.9:  # beyond, few gaps of a single frame are left
        assert pattern.cause is NoPairCause.LOST
        assert str(pattern).startswith("images are lost on the way: the nearest stamps differ by 33.333 ms")


def test_images_lost_from_cameras_that_were_seen_in_step_are_said_to_be_lost():
    """Two images of each are no pattern, but equal stamps came before."""
    left, right = frames([0, 7]), frames([3, 9])
    assert stamp_pattern(left, right).cause is NoPairCause.UNCLEAR
    assert stamp_pattern(left, right, equal_before=True).cause is NoPairCause.LOST


def test_every_second_image_lost_by_turns_is_no_half_frame_offset():
    pattern = stamp_pattern(frames(range(0, 100, 2)), frames(range(1, 100, 2)))
    assert pattern.cause is NoPairCause.UNCLEAR
    for words in ("either images are lost on the way", "or the stamps of the cameras differ"):
        assert words in str(pattern)
    assert pattern.tolerance_s is None


@pytest.mark.parametrize("offset_ms", [0.1, 2.0, 7.0, 8.0, 12.0, 14.0])
@pytest.mark.parametrize("jitter_ms", [0.0, 1.0])
def test_cameras_out_of_step_get_a_tolerance_below_half_a_frame(offset_ms, jitter_ms):
    rng = np.random.default_rng(1)
    left, right = (
        [s + int(rng.uniform(0, jitter_ms) * 1e6) for s in frames(range(100), shift)]
        for shift in (0, int(offset_ms * 1e6))
    )
    pattern = stamp_pattern(left, right)
    assert pattern.cause is NoPairCause.UNEQUAL
    assert pattern.nearest_s <= pattern.tolerance_s < 0.5 / 30


@pytest.mark.parametrize("offset_ms", [-8.0, 5.0, 8.0])
def test_cameras_out_of_step_that_lose_some_images_too_are_seen(offset_ms):
    rng = np.random.default_rng(2)
    left, right = (np.flatnonzero(rng.random(200) > 0.4) for _ in range(2))
    pattern = stamp_pattern(frames(left), frames(right, int(offset_ms * 1e6)))
    assert pattern.cause is NoPairCause.UNEQUAL
    assert pattern.tolerance_s == pytest.approx(abs(offset_ms) * 1.2e-3, abs=1e-3)


def test_three_images_of_each_are_enough_for_a_small_offset():
    pattern = stamp_pattern(frames(range(3)), frames(range(3), 2_000_000))
    assert (pattern.cause, pattern.tolerance_s) == (NoPairCause.UNEQUAL, 0.003)


def test_clocks_that_differ_by_more_than_half_a_frame_get_no_tolerance():
    pattern = stamp_pattern(frames(range(100)), frames(range(100), 10_000_000_000_000 + 20_000_000))
    assert pattern.cause is NoPairCause.CLOCKS
    assert "no tolerance helps, the clocks of the cameras have to be set alike" in str(pattern)


def test_equal_stamps_that_never_met_are_a_matter_of_the_queue():
    assert stamp_pattern(frames(range(20)), frames(range(15, 35))).cause is NoPairCause.QUEUE
    assert stamp_pattern(frames([0]), frames([0], 9_000_000), 0.009).cause is NoPairCause.QUEUE


@pytest.mark.parametrize(("left", "right"), [([], []), ([0], []), ([0], [1]), ([], range(9))])
def test_too_few_images_are_said_to_be_too_few(left, right):
    pattern = stamp_pattern(frames(left), frames(right))
    assert pattern.cause is NoPairCause.TOO_FEW and "too few images" in str(pattern)


@given(
    st.integers(1, 60),
    st.lists(st.booleans(), min_size=120, max_size=120),
    st.lists(st.booleans(), min_size=120, max_size=120),
)
def test_no_tolerance_is_suggested_to_cameras_in_step_whatever_they_lose(rate_hz, keep_left, keep_right):
    """Each frame is seen by one camera at most, so every pair would be of different moments."""
    period_ns = 10**9 // rate_hz
    left = [i for i, kept in enumerate(keep_left) if kept]
    right = [i for i, kept in enumerate(keep_right) if kept and not keep_left[i]]
    pattern = stamp_pattern(frames(left, 0, period_ns), frames(right, 0, period_ns))
    assert pattern.tolerance_s is None or pattern.tolerance_s < 0.5e-9 * period_ns


@given(st.lists(st.tuples(st.booleans(), st.integers(-(2**60), 2**60)), max_size=40))
def test_any_stamps_give_a_sentence(stamps):
    left, right = ([stamp for is_left, stamp in stamps if is_left is side] for side in (True, False))
    assert str(stamp_pattern(left, right))


def test_pattern_of_the_pairer_is_that_of_the_images_since_the_last_pair():
    pairer = StampPairer()
    for number in range(40):
        pairer.add_left(START_NS + number * PERIOD_NS, None)
        pairer.add_right(START_NS + number * PERIOD_NS, None)
    left, right = losing(np.random.default_rng(3), 300, 0.7)
    for number in range(300):
        stamp_ns = START_NS + (number + 40) * PERIOD_NS
        if number in left:
            pairer.add_left(stamp_ns, None)
        if number in right:
            pairer.add_right(stamp_ns, None)
    assert pairer.counts.pairs == 40
    assert pairer.pattern.cause is NoPairCause.LOST
    assert pairer.pattern.lost == pytest.approx((0.7, 0.8), abs=0.1)
    pairer.forget_nearest()
    assert pairer.pattern.cause is NoPairCause.TOO_FEW


@pytest.mark.parametrize(
    ("nearest_s", "rate_hz", "tolerance_s"),
    [
        (0.007, 30.0, 0.009),
        (0.0001, 30.0, 0.001),
        (0.0161, 30.0, 0.0161),  # a fifth more would be beyond half a frame
        (0.017, 30.0, None),
        (0.5 / 30, 30.0, None),
        (0.017, 15.0, 0.021),
        (0.5, math.inf, None),
    ],
)
def test_suggested_tolerance_pairs_the_nearest_and_no_other(nearest_s, rate_hz, tolerance_s):
    found = suggest_tolerance_s(nearest_s, 1 / rate_hz)
    assert found == tolerance_s
    if found is not None:
        pairer = StampPairer(True, found)
        late_ns, period_ns = round(nearest_s * 1e9), round(1e9 / rate_hz)
        pairs = []
        for i in range(20):
            pairs += pairer.add_left(i * period_ns, i)
            pairs += pairer.add_right(i * period_ns + late_ns, i)
        pairs += pairer.flush()
        assert [(pair.left, pair.right) for pair in pairs] == [(i, i) for i in range(20)]
