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

"""What an uncertainty is made of, in words: order, shares, sentences."""

import math
import re

import numpy as np
import pytest

from stereo_selfcal.core.geometry.uncertainty import TERMS, UncertaintyTerm, total_covariance
from stereo_selfcal.report.uncertainty import contributions, std_of, uncertainty_table, variance_line

MM, DEG = 1e-3, math.radians(1.0)


def term(name, height_mm, pitch_deg, roll_deg):
    return UncertaintyTerm(name, np.diag([height_mm * MM, pitch_deg * DEG, roll_deg * DEG]) ** 2)


TERMS_OF_A_DRIVE = (
    term("noise", 0.1, 0.001, 0.01),
    term("roughness", 3.0, 0.03, 0.09),
    term("rectification", 4.0, 0.04, 0.18),
)


def test_the_largest_contribution_is_first_and_the_shares_are_of_the_variance():
    parts = contributions(TERMS_OF_A_DRIVE)
    assert [part.name for part in parts] == ["rectification", "roughness", "noise"]
    assert [part.explanation for part in parts] == [TERMS[part.name] for part in parts]
    assert sum(part.share for part in parts) == pytest.approx(1.0, abs=1e-12)
    expected = [16 / 25.01, 16 / 25.01, 0.18**2 / (0.18**2 + 0.09**2 + 0.01**2)]
    assert parts[0].share == pytest.approx(np.mean(expected))
    assert parts[0].std.height_m == pytest.approx(4.0 * MM)


def test_the_order_is_by_contribution_and_not_by_metres():
    """A term of much roll is more than one of little height, though the numbers are smaller."""
    parts = contributions((term("noise", 1.0, 0.0, 0.0), term("camber", 0.5, 0.0, 0.1)))
    assert [part.name for part in parts] == ["camber", "noise"]


def test_sentences_name_up_to_three_causes_largest_first():
    table = uncertainty_table(TERMS_OF_A_DRIVE)
    assert table["sentences"] == [
        f"Height 5.0 mm: 4.0 {TERMS['rectification']}, 3.0 {TERMS['roughness']}",
        f"Pitch 0.050°: 0.040 {TERMS['rectification']}, 0.030 {TERMS['roughness']}",
        f"Roll 0.20°: 0.18 {TERMS['rectification']}, 0.09 {TERMS['roughness']}",
    ]
    alike = [term(name, 1.0, 0.01, 0.1) for name in list(TERMS)[:5]]
    assert all(sentence.count(",") == 2 for sentence in uncertainty_table(alike)["sentences"])


def test_each_component_has_its_own_order():
    table = uncertainty_table((term("noise", 9.0, 0.01, 0.01), term("crown", 1.0, 0.1, 0.1)))
    causes = [re.findall(r"noise|crown", sentence) for sentence in table["sentences"]]
    assert causes == [["noise"], ["crown"], ["crown"]]


def test_the_table_has_every_term_in_columns_of_one_precision_and_the_sum():
    table = uncertainty_table(TERMS_OF_A_DRIVE)
    assert table["headings"] == ["Height [mm]", "Pitch [deg]", "Roll [deg]"]
    rows = {row["cause"]: row for row in table["rows"]}
    assert next(iter(rows)) == "Distortion of the disparities that the calibration leaves"
    assert rows["Noise of the pixels"]["cells"] == ["0.10", "0.0010", "0.010"]
    assert rows["Noise of the pixels"]["share"] == "< 1 %"
    assert rows["Unevenness of the road along the lane"]["cells"] == ["3.00", "0.0300", "0.090"]
    assert table["sum"] == ["5.00", "0.0500", "0.201"]


def test_shares_are_widths_of_bars():
    bars = [float(row["bar"]) for row in uncertainty_table(TERMS_OF_A_DRIVE)["rows"]]
    assert bars == sorted(bars, reverse=True)
    assert sum(bars) == pytest.approx(100, abs=1.5)


def test_the_line_of_the_terminal_has_the_largest_two():
    assert variance_line(TERMS_OF_A_DRIVE) == (f"69 % {TERMS['rectification']}, 31 % {TERMS['roughness']}")
    assert variance_line(TERMS_OF_A_DRIVE[:1]) == f"100 % {TERMS['noise']}"
    many = [term(name, 1.0, 0.01, 0.1) for name in list(TERMS)[:14]]
    assert variance_line(many).count("%") == 1, "what is small is not told"


def test_a_term_of_a_name_that_is_new_is_told_by_its_name():
    assert variance_line((term("yaw_of_the_sun", 1.0, 0.1, 0.1),)) == "100 % yaw of the sun"


def test_without_terms_there_is_nothing_to_tell():
    assert uncertainty_table(()) is None
    assert variance_line(()) == ""


def test_rounding_below_zero_and_a_component_without_uncertainty_are_zero():
    assert std_of(np.diag([-1e-30, 4e-6, 0.0])).as_array().tolist() == [0.0, 2e-3, 0.0]
    table = uncertainty_table((UncertaintyTerm("noise", np.diag([1e-6, 1e-8, 0.0])),))
    assert table["sum"][2] == "0"
    assert table["sentences"][2] == "Roll 0°: 0 noise of the pixels"


def test_the_squares_of_the_terms_add_up_to_the_square_of_the_sum():
    squares = sum(np.square(part.std.as_array()) for part in contributions(TERMS_OF_A_DRIVE))
    np.testing.assert_allclose(squares, np.diagonal(total_covariance(TERMS_OF_A_DRIVE)), rtol=1e-12)
