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

"""Every reason to refuse a frame before there is an estimate, from both sides of its limit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import ideal_pattern
from refusal_words import assert_says_everything

from stereo_selfcal import CalibratorConfig, Extrinsics, RejectReason, StereoRig
from stereo_selfcal.core.lanes import frame_checks
from stereo_selfcal.core.lanes.matching import Candidate, MatchedLines
from stereo_selfcal.synth.scenes import PAPER_RIG

CONFIG = CalibratorConfig()
GREY = np.zeros((480, 640), np.uint8)


def assert_refuses(rejection, reason, value, threshold, *words):
    assert rejection.reason is reason
    assert rejection.value == pytest.approx(value)
    assert rejection.threshold == pytest.approx(threshold)
    assert_says_everything(rejection, *words)


def test_a_pair_of_grey_images_of_the_rigs_size_is_taken():
    assert frame_checks.check_images(GREY, GREY, PAPER_RIG) is None
    read_only = GREY.copy()
    read_only.flags.writeable = False
    assert frame_checks.check_images(read_only, np.zeros((960, 1280), np.uint8)[::2, ::2], PAPER_RIG) is None


@pytest.mark.parametrize("side", ["left", "right"])
class TestOneImage:
    def check(self, side, image):
        pair = {"left": GREY, "right": GREY, side: image}
        return frame_checks.check_images(pair["left"], pair["right"], PAPER_RIG)

    @pytest.mark.parametrize("image", [None, np.empty((0, 640), np.uint8), np.empty((480, 0), np.uint8)])
    def test_empty(self, side, image):
        reason = RejectReason.IMAGE_EMPTY
        assert_refuses(
            self.check(side, image), reason, 0, 1, f"the {side} image is empty: it has 0 px", "driver"
        )

    @pytest.mark.parametrize(
        ("image", "what", "value", "limit"),
        [
            (np.zeros((480, 640, 3), np.uint8), "uint8 of shape (480, 640, 3)", 3, 2),
            (np.zeros(480, np.uint8), "uint8 of shape (480,)", 1, 2),
            (np.uint8(3), "<class 'numpy.uint8'>", 0, 2),
            (np.zeros((480, 640), np.float64), "float64 of shape (480, 640)", 64, 8),
            (np.zeros((480, 640), np.uint16), "uint16 of shape (480, 640)", 16, 8),
            (np.zeros((480, 640), bool), "bool of shape (480, 640)", 1, 8),
            (np.zeros((480, 640), np.int8), "int8 of shape (480, 640)", 7, 8),
            (np.zeros((480, 640), np.int16), "int16 of shape (480, 640)", 16, 8),
            (np.zeros((480, 640), object), "object of shape (480, 640)", 64, 8),
            ([[1, 2], [3, 4]], "<class 'list'>", 0, 2),
            ([[1], [2, 3]], "<class 'list'>", 0, 2),
            ([], "<class 'list'>", 0, 2),
            ("image.png", "<class 'str'>", 0, 2),
            (b"", "<class 'bytes'>", 0, 2),
            (object(), "<class 'object'>", 0, 2),
        ],
        ids=lambda value: type(value).__name__,
    )
    def test_of_another_type(self, side, image, what, value, limit):
        rejection = self.check(side, image)
        words = f"the {side} image is {what}, not 2-D uint8", "convert it to 8-bit grey"
        assert_refuses(rejection, RejectReason.IMAGE_TYPE, value, limit, *words)


@pytest.mark.parametrize("size", [(480, 641), (481, 640), (640, 480)])
def test_images_of_two_sizes(size):
    other = np.zeros(size, np.uint8)
    difference = max(abs(size[0] - 480), abs(size[1] - 640))
    words = "left image is 640 x 480", f"right image is {size[1]} x {size[0]}", "set both cameras to one size"
    rejection = frame_checks.check_images(GREY, other, PAPER_RIG)
    assert_refuses(rejection, RejectReason.IMAGE_SIZES_DIFFER, difference, 0, *words)


def test_images_of_another_size_than_the_rigs():
    small = np.zeros((240, 320), np.uint8)
    words = "images are 320 x 240, the rig is 640 x 480", "CameraInfo"
    rejection = frame_checks.check_images(small, small, PAPER_RIG)
    assert_refuses(rejection, RejectReason.RIG_SIZE_MISMATCH, 320, 0, *words)


@pytest.mark.parametrize(("side_px", "refused"), [(63, True), (64, False)])
def test_least_size(side_px, refused):
    image = np.zeros((side_px, 200), np.uint8)
    rejection = frame_checks.check_images(image, image, StereoRig(200, side_px, 100, 100, 99.5, 30, 0.1))
    assert (rejection is not None) is refused
    if rejection:
        assert_refuses(rejection, RejectReason.IMAGE_EMPTY, 63, 64, "use larger images")


def lines(n_rows):
    """Return one line, as a candidate, that is upright and seen in so many rows."""
    line = ideal_pattern(PAPER_RIG, Extrinsics(1.4, 0.05, 0.0)).left[0]
    return [Candidate(replace(line, n_rows=n_rows, slope=0.0), 10.0)]


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("n_rows", [None, 39, 40])
def test_every_camera_sees_a_line_of_forty_rows_on_either_side(camera, side, n_rows):
    candidates = [[lines(100), lines(100)], [lines(100), lines(100)]]
    candidates[camera][side] = [] if n_rows is None else lines(n_rows)
    rejection = frame_checks.check_lines_found(candidates, CONFIG)
    if n_rows == 40:
        assert rejection is None
        return
    words = (
        f"no {('left', 'right')[side]} lane line was found in the {('left', 'right')[camera]} image",
        "lens clean",
    )
    assert_refuses(rejection, RejectReason.NO_LINES_FOUND, n_rows or 0, 40, *words)


def test_a_flat_line_is_as_long_as_it_is():
    """A low camera sees lines that run three columns a row: 13 rows of one are 41 px."""
    (candidate,) = lines(13)
    for slope, refused in ((3.0, False), (-3.0, False), (2.8, True)):
        flat = [Candidate(replace(candidate.line, slope=slope), 10.0)]
        rejection = frame_checks.check_lines_found([(flat, lines(100)), (lines(100), lines(100))], CONFIG)
        assert (rejection is not None) == refused


def test_a_frame_without_any_line_says_so_once():
    rejection = frame_checks.check_lines_found([([], []), (lines(39), [])], CONFIG)
    words = "no lane line was found in either image: the longest candidate is 39 px long", "lens clean"
    assert_refuses(rejection, RejectReason.NO_LINES_FOUND, 39, 40, *words)


def test_a_line_on_one_side_is_told():
    candidates = [(lines(100), []), (lines(100), lines(100))]
    rejection = frame_checks.check_lines_found(candidates, CONFIG)
    words = "only a left lane line was found, and no right lane line was found in the left image"
    assert_refuses(rejection, RejectReason.NO_LINES_FOUND, 0, 40, words)


@pytest.mark.parametrize(
    ("n_matched", "value", "words"),
    [
        ((0, 0), 0, "no line of the left image was found in the right one: 0 of 2 lane lines"),
        ((0, 3), 1, "only a right lane line was found in both images, 1 of 2"),
        ((2, 0), 1, "only a left lane line was found in both images, 1 of 2"),
    ],
)
def test_a_line_that_one_camera_does_not_see_is_missing(n_matched, value, words):
    """Without evidence for it, nobody is told that the cameras may be swapped."""
    for n_exchanged in ((0, 0), n_matched):
        rejection = frame_checks.line_not_in_both(n_matched, n_exchanged)
        assert_refuses(rejection, RejectReason.NO_LINES_FOUND, value, 2, words)
        assert "swapped" not in rejection.message and "exchanged" not in rejection.message


@pytest.mark.parametrize(("n_matched", "n_exchanged"), [((0, 0), (1, 0)), ((0, 0), (2, 1)), ((0, 1), (1, 1))])
def test_lines_that_match_with_the_images_exchanged_are_evidence_of_that(n_matched, n_exchanged):
    rejection = frame_checks.line_not_in_both(n_matched, n_exchanged)
    n_sides, n_other = (sum(n > 0 for n in each) for each in (n_matched, n_exchanged))
    words = f"with left and right exchanged, {n_other} of 2 are in both", "not swapped", "rectified"
    assert_refuses(rejection, RejectReason.LINES_NOT_MATCHED, n_sides, 2, *words)


def test_boundaries_that_bound_no_lane():
    rejection = frame_checks.lines_not_matched(math.radians(15.0))
    words = "bound one lane", "at most 15 deg", "rectified"
    assert_refuses(rejection, RejectReason.LINES_NOT_MATCHED, 0, 2, *words)
    assert "swapped" not in rejection.message


@pytest.mark.parametrize(
    ("n_lines", "value", "words"),
    [
        ((0, 0), 0, "no lane line was found on the road surface: 0 of 2"),
        ((3, 0), 1, "only a left lane line was found on the road surface, 1 of 2"),
        ((0, 1), 1, "only a right lane line was found on the road surface, 1 of 2"),
        ((2, 1), 0, "no two of the lines on the road surface are parallel: 0 of 2 lane lines were found"),
    ],
)
def test_lines_on_the_road_that_are_no_pair(n_lines, value, words):
    assert_refuses(frame_checks.no_pair_on_road(*n_lines), RejectReason.NO_LINES_FOUND, value, 2, words)


def test_too_short_lines():
    rejection = frame_checks.lines_too_short(CONFIG)
    assert_refuses(rejection, RejectReason.NO_LINES_FOUND, 0, 40, "in too few rows below the horizon")


def test_exchanged_images_have_a_negative_disparity():
    """Lines that match once the images are exchanged back: as they came, their disparity was negative."""
    pattern = ideal_pattern(PAPER_RIG, Extrinsics(1.4, 0.05, 0.0))
    exchanged_back = MatchedLines.of([*pattern.left, *pattern.right], 1.0)
    disparity_px = np.mean(
        [a.column_at(a.v_mid) - b.column_at(a.v_mid) for a, b in zip(*pattern.lines, strict=True)]
    )
    assert disparity_px > 5.0
    words = "disparity of the lane lines", "exchange the topics"
    rejection = frame_checks.cameras_swapped([exchanged_back])
    assert_refuses(rejection, RejectReason.CAMERAS_SWAPPED, -disparity_px, 0, *words)


def test_a_negative_disparity_of_what_is_near_exchanges_the_images():
    rejection = frame_checks.exchanged_by_disparity(-40.0)
    words = "disparity of the lower part of the images", "exchange the topics"
    assert_refuses(rejection, RejectReason.CAMERAS_SWAPPED, -40, 0, *words)


def test_no_frames():
    assert_refuses(frame_checks.no_frames(), RejectReason.NO_FRAMES, 0, 1, "add a stereo frame")


@pytest.mark.parametrize(("pitch_deg", "converging"), [(24.5, True), (25.5, False)])
def test_lines_meet_below_the_top_of_the_image(pitch_deg, converging):
    """Nose down by atan(239.5 / 516.6) = 24.9 degrees, the horizon leaves the image."""
    pattern = ideal_pattern(PAPER_RIG, Extrinsics(1.4, math.radians(pitch_deg), 0.0))
    rejection = frame_checks.check_converging(MatchedLines.of([*pattern.left, *pattern.right], 1.0))
    assert (rejection is None) is converging
    if rejection:
        row = pattern.vanishing_point[1]
        assert row < 0
        words = "counted from the top of the image", "pitch the camera up"
        assert_refuses(rejection, RejectReason.LINES_NOT_CONVERGING, row, 0, *words)
