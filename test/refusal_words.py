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

"""What every refusal has to say: its value, its limit, which side of the limit is good, and the remedy."""

import re

from stereo_selfcal.core.rejection import Bound, Rejection

# A sentence may name the end of a range instead of saying "at least" or "at most".
_ENDS = {Bound.LEAST: "the least", Bound.MOST: "the greatest", Bound.EXACTLY: "the only"}


def assert_names_its_bound(rejection: Rejection) -> None:
    """Check that the sentence says whether the limit is a least or a most, or counts: 1 of 2."""
    value, limit = (re.escape(f"{number:.4g}") for number in (rejection.value, rejection.threshold))
    end = _ENDS[rejection.bound]
    forms = (f"{rejection.bound} {limit}", f"{value} of {limit}", rf"{end} \w+ searched is {limit}")
    assert any(re.search(form, rejection.finding) for form in forms), rejection.finding


def assert_says_everything(rejection: Rejection, *words: str) -> None:
    """Check that the message is one line with value, limit, bound, unit, remedy and the words."""
    assert rejection.remedy
    message = rejection.message
    for word in (
        f"{rejection.value:.4g}",
        f"{rejection.threshold:.4g}",
        rejection.unit,
        rejection.remedy,
        *words,
    ):
        assert word in message, message
    assert "\n" not in message
    assert "{value}" not in message and "{limit}" not in message
    assert_names_its_bound(rejection)
