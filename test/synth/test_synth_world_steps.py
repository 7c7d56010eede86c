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

"""Kerbs, edges of asphalt, rails of a railway and houses have their heights and places in both images."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from edge_reading import edge_column, edge_point, edge_row
from independent_camera import CAMERAS, project

from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.ingredients import (
    Camera,
    Facade,
    House,
    Kerb,
    Paint,
    Ridge,
    RoadStep,
    WorldScene,
)
from stereo_selfcal.synth.road_shape import RoadShape
from stereo_selfcal.synth.world import LaneLine, Photometry
from stereo_selfcal.synth.world_renderer import render_side
from stereo_selfcal.synth.world_rigs import RIGS
from stereo_selfcal.synth.worlds import named_world

GROUND = 90.0
SHARP = Camera(Photometry(psf_sigma_px=0.0))
# Rig and height over the road: behind a windscreen, on a robot, on a lorry.
HEIGHTS = {"paper": 1.4, "robot": 0.5, "truck": 2.8}
# The lower the camera, the more columns an edge crosses in a row; the higher, the narrower is a face.
REACH_PX = {"paper": 2, "robot": 5, "truck": 1}
# Where along the road each sees a face that is wider than what is read [m].
NEAR_M = {"paper": (4.6, 5.4), "robot": (3.3, 3.7), "truck": (6.5, 7.5)}


def world(rig="paper", **changes):
    pose = Extrinsics(HEIGHTS[rig], math.radians(3.0), math.radians(-1.5))
    values = {"texture_amplitude": 0.0, "asphalt_grey": GROUND, "left": SHARP, "right": SHARP}
    return WorldScene(RIGS[rig].rig, pose, (-1.75, 1.75), 0.02, 0.15, **{**values, **changes})


@lru_cache(maxsize=2)
def rendered(scene, camera):
    """Return the picture of a camera; of the last scene, which is asked for edge by edge."""
    return render_side(scene, camera)


def check_edge(scene, d_m, z_m, before, after, rig="paper", tolerance_px=0.06):
    """Compare an edge along the road with OpenCV's projection and with its disparity in both images.

    Args:
        scene: The world.
        d_m: Lateral position of the edge.
        z_m: Its height.
        before: Grey level on the side of the camera.
        after: Grey level beyond the edge.
        rig: Which rig it is.
        tolerance_px: Of a column, and of a disparity.
    """
    pictures = [rendered(scene, camera) for camera in CAMERAS]
    for s in NEAR_M[rig]:
        point = edge_point(scene, d_m, z_m, s)
        greys = (after, before) if d_m > 0 else (before, after)
        read = [
            edge_column(picture, point.row, column, *greys, REACH_PX[rig])
            for picture, column in zip(pictures, point.columns, strict=True)
        ]
        np.testing.assert_allclose(read, point.columns, atol=tolerance_px)
        expected = scene.rig.fx * scene.rig.baseline_m / point.depth_m
        assert read[0] - read[1] == pytest.approx(expected, abs=tolerance_px)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("rig", HEIGHTS)
def test_top_of_a_kerb_has_the_disparity_of_its_height(rig, side):
    kerb = Kerb(side * 1.9, 0.18, 0.3, face_grey=30.0, top_grey=220.0, behind_grey=120.0, behind_texture=0.0)
    scene = world(rig, kerbs=(kerb,))
    check_edge(scene, side * 1.9, 0.0, GROUND, 30.0, rig)
    check_edge(scene, side * 1.9, 0.18, 30.0, 220.0, rig)
    check_edge(scene, side * 2.2, 0.18, 220.0, 120.0, rig)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("rig", HEIGHTS)
def test_rail_of_a_railway_has_a_face_and_a_top(rig, side):
    rail = Ridge(side * 0.75, 0.15, 0.10, top_grey=220.0, face_grey=20.0)
    scene = world(rig, ridges=(rail,))
    inner, outer = side * 0.70, side * 0.80
    check_edge(scene, inner, 0.0, GROUND, 20.0, rig)
    check_edge(scene, inner, 0.15, 20.0, 220.0, rig)
    check_edge(scene, outer, 0.15, 220.0, GROUND, rig)


def test_rail_of_a_railway_below_the_camera_shows_its_top_alone():
    scene = world(ridges=(Ridge(0.15, 0.15, 0.10, top_grey=220.0, face_grey=20.0),))
    scene = replace(scene, lateral_offset_m=0.224)
    # The right camera is 0.15 m right of the left one, above the rail's middle.
    picture = render_side(scene, "right")
    assert picture[400:].min() > 80.0
    assert picture[400:].max() > 215.0
    assert render_side(scene, "left")[400:].min() < 30.0


@pytest.mark.parametrize("height_m", [-0.06, 0.06])
@pytest.mark.parametrize("side", [-1, 1])
def test_line_beyond_an_edge_of_asphalt_is_on_the_level_there(side, height_m):
    line = Paint(LaneLine(side * 1.75, 0.2, grey=220.0))
    step = RoadStep(side * 1.5, height_m, 120.0, 0.0, face_grey=30.0)
    scene = world(paints=(line,), steps=(step,))
    check_edge(scene, side * 1.65, height_m, 120.0, 220.0)
    check_edge(scene, side * 1.85, height_m, 220.0, 120.0)
    # The edge itself: of the own lane, where it is higher; of the level beyond, with a face before it.
    if height_m < 0:
        check_edge(scene, side * 1.5, 0.0, GROUND, 120.0)
    else:
        check_edge(scene, side * 1.5, 0.0, GROUND, 30.0)
        check_edge(scene, side * 1.5, height_m, 30.0, 120.0)
    assert scene.truth() == replace(scene, steps=()).truth()


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("side", [-1, 1])
def test_ends_windows_and_roofs_of_houses_are_where_opencv_projects_them(camera, side):
    house = House(12.0, 22.0, 5.0, 200.0, 20.0, 4.0, 5.0, 0.0)
    scene = world(facades=(Facade(side * 5.0, (house,)),), sky_grey=20.0, asphalt_grey=20.0)
    picture = render_side(scene, camera)

    def at(s, z):
        point = [(s, side * 5.0, z)]
        return project(scene.rig, scene.pose, camera, point, scene.lane_yaw_rad, scene.lateral_offset_m)[0]

    # Its far end, half way up: the house is on the outer side.
    u, v = at(22.0, 0.9)
    row = round(v)
    u += (row - v) * np.divide(*(at(22.0, 0.8) - at(22.0, 1.0)))
    outer, beyond = float(picture[row, round(u) - 4 * side]), float(picture[row, round(u) + 4 * side])
    greys = (outer, beyond) if side > 0 else (beyond, outer)
    assert edge_column(picture, row, u, *greys) == pytest.approx(u, abs=0.15)
    # Its roof.
    u, v = at(17.0, 5.0)
    v += (round(u) - u) * np.divide(*(at(17.05, 5.0) - at(17.0, 5.0))[::-1])
    above, below = (float(picture[round(v) + off, round(u)]) for off in (-4, 4))
    assert edge_row(picture, round(u), v, above, below) == pytest.approx(v, abs=0.15)
    # Two windows of 2.25 m, 5 m apart, sills at 1.2 m.
    for s, window in ((14.5, True), (17.0, False), (19.5, True)):
        u, v = at(s, 2.2)
        assert (picture[round(v), round(u)] < 60) == window
    u, v = at(14.5, 0.9)
    assert picture[round(v), round(u)] > 150


def test_disparity_of_the_end_of_a_house_is_that_of_its_distance():
    house = House(12.0, 22.0, 9.0, 200.0, 200.0, window_every_m=10.0, texture_amplitude=0.0)
    scene = world(facades=(Facade(5.0, (house,)),), sky_grey=20.0, asphalt_grey=20.0)
    ends = []
    for camera in CAMERAS:
        picture = render_side(scene, camera)
        point = [(22.0, 5.0, 1.0)]
        u, v = project(scene.rig, scene.pose, camera, point, scene.lane_yaw_rad, scene.lateral_offset_m)[0]
        row = round(v)
        ends.append(edge_column(picture, row, u, float(picture[row, round(u) - 4]), 20.0))
    expected = scene.rig.fx * scene.rig.baseline_m / 22.0
    assert ends[0] - ends[1] == pytest.approx(expected, abs=0.08)


def test_both_kerbs_are_of_one_height_and_no_line_is_left():
    scene = named_world("kerbs_for_lines").scene
    assert len({kerb.height_m for kerb in scene.kerbs}) == 1
    assert sorted(kerb.face_m for kerb in scene.kerbs) == [-1.75, 1.75]
    assert scene.paints == ()


def test_sleepers_lie_between_the_rails():
    scene = named_world("train_rails").scene
    rails = sorted(ridge.d_m for ridge in scene.ridges)
    assert rails[1] - rails[0] == pytest.approx(1.505)
    assert len({ridge.height_m for ridge in scene.ridges}) == 1
    sleepers = scene.paints[0].line
    assert sleepers.right_edge_m < rails[0] < rails[1] < sleepers.left_edge_m
    assert sleepers.dash_m + sleepers.gap_m == pytest.approx(0.6)


@pytest.mark.parametrize(
    "changes",
    [
        {"ridges": (Ridge(0.7),)},
        {"steps": (RoadStep(1.5, -0.05),)},
        {"facades": (Facade(5.0, (House(5.0, 9.0, 6.0),)),)},
    ],
)
def test_what_is_straight_is_refused_in_a_bend(changes):
    with pytest.raises(ConfigError, match="straight road"):
        world(shape=RoadShape(1 / 300), **changes)


def test_kerb_as_high_as_the_camera_is_refused():
    with pytest.raises(ConfigError, match="height_m"):
        world("robot", kerbs=(Kerb(2.0, 0.5),))
    with pytest.raises(ConfigError, match="height_m"):
        world("robot", steps=(RoadStep(2.0, 0.5),))
