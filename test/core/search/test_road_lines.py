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

"""Lines that are known to be paint on a road are found again, and others are not taken for them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.evidence.frame_evidence import FrameObservations
from stereo_selfcal.core.search.known_lines import HALF_DOUBLE_LINE_M, MOST_AGE_S
from stereo_selfcal.core.search.road_lines import RoadLines
from stereo_selfcal.core.search.strategy import choose
from stereo_selfcal.synth.scenes import custom_scene

CONFIG = CalibratorConfig()
STAMP_S = 10.0


def frame_of(**changes):
    (frame,) = custom_scene(n_frames=1, noise_fraction=0.01, **changes).frames()
    return frame.left, frame.right


@cache
def known_lines():
    rig = custom_scene(n_frames=1).scene.rig
    cold = Calibrator(rig).calibrate_frame(*frame_of(), STAMP_S)
    lines = RoadLines.of(choose(cold.attempts), STAMP_S, rig)
    assert lines is not None
    return rig, lines


def attempts(lines, rig, age_s, **changes):
    frame = FrameObservations.from_images(frame_of(**changes), rig, CONFIG)
    return list(lines.attempts(frame, STAMP_S + age_s, rig, CONFIG))


@pytest.mark.parametrize("age_s", [0.1, 2.0 * MOST_AGE_S])
def test_the_same_lines_are_found_again(age_s):
    rig, lines = known_lines()
    attempt, after = attempts(lines, rig, age_s, seed=1, lateral_offset_m=0.05)[0]
    assert attempt.accepted
    assert after.camera.stamp_s == STAMP_S + age_s
    assert after.width_m == lines.width_m  # that of the cold frame, from which errors do not add up
    assert attempt.estimate.reservations == lines.reservations
    names = [term.name for term in attempt.estimate.terms]
    assert all(term.name in names for term in lines.road_terms)


def test_their_distance_is_that_of_the_lane():
    right, left = (line.offset_m for line in custom_scene(n_frames=1).scene.road.lines)
    assert known_lines()[1].width_m == pytest.approx(abs(left - right), abs=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lines_that_are_farther_apart_are_others(sign):
    rig, lines = known_lines()
    other = replace(lines, width_m=lines.width_m + sign * (HALF_DOUBLE_LINE_M + 0.05))
    found = attempts(other, rig, 2.0 * MOST_AGE_S)
    assert found and all(after is None for _, after in found)


def test_a_frame_without_lines_has_no_attempt():
    rig, lines = known_lines()
    frame = FrameObservations.from_images(tuple(np.full((2, 480, 640), 90, np.uint8)), rig, CONFIG)
    assert list(lines.attempts(frame, STAMP_S + 0.1, rig, CONFIG)) == []
    assert RoadLines.of(None, STAMP_S, rig) is None
