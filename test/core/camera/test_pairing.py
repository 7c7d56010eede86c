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

"""Pairing by stamps: the nearest partner, counted drops, bags that start over."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal.core.camera.pairing import (
    BACKWARD_JUMP_NS,
    PairCounts,
    StampPairer,
    message_stamp_ns,
    stamp_to_s,
)
from stereo_selfcal.core.errors import ConfigError

MS = 1_000_000


def feed(pairer, arrivals):
    """Add ("L" or "R", stamp_ms) in order and return the pairs as (left_ms, right_ms)."""
    pairs = []
    for side, stamp_ms in arrivals:
        add = pairer.add_left if side == "L" else pairer.add_right
        stamp_ns = round(stamp_ms * MS)
        pairs += add(stamp_ns, (side, stamp_ns))
    return to_ms(pairs)


def to_ms(pairs):
    for pair in pairs:
        assert pair.left == ("L", pair.left_stamp_ns) and pair.right == ("R", pair.right_stamp_ns)
        assert pair.stamp_ns == pair.left_stamp_ns
    return [(pair.left_stamp_ns / MS, pair.right_stamp_ns / MS) for pair in pairs]


def test_exact_pairs_at_once_whichever_side_comes_first():
    pairer = StampPairer()
    assert feed(pairer, [("L", 0)]) == []
    assert feed(pairer, [("R", 0)]) == [(0, 0)]
    assert feed(pairer, [("R", 33), ("L", 33)]) == [(33, 33)]
    assert pairer.counts == PairCounts(left=2, right=2, pairs=2)


def test_exact_ignores_the_tolerance():
    assert feed(StampPairer(False, tolerance_s=1.0), [("L", 0), ("R", 1), ("L", 2)]) == []


def test_one_camera_delayed_by_several_frames_still_pairs():
    pairer = StampPairer(queue_size=4)
    assert feed(pairer, [("L", i * 33) for i in range(4)] + [("R", 0), ("L", 132), ("R", 33)]) == [
        (0, 0),
        (33, 33),
    ]


def test_a_dead_camera_fills_the_queue_and_no_more():
    pairer = StampPairer(queue_size=5)
    assert feed(pairer, [("L", i) for i in range(100)]) == []
    assert pairer.counts == PairCounts(left=100, dropped_left=95)
    assert feed(pairer, [("R", 95)]) == [(95, 95)]
    assert feed(pairer, [("R", 94)]) == []


def test_approximate_waits_for_the_nearer_partner():
    """The greedy rule of message_filters gives (20, 33) here."""
    pairer = StampPairer(True, 0.05)
    assert feed(pairer, [("L", 0), ("L", 20), ("R", 33), ("L", 34), ("R", 66)]) == [(34, 33)]
    assert pairer.counts.dropped_left == 2


def test_approximate_tolerance_is_inclusive():
    assert feed(StampPairer(True, 0.01), [("L", 0), ("R", 10), ("L", 100)]) == [(0, 10)]
    assert feed(StampPairer(True, 0.0099), [("L", 0), ("R", 10), ("L", 100)]) == []


def test_approximate_with_zero_tolerance_pairs_equal_stamps():
    assert feed(StampPairer(True, 0.0), [("L", 7), ("R", 7)]) == [(7, 7)]


def test_approximate_works_with_a_queue_of_one():
    arrivals = itertools.chain.from_iterable((("L", i), ("R", i + 5)) for i in range(0, 1000, 100))
    assert feed(StampPairer(True, 0.01, queue_size=1), arrivals) == [(i, i + 5) for i in range(0, 900, 100)]


def test_what_waits_can_be_forgotten():
    pairer = StampPairer()
    feed(pairer, [("L", 0), ("R", 5)])
    pairer.forget_waiting()
    assert feed(pairer, [("R", 0), ("L", 5), ("R", 5)]) == [(5, 5)]
    assert pairer.counts.left == 2


def test_flush_gives_the_last_pair():
    pairer = StampPairer(True, 0.01)
    assert feed(pairer, [("L", 0), ("R", 5)]) == []
    assert to_ms(pairer.flush()) == [(0, 5)]
    assert pairer.flush() == []


def test_slow_right_camera_gets_the_nearest_left_images():
    arrivals = sorted(
        [("L", i * 33) for i in range(12)] + [("R", 1 + i * 100) for i in range(4)], key=lambda a: a[1]
    )
    assert feed(StampPairer(True, 0.02), arrivals) == [(0, 1), (99, 101), (198, 201), (297, 301)]


def test_offset_of_half_a_period_pairs_every_image_once():
    arrivals = itertools.chain.from_iterable((("L", i), ("R", i + 50)) for i in range(0, 500, 100))
    assert feed(StampPairer(True, 0.06), arrivals) == [(i, i + 50) for i in range(0, 400, 100)]


def test_images_without_stamps_pair_as_they_come():
    pairer = StampPairer()
    assert feed(pairer, [("L", 0), ("R", 0)] * 5) == [(0, 0)] * 5


def test_a_repeated_stamp_replaces_the_waiting_image():
    pairer = StampPairer()
    pairer.add_left(0, "old")
    pairer.add_left(0, "new")
    (pair,) = pairer.add_right(0, "right")
    assert pair.left == "new"
    assert pairer.counts.dropped_left == 1


@pytest.mark.parametrize("approximate", [False, True])
@pytest.mark.parametrize("leftovers", [0, 1, 9, 12, 50])
def test_every_pass_of_a_looping_bag_pairs_alike(approximate, leftovers):
    """message_filters gives 88, 0, 0 pairs with 12 images of the left camera left over."""
    pairer = StampPairer(approximate, 0.001, queue_size=10)
    a_pass = [(side, i * 33) for i in range(100) for side in "LR"]
    a_pass += [("L", 3300 + i * 33) for i in range(leftovers)]
    passes = [feed(pairer, a_pass) for _ in range(3)]
    assert [len(pairs) for pairs in passes] == [100, 100, 100]
    assert pairer.counts.resets == 2


def test_a_pair_that_waited_is_not_lost_when_the_bag_starts_over():
    pairer = StampPairer(True, 0.01)
    first = feed(pairer, [("L", 0), ("R", 5), ("L", 100), ("R", 105), ("L", 200), ("R", 205)])
    assert first == [(0, 5), (100, 105)]
    assert feed(pairer, [("L", 0), ("R", 5), ("L", 100)]) == [(200, 205), (0, 5)]


def test_the_side_that_jumps_second_does_not_drop_the_first_images_of_the_other():
    pairer = StampPairer()
    feed(pairer, [("L", 1000), ("L", 2000), ("R", 1000)])
    assert feed(pairer, [("L", 0), ("R", 2000), ("R", 0)]) == [(0, 0)]


def test_a_loop_shorter_than_the_jump_pairs_without_a_reset():
    pairer = StampPairer(queue_size=5)
    a_pass = [(side, stamp) for stamp in (0, 33, 66) for side in "LR"] + [("L", 99)]
    assert [len(feed(pairer, a_pass)) for _ in range(10)] == [3] * 10
    assert pairer.counts.resets == 0


def test_jump_threshold_from_both_sides():
    for step, resets in ((BACKWARD_JUMP_NS, 0), (BACKWARD_JUMP_NS + 1, 1)):
        pairer = StampPairer()
        pairer.add_left(10**9, None)
        pairer.add_left(10**9 - step, None)
        assert pairer.counts.resets == resets


def test_nearest_difference_is_measured_anew():
    pairer = StampPairer()
    assert pairer.nearest_s is None
    feed(pairer, [("L", 0), ("R", 12), ("L", 33)])
    assert pairer.nearest_s == 0.012
    pairer.forget_nearest()
    assert pairer.nearest_s is None
    feed(pairer, [("R", 50)])
    assert pairer.nearest_s == 0.017


def test_counts_since():
    assert PairCounts(5, 4, 3, 2, 1, 1).since(PairCounts(1, 1, 1, 1, 1, 0)) == PairCounts(4, 3, 2, 1, 0, 1)


@pytest.mark.parametrize("tolerance_s", [-0.001, math.nan, math.inf])
def test_impossible_tolerance_is_refused(tolerance_s):
    with pytest.raises(ConfigError, match="tolerance"):
        StampPairer(True, tolerance_s)


def test_empty_queue_is_refused():
    with pytest.raises(ConfigError, match="queue size of the pairing is 0"):
        StampPairer(queue_size=0)


def test_stamp_conversion_is_that_of_the_message_fields():
    class Stamp:
        sec, nanosec = 1_700_000_000, 123_456_789

    class Message:
        class header:  # noqa: N801 - the field of a message
            stamp = Stamp

    assert message_stamp_ns(Message) == 1_700_000_000_123_456_789
    assert stamp_to_s(message_stamp_ns(Message)) == Stamp.sec + Stamp.nanosec * 1e-9


stamps_ms = st.lists(st.integers(0, 3000), max_size=30, unique=True).map(sorted)


@given(stamps_ms, stamps_ms, st.integers(0, 60), st.randoms(use_true_random=False))
def test_pairs_of_any_two_streams(lefts, rights, tolerance_ms, random):
    """Whatever arrives in whatever interleaving: in tolerance, each image once, in order, all counted."""
    pairer = StampPairer(True, tolerance_ms / 1000, queue_size=5)
    left, right = [("L", s) for s in lefts], [("R", s) for s in rights]
    pairs = []
    while left or right:
        source = left if not right or (left and random.random() < 0.5) else right
        pairs += feed(pairer, [source.pop(0)])
    pairs += to_ms(pairer.flush())
    assert all(abs(a - b) <= tolerance_ms for a, b in pairs)
    assert all(a < c and b < d for (a, b), (c, d) in itertools.pairwise(pairs))
    counts = pairer.counts
    assert (counts.left, counts.right, counts.pairs) == (len(lefts), len(rights), len(pairs))
    assert counts.dropped_left + counts.pairs <= counts.left <= counts.dropped_left + counts.pairs + 5


@given(
    st.integers(1, 40),
    st.floats(-14, 14),
    st.lists(st.floats(0, 1), min_size=80, max_size=80),
    st.integers(1, 5),
)
def test_jittered_cameras_pair_frame_by_frame(n, offset_ms, jitter, queue_size):
    """30 Hz, offset and jitter below half a period, arrival in order of stamps: all true pairs."""
    lefts = [i * 33 + jitter[i] for i in range(n)]
    rights = [i * 33 + offset_ms + jitter[40 + i] for i in range(n)]
    arrivals = sorted([("L", s) for s in lefts] + [("R", s) for s in rights], key=lambda a: a[1])
    pairer = StampPairer(True, 0.0165, queue_size)
    pairs = feed(pairer, arrivals) + to_ms(pairer.flush())
    assert [(round(a * MS), round(b * MS)) for a, b in pairs] == [
        (round(a * MS), round(b * MS)) for a, b in zip(lefts, rights, strict=True)
    ]


@given(st.lists(st.tuples(st.sampled_from("LR"), st.integers(0, 1000)), max_size=60), st.integers(1, 6))
def test_any_order_of_any_stamps_is_survived_and_repeatable(arrivals, queue_size):
    """Stamps in no order at all (overtaking, loops, repeats): bounded, no exception, the same again."""
    first, second = (StampPairer(True, 0.02, queue_size) for _ in range(2))
    assert feed(first, arrivals) == feed(second, arrivals)
    counts = first.counts
    assert counts.left - counts.pairs - counts.dropped_left <= queue_size
    assert counts.right - counts.pairs - counts.dropped_right <= queue_size


def test_tolerance_can_change_while_images_wait():
    pairer = StampPairer()
    assert feed(pairer, [("L", 0), ("R", 5)]) == []
    pairer.configure(True, 0.01, 5)
    assert feed(pairer, [("L", 100)]) == [(0, 5)]
    assert pairer.counts.left == 2
