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

"""A camera that repeats its last image while the other one goes on, and images that arrive twice."""

from types import SimpleNamespace

import numpy as np
import pytest

from stereo_selfcal.core.camera.frozen import FrozenImage, FrozenImages, checksum, refuse_frozen
from stereo_selfcal.core.camera.pairing import PairCounts, StampPairer
from stereo_selfcal.core.rejection import RejectReason

SEEN = np.arange(12, dtype=np.uint8).reshape(3, 4)


def follow(left, right):
    """Return the frozen image of every pair; a letter stands for the bytes of an image."""
    frozen = FrozenImages()
    return [
        frozen.follow((ord(a), ord(b)), index) for index, (a, b) in enumerate(zip(left, right, strict=True))
    ]


@pytest.mark.parametrize(
    ("left", "right", "sides"),
    [
        ("abcd", "efgh", "...."),
        ("abcd", "effg", "..R."),
        ("aabc", "efgh", ".L.."),
        ("aaaa", "eeee", "...."),  # a scene that stands
        ("abbc", "eeee", ".RRR"),  # the left one repeats a frame as well: the right one is no newer for it
        ("abbb", "eefg", ".RLL"),
        ("abcc", "effg", "..RL"),
    ],
)
def test_the_image_that_repeats_is_told_until_it_changes(left, right, sides):
    assert [("." if each is None else each.side[0].upper()) for each in follow(left, right)] == list(sides)


def test_it_is_told_since_when_the_image_is_there():
    assert follow("abcde", "effff")[2:] == [FrozenImage("right", 1)] * 3


def test_the_refusal_names_side_time_and_remedy():
    refusal = refuse_frozen(FrozenImage("left", 7_200_000_000), SEEN, SEEN, since=True)
    assert refusal.reason is RejectReason.IMAGE_FROZEN
    assert refusal.message == (
        "the left camera repeats its last image since 7.200 s, while the right one goes on: 0 bytes of the "
        "left image differ from those of the frame next to it, at least 1 needed; restart the left camera "
        "and its driver"
    )


def test_an_image_of_one_grey_value_is_left_to_the_other_checks():
    black = np.zeros_like(SEEN)
    assert refuse_frozen(FrozenImage("left", 0), black, SEEN) is None
    assert refuse_frozen(FrozenImage("right", 0), black, SEEN) is not None
    assert refuse_frozen(None, SEEN, SEEN) is None


def test_the_checksum_is_of_all_bytes():
    sums = {
        checksum(SimpleNamespace(data=data)) for data in (b"", b"abc", b"abd", np.arange(3, dtype=np.uint8))
    }
    assert len(sums) == 4


def paired(*images):
    """Return the pairs and counts of images ("L" or "R", stamp, checksum)."""
    pairer = StampPairer()
    pairs = []
    for side, stamp_ns, each in images:
        pairs += (pairer.add_left if side == "L" else pairer.add_right)(stamp_ns, side, each)
    return pairs, pairer


@pytest.mark.parametrize("order", ["LRLR", "LLRR", "RLLR", "RRLL"])
def test_an_image_that_arrives_twice_counts_once(order):
    images = [(side, stamp_ns, stamp_ns) for stamp_ns in (10, 20) for side in order]
    pairs, pairer = paired(*images)
    assert [pair.stamp_ns for pair in pairs] == [10, 20] and all(pair.frozen is None for pair in pairs)
    assert pairer.counts == PairCounts(left=4, right=4, pairs=2, repeated_left=2, repeated_right=2)


def test_an_image_of_other_bytes_or_another_stamp_is_another_image():
    pairs, pairer = paired(*((side, 0, each) for each in (1, 2, 3) for side in "LR"))
    assert len(pairs) == 3 and pairer.counts.repeated_left == 0
    pairs, pairer = paired(*((side, stamp_ns, 1) for stamp_ns in (1, 2, 3) for side in "LR"))
    assert len(pairs) == 3 and pairer.counts.repeated_left == 0


def test_a_recording_that_starts_over_repeats_nothing():
    stamps_ns = [step * 10**8 for step in range(5)] * 2
    pairs, pairer = paired(*((side, stamp_ns, stamp_ns) for stamp_ns in stamps_ns for side in "LR"))
    assert len(pairs) == 10 and pairer.counts.repeated_right == 0 and pairer.counts.resets >= 1


def test_a_new_measurement_takes_every_image_for_a_new_one():
    """A single frame that is played in a loop is a frame of every call."""
    pairer = StampPairer()
    for _ in range(2):
        pairer.add_left(0, "L", 1)
        assert len(pairer.add_right(0, "R", 1)) == 1
        pairer.forget_nearest()


def test_pairs_say_which_image_is_a_repeated_one():
    pairs, _ = paired(*((side, at, at if side == "L" else min(at, 2)) for at in range(1, 5) for side in "LR"))
    assert [pair.frozen for pair in pairs] == [None, None, FrozenImage("right", 2), FrozenImage("right", 2)]
