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

"""Rails, ropes and wires are at their height over the road in both images."""

import math
from dataclasses import replace

import numpy as np
import pytest
from edge_reading import edge_column, edge_point, edge_row, stripe_column
from independent_camera import CAMERAS, project

from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.ingredients import Barrier, Camera, Posts, Strand, WorldScene
from stereo_selfcal.synth.road_shape import RoadShape
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import Photometry
from stereo_selfcal.synth.world_renderer import render_side
from stereo_selfcal.synth.world_rigs import RIGS
from stereo_selfcal.synth.world_upright import Linear

GROUND, RAIL = 90.0, 210.0
SHARP = Camera(Photometry(psf_sigma_px=0.0))
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(-1.5))


def world(*barriers, rig=PAPER_RIG, pose=POSE, **changes):
    values = {"texture_amplitude": 0.0, "asphalt_grey": GROUND, "left": SHARP, "right": SHARP}
    values |= {"barriers": barriers, **changes}
    return WorldScene(rig, pose, (-1.75, 1.75), 0.02, 0.15, **values)


def seen_at(scene, camera, point):
    where = project(scene.rig, scene.pose, camera, [point], scene.lane_yaw_rad, scene.lateral_offset_m)
    return where[0]


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("rig", ["paper", "kitti", "truck"])
def test_disparity_of_both_edges_of_a_rail_is_that_of_its_height(rig, side):
    # The truck looks down from 2.8 m.
    pose = replace(POSE, height_m=2.8) if rig == "truck" else POSE
    scene = world(Barrier(side * 2.6, (Strand(0.40, 0.70, RAIL),)), rig=RIGS[rig].rig, pose=pose)
    pictures = [render_side(scene, camera) for camera in CAMERAS]
    for z, (upper, lower) in ((0.70, (GROUND, RAIL)), (0.40, (RAIL, GROUND))):
        for s in (7.0, 11.0, 16.0):
            point = edge_point(scene, side * 2.6, z, s)
            # Ground is before the rail: below it, and on the side of the road.
            greys = (upper, lower) if side > 0 else (lower, upper)
            read = [
                edge_column(picture, point.row, column, *greys)
                for picture, column in zip(pictures, point.columns, strict=True)
            ]
            np.testing.assert_allclose(read, point.columns, atol=0.02)
            rig_ = scene.rig
            assert read[0] - read[1] == pytest.approx(rig_.fx * rig_.baseline_m / point.depth_m, abs=0.03)
            # And not that of the road there, where a line would be.
            on_road = point.depth_m * pose.height_m / (pose.height_m - z)
            assert abs(rig_.fx * rig_.baseline_m * (1 / point.depth_m - 1 / on_road)) > 0.1


@pytest.mark.parametrize("camera", CAMERAS)
def test_rail_higher_than_a_low_camera_is_seen_against_the_sky(camera):
    robot = RIGS["robot"].rig
    sky = 160.0
    scene = world(Barrier(-2.0, (Strand(0.40, 0.80, RAIL),)), rig=robot, pose=replace(POSE, height_m=0.5))
    picture = render_side(replace(scene, sky_grey=sky), camera)
    u, v = seen_at(scene, camera, (5.0, -2.0, 0.8))
    u, v = round(u), v + (round(u) - u) * _slope(scene, camera, 5.0, -2.0, 0.8)
    above = float(picture[round(v) - 3, u])
    assert above >= sky
    assert edge_row(picture, u, v, above, RAIL) == pytest.approx(v, abs=0.05)


def _slope(scene, camera, s, d, z):
    near, far = (seen_at(scene, camera, (s + i, d, z)) for i in (0.0, 0.05))
    return (far[1] - near[1]) / (far[0] - near[0])


def test_thin_rope_has_its_place_and_its_light():
    scene = world(Barrier(2.2, (Strand(0.5, 0.52, RAIL),)))
    pictures = [render_side(scene, camera) for camera in CAMERAS]
    for s in (7.0, 12.0):
        low, high = edge_point(scene, 2.2, 0.5, s), edge_point(scene, 2.2, 0.52, s)
        for i, picture in enumerate(pictures):
            ends = seen_at(scene, CAMERAS[i], (s, 2.2, 0.5)), seen_at(scene, CAMERAS[i], (s, 2.2, 0.52))
            slope = _slope(scene, CAMERAS[i], s, 2.2, 0.51)
            # Its width along a row is its height, over the slope of its image.
            width = abs((ends[1][1] - ends[0][1]) / slope)
            expected = low.columns[i] + width / 2 * np.sign(slope)
            middle, light = stripe_column(picture, low.row, expected, GROUND, reach=6)
            assert middle == pytest.approx(expected, abs=0.05)
            assert light == pytest.approx(width * (RAIL - GROUND), rel=0.05)
        assert low.depth_m != high.depth_m


def test_wire_hangs_lowest_between_its_posts():
    strand = Strand(5.0, 5.04, 20.0, sag_m=0.6, span_m=30.0, hung_m=4.0)
    scene = world(Barrier(2.0, (strand,)), sky_grey=160.0, pose=replace(POSE, pitch_rad=0.0))
    picture = render_side(scene, "left")
    # A span begins at 34 m; a quarter of it further on, three quarters of the sag are there.
    for s, z in ((34.0, 5.0), (41.5, 5.0 - 0.45), (49.0, 5.0 - 0.6)):
        u, v = seen_at(scene, "left", (s, 2.0, z + 0.02))
        column = picture[round(v) - 4 : round(v) + 5, round(u)]
        assert abs(int(column.argmin()) - 4) <= 1
        assert column.min() < 145.0


@pytest.mark.parametrize("camera", CAMERAS)
def test_posts_stand_on_the_road_at_their_places(camera):
    posts = Posts(-2.5, 0.6, every_m=3.0, first_m=1.0, width_m=0.2, grey=220.0)
    shape = RoadShape(crown_at_m=-1.0, fall_right=0.03, fall_left=0.03)
    scene = world(Barrier(-2.5, (Strand(0.5, 0.51, 200.0),), posts), shape=shape)
    picture = render_side(scene, camera)
    ground_m = float(shape.height(7.0, -2.5)[0])
    assert ground_m < -0.03
    u, v = seen_at(scene, camera, (6.9, -2.5, ground_m))
    foot = edge_row(picture, round(u), v, float(picture[round(v) - 4, round(u)]), GROUND)
    assert foot == pytest.approx(v, abs=0.5)
    for s, there in ((7.0, True), (8.5, False), (10.0, True)):
        u, v = seen_at(scene, camera, (s - 0.1 * there, -2.5, ground_m + 0.2))
        assert (picture[round(v), round(u)] > 180) == there


def test_share_of_a_pixel_is_exact_for_an_oblique_edge():
    rng = np.random.default_rng(0)
    value, per_u, per_v = rng.uniform(-1, 1, (3, 1, 200))
    u, v = ((np.arange(200) + 0.5) / 200 - 0.5 for _ in range(2))
    samples = value[..., None, None] + per_u[..., None, None] * u + per_v[..., None, None] * v[:, None]
    counted = (samples > 0.2).mean(axis=(2, 3))
    np.testing.assert_allclose(Linear(value, per_u, per_v).above(0.2), counted, atol=0.01)
    upright = Linear(value, per_u, np.zeros_like(per_v)).above(0.2)
    np.testing.assert_allclose(upright, np.clip((value - 0.2) / np.abs(per_u) + 0.5, 0, 1), atol=2e-3)


def test_strips_of_a_period_cover_their_share():
    at = np.linspace(0.0, 9.0, 1000)[None]
    fine = Linear(at, np.full_like(at, 0.009), np.zeros_like(at)).periodic(0.5, 1.0, 3.0)
    assert fine.mean() == pytest.approx(1 / 3, abs=0.01)
    assert (fine[0, (at[0] > 0.6) & (at[0] < 1.4)] == pytest.approx(1.0)) and fine[0, 0] == 0.0
    coarse = Linear(at, np.full_like(at, 30.0), np.zeros_like(at)).periodic(0.5, 1.0, 3.0)
    np.testing.assert_allclose(coarse, 1 / 3, atol=0.02)


def test_barrier_in_a_bend_is_refused():
    with pytest.raises(ConfigError, match="straight road"):
        world(Barrier(2.0, (Strand(0.4, 0.7, RAIL),)), shape=RoadShape(1 / 300))
