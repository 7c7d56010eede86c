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

"""Colour mosaic, compression and rolling shutter leave edges where they belong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from edge_reading import edge_column, edge_point
from independent_camera import CAMERAS

from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.synth.ingredients import Camera, Paint, Sensor, Shake, WorldScene
from stereo_selfcal.synth.scenes import PAPER_RIG
from stereo_selfcal.synth.world import LaneLine, Photometry
from stereo_selfcal.synth.world_rays import WorldRays
from stereo_selfcal.synth.world_renderer import render_scene, render_side
from stereo_selfcal.synth.world_sensor import GREY_WEIGHTS, capture, demosaic
from stereo_selfcal.synth.worlds import named_world

GROUND = 90.0
SHARP = Camera(Photometry(psf_sigma_px=0.0))
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(-1.5))


def world(camera=SHARP, **changes):
    values = {"texture_amplitude": 0.0, "asphalt_grey": GROUND, "left": camera, "right": camera}
    values["paints"] = (Paint(LaneLine(1.75, 0.4, grey=200.0)),)
    return WorldScene(PAPER_RIG, POSE, (-1.75, 1.75), 0.02, 0.15, **{**values, **changes})


def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("grey", [20.0, 90.0, 200.0])
def test_grey_surface_stays_grey_in_a_mosaic(grey):
    picture = np.full((21, 30), grey, np.float32)
    camera = replace(SHARP, sensor=Sensor(mosaic=True))
    np.testing.assert_allclose(capture(picture, camera, rng()), grey, atol=1.0)
    error = 0.1
    camera = replace(SHARP, sensor=Sensor(mosaic=True, white_balance_error=error))
    red, green, blue = GREY_WEIGHTS
    expected = grey * (red * (1 + error) + green + blue / (1 + error))
    np.testing.assert_allclose(capture(picture, camera, rng()), min(expected, 255), atol=1.0)


def test_every_colour_of_a_mosaic_has_its_weight():
    for colour, weight in enumerate(GREY_WEIGHTS):
        raw = np.zeros((20, 20), np.uint8)
        for row, column in (((0, 0),), ((0, 1), (1, 0)), ((1, 1),))[colour]:
            raw[row::2, column::2] = 100
        np.testing.assert_allclose(demosaic(raw, Sensor(red=1.0, blue=1.0)), 100 * weight, atol=0.5)


@pytest.mark.parametrize(
    "sensor", [Sensor(mosaic=True), Sensor(jpeg_quality=75), Sensor(True, jpeg_quality=90)]
)
def test_edges_of_a_line_stay_where_they_are(sensor):
    scene = world(Camera(sensor=sensor))
    errors = []
    for picture, camera in zip(render_scene(scene, rng()), CAMERAS, strict=True):
        for s in np.linspace(4.5, 9.0, 20):
            point = edge_point(scene, 1.55, 0.0, s)
            column = point.columns[CAMERAS.index(camera)]
            errors.append(edge_column(picture, point.row, column, 200.0, GROUND, reach=6) - column)
    assert abs(np.mean(errors)) < 0.05
    assert 0.01 < np.std(errors) < 0.5


def test_noise_of_a_mosaic_is_alike_in_neighbours():
    camera = Camera(Photometry(noise_fraction=0.03), sensor=Sensor(mosaic=True))
    frame = capture(np.full((200, 200), 120.0, np.float32), camera, rng()).astype(np.float64) - 120.0
    alike = np.mean(frame[:, 1:] * frame[:, :-1]) / np.mean(frame**2)
    assert alike > 0.2
    plain = capture(np.full((200, 200), 120.0, np.float32), Camera(camera.photometry), rng()) - 120.0
    assert abs(np.mean(plain[:, 1:] * plain[:, :-1]) / np.mean(plain**2)) < 0.05


def test_more_is_lost_at_a_lower_quality():
    scene = world(texture_amplitude=5.0)
    plain = render_scene(scene, rng())[0].astype(np.float64)
    lost = []
    for quality in (95, 60):
        camera = replace(SHARP, sensor=Sensor(jpeg_quality=quality))
        frame = render_scene(replace(scene, left=camera), rng())[0]
        lost.append(np.sqrt(np.mean((frame - plain) ** 2)))
    assert 0.1 < lost[0] < lost[1] < 6.0


SHAKE = Shake(math.radians(0.1), math.radians(0.06), 60.0, 0.4, 0.02)


def angles(shake, rig):
    """Return pitch and yaw of every row against their means over the lower rows [rad]."""
    phase = 2 * np.pi * shake.hz * shake.readout_s * np.arange(rig.height) / rig.height + shake.phase_rad
    pitch, yaw = shake.pitch_rad * np.sin(phase), shake.yaw_rad * np.cos(phase)
    lower = np.arange(rig.height) >= rig.cy
    return pitch - pitch[lower].mean(), yaw - yaw[lower].mean()


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_row_is_seen_with_the_pose_of_its_moment(camera):
    still, shaken = (render_side(world(shake=shake), camera) for shake in (None, SHAKE))
    pitch, yaw = angles(SHAKE, PAPER_RIG)
    moved = 0.0
    for row in (270, 320, 370, 420):
        pose = replace(POSE, pitch_rad=POSE.pitch_rad + pitch[row])
        moment = replace(world(), pose=pose, lane_yaw_rad=0.02 + yaw[row])
        at_once = render_side(moment, camera)[row]
        # A camera beside the middle of the rig is not moved by the yaw: 0.15 mm at most.
        assert np.abs(shaken[row] - at_once).sum() < 12.0
        moved = max(moved, float(np.abs(still[row] - at_once).sum()))
    assert moved > 50.0


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_and_rays_agree_under_a_rolling_shutter(camera):
    rays = WorldRays(world(shake=SHAKE), camera)
    points = np.array([[6.0, 1.0, 0.0], [20.0, -2.0, 0.5], [50.0, 4.0, 1.0]])
    direction = np.stack(rays.directions(*rays.project(points).T), axis=1)
    to_points = points - rays.centre_m
    cross = np.cross(direction, to_points) / np.linalg.norm(to_points, axis=1, keepdims=True)
    assert np.abs(cross).max() < 1e-9
    apart = rays.project(points) - WorldRays(world(), camera).project(points)
    assert np.abs(apart).max() > 0.2


def test_disparities_do_not_shake():
    scene = world(shake=SHAKE)
    pictures = [render_side(scene, camera) for camera in CAMERAS]
    still = [render_side(world(), camera) for camera in CAMERAS]
    # At a given row, the camera is another one, but the same for both images.
    for row in (300, 350, 400):
        pitch = angles(SHAKE, PAPER_RIG)[0][row]
        widths = []
        for pair, added in ((pictures, pitch), (still, 0.0)):
            columns = [(np.arange(640) * (p[row] - GROUND)).sum() / (p[row] - GROUND).sum() for p in pair]
            pose = replace(POSE, pitch_rad=POSE.pitch_rad + added)
            fall = math.tan(pose.pitch_rad) + (row - PAPER_RIG.cy) / PAPER_RIG.fy
            widths.append((columns[0] - columns[1]) / fall)
        assert widths[0] == pytest.approx(widths[1], rel=2e-3)


def test_yellow_paint_is_darker_than_white_and_without_line_there_is_texture():
    assert all(paint.line.grey < 170 for paint in named_world("yellow_paint").scene.paints)
    scene = named_world("no_line_textured").scene
    assert scene.paints == ()
    assert scene.fine_texture
    assert scene.texture_amplitude >= 2.0
    assert len(named_world("one_line_textured").scene.paints) == 1
