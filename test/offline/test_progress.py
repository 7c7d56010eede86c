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

"""How well the mount is known as a recording goes on."""

from types import SimpleNamespace

import pytest

from stereo_selfcal import Extrinsics
from stereo_selfcal.offline.progress import ProgressNotes


def std_of(n):
    return Extrinsics(1.0 / n, 2.0 / n, 3.0 / n)


def noted(verdicts):
    """Return the notes of frames, and after how many accepted ones an estimate was made."""
    notes, asked = ProgressNotes(), []
    accepted = 0

    class Fake:
        @property
        def estimate(self):
            asked.append(accepted)
            return SimpleNamespace(std=std_of(accepted))

    for index, verdict in enumerate(verdicts):
        accepted += verdict
        notes.note(SimpleNamespace(accepted=verdict, stamp_s=float(index)), Fake())
    return notes, asked, accepted


@pytest.mark.parametrize(("n", "counts"), [(1, [1]), (2, [1, 2]), (5, [1, 2, 4, 5]), (8, [1, 2, 4, 8])])
def test_the_estimate_is_noted_each_time_the_frames_have_doubled_and_at_the_end(n, counts):
    notes, asked, _ = noted([True] * n)
    points = notes.end(std_of(n))
    assert [point.accepted for point in points] == counts
    assert [point.std for point in points] == [std_of(count) for count in counts]
    assert [point.stamp_s for point in points] == [count - 1.0 for count in counts]
    assert len(asked) <= n.bit_length()


def test_refused_frames_count_for_nothing():
    notes, _, accepted = noted([False, True, False, True, True, False])
    points = notes.end(std_of(accepted))
    assert [(point.accepted, point.stamp_s) for point in points] == [(1, 1.0), (2, 3.0), (3, 4.0)]
    assert noted([False] * 3)[0].end(None) == ()


def test_with_other_cameras_it_begins_anew():
    notes, _, _ = noted([True] * 3)
    notes.clear()
    assert notes.end(None) == ()
