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

"""Lines looked for on the road that its surface shows, and the yaw by one of them."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import CalibratorConfig, RejectReason
from stereo_selfcal.core.geometry.plane import PlaneCamera, plane_from_pose
from stereo_selfcal.core.geometry.rays import pixel_rays
from stereo_selfcal.core.lanes.hypotheses import NoPattern, find_hypotheses
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.search import lines_on_road as module
from stereo_selfcal.core.search.lines_on_road import candidates_on_road, lines_on_road, yaw_of_line
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

CONFIG = CalibratorConfig()


@cache
def seen():
    """Return a scene, its images and their points."""
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    images = render(scene, np.random.default_rng(0))
    return scene, images, tuple(find_stripe_points(image, CONFIG.extraction) for image in images)


def found_on(**changes):
    """Return the lines on a road that differs from the true one."""
    scene, images, points = seen()
    return lines_on_road(replace(scene.extrinsics, **changes), points, images, scene.rig, CONFIG)


def test_both_lines_of_the_lane_are_found_on_its_road():
    """The same as those that are found in the whole image, without any plane."""
    scene, images, points = seen()
    on_road, in_image = found_on(), find_hypotheses(points, images, scene.rig, CONFIG)
    rows = np.array([300.0, 450.0])
    ours, theirs = on_road.patterns[0], in_image.patterns[0]
    for our, their in zip((*ours.left, *ours.right), (*theirs.left, *theirs.right), strict=True):
        np.testing.assert_allclose(our.column_at(rows), their.column_at(rows), atol=0.3)
    left, right = on_road.matches
    assert left and right
    assert not any(
        a.left.line.is_same_stripe(b.left.line)
        for side in (left, right)
        for a in side
        for b in side
        if a is not b
    )


def test_what_is_not_on_the_road_is_no_candidate():
    """Points above the horizon, and those farther aside than the next lane."""
    scene, images, points = seen()
    plane = plane_from_pose(scene.extrinsics, scene.rig, PlaneCamera.LEFT)
    asked = {}

    def detector(chosen, image):
        asked["points"] = chosen
        return [], []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "detect_by_hough", detector)
        candidates_on_road(scene.extrinsics, points[0], images[0], scene.rig)
    chosen = asked["points"]
    assert 0 < len(chosen.rows) < len(points[0].rows)
    disparity = plane.disparities(pixel_rays(scene.rig, chosen.columns, chosen.rows))
    aside_m = (chosen.columns - scene.rig.cx) / disparity * scene.rig.baseline_m
    assert disparity.min() > 0.0 and np.abs(aside_m).max() < 1.5 * 3.75
    assert chosen.gradient is points[0].gradient and len(chosen.columns) == len(chosen.rows)


@pytest.mark.parametrize("lift_m", [-0.06, 0.06])
def test_lines_above_or_below_the_road_are_not_found_on_it(lift_m):
    other = found_on(height_m=seen()[0].extrinsics.height_m + lift_m)
    assert other.matches == ([], []) and isinstance(other.patterns, NoPattern)
    assert other.patterns.rejection.reason is RejectReason.NO_LINES_FOUND
    assert "no lane line was found on the road surface: 0 of 2" in other.patterns.rejection.message


def test_lines_that_do_not_meet_at_the_horizon_are_no_pair(monkeypatch):
    """By a hundredth of slope; the lines stay, as each of them tells the yaw."""
    monkeypatch.setattr(module, "MAX_GAP_RAD", -1.0)
    found = found_on()
    assert isinstance(found.patterns, NoPattern)
    assert "no two of the lines on the road surface are parallel" in found.patterns.rejection.message
    assert all(found.matches)


@pytest.mark.parametrize("pitch_deg", [-0.3, 0.3])
def test_a_plane_that_is_a_little_off_finds_the_lines(pitch_deg):
    """As far as the surface may be off: it is lower at the far end, or higher, and not by half a kerb."""
    pitch = seen()[0].extrinsics.pitch_rad + math.radians(pitch_deg)
    assert isinstance(found_on(pitch_rad=pitch).patterns, list)


def test_one_line_on_the_road_tells_the_yaw():
    scene = seen()[0]
    left, right = found_on().matches
    for matches in ((left, []), ([], right)):
        yaw = yaw_of_line(matches, scene.extrinsics, scene.rig)
        assert yaw == pytest.approx(scene.lane_yaw_rad, abs=math.radians(0.2))
    assert yaw_of_line(([], []), scene.extrinsics, scene.rig) is None


def test_a_line_that_crosses_the_road_tells_no_yaw():
    """The same lines, seen by a camera that is said to be turned by what no car in its lane is."""
    scene = seen()[0]
    turned = replace(scene.rig, cx=scene.rig.cx + scene.rig.fx * math.tan(math.radians(12.0)))
    assert yaw_of_line(found_on().matches, scene.extrinsics, turned) is None


def test_what_chance_makes_of_texture_tells_no_yaw():
    """Texture without any line had one of 64 rows and 4 votes, which led 7 deg aside."""
    scene, (matches, _) = seen()[0], found_on().matches

    def with_votes(per_row):
        match = matches[0]
        votes = per_row * match.left.line.n_rows / match.similarity / 2.0
        sides = {side: replace(getattr(match, side), votes=votes) for side in ("left", "right")}
        weak = replace(match, **sides)
        return yaw_of_line(([weak], []), scene.extrinsics, scene.rig)

    assert with_votes(0.15) is None and with_votes(0.24) is None
    assert with_votes(0.26) == pytest.approx(scene.lane_yaw_rad, abs=math.radians(0.2))
