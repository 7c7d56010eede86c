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

"""The renderer against cv2.projectPoints and the core's rotation: another derivation altogether."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.core.geometry.pose import BODY_FROM_OPTICAL, Extrinsics, road_from_camera_rotation
from stereo_selfcal.synth import renderer
from stereo_selfcal.synth.renderer import render, render_camera
from stereo_selfcal.synth.world import ASPHALT_GREY, PAINT_GREY, LaneLine, Photometry, Road, Scene, Verge

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
ODD_RIG = StereoRig(321, 200, 300.0, 280.0, 150.2, 111.7, 0.4)
SHARP = Photometry(psf_sigma_px=0.0)
SIDES = ("left", "right")
# (height_m, pitch_rad, roll_rad, lane_yaw_rad, lateral_offset_m)
POSES = [
    (1.4, 0.05, 0.0, 0.0, 0.0),
    (1.15, 0.02, 0.035, 0.025, -0.4),
    (1.7, 0.10, -0.03, -0.02, 0.35),
    (0.8, 0.25, 0.2, -0.15, 0.1),
]
EDGE_TOLERANCE_PX = 0.01


def make_scene(pose=POSES[0], rig=RIG, travelled_m=0.0, camera=SHARP, **road):
    height_m, pitch_rad, roll_rad, lane_yaw_rad, lateral_offset_m = pose
    road = Road(**{"texture_amplitude": 0.0, **road})
    extrinsics = Extrinsics(height_m, pitch_rad, roll_rad)
    return Scene(
        rig, extrinsics, lane_yaw_rad, lateral_offset_m, travelled_m, road, left=camera, right=camera
    )


def project(scene, side, points_m):
    """Project lane-frame points (n, 3) with OpenCV; shape (n, 2)."""
    rig, pose = scene.rig, scene.extrinsics
    rotation = road_from_camera_rotation(pose.pitch_rad, pose.roll_rad, scene.lane_yaw_rad)
    optical_from_lane = (rotation @ BODY_FROM_OPTICAL).T
    y_m = rig.baseline_m / 2 * {"left": 1, "right": -1}[side]
    centre_m = np.array([0.0, scene.lateral_offset_m, pose.height_m]) + rotation @ np.array([0.0, y_m, 0.0])
    camera = np.array([[rig.fx, 0, rig.cx], [0, rig.fy, rig.cy], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(
        np.asarray(points_m, np.float64),
        cv2.Rodrigues(optical_from_lane)[0],
        -optical_from_lane @ centre_m,
        camera,
        None,
    )
    return pixels.reshape(-1, 2)


def columns_of_straight_edge(scene, side, lateral_m, rows):
    (u0, v0), (u1, v1) = project(scene, side, [(5.0, lateral_m, 0.0), (50.0, lateral_m, 0.0)])
    return u0 + (np.asarray(rows) - v0) * (u1 - u0) / (v1 - v0)


def paint_share(picture):
    return (picture.astype(np.float64) - ASPHALT_GREY) / (PAINT_GREY - ASPHALT_GREY)


def without_sky(scene):
    """Return the scene with a sky that cannot be told from asphalt: only paint stands out."""
    return replace(scene, sky_grey=ASPHALT_GREY, sky_gradient=0.0)


def assert_edges(share, rows, left, right):
    """Compare the places of a wide line's edges, measured by area, with the expected ones."""
    checked = 0
    for row, expected_left, expected_right in zip(rows, left, right, strict=True):
        middle = round((expected_left + expected_right) / 2)
        # The middle pixel must be all paint in all its rows, and nothing may leave the image.
        if expected_right - expected_left < 12 or expected_left < 8 or expected_right > share.shape[1] - 9:
            continue
        measured_left = middle + 0.5 - share[row, : middle + 1].sum()
        measured_right = middle - 0.5 + share[row, middle:].sum()
        assert measured_left == pytest.approx(expected_left, abs=EDGE_TOLERANCE_PX)
        assert measured_right == pytest.approx(expected_right, abs=EDGE_TOLERANCE_PX)
        checked += 1
    return checked


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("rig", [RIG, ODD_RIG])
@pytest.mark.parametrize("pose", POSES)
def test_edges_of_a_line_are_where_opencv_projects_them(pose, rig, side):
    checked = 0
    for offset_m in (-0.9, 0.6):
        line = LaneLine(offset_m, width_m=0.5)
        scene = without_sky(make_scene(pose, rig, lines=(line,)))
        rows = np.arange(rig.height // 2, rig.height)
        left = columns_of_straight_edge(scene, side, line.left_edge_m, rows)
        right = columns_of_straight_edge(scene, side, line.right_edge_m, rows)
        checked += assert_edges(paint_share(render_camera(scene, side)), rows, left, right)
    assert checked > 50


@pytest.mark.parametrize("side", SIDES)
def test_thin_line_covers_the_area_of_its_projection_in_every_pixel(side):
    line = LaneLine(1.0, width_m=0.04)
    scene = without_sky(make_scene(POSES[1], lines=(line,)))
    share = paint_share(render_camera(scene, side))
    rows, parts = np.arange(245, 470, 5), 2000
    fine_rows = rows[:, None] + (np.arange(parts) + 0.5) / parts - 0.5
    left = columns_of_straight_edge(scene, side, line.left_edge_m, fine_rows)
    right = columns_of_straight_edge(scene, side, line.right_edge_m, fine_rows)
    assert (right - left).min() < 0.6
    for column in range(RIG.width):
        covered = np.clip(right, column - 0.5, column + 0.5) - np.clip(left, column - 0.5, column + 0.5)
        np.testing.assert_allclose(share[rows, column], covered.mean(axis=1), atol=1e-3)
    np.testing.assert_allclose(share[rows].sum(axis=1), (right - left).mean(axis=1), rtol=1e-3)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("pose", POSES)
def test_horizon_is_where_opencv_projects_points_far_away(pose, side):
    scene = replace(make_scene(pose, lines=()), sky_grey=200.0, sky_gradient=0.0)
    below = (200.0 - render_camera(scene, side).astype(np.float64)) / (200.0 - ASPHALT_GREY)
    # Directions of the road plane, so far away that the height of the camera does not matter.
    (u0, v0), (u1, v1) = project(scene, side, [(1e9, 3e8, 0.0), (1e9, -3e8, 0.0)])
    horizon = v0 + (np.arange(RIG.width) - u0) * (v1 - v0) / (u1 - u0)
    seen = (horizon > 1) & (horizon < RIG.height - 2)
    measured = RIG.height - 0.5 - below.sum(axis=0)
    np.testing.assert_allclose(measured[seen], horizon[seen], atol=EDGE_TOLERANCE_PX)
    assert seen.any()


@pytest.mark.parametrize("curvature_per_m", [1 / 150, -1 / 60, 1e-9])
@pytest.mark.parametrize("offset_m", [-0.8, 1.0])
def test_bend_follows_concentric_circles(offset_m, curvature_per_m):
    line = LaneLine(offset_m, width_m=0.5)
    scene = without_sky(make_scene(POSES[2], lines=(line,), curvature_per_m=curvature_per_m))

    def columns(lateral_m):
        angle = np.linspace(2.0, 40.0, 20_000) * curvature_per_m
        radius_m = 1 / curvature_per_m - lateral_m
        # y = 1 / curvature - radius * cos(angle), without the loss of digits of a slight bend.
        y_m = lateral_m + radius_m * 2 * np.sin(angle / 2) ** 2
        points_m = np.stack([radius_m * np.sin(angle), y_m, np.zeros_like(angle)], axis=1)
        pixels = project(scene, "left", points_m)[::-1]
        return np.interp(rows, pixels[:, 1], pixels[:, 0])

    rows = np.arange(240, RIG.height)
    share = paint_share(render_camera(scene, "left"))
    assert assert_edges(share, rows, columns(line.left_edge_m), columns(line.right_edge_m)) > 100


def test_dash_covers_the_area_of_its_projection():
    line = LaneLine(1.0, width_m=0.3, dash_m=3.0, gap_m=97.0, phase_m=6.5)
    for travelled_m in (0.0, 0.4, -3.3):
        scene = without_sky(make_scene(POSES[1], travelled_m=travelled_m, lines=(line,)))
        share = paint_share(render_camera(scene, "left"))
        share[:250] = 0.0  # the next dash, 100 m ahead
        ends_m = 6.5 - travelled_m, 9.5 - travelled_m
        corners = [(ends_m[i], y, 0.0) for i, y in ((0, 0.85), (0, 1.15), (1, 1.15), (1, 0.85))]
        outline = project(scene, "left", corners).astype(np.float32)
        moments = cv2.moments(outline.reshape(-1, 1, 2))
        assert share.sum() == pytest.approx(moments["m00"], rel=2e-3)
        centroid = (
            share.sum(axis=0) @ np.arange(RIG.width),
            share.sum(axis=1) @ np.arange(RIG.height),
        ) / share.sum()
        expected = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
        np.testing.assert_allclose(centroid, expected, atol=EDGE_TOLERANCE_PX)


def test_far_dashes_keep_their_share_of_the_road():
    dashed = make_scene(lines=(LaneLine(0.5, dash_m=0.2, gap_m=0.6),))
    solid = make_scene(lines=(LaneLine(0.5),))
    rows = slice(225, 240)  # a row is longer than several dashes there
    ratio = (
        paint_share(render_camera(dashed, "left"))[rows].sum()
        / paint_share(render_camera(solid, "left"))[rows].sum()
    )
    assert ratio == pytest.approx(0.25, abs=0.01)


def test_signs_as_people_see_them():
    def horizon_rows(pose):
        picture = render_camera(make_scene(pose, lines=()), "left")
        return (picture > (ASPHALT_GREY + 160) / 2).sum(axis=0)

    level = horizon_rows((1.4, 0.0, 0.0, 0.0, 0.0))
    assert (horizon_rows((1.4, 0.05, 0.0, 0.0, 0.0)) < level).all(), "nose down: the horizon rises"
    rolled = horizon_rows((1.4, 0.0, 0.05, 0.0, 0.0))
    assert rolled[-1] < level[-1] < rolled[0] + 2 * (level[-1] - rolled[-1]), "right side down"
    assert rolled[-1] < rolled[0], "right side down: the horizon rises on the right"

    def column(pose, side, row=400):
        share = paint_share(render_camera(make_scene(pose, lines=(LaneLine(0.0),)), side))[row]
        return share @ np.arange(RIG.width) / share.sum()

    straight = column((1.4, 0.05, 0.0, 0.0, 0.0), "left")
    assert column((1.4, 0.05, 0.0, 0.02, 0.0), "left") > straight, "camera turned left: the road goes right"
    assert column((1.4, 0.05, 0.0, 0.0, 0.3), "left") > straight, "rig left of the line: the line is right"
    assert column((1.4, 0.05, 0.0, 0.0, 0.0), "right") < straight, "disparity is positive"


def test_texture_lies_on_the_road_for_both_cameras_and_over_time():
    scene = make_scene(POSES[1], lines=(), texture_amplitude=20.0, travelled_m=3.0)
    left, right = (render_camera(scene, side) for side in SIDES)
    later = render_camera(replace(scene, travelled_m=3.7), "left")
    x, y = np.meshgrid(np.linspace(4.5, 8.0, 120), np.linspace(-1.0, 1.0, 80))
    points_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    def sample(picture, points_m, side):
        pixels = project(scene, side, points_m).astype(np.float32)
        return cv2.remap(picture, pixels[:, :1], pixels[:, 1:], cv2.INTER_LINEAR).ravel()

    seen = sample(left, points_m, "left")
    assert seen.std() > 5
    assert np.corrcoef(seen, sample(right, points_m, "right"))[0, 1] > 0.98
    assert np.corrcoef(seen, sample(later, points_m - [0.7, 0.0, 0.0], "left"))[0, 1] > 0.95
    assert abs(np.corrcoef(seen, sample(later, points_m, "left"))[0, 1]) < 0.9


def test_texture_has_the_amplitude_asked_for_and_fades_far_away():
    scene = make_scene((1.4, 1.0, 0.0, 0.0, 0.0), lines=(), texture_amplitude=10.0)  # looks down
    near = render_camera(scene, "left")
    assert near.mean() == pytest.approx(ASPHALT_GREY, abs=6)
    assert 5 < near.std() < 12
    ahead = render_camera(make_scene(lines=(), texture_amplitude=10.0), "left")
    assert np.abs(ahead[217:222] - ASPHALT_GREY).max() < 1e-3
    assert np.array_equal(ahead, render_camera(make_scene(lines=(), texture_amplitude=10.0), "left"))
    assert not np.array_equal(
        ahead, render_camera(make_scene(lines=(), texture_amplitude=10.0, texture_seed=1), "left")
    )


def test_verge_begins_where_it_should_on_both_sides():
    scene = make_scene(lines=(), verge=Verge(2.0, -1.5, grey=190.0, texture_amplitude=0.0))
    row = 330
    share = (render_camera(scene, "left")[row].astype(np.float64) - ASPHALT_GREY) / 100.0
    left, right = (columns_of_straight_edge(scene, "left", y, row) for y in (2.0, -1.5))
    middle = round((left + right) / 2)
    assert share[:middle].sum() - 0.5 == pytest.approx(left, abs=EDGE_TOLERANCE_PX)
    assert RIG.width - 0.5 - share[middle:].sum() == pytest.approx(right, abs=EDGE_TOLERANCE_PX)


def test_all_sky_and_all_ground():
    sky = render_camera(make_scene((1.4, -0.9, 0.0, 0.0, 0.0)), "left")
    assert sky.min() >= 160
    ground = render_camera(make_scene((1.4, 0.9, 0.0, 0.0, 0.0), lines=()), "left")
    np.testing.assert_allclose(ground, ASPHALT_GREY)


def test_photometry():
    scene = make_scene(lines=(), camera=Photometry(gain=1.2, offset=-5.0, vignetting=0.4))
    plain = render_camera(make_scene(lines=(), camera=Photometry()), "left")
    picture = render_camera(scene, "left")
    assert picture[0, 0] == pytest.approx(plain[0, 0] * 0.6 * 1.2 - 5, rel=1e-5)
    assert picture[240, 320] == pytest.approx(plain[240, 320] * 1.2 - 5, rel=1e-4)
    blurred = render_camera(make_scene(camera=Photometry(psf_sigma_px=2.0)), "left")
    sharp = render_camera(make_scene(), "left")
    assert np.abs(np.diff(blurred, axis=1)).max() < 0.5 * np.abs(np.diff(sharp, axis=1)).max()
    assert blurred[300].sum() == pytest.approx(sharp[300].sum(), rel=1e-3)


def test_noise_has_the_asked_spread_and_differs_between_cameras():
    scene = make_scene(lines=()).with_noise(0.05)
    left, right = render(scene, np.random.default_rng(1))
    clean = render_camera(scene, "left")
    assert left.dtype == right.dtype == np.uint8
    assert left.shape == right.shape == (RIG.height, RIG.width)
    noise = np.stack([left, right]) - np.stack([clean, render_camera(scene, "right")])
    assert noise.std() == pytest.approx(0.05 * 255, rel=0.01)
    assert abs(noise.mean()) < 0.1
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.01


def test_same_seed_same_bytes_and_overflow_is_clipped():
    scene = make_scene(texture_amplitude=3.0, camera=Photometry(gain=1.5)).with_noise(0.2)
    first, again, other = (render(scene, np.random.default_rng(seed)) for seed in (7, 7, 8))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    assert first[0].max() == 255


def test_unknown_side_is_named():
    with pytest.raises(ConfigError, match="'middle'"):
        render_camera(make_scene(), "middle")


def test_geometry_is_not_taken_from_the_estimator():
    source = Path(renderer.__file__).read_text(encoding="utf-8")
    source += Path(renderer.__file__).with_name("world.py").read_text(encoding="utf-8")
    for name in ("road_from_camera_rotation", "BODY_FROM_OPTICAL", "omography"):
        assert name not in source
