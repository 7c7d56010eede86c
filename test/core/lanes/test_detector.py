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

"""A detector proposes the lines of an image; another one can take the place of the Hough transform."""

from dataclasses import replace

import numpy as np

from stereo_selfcal import CalibratorConfig
from stereo_selfcal.core.lanes.detector import detect_by_hough
from stereo_selfcal.core.lanes.hypotheses import NoPattern, find_hypotheses
from stereo_selfcal.core.lanes.matching import Candidate
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.synth.scenes import named_scene


def frame_of_a_straight_road():
    scene = named_scene("straight_road")
    frame = scene.frame(0)
    images = (frame.left, frame.right)
    config = CalibratorConfig()
    points = tuple(find_stripe_points(image, config.extraction) for image in images)
    return images, points, scene.scene.rig, config


def test_hough_detector_finds_both_boundaries_on_their_sides():
    images, points, _, _ = frame_of_a_straight_road()
    for image, view in zip(images, points, strict=True):
        left, right = detect_by_hough(view, image)
        assert left[0].line.slope < 0.0 < right[0].line.slope  # going down: to the left, to the right
        assert left[0].votes == max(candidate.votes for candidate in left)


def test_another_detector_takes_the_place_of_hough():
    images, points, rig, config = frame_of_a_straight_road()
    calls = []

    def best_only(view, image):
        calls.append(len(view.rows))
        return tuple(side[:1] for side in detect_by_hough(view, image))

    usual = find_hypotheses(points, images, rig, config)
    found = find_hypotheses(points, images, rig, config, detector=best_only)
    assert calls == [len(view.rows) for view in points]  # once for each camera
    assert [len(side) for camera in found.candidates for side in camera] == [1, 1, 1, 1]
    np.testing.assert_allclose(found.patterns[0].columns, usual.patterns[0].columns, atol=0.2)


def test_lines_of_a_detector_are_judged_as_those_of_hough_are():
    images, points, rig, config = frame_of_a_straight_road()

    def far_too_short(view, image):
        sides = detect_by_hough(view, image)
        return tuple([Candidate(replace(c.line, n_rows=12), c.votes) for c in side] for side in sides)

    found = find_hypotheses(points, images, rig, config, detector=far_too_short)
    assert isinstance(found.patterns, NoPattern)
    assert found.patterns.rejection.reason is RejectReason.NO_LINES_FOUND
