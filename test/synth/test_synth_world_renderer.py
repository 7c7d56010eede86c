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

"""The renderer of worlds against cv2.projectPoints, and against the renderer of plane scenes."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from independent_camera import CAMERAS, project

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.ingredients import (
    Arrow,
    Band,
    Camera,
    Car,
    Glare,
    GuardRail,
    Kerb,
    Paint,
    Shadow,
    Wall,
    WorldScene,
)
from stereo_selfcal.synth.renderer import render_camera
from stereo_selfcal.synth.road_shape import RoadShape
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import LaneLine, Photometry, Road, Scene, Verge
from stereo_selfcal.synth.world_rays import WorldRays
from stereo_selfcal.synth.world_renderer import render_scene, render_side

SHARP = Camera(Photometry(psf_sigma_px=0.0))
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(-1.5))
YAW, OFFSET = 0.02, 0.15
ASPHALT = 90.0


def world(**changes):
    values = {"texture_amplitude": 0.0, "asphalt_grey": ASPHALT, "left": SHARP, "right": SHARP}
    return WorldScene(PAPER_RIG, POSE, (-1.75, 1.75), YAW, OFFSET, **{**values, **changes})


def pixels(scene, camera, points):
    return project(scene.rig, scene.pose, camera, points, scene.lane_yaw_rad, scene.lateral_offset_m)


def line(offset_m, width_m=0.15, worn=0.0, **more):
    return Paint(LaneLine(offset_m, width_m, **more), worn)


def middle_of_bright(picture, row, near_px, reach=40, level=150.0):
    """Return the middle of what is brighter than ``level`` in a row around a column, by area."""
    first = max(round(near_px) - reach, 0)
    part = picture[row, first : round(near_px) + reach].astype(np.float64)
    share = np.clip((part - ASPHALT) / (part.max() - ASPHALT), 0, 1)
    share[share < (level - ASPHALT) / (255 - ASPHALT) / 4] = 0
    return first + (share * np.arange(share.size)).sum() / share.sum()


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("bend", [0.0, 1 / 200])
def test_plane_world_is_what_the_other_renderer_draws(camera, bend):
    lines = (LaneLine(-1.75, dash_m=4.0, gap_m=2.0, phase_m=1.0), LaneLine(1.75, 0.2))
    photometry = Photometry(vignetting=0.1, gain=1.05, offset=2.0)
    road = Road(lines, bend, texture_amplitude=4.0, texture_seed=3, verge=Verge(4.0, -2.5))
    scene = Scene(PAPER_RIG, POSE, YAW, OFFSET, road=road, left=photometry, right=photometry)
    same = world(
        shape=RoadShape(bend),
        paints=tuple(Paint(line) for line in lines),
        bands=(Band(4.0, 1e4), Band(-1e4, -2.5)),
        texture_amplitude=4.0,
        texture_seed=3,
        left=Camera(photometry),
        right=Camera(photometry),
    )
    np.testing.assert_allclose(same.truth().as_array(), POSE.as_array(), atol=1e-12)
    difference = np.abs(render_side(same, camera) - render_camera(scene, camera))
    # Close to the horizon an edge crosses several pixels within one row.
    near = difference[260:]
    assert near.max() < 3.0
    assert np.percentile(near, 99.9) < 1.0
    assert np.mean(difference) < 0.1


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_and_projection_agree_with_opencv(camera):
    scene = world()
    points = np.array([[6.0, 1.0, 0.0], [20.0, -2.0, 0.5], [50.0, 4.0, 1.0]])
    rays = WorldRays(scene, camera)
    expected = pixels(scene, camera, points)
    np.testing.assert_allclose(rays.project(points), expected, atol=1e-6)
    direction = np.stack(rays.directions(*expected.T), axis=1)
    to_points = points - rays.centre_m
    cross = np.cross(direction, to_points) / np.linalg.norm(to_points, axis=1, keepdims=True)
    assert np.abs(cross).max() < 1e-9


@pytest.mark.parametrize(
    "shape",
    [
        RoadShape(crown_at_m=1.75, fall_right=0.025, fall_left=0.02),
        RoadShape(grade_change=0.03, grade_begins_m=15.0, grade_length_m=10.0),
        RoadShape(grade_change=-0.02, grade_begins_m=15.0, grade_length_m=10.0),
        RoadShape(1 / 300, 0.0, 0.02, 0.02, 0.01, 20.0, 20.0),
    ],
)
@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_meet_a_road_with_height_where_its_points_are_seen(camera, shape):
    scene = world(shape=shape)
    s, d = (grid.ravel() for grid in np.meshgrid([5.0, 12.0, 25.0, 45.0], [-3.0, -1.0, 1.7, 3.5]))
    height, _, _ = shape.height(s, d)
    points = np.stack([*shape.place(s, d), height], axis=1)
    found_s, found_d, meets = WorldRays(scene, camera).meet(*pixels(scene, camera, points).T)
    assert meets.all()
    np.testing.assert_allclose(found_s, s, atol=0.01, rtol=1e-3)
    np.testing.assert_allclose(found_d, d, atol=0.01)


@pytest.mark.parametrize("camera", CAMERAS)
def test_line_on_a_crowned_road_with_a_crest_is_where_opencv_projects_it(camera):
    shape = RoadShape(
        crown_at_m=-1.0, fall_right=0.02, fall_left=0.04, grade_change=-0.02, grade_begins_m=8.0
    )
    scene = world(shape=shape, paints=(line(1.75, 0.3),))
    picture = render_side(scene, camera)
    for s in (6.0, 9.0, 14.0):
        points = [(s, 1.75, float(shape.height(s, 1.75)[0]))]
        u, v = pixels(scene, camera, points)[0]
        flat_u, flat_v = pixels(scene, camera, [(s, 1.75, 0.0)])[0]
        assert math.hypot(flat_u - u, flat_v - v) > 1.0
        slope = np.subtract(*pixels(scene, camera, [(s + 0.1, 1.75, points[0][2]), *points]))
        column = u + (round(v) - v) * slope[0] / slope[1]
        assert middle_of_bright(picture, round(v), column) == pytest.approx(column, abs=0.3)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("side", [-1, 1])
def test_edges_of_a_kerb_are_where_opencv_projects_them(camera, side):
    kerb = Kerb(side * 2.2, 0.08, 0.15, face_grey=20.0, top_grey=220.0, behind_grey=120.0, behind_texture=0.0)
    scene = world(kerbs=(kerb,))
    picture = render_side(scene, camera)
    for s in (8.0, 12.0):
        # Heights and places of the edges: foot of the face, its upper edge, the far edge of the top.
        for (y, z), before, after in (
            ((2.2, 0.0), ASPHALT, 20.0),
            ((2.2, 0.08), 20.0, 220.0),
            ((2.35, 0.08), 220.0, 120.0),
        ):
            ends = pixels(scene, camera, [(s, side * y, z), (s + 1, side * y, z)])
            row = round(ends[0, 1])
            column = ends[0, 0] + (row - ends[0, 1]) * (ends[1, 0] - ends[0, 0]) / (ends[1, 1] - ends[0, 1])
            outward = 1 if side < 0 else -1
            u = round(column)
            values = picture[row, u - 1 : u + 2][::outward].astype(np.float64)
            share = (values - before) / (after - before)
            inner = (u - outward) - 0.5 * outward
            edge = inner + outward * (3 - share.sum())
            assert edge == pytest.approx(column, abs=0.15)


@pytest.mark.parametrize("camera", CAMERAS)
def test_car_is_seen_between_the_projections_of_its_corners(camera):
    car = Car(12.0, -0.2, grey=230.0)
    picture = render_side(world(cars=(car,), sky_grey=ASPHALT), camera)
    rear = pixels(world(), camera, [(12.0, -0.2 + 0.9, 0.5), (12.0, -0.2 - 0.9, 0.5)])
    row = round(rear[:, 1].mean())
    bright = np.flatnonzero(picture[row] > 200)
    assert bright.min() == pytest.approx(rear[0, 0], abs=1.5)
    assert bright.max() == pytest.approx(rear[1, 0], abs=1.5)


@pytest.mark.parametrize("camera", CAMERAS)
def test_guard_rail_hangs_between_its_heights(camera):
    scene = world(rails=(GuardRail(-3.0, 0.4, 0.7, grey=200.0, relief=0.0),), sky_grey=ASPHALT)
    picture = render_side(scene, camera)
    low, high = pixels(scene, camera, [(15.0, -3.0, 0.4), (15.0, -3.0, 0.7)])
    column = round((low[0] + high[0]) / 2)
    bright = np.flatnonzero(picture[:, column] > 150)
    assert bright.max() == pytest.approx(low[1], abs=1.5)
    assert bright.min() == pytest.approx(high[1], abs=1.5)


def test_fine_texture_is_on_the_road_and_seen_farther():
    plain = replace(world(texture_amplitude=8.0, texture_seed=3), pose=replace(POSE, roll_rad=0.0))
    fine = replace(plain, fine_texture=True)
    contrasts = []
    for scene in (plain, fine):
        left, right = (render_side(scene, camera).astype(np.float32) for camera in CAMERAS)
        for s, row in zip((5.0, 7.0), _rows(scene, (5.0, 7.0)), strict=True):
            # A row of pixels is found at the disparity of the road, which tilts by less than a pixel.
            patch = left[row : row + 1, 250:400]
            score = cv2.matchTemplate(right[row : row + 1], patch, cv2.TM_CCOEFF_NORMED)[0]
            depth = s * math.cos(POSE.pitch_rad) + POSE.height_m * math.sin(POSE.pitch_rad)
            assert 250 - score.argmax() == pytest.approx(PAPER_RIG.fx * PAPER_RIG.baseline_m / depth, abs=0.8)
            contrasts.append(patch.std())
    assert contrasts[2] > 1.2 * contrasts[0]
    assert contrasts[3] > 1.2 * contrasts[1]


def _rows(scene, distances):
    return [round(pixels(scene, "left", [(s, 0.0, 0.0)])[0, 1]) for s in distances]


def test_both_cameras_see_a_wall_at_its_distance():
    scene = world(walls=(Wall(60.0, height_m=12.0, ragged_m=0.0, texture_amplitude=30.0),))
    left, right = (render_side(scene, camera).astype(np.float32) for camera in CAMERAS)
    patch = left[150:185, 280:360]
    _, _, _, place = cv2.minMaxLoc(cv2.matchTemplate(right[150:185], patch, cv2.TM_CCORR_NORMED))
    assert 280 - place[0] == pytest.approx(PAPER_RIG.fx * PAPER_RIG.baseline_m / 60.0, abs=0.8)


def test_worn_paint_has_less_of_it_and_an_arrow_is_painted():
    fresh = render_side(world(paints=(line(1.75, 0.2),)), "left")[260:] - ASPHALT
    worn = render_side(world(paints=(line(1.75, 0.2, worn=0.4),)), "left")[260:] - ASPHALT
    assert worn.sum() / fresh.sum() == pytest.approx(0.6, abs=0.2)
    scene = world(arrows=(Arrow(8.0, 0.2, length_m=4.0, head_m=1.5),))
    picture = render_side(scene, "left")
    inside = pixels(scene, "left", [(8.5, 0.2, 0), (10.0, 0.2, 0), (10.9, 0.2 + 0.2, 0)])
    outside = pixels(scene, "left", [(9.0, 0.6, 0), (7.5, 0.2, 0), (12.3, 0.2, 0), (11.9, 0.2 + 0.3, 0)])
    assert all(picture[round(v), round(u)] > 195 for u, v in inside)
    assert all(picture[round(v), round(u)] == ASPHALT for u, v in outside)


@pytest.mark.parametrize(
    ("shadow", "dark", "bright"),
    [
        (Shadow("across", 8.0, 10.0, 0.5), (9.0, 0.0), (11.0, 0.0)),
        (Shadow("across", 8.0, 10.0, 0.5, skew=1.0), (11.0, 2.0), (9.0, 2.0)),
        (Shadow("along", 0.5, 2.0, 0.5), (9.0, 1.0), (9.0, 0.0)),
    ],
)
def test_shadows_lie_on_the_road(shadow, dark, bright):
    scene = world(shadows=(shadow,))
    picture = render_side(scene, "right")
    (u0, v0), (u1, v1) = pixels(scene, "right", [(*dark, 0.0), (*bright, 0.0)])
    assert picture[round(v0), round(u0)] == pytest.approx(ASPHALT / 2, abs=0.5)
    assert picture[round(v1), round(u1)] == pytest.approx(ASPHALT, abs=0.5)


def test_dappled_shade_leaves_half_of_the_sun():
    shadows = (Shadow("dappled", light=0.5),)
    picture = np.array([render_side(world(shadows=shadows, texture_seed=i), "left")[280:] for i in range(8)])
    assert picture.mean() == pytest.approx(0.75 * ASPHALT, rel=0.1)
    assert picture.min() < 0.55 * ASPHALT
    assert picture.max() > 0.95 * ASPHALT


def test_misalignment_moves_the_right_picture_by_exactly_one_row():
    scene = world(paints=(line(-1.75), line(1.75)), texture_amplitude=4.0)
    moved = replace(scene, right=replace(SHARP, lower_px=1.0))
    np.testing.assert_array_equal(render_side(moved, "left"), render_side(scene, "left"))
    below, above = render_side(moved, "right"), render_side(scene, "right")
    np.testing.assert_allclose(below[251:], above[250:-1], atol=0.01)


def test_turned_camera_turns_its_picture_about_the_principal_point():
    angle = math.radians(1.0)
    scene = world(paints=(line(1.75, 0.3),), right=replace(SHARP, turned_rad=angle))
    rays = WorldRays(scene, "right")
    straight = pixels(scene, "right", [(10.0, 1.75, 0.0)])[0] - (PAPER_RIG.cx, PAPER_RIG.cy)
    # Right side down: what is seen turns to the left, counter-clockwise.
    turned = rays.project([(10.0, 1.75, 0.0)])[0] - (PAPER_RIG.cx, PAPER_RIG.cy)
    c, s = math.cos(angle), math.sin(angle)
    np.testing.assert_allclose(turned, [c * straight[0] + s * straight[1], c * straight[1] - s * straight[0]])


def test_camera_that_looks_further_left_sees_everything_further_right():
    yaw = math.radians(0.2)
    scene = world(right=replace(SHARP, yaw_rad=yaw))
    points = [(8.0, 1.0, 0.0), (60.0, -2.0, 0.0)]
    turned, straight = WorldRays(scene, "right").project(points), pixels(scene, "right", points)
    # Along a circle about the vertical of the rig, its distance to the camera's axis in focal lengths.
    angle = np.arctan((straight[:, 0] - PAPER_RIG.cx) / PAPER_RIG.fx) + yaw
    np.testing.assert_allclose(turned[:, 0], PAPER_RIG.cx + PAPER_RIG.fx * np.tan(angle), atol=1e-6)
    assert (turned[:, 0] - straight[:, 0] > 1.7).all()
    assert scene.truth() == world().truth()
    picture = render_side(replace(scene, paints=(line(1.75, 0.3),)), "right")
    u, v = WorldRays(scene, "right").project([(9.0, 1.75, 0.0)])[0]
    beside = WorldRays(scene, "right").project([(9.1, 1.75, 0.0)])[0]
    column = u + (round(v) - v) * (beside[0] - u) / (beside[1] - v)
    assert middle_of_bright(picture, round(v), column) == pytest.approx(column, abs=0.3)


def test_cameras_swapped_glare_and_noise():
    scene = world(paints=(line(-1.75), line(1.75)))
    left, right = render_scene(scene, np.random.default_rng(0))
    exchanged = render_scene(replace(scene, swapped=True), np.random.default_rng(0))
    np.testing.assert_array_equal(exchanged[0], right)
    np.testing.assert_array_equal(exchanged[1], left)
    bright = replace(scene, left=replace(SHARP, glare=Glare(300, 350, 30, 20)))
    assert render_scene(bright, np.random.default_rng(0))[0][350, 300] == 255
    noisy = replace(scene, left=Camera(Photometry(noise_fraction=0.02)))
    first, again = (render_scene(noisy, np.random.default_rng(5))[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert np.std(first[400:, 300:340].astype(float)) == pytest.approx(0.02 * 255, rel=0.1)


def test_truth_is_the_pose_over_the_plane_of_the_own_lane():
    # All of the own lane on one cross slope: the truth is the pose turned by it, at the same place.
    fall = 0.02
    tilted = replace(
        world(shape=RoadShape(crown_at_m=8.0, fall_right=fall, fall_left=fall)), lane_yaw_rad=0.0
    )
    truth = tilted.truth()
    assert truth.roll_rad == pytest.approx(POSE.roll_rad - math.atan(fall), abs=2e-4)
    over_m = POSE.height_m + fall * (8.0 - OFFSET)
    assert truth.height_m == pytest.approx(over_m * math.cos(math.atan(fall)), abs=5e-3)
    # A constant change of grade before the lane begins is a pitch of the whole plane.
    climbing = replace(tilted, shape=RoadShape(grade_change=0.03, grade_begins_m=-1.0, grade_length_m=0.5))
    assert climbing.truth().pitch_rad == pytest.approx(POSE.pitch_rad + math.atan(0.03), abs=1e-4)


def test_impossible_worlds_are_refused():
    with pytest.raises(ConfigError, match="fall_left"):
        RoadShape(fall_left=0.5)
    with pytest.raises(ConfigError, match="grade_length_m"):
        RoadShape(grade_length_m=0.0)
    with pytest.raises(ConfigError, match="height_m"):
        replace(world(), pose=Extrinsics(0.6, 0.0, 0.0), rails=(GuardRail(3.0),))


def test_wide_and_large_rigs_are_rendered():
    rig = StereoRig(321, 200, 300.0, 280.0, 150.2, 111.7, 0.4)
    scene = replace(world(paints=(line(1.75),)), rig=rig)
    assert render_side(scene, "left").shape == (200, 321)
