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

"""An alignment in the user's units: signs against projected points, limits from both sides, the words."""

import numpy as np
import pytest

from stereo_selfcal import StereoRig
from stereo_selfcal.core.alignment_verdict import (
    CORRECTABLE_LIMIT_RAD,
    GOOD_LIMITS_RAD,
    UNEXPLAINED_LIMIT_RAD,
    AlignmentVerdict,
    depth_error,
    report_alignment,
    verdict_of,
)
from stereo_selfcal.core.geometry.alignment import ALIGNMENT_NAMES, Alignment

RIG = StereoRig(1242, 375, 720.0, 720.0, 621.0, 187.0, 0.54)
SURE = np.radians(0.001)


def alignment(pitch_deg=0.0, roll_deg=0.0, yaw_deg=0.0, std_deg=0.001, **changes):
    stds = np.radians(np.broadcast_to(std_deg, 3).astype(float))
    return Alignment(*np.radians([pitch_deg, roll_deg, yaw_deg]), np.diag(stds**2), **changes)


def seen_by_turned_camera(turn, point):
    """Return column and row of a point (x right, y down, z ahead of the left camera) in the right image."""
    ray = turn.left_from_right.T @ (np.array(point) - [RIG.baseline_m, 0.0, 0.0])
    return RIG.cx + RIG.fx * ray[0] / ray[2], RIG.cy + RIG.fy * ray[1] / ray[2]


@pytest.mark.parametrize("yaw_deg", [0.14, -0.14, 0.5, -0.5])
@pytest.mark.parametrize("true_m", [8.0, 20.0])
def test_depth_error_is_that_of_a_projected_point(yaw_deg, true_m):
    turn = alignment(yaw_deg=yaw_deg)
    right, _ = seen_by_turned_camera(turn, (RIG.baseline_m, 0.0, true_m))
    left = RIG.cx + RIG.fx * RIG.baseline_m / true_m
    measured_m = RIG.fx * RIG.baseline_m / (left - right)
    assert depth_error(turn, RIG, measured_m) == pytest.approx(measured_m / true_m - 1.0, rel=1e-3)
    assert (measured_m > true_m) == (yaw_deg > 0)
    size = "large" if measured_m > true_m else "small"
    assert f"depths are too {size}, by" in report_alignment(turn, RIG).message


def test_words_of_the_issue():
    report = report_alignment(alignment(yaw_deg=0.14, std_deg=0.01), RIG)
    assert report.verdict is AlignmentVerdict.CORRECTABLE
    assert report.message.startswith(
        "the right camera looks 0.14 +- 0.01 deg too far left: depths are too large, by 4.5 % at 10 m, "
        "14 % at 30 m; its rows are right to 0.1 px (pitch +0.00 +- 0.01 deg)"
    )
    assert report.message.endswith("; correctable: a rotation of the right image explains all of it")


@pytest.mark.parametrize(("pitch_deg", "side"), [(0.06, "high"), (-0.06, "low")])
def test_rows_lie_where_a_projected_point_does(pitch_deg, side):
    turn = alignment(pitch_deg=pitch_deg)
    _, row = seen_by_turned_camera(turn, (RIG.baseline_m, 0.0, 50.0))
    assert (row < RIG.cy) == (side == "high")  # rows count downwards
    words = f"its rows lie {abs(row - RIG.cy):.1f} px too {side} (pitch {pitch_deg:+.3f} +- 0.001 deg)"
    assert words in report_alignment(turn, RIG).message


@pytest.mark.parametrize(("roll_deg", "side"), [(0.1, "right"), (-0.1, "left")])
def test_lean_lifts_the_rows_of_the_side_that_hangs(roll_deg, side):
    turn = alignment(roll_deg=roll_deg)
    aside = RIG.width / 2 / RIG.fx * (1 if side == "right" else -1)
    _, row = seen_by_turned_camera(turn, (RIG.baseline_m + 50.0 * aside, 0.0, 50.0))
    assert row < RIG.cy
    words = (
        f"its {side} side hangs 0.100 +- 0.001 deg too low: rows lie {RIG.cy - row:.1f} px too high at "
        f"the {side} border"
    )
    assert words in report_alignment(turn, RIG).message


@pytest.mark.parametrize("index", range(3))
def test_each_limit_from_both_sides(index):
    angles = dict.fromkeys(("pitch_deg", "roll_deg", "yaw_deg"), 0.0)
    name = list(angles)[index]
    good, most = np.degrees([GOOD_LIMITS_RAD[index], CORRECTABLE_LIMIT_RAD])
    expected = {
        0.99 * good: AlignmentVerdict.GOOD,
        1.01 * good: AlignmentVerdict.CORRECTABLE,
        0.99 * most: AlignmentVerdict.CORRECTABLE,
        1.01 * most: AlignmentVerdict.CALIBRATE_AGAIN,
    }
    for angle, verdict in expected.items():
        for sign in (-1, 1):
            assert verdict_of(alignment(**{**angles, name: sign * angle})) is verdict, angle


def test_error_of_the_measurement_widens_the_limit():
    # 0.05 deg is off where it is known to 0.005, and may be a good 0.00 where it is known to 0.02.
    assert verdict_of(alignment(yaw_deg=0.05, std_deg=0.005)) is AlignmentVerdict.CORRECTABLE
    assert verdict_of(alignment(yaw_deg=0.05, std_deg=0.02)) is AlignmentVerdict.GOOD


def test_what_is_not_seen_is_no_zero():
    report = report_alignment(alignment(std_deg=[0.002, 0.005, 0.1]), RIG)
    assert report.verdict is AlignmentVerdict.NOT_SEEN
    assert "yaw +0.00 +- 0.10 deg is not seen well enough to be judged" in report.message
    assert "depths" not in report.message
    assert "its rows are right to 0.03 px" in report.message


def test_what_is_off_is_seen_however_uncertain():
    report = report_alignment(alignment(yaw_deg=0.4, std_deg=[0.002, 0.005, 0.05]), RIG)
    assert report.verdict is AlignmentVerdict.CORRECTABLE
    assert report.message.startswith("the right camera looks 0.40 +- 0.05 deg too far left")


@pytest.mark.parametrize("nothing", [None, alignment(std_deg=1.0), alignment(std_deg=np.inf)])
def test_nothing_seen(nothing):
    report = report_alignment(nothing, RIG)
    assert report.verdict is AlignmentVerdict.NOT_SEEN
    assert report.message == "it is not seen how the right camera is turned"


def test_rows_that_no_rotation_explains():
    good = alignment(unexplained_rad=0.99 * UNEXPLAINED_LIMIT_RAD)
    assert verdict_of(good) is AlignmentVerdict.GOOD
    report = report_alignment(alignment(unexplained_rad=1.5 * UNEXPLAINED_LIMIT_RAD), RIG)
    assert report.verdict is AlignmentVerdict.CALIBRATE_AGAIN
    assert "calibrate the cameras again: no rotation explains the rows, which are off by 0.068 deg" in (
        report.message
    )


def test_beyond_infinity_is_told():
    narrow = StereoRig(640, 480, 500.0, 500.0, 320.0, 240.0, 0.1)
    message = report_alignment(alignment(yaw_deg=-0.3), narrow).message
    assert "depths are too small, by 52 % at 10 m, and infinity is measured as 19.1 m" in message


def test_zero_has_no_minus():
    assert "(pitch +0.000 +- 0.001 deg)" in report_alignment(alignment(pitch_deg=-0.0001), RIG).message


def test_verdicts_are_stable_words():
    assert [str(each) for each in AlignmentVerdict] == ["good", "correctable", "calibrate_again", "not_seen"]
    faults = {str(each) for each in AlignmentVerdict if each.is_fault}
    assert faults == {"correctable", "calibrate_again"}


def test_values_by_name_and_back():
    one = alignment(0.1, -0.2, 0.3, std_deg=[0.01, 0.02, 0.03])
    assert tuple(one.as_dict()) == ALIGNMENT_NAMES
    again = Alignment.from_values({**one.as_dict(), **one.std_dict()})
    assert np.array_equal(again.as_array(), one.as_array())
    assert np.allclose(again.covariance, one.covariance)
