"""Lines found with the plane of the road surface's texture."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stereo_selfcal import CalibratorConfig, Extrinsics
from stereo_selfcal.core.lanes.hypotheses import find_hypotheses
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.search.texture_guided_lines import (
    find_road,
    line_on_road,
    lines_on_road,
    roads_of_single_lines,
)
from stereo_selfcal.core.tolerances import AGREEMENT
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

CONFIG = CalibratorConfig()


@cache
def seen(texture_amplitude=12.0):
    """Return a scene, its images, their points and what a look at them finds."""
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    images = render(scene, np.random.default_rng(0))
    points = tuple(find_stripe_points(image, CONFIG.extraction) for image in images)
    return scene, images, points, find_hypotheses(points, images, scene.rig, CONFIG)


def matches():
    return [match for side in seen()[3].matches for match in side]


def test_one_line_and_no_roll_are_near_the_road():
    """Accurate enough to align the texture: a line 2 m aside is off by 2 m times the roll."""
    scene = seen()[0]
    starts = list(roads_of_single_lines(matches(), scene.rig, CONFIG))
    assert len(starts) == len(matches())
    for start in starts:
        assert start.roll_rad == pytest.approx(0.0)
        assert abs(start.height_m - scene.extrinsics.height_m) < 2.5 * abs(scene.extrinsics.roll_rad) + 0.02
        assert abs(start.pitch_rad - scene.extrinsics.pitch_rad) < math.radians(0.5)


def test_lines_beyond_the_search_box_are_no_start():
    scene = seen()[0]
    low = CalibratorConfig.from_mapping({"search.height_max_m": 0.5 * scene.extrinsics.height_m})
    assert not list(roads_of_single_lines(matches(), scene.rig, low))


@pytest.mark.parametrize("known", [True, False])
def test_road_of_the_asphalt(known):
    scene, images, _, _ = seen()
    start = scene.extrinsics if known else None
    fit = find_road(images, start, [] if known else matches()[:1], scene.rig, CONFIG)
    assert np.all(np.abs(fit.extrinsics.as_array() - scene.extrinsics.as_array()) < AGREEMENT)


def test_no_road_without_texture_or_without_a_start():
    scene, images, _, found = seen(0.0)
    assert find_road(images, None, list(found.matches[0]), scene.rig, CONFIG) is None
    scene, images, _, _ = seen()
    assert find_road(images, None, [], scene.rig, CONFIG) is None


def test_lines_of_the_left_camera_are_found_in_the_right_one():
    """The best pair is the lane's, though the right camera's own candidates are not asked."""
    scene, images, points, found = seen()
    patterns = lines_on_road(scene.extrinsics, [found.candidates[0]], points, images, scene.rig, CONFIG)
    pattern, free = patterns[0], found.patterns[0]
    rows = np.array([300.0, 450.0])
    for ours, theirs in zip((*pattern.left, *pattern.right), (*free.left, *free.right), strict=True):
        np.testing.assert_allclose(ours.column_at(rows), theirs.column_at(rows), atol=0.3)


@pytest.mark.parametrize("lift_m", [-0.06, 0.06])
def test_lines_above_or_below_the_road_are_not_found_on_it(lift_m):
    scene, images, points, found = seen()
    other = replace(scene.extrinsics, height_m=scene.extrinsics.height_m + lift_m)
    assert not lines_on_road(other, [found.candidates[0]], points, images, scene.rig, CONFIG)
    assert line_on_road(other, matches(), points, images, scene.rig, CONFIG) is None


def test_one_line_on_the_road_knows_where_it_leads():
    scene, images, points, _ = seen()
    found = line_on_road(scene.extrinsics, matches(), points, images, scene.rig, CONFIG)
    assert found is not None
    assert found[1] == pytest.approx(scene.lane_yaw_rad, abs=math.radians(0.2))


def test_a_line_that_crosses_the_road_leads_nowhere():
    """The same lines, seen by a camera that is said to be turned by what no car in its lane is."""
    scene, images, points, _ = seen()
    turned = replace(scene.rig, cx=scene.rig.cx + scene.rig.fx * math.tan(math.radians(12.0)))
    road = Extrinsics(*scene.extrinsics.as_array())
    assert line_on_road(road, matches(), points, images, turned, CONFIG) is None
