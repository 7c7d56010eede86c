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

"""Headlights, lamps, wet roads and rain: where light is, and what a mirror shows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from edge_reading import edge_column
from independent_camera import CAMERAS, project

from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.ingredients import (
    Camera,
    Facade,
    Headlights,
    House,
    Lamp,
    Rain,
    Wall,
    Wet,
    WorldScene,
)
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import Photometry
from stereo_selfcal.synth.world_light import lit
from stereo_selfcal.synth.world_renderer import render_side
from stereo_selfcal.synth.worlds import named_world

GROUND = 90.0
SHARP = Camera(Photometry(psf_sigma_px=0.0))
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(-1.5))
NIGHT = Headlights(ambient=0.02, near=1.0, reach_m=15.0, spread_rad=0.4)


def world(**changes):
    values = {"texture_amplitude": 0.0, "asphalt_grey": GROUND, "left": SHARP, "right": SHARP}
    return WorldScene(PAPER_RIG, POSE, (-1.75, 1.75), 0.02, 0.15, **{**values, **changes})


def seen_at(scene, camera, point):
    where = project(scene.rig, scene.pose, camera, [point], scene.lane_yaw_rad, scene.lateral_offset_m)
    return where[0]


def centre(picture, u, v, reach=8):
    """Return the centre of the light around a pixel, (u, v), and its sum."""
    first = np.array([round(u) - reach, round(v) - reach])
    part = picture[first[1] : first[1] + 2 * reach + 1, first[0] : first[0] + 2 * reach + 1].astype(float)
    part = part - np.median(part)
    rows, columns = np.indices(part.shape)
    total = max(part.sum(), 1e-9)
    return first + np.array([(columns * part).sum(), (rows * part).sum()]) / total, total


def test_headlights_light_the_road_ahead():
    scene = world(headlights=NIGHT, sky_grey=5.0)
    picture = render_side(scene, "left")
    for (s, d), share in (
        ((15.0, 0.15), 0.5),
        ((30.0, 0.15), 0.2),
        ((15.0, 0.15 - 15 * math.tan(0.4)), None),
    ):
        expected = 0.02 + share if share else 0.02 + math.exp(-0.5) / (2 + math.tan(0.4) ** 2)
        assert float(lit(scene, s, d)) == pytest.approx(expected, rel=1e-3)
        u, v = seen_at(scene, "left", (s, d, 0.0))
        # A row is up to a metre of road.
        assert picture[round(v), round(u)] == pytest.approx(GROUND * expected, rel=0.1)
    assert lit(world(), 15.0, 0.0) == 1.0


def test_what_stands_beside_the_road_is_lit_too():
    house = Facade(5.0, (House(10.0, 40.0, 6.0, 150.0, 150.0, texture_amplitude=0.0),))
    hedge = Wall(-5.0, True, 4.0, 0.0, 150.0, 0.0)
    scene = world(headlights=NIGHT, sky_grey=5.0, facades=(house,), walls=(hedge,))
    picture = render_side(scene, "left")
    for side in (-1, 1):
        near, far = (seen_at(scene, "left", (s, side * 5.0, 1.0)) for s in (14.0, 38.0))
        greys = [float(picture[round(v), round(u)]) for u, v in (near, far)]
        assert 150 * 0.02 < greys[1] < greys[0] < 110


@pytest.mark.parametrize("s", [20.0, 60.0])
def test_lamp_is_seen_at_its_distance_by_both_cameras(s):
    lamp = Lamp(s, 1.2, 0.9, 0.05, 2000.0)
    scene = world(headlights=NIGHT, sky_grey=5.0, lamps=(lamp,))
    dark = replace(scene, lamps=())
    found = []
    for camera in CAMERAS:
        expected = seen_at(scene, camera, (s, 1.2, 0.9))
        place, light = centre(render_side(scene, camera) - render_side(dark, camera), *expected)
        np.testing.assert_allclose(place, expected, atol=0.1)
        assert light > 2000
        found.append(place)
    assert found[0][0] - found[1][0] == pytest.approx(PAPER_RIG.fx * PAPER_RIG.baseline_m / s, abs=0.05)
    assert not (
        render_side(replace(scene, lamps=(replace(lamp, s_m=-s),)), "left") != render_side(dark, "left")
    ).any()


@pytest.mark.parametrize("camera", CAMERAS)
def test_wet_road_shows_a_lamp_below_itself(camera):
    wet = Wet(darker=0.3, mirror=0.8, patches=0.0, rough_rows=0.002)
    scene = world(headlights=NIGHT, sky_grey=5.0, wet=wet, lamps=(Lamp(25.0, 1.2, 0.9, 0.05, 4000.0),))
    light = render_side(scene, camera) - render_side(replace(scene, lamps=()), camera)
    below = seen_at(scene, camera, (25.0, 1.2, -0.9))
    place, total = centre(light, *below, reach=5)
    # Fresnel's share grows within the smeared spot, and the lamp's own halo ends near it.
    np.testing.assert_allclose(place, below, atol=0.5)
    dry = render_side(replace(scene, wet=None), camera) - render_side(
        replace(scene, wet=None, lamps=()), camera
    )
    assert total > 3 * max(centre(dry, *below, reach=5)[1], 1.0)


def test_wet_road_is_darker_near_and_mirrors_the_sky_far_away():
    wet = Wet(darker=0.4, mirror=1.0, patches=0.0, rough_rows=0.005)
    scene = world(wet=wet, sky_grey=220.0)
    picture = render_side(scene, "left")
    greys = []
    for s in (3.5, 8.0, 40.0):
        u, v = seen_at(scene, "left", (s, 0.15, 0.0))
        greys.append(float(picture[round(v), round(u)]))
        share = 0.02 + 0.98 * (1 - 1.4 / math.hypot(s, 1.4)) ** 5
        sky = 220.0 + 40.0 * 1.4 / s
        assert greys[-1] == pytest.approx(0.6 * GROUND * (1 - share) + sky * share, rel=0.05)
    assert greys[0] < GROUND < greys[2]


def test_mirror_of_a_house_has_the_disparity_of_the_house_not_of_the_road():
    house = House(12.0, 22.0, 9.0, 200.0, 200.0, window_every_m=10.0, texture_amplitude=0.0)
    wet = Wet(darker=0.9, mirror=1.0, patches=0.0, rough_rows=0.002)
    scene = world(facades=(Facade(5.0, (house,)),), sky_grey=20.0, asphalt_grey=20.0, wet=wet)
    scene = replace(scene, pose=replace(POSE, roll_rad=0.0))
    ends, row = [], None
    for camera in CAMERAS:
        u, v = seen_at(scene, camera, (22.0, 5.0, -1.5))
        row = round(v)
        assert row > seen_at(scene, camera, (22.0, 5.0, 0.0))[1] + 10
        picture = render_side(scene, camera)
        ends.append(edge_column(picture, row, u, picture[row, round(u) - 4], picture[row, round(u) + 4]))
    assert ends[0] - ends[1] == pytest.approx(PAPER_RIG.fx * PAPER_RIG.baseline_m / 22.0, abs=0.1)


def test_every_camera_has_drops_of_its_own():
    rain = Rain(200, 20.0, 30.0, 0.0, 3)
    scene = world(left=replace(SHARP, rain=rain), right=replace(SHARP, rain=replace(rain, seed=4)))
    left, right = (render_side(scene, camera) - render_side(world(), camera) for camera in CAMERAS)
    np.testing.assert_array_equal(left, render_side(scene, "left") - render_side(world(), "left"))
    for added in (left, right):
        assert added.min() > -0.01
        # Drops have a width of 1.75 px and 20 px of length, fewer at the borders.
        assert added.sum() == pytest.approx(200 * 20 * 1.75 * 30, rel=0.25)
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] < 0.1


def test_there_is_no_sun_at_night_and_noise_is_that_of_the_night():
    world_ = named_world("night_rain")
    assert world_.scene.shadows == ()
    assert world_.scene.headlights is not None
    assert world_.scene.wet is not None
    assert world_.scene.left.rain != world_.scene.right.rain
    assert world_.scene.sky_grey < 15.0
