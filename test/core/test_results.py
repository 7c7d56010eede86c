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

"""Results and rejections: stable words, sentences with value, threshold and remedy."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Extrinsics, Rejection, RejectReason
from stereo_selfcal.core.rejection import Bound, NotFitted, fitted
from stereo_selfcal.core.results import rejected

REJECTION = Rejection(
    RejectReason.NO_LINES_FOUND, "rows of the line", 12.0, Bound.LEAST, 40, "px", "clean the lens"
)

# Other people's scripts compare these words: a change here breaks them.
WORDS = {
    "image_empty",
    "image_type",
    "image_sizes_differ",
    "rig_size_mismatch",
    "no_lines_found",
    "lines_not_matched",
    "lines_not_straight",
    "line_below_road",
    "road_not_flat",
    "lines_not_converging",
    "fitness_too_low",
    "search_space_edge",
    "no_frames",
}


def test_reasons_are_stable_words():
    # Names may be added, none may go.
    assert {str(reason) for reason in RejectReason} >= WORDS
    assert all(str(reason) == reason.name.lower() for reason in RejectReason)
    assert f"{RejectReason.NO_FRAMES}" == "no_frames"


def test_message_has_what_value_threshold_unit_and_remedy():
    assert REJECTION.message == "rows of the line: 12 px, at least 40 px needed; clean the lens"


def test_a_printed_result_is_one_line_that_says_what_came_out():
    refused = rejected(REJECTION, stamp_s=1.0)
    assert repr(refused) == f"CalibrationResult(accepted=False, {REJECTION.message!r})"
    found = replace(refused, rejection=None, message="calibrated", covariance=np.eye(300))
    assert str(found) == "CalibrationResult(accepted=True, 'calibrated')"


def test_message_without_a_unit():
    rejection = Rejection(
        RejectReason.FITNESS_TOO_LOW, "fitness", 0.123456, Bound.LEAST, 0.9999, "", "drive on"
    )
    assert rejection.message == "fitness: 0.1235, at least 0.9999 needed; drive on"


def test_message_of_a_sentence_has_the_numbers_in_it():
    rejection = replace(REJECTION, what="the line is {value} high", bound=Bound.MOST)
    assert rejection.message == "the line is 12 px high, at most 40 px allowed; clean the lens"
    assert (rejection.measured, rejection.limit) == ("the line is 12 px high", "at most 40 px")


def test_message_of_a_sentence_with_its_limit_says_no_more():
    rejection = replace(REJECTION, what="only {value} of {limit} lines {}", value=1, threshold=2, unit="")
    assert rejection.message == "only 1 of 2 lines {}; clean the lens"


def test_rejected_result():
    result = rejected(REJECTION, 3.5, stages={"genetic": Extrinsics(1, 2, 3)})
    assert not result.accepted
    assert result.reason is RejectReason.NO_LINES_FOUND
    assert result.message == REJECTION.message
    assert result.stamp_s == 3.5
    assert (result.extrinsics, result.covariance, result.std, result.lane_yaw_rad) == (None,) * 4
    assert result.stages == {"genetic": Extrinsics(1, 2, 3)}
    assert result.n_frames == 0


def test_accepted_result():
    covariance = np.diag([4e-6, 9e-8, 16e-10])
    result = CalibrationResult("fine", extrinsics=Extrinsics(1.4, 0.05, 0.01), covariance=covariance)
    assert result.accepted
    assert result.reason is None
    np.testing.assert_allclose(result.std.as_array(), [2e-3, 3e-4, 4e-5])


def test_results_do_not_share_their_stages():
    first, second = CalibrationResult("a"), CalibrationResult("b")
    first.stages["genetic"] = Extrinsics(1, 2, 3)
    assert second.stages == {}


@pytest.mark.parametrize("reason", RejectReason)
def test_every_reason_can_be_looked_up_by_its_word(reason):
    assert RejectReason(str(reason)) is reason


def test_an_estimator_says_why_it_gave_up():
    few = NotFitted("cells", 3, Bound.LEAST, 6)
    assert few.reason == "cells: 3, at least 6 needed"
    assert NotFitted("offset", 9.5, Bound.MOST, 8.0, "px").reason == "offset: 9.5 px, at most 8 px allowed"
    assert fitted(few) is None
    assert fitted("a fit") == "a fit"
