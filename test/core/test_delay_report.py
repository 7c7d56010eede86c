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

from dataclasses import replace

import numpy as np

from stereo_selfcal.core.delay_report import describe_delay, is_late
from stereo_selfcal.core.geometry.travel import RightDelay

LATE = RightDelay(0.005, 0.001, np.diag([4e-4**2, 1e-4]), 60, (5.0, 15.0))


def test_the_words_have_the_side_and_the_digits_of_the_deviation():
    words = "right images are taken 5.0 +- 0.4 ms later than the left ones of the same stamps"
    assert is_late(LATE) and describe_delay(LATE) == words
    assert describe_delay(replace(LATE, delay_s=-0.005)) == words.replace("later", "earlier")
    vague = replace(LATE, delay_s=0.02, covariance=np.diag([0.003**2, 1e-4]))
    assert "20 +- 3 ms later" in describe_delay(vague)


def test_what_is_not_sure_is_told_as_a_doubt():
    small = replace(LATE, delay_s=0.001)
    assert not is_late(small)
    assert describe_delay(small) == "both images of a pair are taken when their stamps say, to 1 ms"
    assert describe_delay(None) == "" and not is_late(None)


def test_at_constant_speed_it_says_what_looks_alike():
    text = describe_delay(replace(LATE, speeds_mps=(9.5, 10.0)))
    assert "at a constant speed, here 10.0 m/s, 1 ms looks like a right camera that sits 10 mm" in text
