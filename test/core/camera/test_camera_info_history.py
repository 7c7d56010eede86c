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

"""Which CameraInfo holds for which image."""

from types import SimpleNamespace

import pytest

from stereo_selfcal.core.camera.camera_info_history import CameraInfoHistory

MS = 1_000_000


def info(name, stamp_ms, calibrated=True):
    stamp = SimpleNamespace(sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * MS)
    first = float(ord(name[0])) if calibrated else 0.0
    header = SimpleNamespace(stamp=stamp)
    return SimpleNamespace(name=name, header=header, width=64, height=48, k=[first] * 9, p=[first] * 12)


def history(*infos, keep_ms=10_000):
    """Make one of (name, stamp, arrival) in milliseconds; a small first letter is uncalibrated."""
    made = CameraInfoHistory(keep_ms * MS)
    for name, stamp_ms, arrived_ms in infos:
        made.add(info(name, stamp_ms, name[0].isupper()), arrived_ms * MS)
    return made


def at(made, stamp_ms, arrived_ms):
    found = made.at(stamp_ms * MS, arrived_ms * MS)
    return None if found is None else found.name


def test_an_image_has_the_camera_info_of_its_own_stamp():
    """Whichever arrives first of the two, and whatever else there is."""
    made = history(("A", 100, 100), ("B", 200, 205), ("C", 300, 301))
    assert [at(made, stamp, stamp) for stamp in (100, 200, 300)] == ["A", "B", "C"]


def test_without_one_it_has_the_last_one_before_it():
    made = history(("A", 100, 100), ("B", 200, 200))
    assert [at(made, stamp, stamp) for stamp in (150, 250, 10_000)] == ["A", "B", "B"]


def test_images_before_the_first_one_have_that():
    assert at(history(), 50, 50) is None
    assert at(history(("A", 100, 100), ("B", 200, 200)), 50, 50) == "A"


def test_uncalibrated_ones_at_the_start_do_not_count():
    made = history(("a", 100, 100), ("b", 200, 200))
    assert at(made, 150, 150) == "b"  # there is nothing better yet
    made.add(info("C", 300), 300 * MS)
    made.add(info("d", 400, calibrated=False), 400 * MS)
    assert [at(made, stamp, stamp) for stamp in (150, 350, 450)] == ["C", "C", "d"]


def test_without_stamps_the_order_of_arrival_decides():
    made = history(("A", 0, 100), ("B", 0, 200))
    assert [at(made, stamp, stamp) for stamp in (150, 250)] == ["A", "B"]
    later = history(("A", 99_100, 100), ("B", 99_200, 200))  # the stamps are of another clock
    assert [at(later, stamp, stamp) for stamp in (50, 150, 250)] == ["A", "A", "B"]


@pytest.mark.parametrize("keep_ms", [1000, 5000])
def test_a_history_does_not_grow_with_time(keep_ms):
    made = history(*((f"A{i}", 10 * i, 10 * i) for i in range(2000)), keep_ms=keep_ms)
    assert len(made._entries) <= keep_ms // 10 + 2
    assert at(made, 20_000 - keep_ms, 20_000) == f"A{2000 - keep_ms // 10}"
    assert made.last.name == "A1999" and made.last_stamp_ns == 19_990 * MS


def test_one_that_came_once_stays():
    made = history(("A", 100, 100), keep_ms=1)
    assert at(made, 10_000_000, 10_000_000) == "A"
    made.clear()
    assert at(made, 10_000_000, 10_000_000) is None and made.last is None


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ("ABAB", ("A", "B")),
        ("AABBAB", ("A", "B")),
        ("ABABA", ("B", "A")),
        ("ABA", None),
        ("ABCABC", None),
        ("AAAA", None),
    ],
)
def test_two_that_alternate_are_found_whatever_their_stamps(names, found):
    made = history(*((name, 100, 100 + i) for i, name in enumerate(names)))
    alternating = made.alternating
    assert (alternating and tuple(each.name for each in alternating)) == found


def test_what_alternated_long_ago_is_forgotten():
    made = history(*((name, 100, 100 + i) for i, name in enumerate("ABAB")), keep_ms=1000)
    made.add(info("B", 1100), 1100 * MS)
    assert made.alternating is not None
    made.add(info("B", 1200), 1200 * MS)
    assert made.alternating is None
