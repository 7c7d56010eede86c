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

"""Which refusal a frame has where nothing was accepted: what the surface lacks, and what the lines lack."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from refusal_words import assert_says_everything

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics, RejectReason
from stereo_selfcal.core.estimators.coarse_road import CoarseRoad
from stereo_selfcal.core.evidence.frame_evidence import FoundBy, Hypothesis
from stereo_selfcal.core.evidence.road_surface import RoadSurface
from stereo_selfcal.core.lanes import frame_checks
from stereo_selfcal.core.lanes.hypotheses import LaneHypotheses, NoPattern
from stereo_selfcal.core.rejection import Bound, GateReading, NotFitted, Rejection
from stereo_selfcal.core.search.attempt import Attempt, Verdict
from stereo_selfcal.core.search.refusal import with_lines_missing, without_pair
from stereo_selfcal.core.search.strategy import choose
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import custom_scene
from stereo_selfcal.synth.world import LaneLine, Road

NO_POINTS = NotFitted("points of a road", 35, Bound.LEAST, 100)
NOT_ALIGNED = NotFitted("cells whose height is known", 1, Bound.LEAST, 6)
COARSE = CoarseRoad(Extrinsics(1.4, 0.05, 0.0), np.eye(3), 0.6, 0.9, 2)
ONE_LINE = frame_checks.line_not_in_both((1, 0), (0, 0))
NO_LINE = frame_checks.check_lines_found([([], []), ([], [])], CalibratorConfig())
LINE = object()


def lines(rejection, n_candidates=1):
    """Return lines of a frame of which no two are a pair."""
    camera = [LINE] * n_candidates, []
    return LaneHypotheses((camera, camera), ([], []), NoPattern(rejection))


def attempt_of(found_by, verdict=Verdict.REFUSED, reason=None, gate="certain", pattern=None):
    rejection = None
    if reason is not None:
        rejection = Rejection(reason, "a measured value", 2.0, Bound.MOST, 1.0, "m", "drive on")
    readings = (GateReading(gate, gate, 2.0, Bound.MOST, 1.0, "m", False),)
    message = "the strip under the car is not aligned" if rejection is None else rejection.message
    return Attempt(Hypothesis(found_by, pattern), verdict, message, rejection, readings=readings)


def test_neither_a_road_nor_a_line_is_a_reason_of_its_own():
    rejection = without_pair(None, lines(NO_LINE, 0), RoadSurface(NO_POINTS, NO_POINTS, NO_POINTS), [])
    assert rejection.reason is RejectReason.ROAD_NOT_SEEN
    assert_says_everything(rejection, "points of a road: 35, at least 100", "no lane line", "at least 40 px")


def test_the_surface_of_a_frame_without_a_pair_of_lines_is_told_with_value_and_limit():
    for surface, words in (
        (
            RoadSurface(NO_POINTS, NO_POINTS, NO_POINTS),
            "the road surface is not seen: points of a road: 35, at least 100",
        ),
        (
            RoadSurface(COARSE, NOT_ALIGNED, NOT_ALIGNED),
            "does not align in both images: cells whose height is known: 1",
        ),
    ):
        rejection = without_pair(None, lines(ONE_LINE), surface, [])
        assert rejection.reason is RejectReason.NO_LINES_FOUND
        assert_says_everything(rejection, "only a left lane line was found in both images, 1 of 2", words)


def test_where_the_surface_is_not_asked_it_is_not_told():
    assert without_pair(None, lines(ONE_LINE), None, []) is ONE_LINE
    assert without_pair(None, lines(NO_LINE, 0), None, []) is NO_LINE


def test_what_exchanged_cameras_cause_is_not_told_beside_it():
    swapped = frame_checks.exchanged_by_disparity(-40.0)
    assert without_pair(None, lines(swapped), RoadSurface(NO_POINTS, NO_POINTS, NO_POINTS), []) is swapped


def test_a_surface_that_was_no_estimate_is_told_with_the_lines_on_it():
    on_road = lines(frame_checks.no_pair_on_road(0, 1))
    tried = attempt_of(FoundBy.SURFACE, Verdict.NOT_FITTED)
    rejection = without_pair(on_road, lines(ONE_LINE), RoadSurface(COARSE, NOT_ALIGNED, NOT_ALIGNED), [tried])
    words = "only a right lane line was found on the road surface", "the strip under the car is not aligned"
    assert_says_everything(rejection, *words)


def test_a_surface_that_a_gate_refused_is_told_with_the_lines_that_are_missing():
    refused = attempt_of(FoundBy.SURFACE, reason=RejectReason.ESTIMATE_UNCERTAIN)
    rejection = with_lines_missing(refused, lines(frame_checks.no_pair_on_road(1, 0)))
    assert rejection.reason is RejectReason.ESTIMATE_UNCERTAIN and rejection.remedy == "drive on"
    words = (
        "a measured value: 2 m, at most 1 m allowed",
        "only a left lane line was found on the road surface",
    )
    assert_says_everything(rejection, *words)
    assert with_lines_missing(refused, None) is refused.rejection


def test_the_most_helpful_refusal_is_that_of_the_frame():
    pattern = object()
    clutter = attempt_of(FoundBy.HOUGH, reason=RejectReason.FITNESS_TOO_LOW, pattern=pattern)
    bend = attempt_of(FoundBy.HOUGH, reason=RejectReason.LINES_NOT_STRAIGHT, pattern=pattern)
    on_road = attempt_of(FoundBy.ROAD, reason=RejectReason.FITNESS_TOO_LOW, pattern=pattern)
    surface = attempt_of(FoundBy.SURFACE, reason=RejectReason.ESTIMATE_UNCERTAIN)
    gave_up = attempt_of(FoundBy.SURFACE, Verdict.NOT_FITTED)
    reason = RejectReason.TEXTURE_DISAGREES
    contradiction = attempt_of(FoundBy.HOUGH, reason=reason, gate="surface_agrees", pattern=pattern)
    accepted = attempt_of(FoundBy.HOUGH, Verdict.ACCEPTED, pattern=pattern)
    assert choose([on_road, surface, clutter, accepted]) is accepted
    assert choose([on_road, surface, contradiction]) is contradiction
    assert choose([on_road, surface, clutter]) is on_road
    assert choose([surface, clutter]) is surface
    assert choose([surface, clutter, bend]) is bend
    assert choose([gave_up, clutter]) is clutter
    assert choose([gave_up]) is None
    assert choose([]) is None


@pytest.fixture(scope="module")
def bare():
    scene = custom_scene(no_lines=True).scene
    return replace(scene, road=Road(lines=(), texture_amplitude=0.0))


def calibrated(scene, images=None):
    images = images or render(scene, np.random.default_rng(0))
    return Calibrator(scene.rig).add(*images)


def test_a_frame_that_shows_nothing_says_that_the_road_is_not_seen(bare):
    result = calibrated(bare)
    assert result.reason is RejectReason.ROAD_NOT_SEEN
    assert_says_everything(result.rejection, "look at the road", "no lane line was found in either image")


def test_a_frame_with_one_line_says_which_one_is_missing(bare):
    result = calibrated(replace(bare, road=replace(bare.road, lines=(LaneLine(1.75),))))
    assert result.reason is RejectReason.NO_LINES_FOUND
    assert_says_everything(result.rejection, "only a left lane line was found", "the road surface")
    assert "swapped" not in result.message


def test_exchanged_images_without_lines_are_told_by_what_is_near(bare):
    """Stones that lie about, larger than the pixels of the small images in which both are compared."""
    images = render(bare, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    grain = cv2.resize(rng.normal(0.0, 25.0, (40, 54)).astype(np.float32), (640, 480))
    v = np.arange(480)[:, None] - 240.0
    u = np.arange(640)[None, :] + np.zeros((480, 1))
    disparity = np.maximum(v, 0.0) * 0.15
    left = np.clip(images[0] + grain, 0, 255).astype(np.uint8)
    shifted = cv2.remap(
        left, (u + disparity).astype(np.float32), np.float32(v + 240 + 0 * u), cv2.INTER_LINEAR
    )
    swapped = calibrated(bare, (shifted, left))
    assert swapped.reason is RejectReason.CAMERAS_SWAPPED
    assert_says_everything(swapped.rejection, "disparity of the lower part of the images", "exchange")
    assert calibrated(bare, (left, shifted)).reason is not RejectReason.CAMERAS_SWAPPED
