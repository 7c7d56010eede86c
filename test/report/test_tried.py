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

"""What was tried with a refused frame: the attempts in order, in words."""

import numpy as np

from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.search.attempt import Verdict
from stereo_selfcal.offline import AttemptSummary, FrameRow
from stereo_selfcal.report.tried import FOUND_BY_IN_WORDS, VERDICT_IN_WORDS, tried

BEND = Rejection(
    RejectReason.LINES_NOT_STRAIGHT, "the lines bend", 300.0, Bound.LEAST, 1000.0, "m", "go straight"
)
NO_PAIR = Rejection(RejectReason.LINES_NOT_MATCHED, "lines", 1, Bound.LEAST, 2, "", "wipe the lens")
BENT = AttemptSummary(FoundBy.HOUGH, Verdict.REFUSED, BEND, "straight lane")
ON_ROAD = AttemptSummary(FoundBy.ROAD, Verdict.REFUSED, BEND, "straight lane")
SURFACE = AttemptSummary(FoundBy.SURFACE, Verdict.NOT_FITTED, comment="no line lies in it")


def refused(rejection, attempts=(), name="", stamp_s=0.0):
    return FrameRow(stamp_s, str(rejection.reason), None, name=name, rejection=rejection, attempts=attempts)


def test_every_way_and_every_verdict_has_words():
    assert set(FOUND_BY_IN_WORDS) == set(FoundBy)
    assert set(VERDICT_IN_WORDS) == set(Verdict)
    assert len({*FOUND_BY_IN_WORDS.values()}) == len(FoundBy)


def test_attempts_are_told_in_order_with_verdict_check_value_and_limit():
    (frame,) = tried([refused(BEND, (ON_ROAD, SURFACE, BENT), "7.png")])
    assert (frame["reason"], frame["frame"], frame["without"]) == ("lines_not_straight", "7.png", 0)
    bent = {
        "verdict": "refused",
        "reason": "lines_not_straight",
        "gate": "straight lane",
        "why": "The lines bend: 300 m, at least 1000 m needed",
    }
    assert frame["steps"] == [
        {"lines": "Two lane lines on the road surface", **bent},
        {
            "lines": "The road surface, without a pair of lines",
            "verdict": "no estimate",
            "reason": "",
            "gate": "",
            "why": "No line lies in it",
        },
        {"lines": "Two lane lines of the whole image", **bent},
    ]


def test_a_search_for_lines_that_failed_comes_after_the_road_surface():
    (frame,) = tried([refused(NO_PAIR, (SURFACE,))])
    first, second = frame["steps"]
    assert first["verdict"] == "no estimate"
    assert (second["verdict"], second["reason"]) == ("not found", "lines_not_matched")
    assert second["why"] == "Lines: 1, at least 2 needed"


def test_what_a_refusal_says_beside_that_of_its_attempt_is_no_attempt():
    more = BEND.followed_by("a line lies on one side", "go straight")
    (frame,) = tried([refused(more, (BENT,))])
    assert [step["verdict"] for step in frame["steps"]] == ["refused"]


def test_the_frame_that_is_told_is_one_with_attempts_and_the_others_are_counted():
    rows = [refused(NO_PAIR, (SURFACE,) if index == 1 else (), f"{index}.png") for index in range(7)]
    (frame,) = tried(rows)
    assert (frame["frame"], frame["frames"], frame["without"]) == ("1.png", 7, 6)


def test_where_there_was_nothing_to_try_there_are_no_steps():
    (frame,) = tried([refused(NO_PAIR, stamp_s=12.0)])
    assert frame["steps"] == []
    assert frame["frame"] == "at 12.0 s"


def test_accepted_frames_are_not_told():
    assert tried([FrameRow(0.0, None, None, covariance=np.eye(3), attempts=(BENT,))]) == []


def test_each_reason_has_a_frame_the_most_frequent_first():
    rows = [refused(BEND, (BENT,)), refused(NO_PAIR, (SURFACE,)), refused(NO_PAIR, (SURFACE,))]
    assert [frame["reason"] for frame in tried(rows)] == ["lines_not_matched", "lines_not_straight"]
