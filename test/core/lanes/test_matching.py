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

"""Matching: four lines through one point, the wrong neighbour, and the sampled rows."""

from dataclasses import replace

import numpy as np
import pytest
from independent_camera import CAMERAS, ideal_pattern, image_line

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.core.lanes.hough import hough_peaks
from stereo_selfcal.core.lanes.lane_pair import LanePattern
from stereo_selfcal.core.lanes.line_fit import fit_line
from stereo_selfcal.core.lanes.matching import (
    Candidate,
    Match,
    MatchedLines,
    common_point,
    first_sampled_row,
    is_sampled,
    match_lines,
    pair_lines,
    sample_pattern,
    similarity,
)
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene
from stereo_selfcal.synth.world import LaneLine, Road

CONFIG = CalibratorConfig()
POSE = Extrinsics(1.4, 0.05, 0.02)
NEAR_ROW = 400.0
# Beside each lane line another one, as a kerb or a worn old marking: thinner and darker.
LINES = (LaneLine(1.75), LaneLine(-1.75))
KERBS = (LaneLine(2.05, width_m=0.10, grey=175.0), LaneLine(-2.05, width_m=0.10, grey=175.0))


def candidates(image):
    """Return the fitted lines of one image, left boundaries and right boundaries."""
    points = find_stripe_points(image, CONFIG.extraction)
    fitted = [
        [(fit_line(points.gradient, peak, points.noise_grey), peak.votes) for peak in peaks]
        for peaks in hough_peaks(points, image.shape)
    ]
    return tuple([Candidate(*pair) for pair in side if pair[0] is not None] for side in fitted)


def columns_at(scene, camera, lines, row=NEAR_ROW):
    """Return the true column of the left edge of each painted line."""
    columns = []
    for line in lines:
        slope, at_0 = image_line(
            scene.rig,
            scene.extrinsics,
            camera,
            line.offset_m + line.width_m / 2,
            scene.lane_yaw_rad,
            scene.lateral_offset_m,
        )
        columns.append(at_0 + slope * row)
    return np.array(columns)


def of(scene, camera, line, found, tolerance_px=3.0):
    """Return the candidate that is the given painted line."""
    expected = columns_at(scene, camera, [line])[0]
    near = [c for c in found if abs(c.line.column_at(np.array(NEAR_ROW)) - expected) < tolerance_px]
    assert near, f"{line} was not found at all"
    return near[0]


@pytest.fixture(scope="module")
def kerbed():
    """Return (scene, left image, right image, candidates of both) of a lane between kerbs."""
    scene = random_scene(np.random.default_rng(2), 0.01)
    scene = replace(scene, road=Road(lines=(*LINES, *KERBS)))
    images = render(scene, np.random.default_rng(0))
    return scene, *images, [candidates(image) for image in images]


def test_lines_of_one_direction_meet_in_one_point():
    pattern = ideal_pattern(PAPER_RIG, POSE, lane_yaw_rad=0.02)
    lines = [*pattern.left, *pattern.right]
    point, distance = common_point(lines)
    # Far road points are projected with doubles; lines are fitted by polyfit.
    np.testing.assert_allclose(point, pattern.vanishing_point, atol=1e-6)
    assert distance < 1e-6


def test_distance_from_the_common_point_is_the_rms():
    pattern = ideal_pattern(PAPER_RIG, POSE)
    one = pattern.left[0]
    # The same direction 2 px apart: the point lies between, 1 px from each, wherever it is.
    pair = [replace(one, u_mid=one.u_mid - 1), replace(one, u_mid=one.u_mid + 1)]
    assert common_point(pair)[1] == pytest.approx(1.0)


def test_wrong_partner_misses_the_common_point():
    lane = ideal_pattern(PAPER_RIG, POSE)
    # A shadow that crosses the road at a tenth of a radian: a lane line for a camera with another yaw.
    shadow = ideal_pattern(PAPER_RIG, POSE, lane_yaw_rad=0.1).right[1]
    matched = MatchedLines.of([*lane.left, *lane.right], votes=100.0)
    wrong = MatchedLines.of([*lane.left, lane.right[0], shadow], votes=100.0)
    # Half credit is at 0.3 px.
    assert matched.concurrency_px < 1e-6
    assert wrong.concurrency_px > 3.0
    assert wrong.score < 0.02 * matched.score
    assert matched.score == pytest.approx(100.0)


def test_parallel_neighbour_goes_through_the_same_point():
    """Which is why the common point cannot tell it from the line, and the cross-section has to."""
    lane, neighbour = (ideal_pattern(PAPER_RIG, POSE, positions_m=(1.75, y)) for y in (-1.75, -2.05))
    wrong = MatchedLines.of([*lane.left, lane.right[0], neighbour.right[1]], votes=100.0)
    assert wrong.concurrency_px < 1e-6


def test_kerb_is_no_partner_of_the_line_beside_it(kerbed):
    scene, left, right, (in_left, in_right) = kerbed
    for side in (0, 1):
        line = of(scene, "left", LINES[side], in_left[side]).line
        same = of(scene, "right", LINES[side], in_right[side]).line
        kerb = of(scene, "right", KERBS[side], in_right[side]).line
        # 0.7 is the limit of match_lines.
        assert similarity((left, right), line, same) > 0.9
        assert similarity((left, right), line, kerb) < 0.6


def test_nothing_is_matched_when_only_the_kerb_is_left(kerbed):
    scene, left, right, (in_left, in_right) = kerbed
    only_line = tuple([of(scene, "left", LINES[side], in_left[side])] for side in (0, 1))
    only_kerb = tuple([of(scene, "right", KERBS[side], in_right[side])] for side in (0, 1))
    only_same = tuple([of(scene, "right", LINES[side], in_right[side])] for side in (0, 1))
    assert match_lines(only_line, only_kerb, (left, right), scene.rig, CONFIG) == ([], [])
    matches = match_lines(only_line, only_same, (left, right), scene.rig, CONFIG)
    assert [len(side) for side in matches] == [1, 1]
    assert len(pair_lines(matches, scene.rig, CONFIG)) == 1


def test_two_equal_lines_side_by_side_are_told_apart_by_what_lies_across():
    """A double line: either of its lines is as wide and as bright as the other.

    20 cm lines 25 cm apart: taken for one line, their disparity is that of a camera at 0.47 m, and
    their width 7 cm, both of which may be; so nothing but the cross-section speaks against it.
    """
    outer, inner = LaneLine(2.0, width_m=0.20), LaneLine(1.75, width_m=0.20)
    scene = random_scene(np.random.default_rng(2), 0.01)
    scene = replace(scene, road=Road(lines=(outer, inner, LINES[1])))
    images = render(scene, np.random.default_rng(0))
    in_left, in_right = (candidates(image) for image in images)
    right_boundary = [
        [of(scene, camera, LINES[1], found[1])]
        for camera, found in zip(CAMERAS, (in_left, in_right), strict=True)
    ]
    for partner, n_matched in ((inner, 1), (outer, 0)):
        first = [of(scene, "left", inner, in_left[0])]
        second = [of(scene, "right", partner, in_right[0])]
        both = (first, right_boundary[0]), (second, right_boundary[1])
        matches = match_lines(*both, images, scene.rig, CONFIG)
        assert [len(side) for side in matches] == [n_matched, 1]


@pytest.mark.parametrize("seed", range(6))
def test_both_cameras_take_the_same_line_beside_kerbs(seed):
    scene = random_scene(np.random.default_rng(seed), 0.03)
    scene = replace(scene, road=Road(lines=(*LINES, *KERBS), texture_seed=seed))
    pattern = Calibrator(scene.rig).extract(*render(scene, np.random.default_rng(seed)))
    assert isinstance(pattern, LanePattern)
    chosen = [
        [
            int(np.argmin(np.abs(columns_at(scene, camera, (*LINES, *KERBS)) - line.column_at(NEAR_ROW))))
            for line in lines
        ]
        for camera, lines in zip(CAMERAS, (pattern.left, pattern.right), strict=True)
    ]
    assert chosen[0] == chosen[1]


def test_swapped_images_are_not_matched(rendered):
    scene, left, right = rendered(0, 0.01)
    found = candidates(left), candidates(right)
    assert all(match_lines(*found, (left, right), scene.rig, CONFIG))
    assert match_lines(*found[::-1], (right, left), scene.rig, CONFIG) == ([], [])


def test_road_rolled_further_than_searched_is_not_matched(rendered):
    scene, left, right = rendered(0, 0.01)
    found = candidates(left), candidates(right)
    roll = abs(scene.extrinsics.roll_rad)
    for factor, n_pairs in ((0.5, 0), (2.0, 1)):
        config = CalibratorConfig.from_mapping({"search.roll_max_rad": factor * roll})
        matches = match_lines(*found, (left, right), scene.rig, config)
        assert [len(side) for side in matches] == [1, 1]
        assert len(pair_lines(matches, scene.rig, config)) == n_pairs


def test_similarity_of_an_image_with_itself_is_one_and_with_its_negative_minus_one(rendered):
    scene, left, right = rendered(0, 0.01)
    pattern = Calibrator(scene.rig).extract(left, right)
    line = pattern.left[0]
    partner = replace(line, slope=line.slope * 0.9)  # another slope, as a disparity is needed
    assert similarity((left, left), pattern.left[0], pattern.right[0]) < 0.9
    assert similarity((left, right), pattern.left[0], pattern.right[0]) > 0.9
    assert similarity((left, 255 - right), pattern.left[0], pattern.right[0]) < -0.9
    assert similarity((np.zeros_like(left), right), line, partner) == 0.0


@pytest.mark.parametrize(("horizon", "first"), [(200.0, 479 - 0.9 * 279), (0.0, 479 * 0.1), (-500.0, 0.0)])
def test_first_row_is_at_nine_tenths_of_the_vanishing_points_height(horizon, first):
    assert first_sampled_row(np.array([320.0, horizon]), PAPER_RIG, CONFIG) == pytest.approx(first)


def test_rows_are_sampled_every_ten_pixels_to_the_bottom():
    ideal = ideal_pattern(PAPER_RIG, POSE)
    matched = MatchedLines.of([*ideal.left, *ideal.right], 1.0)
    pattern = sample_pattern(matched, PAPER_RIG, CONFIG)
    np.testing.assert_allclose(np.diff(pattern.rows), 10.0)
    assert pattern.rows[0] == pytest.approx(479 - 0.9 * (479 - ideal.vanishing_point[1]))
    assert 479 - 10 < pattern.rows[-1] <= 479.999
    assert pattern.columns.shape == (2, 2, len(pattern.rows))
    for camera, lines in enumerate((ideal.left, ideal.right)):
        for i, line in enumerate(lines):
            np.testing.assert_allclose(pattern.columns[camera, i], line.column_at(pattern.rows))


def test_step_and_fraction_are_settings():
    ideal = ideal_pattern(PAPER_RIG, POSE)
    matched = MatchedLines.of([*ideal.left, *ideal.right], 1.0)
    config = CalibratorConfig.from_mapping({"extraction": {"sample_step_px": 7, "horizon_fraction": 0.5}})
    rows = sample_pattern(matched, PAPER_RIG, config).rows
    np.testing.assert_allclose(np.diff(rows), 7.0)
    assert rows[0] == pytest.approx(479 - 0.5 * (479 - ideal.vanishing_point[1]))


def test_lines_of_one_slope_bound_no_lane():
    """Two lines of one slope leave the roll open; their equations once ended a whole recording."""
    pattern = ideal_pattern(PAPER_RIG, POSE)
    lines = [replace(line, slope=-0.5) for line in pattern.left]
    others = [replace(line, slope=-0.6) for line in pattern.right]
    matches = tuple(
        [Match(Candidate(left, 9.0), Candidate(right, 9.0), 1.0)]
        for left, right in zip(lines, others, strict=True)
    )
    assert pair_lines(matches, PAPER_RIG, CONFIG) == []


def test_lines_that_meet_at_the_bottom_of_the_image_are_not_sampled():
    pattern = ideal_pattern(PAPER_RIG, POSE)
    matched = MatchedLines(pattern.left, pattern.right, 1.0, pattern.vanishing_point, 0.0)
    assert is_sampled(matched, PAPER_RIG, CONFIG)
    for row in (PAPER_RIG.height - 1.0, PAPER_RIG.height + 50.0):
        low = replace(matched, vanishing_point=np.array([320.0, row]))
        assert not is_sampled(low, PAPER_RIG, CONFIG)
