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

"""Pitch and roll of the right camera: Bayes' rule by brute force, and images that are turned back."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import seen_turned

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.estimators.dense_disparity import DenseDisparities
from stereo_selfcal.core.estimators.matched_points import MatchedPoints
from stereo_selfcal.core.estimators.row_alignment import LEAST_SMOOTH_PX, RowAlignment
from stereo_selfcal.core.evidence import camera_turn
from stereo_selfcal.core.evidence.camera_turn import CameraTurn, measure_turn, turned_back, with_prior
from stereo_selfcal.core.evidence.row_offset import VerticalOffset
from stereo_selfcal.core.rejection import Bound, NotFitted
from stereo_selfcal.core.road.priors import CALIBRATED_TURN_STD_RAD, TURNED_ROWS_PART, TURNED_STD_RAD
from stereo_selfcal.synth.scenes import PAPER_RIG

RIG = PAPER_RIG
BLANK = np.full((RIG.height, RIG.width), 90, np.uint8)
NO_DISPARITIES = DenseDisparities(np.full((240, 320), -1.0, np.float32), 2, 16)
NO_POINTS = NotFitted("points", 3, Bound.LEAST, 30)
NO_CELLS = NotFitted("cells", 3, Bound.LEAST, 12)
POSE = Extrinsics(1.4, 0.05, 0.02)
DEG = math.radians(1.0)


def rows(pitch_deg, roll_deg, std_deg=(0.01, 0.02)):
    """Return what points tell: a turn with standard deviations."""
    turn = np.radians([pitch_deg, roll_deg, 0.0])
    return RowAlignment(turn, 0.0, 0.0, np.diag(np.radians([*std_deg, 0.1, 0.3, 0.3]) ** 2), 0.1, 0.05, 300)


def offset(lower_px, fall_deg, std_px=0.01, std_deg=0.005):
    return VerticalOffset(lower_px, std_px, fall_deg * DEG, std_deg * DEG, 40)


def told(monkeypatch, points, road=NO_CELLS, coarse=POSE):
    """Return the turn where points and road tell these."""
    nothing = np.zeros((0, 2), np.float32)
    monkeypatch.setattr(camera_turn, "match_points", lambda *_: MatchedPoints(nothing, nothing))
    monkeypatch.setattr(camera_turn, "describe_points", lambda *_: None)
    monkeypatch.setattr(camera_turn, "align_rows", lambda *_: points)
    monkeypatch.setattr(camera_turn, "vertical_offset", lambda *_: road)
    return measure_turn((BLANK, BLANK), RIG, NO_DISPARITIES, coarse)


def believed(points):
    return with_prior(CameraTurn.of_points(points))


def by_brute_force(values, stds, calibrated_std):
    """Return mean and standard deviation of an angle by Bayes' rule, from all that tells it."""
    grid = np.arange(-1.0, 1.0, 2e-4) * DEG

    def normal(x, std):
        return np.exp(-0.5 * (x / std) ** 2) / std

    turned_std = math.sqrt(calibrated_std**2 + TURNED_STD_RAD**2)
    probability = (1.0 - TURNED_ROWS_PART) * normal(grid, calibrated_std)
    probability = probability + TURNED_ROWS_PART * normal(grid, turned_std)
    for value, std in zip(values, stds, strict=True):
        probability = probability * normal(grid - value, std)
    probability /= probability.sum()
    mean = float(probability @ grid)
    return mean, math.sqrt(float(probability @ (grid - mean) ** 2))


@pytest.mark.parametrize("pitch_deg", [0.0, 0.005, 0.03, 0.06, -0.2])
@pytest.mark.parametrize("std_deg", [0.002, 0.009, 0.05])
def test_posterior_is_that_of_bayes_rule(pitch_deg, std_deg):
    found = believed(rows(pitch_deg, -2.0 * pitch_deg, (std_deg, 2.0 * std_deg)))
    for index, (value, std) in enumerate(((pitch_deg, std_deg), (-2.0 * pitch_deg, 2.0 * std_deg))):
        mean, spread = by_brute_force([value * DEG], [std * DEG], CALIBRATED_TURN_STD_RAD[index])
        assert found.as_array()[index] == pytest.approx(mean, abs=0.01 * spread)
        assert found.std_rad[index] == pytest.approx(spread, rel=0.01)


def test_faint_points_and_road_are_both_believed(monkeypatch):
    """Content that is lower is that of a camera that is nose up."""
    lower_px, fall_deg, points = 0.3, 0.05, rows(-0.02, -0.06, (0.02, 0.05))
    found = told(monkeypatch, points, offset(lower_px, fall_deg))
    smooth_rad = LEAST_SMOOTH_PX / RIG.fy
    of_road = (
        math.hypot(0.01 / RIG.fy, smooth_rad),
        math.hypot(0.005 * DEG, smooth_rad * 2 * RIG.fx / RIG.width),
    )
    values = ([-0.02 * DEG, -lower_px / RIG.fy], [-0.06 * DEG, -fall_deg * DEG])
    for index, std in enumerate(([0.02 * DEG, of_road[0]], [0.05 * DEG, of_road[1]])):
        mean, spread = by_brute_force(values[index], std, CALIBRATED_TURN_STD_RAD[index])
        assert found.as_array()[index] == pytest.approx(mean, abs=0.01 * spread)
        assert found.std_rad[index] == pytest.approx(spread, rel=0.01)
    # What points tell clearly needs no road.
    clear = rows(0.0, 0.0, (0.004, 0.009))
    np.testing.assert_array_equal(
        told(monkeypatch, clear, offset(5.0, 1.0)).as_array(), told(monkeypatch, clear).as_array()
    )


@pytest.mark.parametrize("std_deg", [0.003, 0.01, 0.04])
def test_turn_grows_with_what_is_told_without_a_jump(std_deg):
    stated = np.arange(0.0, 0.4, 0.002)
    found = [believed(rows(each, 0.0, (std_deg, 0.02))) for each in stated]
    pitch, std = np.array([[each.pitch_rad, each.std_rad[0]] for each in found]).T / DEG
    assert np.all(np.diff(pitch) > 0.0) and np.all(pitch <= stated)
    assert np.diff(pitch).max() < 0.012 and np.abs(np.diff(std)).max() < 0.006


def test_tails_are_heavy():
    """A camera that has surely turned is corrected by all of it; one that may have turned, by little."""
    clear = believed(rows(0.2, 0.0, (0.01, 0.02)))
    assert clear.pitch_rad == pytest.approx(0.2 * DEG, rel=0.02)
    unclear = believed(rows(0.05, 0.0, (0.05, 0.05)))
    assert abs(unclear.pitch_rad) < 0.01 * DEG and unclear.std_rad[0] < 0.03 * DEG


def test_without_any_rows_it_is_what_calibrations_leave(monkeypatch):
    for coarse, road in ((None, offset(5.0, 1.0)), (POSE, NO_CELLS)):
        found = told(monkeypatch, NO_POINTS, road, coarse)
        assert not found.seen and found.lacking is NO_POINTS
        assert (found.pitch_rad, found.roll_rad) == (0.0, 0.0)
        np.testing.assert_allclose(found.std_rad, CALIBRATED_TURN_STD_RAD[:2])
        images = (BLANK, BLANK)
        assert turned_back(images, RIG, found) == (images, found)


def test_points_that_hardly_tell_a_turn_are_no_comparison_of_the_rows(monkeypatch):
    """A correction by half of what calibrations leave, or more, adds as much noise as it takes away."""
    for points in (rows(0.03, 0.0, (0.008, 0.001)), rows(0.0, 0.05, (0.001, 0.011))):
        found = told(monkeypatch, points)
        assert not found.seen and (found.pitch_rad, found.roll_rad) == (0.0, 0.0)
        assert "that the rows of both images tell: 0.0" in found.lacking.reason
    assert told(monkeypatch, rows(0.03, 0.0, (0.004, 0.009))).seen
    # The same where the road tells no more.
    assert not told(monkeypatch, rows(0.03, 0.0, (0.02, 0.02)), offset(0.1, 0.0, std_px=0.2)).seen


def test_what_is_not_corrected_is_unknown_by_all_of_it():
    turn = CameraTurn.of_points(rows(0.03, -0.04, (0.04, 0.03)))
    std = turn.rig_std(0.001)
    assert (std.pitch_rad, std.roll_rad) == pytest.approx((0.05 * DEG, 0.05 * DEG))
    std = replace(turn, corrected=True).rig_std(0.001)
    assert (std.pitch_rad, std.roll_rad) == pytest.approx((0.04 * DEG, 0.03 * DEG))
    assert std.yaw_rad == 0.001 and std.distortion_px == 0.05 and std.rows_measured
    assert not CameraTurn.unknown(NO_POINTS).rig_std(0.001).rows_measured


SPOTS = np.array([(80.0, 420.0), (320.0, 240.0), (560.0, 90.0), (120.0, 60.0)])


def spots_at(middles):
    v, u = np.mgrid[: RIG.height, : RIG.width]
    grey = sum(np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * 3.0**2)) for x, y in middles)
    return np.rint(200.0 * grey).astype(np.uint8)


@pytest.mark.parametrize("angles_deg", [(0.3, 0.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, 0.2), (0.2, 0.4, -0.1)])
def test_image_of_a_turned_camera_is_turned_back(angles_deg):
    """Spots where OpenCV projects them for a turned camera end where they are without a turn.

    OpenCV's cubic interpolation draws them to the middle of a pixel by up to 0.05 px.
    """
    pitch, roll, yaw = np.radians(angles_deg)
    turned = spots_at(seen_turned(RIG, SPOTS, pitch_rad=pitch, roll_rad=roll, yaw_rad=yaw))
    turn = CameraTurn(pitch, roll, np.eye(2) * 1e-8)
    (left, straight), after = turned_back((BLANK, turned), RIG, turn, yaw)
    lower = turned_back((BLANK, turned), RIG, turn, yaw, first_row=RIG.height // 3)[0][1]
    np.testing.assert_array_equal(lower[: RIG.height // 3], turned[: RIG.height // 3])
    difference = lower[RIG.height // 3 :].astype(int) - straight[RIG.height // 3 :]
    assert np.max(np.abs(difference)) <= 1  # as OpenCV rounds the positions
    assert left is BLANK and after.corrected and straight.dtype == np.uint8
    v, u = np.mgrid[: RIG.height, : RIG.width]
    for x, y in SPOTS:
        near = np.hypot(u - x, v - y) < 15
        found = [np.average(places[near], weights=straight[near].astype(float)) for places in (u, v)]
        np.testing.assert_allclose(found, (x, y), atol=0.06)
