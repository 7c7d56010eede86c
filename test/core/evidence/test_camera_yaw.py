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

"""The yaw of the right camera: what lines tell of it, and all together against Bayes' rule by brute force."""

import math

import cv2
import numpy as np
import pytest
from independent_camera import ideal_pattern, of_turned_camera, project, with_columns

from stereo_selfcal import Calibrator, Extrinsics
from stereo_selfcal.core.evidence.camera_yaw import YawTold, yaw_of_lines, yaw_of_matches, yaw_posterior
from stereo_selfcal.core.evidence.far_disparity import MOST_TURN_RAD, FarDisparity, infinitely_far
from stereo_selfcal.core.lanes.matching import Candidate, Match
from stereo_selfcal.core.road.priors import (
    FARTHEST_M,
    PAINT_ANGLE_STD_RAD,
    PARALLEL_PART,
    TURNED_PART,
    TURNED_STD_RAD,
    VERGENCE_STD_RAD,
)
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

RIG = PAPER_RIG
POSE = Extrinsics(1.4, 0.05, 0.02)
WIDTH_M = 3.5


def told_by(pattern, width_m=WIDTH_M):
    return yaw_of_lines(pattern.left, pattern.right, width_m, RIG)


# --- lane lines ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw_deg", [-0.2, -0.03, 0.0, 0.06, 0.12])
@pytest.mark.parametrize(("pose", "lane_yaw"), [(POSE, 0.0), (Extrinsics(2.0, -0.03, -0.04), 0.03)])
def test_lines_of_a_turned_camera_meet_where_it_looks(yaw_deg, pose, lane_yaw):
    pattern = ideal_pattern(RIG, pose, lane_yaw_rad=lane_yaw)
    told = told_by(of_turned_camera(pattern, RIG, yaw_rad=math.radians(yaw_deg)))
    # Beside the optical axis, a turn moves a column by a little more.
    assert told.yaw_rad == pytest.approx(math.radians(yaw_deg), rel=0.01, abs=1e-7)
    assert told.certainty == PARALLEL_PART


def test_rows_that_are_off_move_where_lines_meet_along_the_row_by_nothing():
    """Both lines meet as much lower. A pitch is no yaw."""
    told = told_by(of_turned_camera(ideal_pattern(RIG, POSE), RIG, pitch_rad=math.radians(0.1)))
    assert abs(told.yaw_rad) < math.radians(0.002)


def converging(angle_rad):
    """Return the pattern of two lines that are not parallel, by an angle between them."""
    pattern = ideal_pattern(RIG, POSE)
    columns = pattern.columns.copy()
    for i, camera in enumerate(("left", "right")):
        for j, (at_m, slope) in enumerate(((1.75, -angle_rad / 2), (-1.75, angle_rad / 2))):
            ends = [(x, at_m + slope * x, 0.0) for x in (4.0, 40.0)]
            (u0, v0), (u1, v1) = project(RIG, POSE, camera, ends)
            columns[i, j] = u0 + (pattern.rows - v0) * (u1 - u0) / (v1 - v0)
    return with_columns(pattern, columns)


@pytest.mark.parametrize("angle_rad", [PAINT_ANGLE_STD_RAD, -PAINT_ANGLE_STD_RAD])
def test_paint_at_an_angle_tells_a_wrong_yaw_by_what_it_is_said_to(angle_rad):
    """Lines that meet at a distance have a disparity there; noise of the lines adds to it."""
    told = told_by(converging(angle_rad))
    by_lines = told_by(ideal_pattern(RIG, POSE, std=(1e-6, 1e-8))).std_rad
    assert abs(told.yaw_rad) == pytest.approx(by_lines, rel=0.02)
    assert math.copysign(1.0, told.yaw_rad) == -math.copysign(1.0, angle_rad)  # nearer: larger disparity


def test_noise_of_the_lines_scatters_the_yaw_as_claimed():
    rng = np.random.default_rng(0)
    pattern = ideal_pattern(RIG, POSE, std=(0.05, 5e-4))
    yaws = []
    for _ in range(300):
        columns = pattern.columns.copy()
        for i, pair in enumerate((pattern.left, pattern.right)):
            for j, line in enumerate(pair):
                u, slope = rng.multivariate_normal((0, 0), line.covariance)
                columns[i, j] += u + slope * (pattern.rows - line.v_mid)
        yaws.append(told_by(with_columns(pattern, columns)).yaw_rad)
    by_paint = told_by(ideal_pattern(RIG, POSE, std=(1e-6, 1e-8))).std_rad
    noise = math.sqrt(told_by(pattern).std_rad ** 2 - by_paint**2)
    # 300 draws give a standard deviation to 4 %.
    assert np.std(yaws) == pytest.approx(noise, rel=0.15)


def test_lines_that_do_not_meet_tell_nothing():
    pattern = ideal_pattern(RIG, POSE)
    twice = (pattern.left[0], pattern.left[0])
    assert yaw_of_lines(twice, pattern.right, WIDTH_M, RIG) is None
    assert told_by(pattern, width_m=0.0) is None


def test_lines_of_rendered_images_tell_a_shift_of_a_part_of_a_pixel():
    """The content of a camera that looks farther left moves to the right."""
    scene = named_scene("straight_road")
    rig, (left, right) = scene.scene.rig, (scene.frame(0).left, scene.frame(0).right)
    yaws_px = []
    for shift_px in (0.0, 0.25, 0.5, 1.0):
        move = np.array([[1.0, 0.0, shift_px], [0.0, 1.0, 0.0]])
        size = right.shape[1], right.shape[0]
        moved = cv2.warpAffine(right, move, size, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        pattern = Calibrator(rig).extract(left, moved)
        told = yaw_of_lines(pattern.left, pattern.right, WIDTH_M, rig)
        yaws_px.append(told.yaw_rad * rig.fx)
        assert abs(told.yaw_rad * rig.fx - shift_px) < 2.0 * told.std_rad * rig.fx
    np.testing.assert_allclose(np.array(yaws_px) - yaws_px[0], [0.0, 0.25, 0.5, 1.0], atol=0.03)


def matches_at(*offsets_and_votes, yaw_rad=0.0):
    found = ([], [])
    for offset_m, votes in offsets_and_votes:
        pattern = ideal_pattern(RIG, POSE, (offset_m, offset_m - 3.0))
        pattern = of_turned_camera(pattern, RIG, yaw_rad=yaw_rad)
        match = Match(Candidate(pattern.left[0], votes), Candidate(pattern.right[0], votes), 1.0)
        found[0 if offset_m > 0.0 else 1].append(match)
    return found


def test_the_clearest_two_lines_as_far_apart_as_those_of_a_lane_tell_the_yaw():
    yaw = math.radians(0.1)
    for lines in (((1.75, 9.0), (-1.75, 9.0)), ((1.75, 9.0), (0.3, 90.0), (-1.75, 9.0))):
        told = yaw_of_matches(matches_at(*lines, yaw_rad=yaw), RIG, POSE)
        assert told.yaw_rad == pytest.approx(yaw, rel=0.01)
    assert yaw_of_matches(matches_at((0.8, 9.0), (-0.8, 9.0)), RIG, POSE) is None  # too near for a lane
    assert yaw_of_matches(matches_at((1.75, 9.0)), RIG, POSE) is None


# --- all together --------------------------------------------------------------------------------------


def normal(x, std):
    return np.exp(-0.5 * (x / std) ** 2) / (std * math.sqrt(2.0 * math.pi))


def by_brute_force(told, far, calibrated, n=4001):
    """Return mean and standard deviation by Bayes' rule, on a grid of a four thousandth of a degree.

    The likelihood of the least disparity is integrated over how far away the farthest thing is.
    """
    yaw = np.linspace(-MOST_TURN_RAD, MOST_TURN_RAD, n)
    anything = 1.0 / (2.0 * MOST_TURN_RAD)
    probability = np.ones(n)
    for each in told:
        likely = normal(yaw - each.yaw_rad, each.std_rad)
        probability *= each.certainty * likely + (1.0 - each.certainty) * anything
    if far is not None:
        at_infinity, std = -yaw * RIG.fx, far.std_px
        mean_px = RIG.fx * RIG.baseline_m / FARTHEST_M
        # The middles of so many parts of equal probability.
        parts = -mean_px * np.log1p(-(np.arange(300) + 0.5) / 300)
        nearer = sum(normal(far.disparity_px - at_infinity - each, std) for each in parts) / len(parts)
        share = infinitely_far(far)
        seen = share * normal(far.disparity_px - at_infinity, std) + (1.0 - share) * nearer
        probability *= 0.99 * seen * RIG.fx + 0.01 * anything
    if calibrated:
        probability *= (1.0 - TURNED_PART) * normal(yaw, VERGENCE_STD_RAD) + TURNED_PART * normal(
            yaw, TURNED_STD_RAD
        )
    probability /= probability.sum()
    mean = float(probability @ yaw)
    return mean, math.sqrt(float(probability @ (yaw - mean) ** 2))


DEG = math.radians(1.0)
LINES = YawTold(0.1 * DEG, 0.01 * DEG, 0.9)
ROWS = YawTold(-0.02 * DEG, 0.1 * DEG)


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("far", [None, FarDisparity(0.4, 0.1, 1.0), FarDisparity(-0.6, 0.1, 8.0)])
@pytest.mark.parametrize("told", [(), (ROWS,), (ROWS, LINES)], ids=["none", "rows", "rows and lines"])
def test_posterior_is_that_of_bayes_rule(told, far, calibrated):
    found = yaw_posterior(told, far, RIG, calibrated=calibrated)
    mean, std = by_brute_force(told, far, calibrated)
    assert found.yaw_rad == pytest.approx(mean, abs=0.02 * std)
    assert found.std_rad == pytest.approx(std, rel=0.04)  # of a uniform distribution, the ends count a little


def posteriors(stated_deg, std_deg, **more):
    told = [(YawTold(each * DEG, std_deg * DEG),) for each in stated_deg]
    found = [yaw_posterior(each, None, RIG, calibrated=True, **more) for each in told]
    return np.array([[each.yaw_rad, each.std_rad] for each in found]).T / DEG


@pytest.mark.parametrize("std_deg", [0.005, 0.02, 0.1])
def test_what_is_told_is_believed_the_more_the_clearer_it_is_and_without_a_jump(std_deg):
    stated = np.arange(0.0, 0.4, 0.002)
    yaw, std = posteriors(stated, std_deg)
    assert yaw[0] == pytest.approx(0.0, abs=1e-6)
    assert np.all(np.diff(yaw) > 0.0)
    # From the prior to what is told, within a few standard deviations.
    assert np.diff(yaw).max() < 0.012
    assert np.abs(np.diff(std)).max() < 0.006
    assert np.all(np.abs(yaw) <= stated + 1e-6)


def test_tails_are_heavy():
    """A turn that is clearly told is believed; one that is hardly told is that of a usual calibration."""
    (clear, unclear), (clear_std, unclear_std) = np.transpose(
        [posteriors([0.2], std_deg)[:, 0] for std_deg in (0.01, 0.2)]
    )
    assert clear == pytest.approx(0.2, rel=0.02) and clear_std == pytest.approx(0.01, rel=0.05)
    assert abs(unclear) < 0.02 and unclear_std < 0.07


def test_two_lines_that_contradict_everything_else_may_be_no_paint():
    lines = YawTold(0.3 * DEG, 0.01 * DEG, PARALLEL_PART)
    others = YawTold(0.0, 0.01 * DEG)
    found = yaw_posterior((lines, others), None, RIG, calibrated=False)
    assert found.yaw_rad == pytest.approx(0.0, abs=0.002 * DEG)


def test_far_things_show_a_turn_without_a_jump():
    """A negative disparity is one at infinity or beyond; a positive one is that of things that are near."""
    disparities = np.arange(-2.0, 2.01, 0.05)
    for n_equal in (1.0, 16.0):
        found = [
            yaw_posterior((), FarDisparity(float(each), 0.1, n_equal), RIG, calibrated=True)
            for each in disparities
        ]
        yaw_px = np.array([each.yaw_rad for each in found]) * RIG.fx
        assert np.all(np.diff(yaw_px)[disparities[:-1] < 0.0] < 0.0)
        assert np.abs(np.diff(yaw_px)).max() < 0.4
        # What is farthest away may be nearer than infinity: then the camera has turned by more.
        assert 0.9 < yaw_px[20] < 1.5
        assert np.abs(yaw_px[disparities > 0.5]).max() < (0.4 if n_equal == 1.0 else 2.1)


def test_of_images_that_were_turned_back_the_rest_is_told():
    whole = yaw_posterior((YawTold(0.2 * DEG, 0.01 * DEG),), None, RIG, calibrated=True)
    rest = (YawTold(0.05 * DEG, 0.01 * DEG),)
    left = yaw_posterior(rest, None, RIG, calibrated=True, corrected_rad=0.15 * DEG)
    assert left.yaw_rad + 0.15 * DEG == pytest.approx(whole.yaw_rad, abs=1e-3 * DEG)
    assert left.std_rad == pytest.approx(whole.std_rad, rel=0.02)
    assert YawTold(3e-4, 4e-4).rms_rad == pytest.approx(5e-4)


@pytest.mark.parametrize("yaw_deg", [-1.0, -0.6, 0.6, 1.5])
def test_a_turn_beyond_the_range_of_far_things_is_not_sharply_known_at_its_end(yaw_deg):
    told = YawTold(math.radians(yaw_deg), math.radians(0.1))
    yaw = yaw_posterior([told], None, RIG, calibrated=False)
    assert yaw.yaw_rad == pytest.approx(told.yaw_rad, rel=1e-3)
    assert yaw.std_rad == pytest.approx(told.std_rad, rel=1e-2)
