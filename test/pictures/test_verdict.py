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

"""What pictures say in words."""

from picture_making import REJECTION

from stereo_selfcal.core.results import rejected
from stereo_selfcal.pictures.canvas import GREEN
from stereo_selfcal.pictures.overview import draw_notice
from stereo_selfcal.pictures.verdict import StripContent, verdict_of, verdict_strip


def test_words_of_a_verdict_are_there_and_wrapped():
    def ink(verdict):
        strip = verdict_strip(verdict, 960)
        return (strip[:, 40:] > 150).all(axis=2).sum(), len(strip)

    none, short = ink(StripContent("", GREEN)), ink(StripContent("REFUSED", GREEN))
    long = ink(StripContent("REFUSED", GREEN, ("bend of the road: 320 m, at least 1000 m needed; " * 6,)))
    assert none[0] == 0 < short[0] < long[0]
    assert none[1] == short[1] < long[1]
    assert draw_notice(StripContent("no picture", GREEN)).shape == (403, 960, 3)


def test_verdict_of_a_refusal_names_reason_and_limit():
    verdict = verdict_of(rejected(REJECTION))
    assert verdict.title == "REFUSED: lines_not_straight"
    assert "3 px, at most 1 px allowed; drive straight" in verdict.lines[0]
