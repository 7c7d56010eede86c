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

"""Road texture: what rendered roads have, what noise has not, and what the reported uncertainty is worth."""

import math
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.core.estimators.texture_alignment import align_texture
from stereo_selfcal.core.estimators.texture_fit import MIN_SIGMAS
from stereo_selfcal.core.evidence.row_offset import vertical_offset
from stereo_selfcal.core.geometry.plane import plane_from_pose, pose_from_plane
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road.cell_grid import lay_out_samples
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

# Beside the checkout, or beside the folder it is in.
_PLACES = [folder / "shared" / "data" / "kitti_frames" for folder in Path(__file__).resolve().parents[4:6]]
FRAMES = next((place for place in _PLACES if place.is_dir()), _PLACES[0])
START_ERROR = np.array([0.06, math.radians(0.5), math.radians(2.0)])
TOLERANCE = np.array([0.03, math.radians(0.25), math.radians(0.8)])


@cache
def rendered(seed, amplitude, noise):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, noise, texture_amplitude=amplitude)
    return scene, render(scene, rng)


def aligned(seed, amplitude, noise, off=(1.0, -1.0, 1.0), **kwargs):
    scene, images = rendered(seed, amplitude, noise)
    start = Extrinsics.from_array(scene.extrinsics.as_array() + START_ERROR * off)
    return scene.extrinsics, align_texture(images, PAPER_RIG, start, scene.lane_yaw_rad, **kwargs)


def moved_down(image, rows):
    shift = np.float64([[1, 0, 0], [0, 1, rows]])
    size = image.shape[::-1]
    return cv2.warpAffine(image, shift, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("off", [(1, 1, 1), (-1, -1, -1), (1, -1, 1), (-1, 1, 1)])
def test_finds_the_road_from_a_start_that_is_off(seed, off):
    truth, fit = aligned(seed, 12.0, 0.002, off)
    assert fit.enough_texture
    error = fit.extrinsics.as_array() - truth.as_array()
    assert np.all(np.abs(error) < [0.008, math.radians(0.12), math.radians(0.4)])


@pytest.mark.slow
def test_reported_uncertainty_is_the_error_made():
    ratios = []
    for seed in range(16):
        truth, fit = aligned(seed, 12.0, 0.01)
        error = fit.extrinsics.as_array() - truth.as_array()
        ratios.append(error / np.sqrt(np.diag(fit.covariance)))
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all(rms > 0.3)
    assert np.all(rms < 1.7)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_bare_asphalt_is_no_texture(seed, noise):
    _, fit = aligned(seed, 0.0, noise)
    assert isinstance(fit, NotFitted) or not fit.enough_texture


@pytest.mark.parametrize("blur", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_is_no_texture(seed, blur):
    rng = np.random.default_rng(seed)
    noise = rng.normal(120.0, 30.0, (2, PAPER_RIG.height, PAPER_RIG.width)).astype(np.float32)
    if blur:
        noise = 120.0 + 2.0 * blur * (np.array([cv2.GaussianBlur(n, (0, 0), blur) for n in noise]) - 120.0)
    left, right = np.clip(noise, 0, 255).astype(np.uint8)
    fit = align_texture((left, right), PAPER_RIG, Extrinsics(1.4, 0.05, 0.0))
    assert isinstance(fit, NotFitted) or (not fit.enough_texture and fit.quality.sigmas < 4.0 * MIN_SIGMAS)


def test_views_of_different_roads_are_no_texture():
    left = rendered(0, 12.0, 0.0)[1][0]
    scene, (_, right) = rendered(1, 12.0, 0.0)
    fit = align_texture((left, right), PAPER_RIG, scene.extrinsics)
    assert isinstance(fit, NotFitted) or not fit.enough_texture


def test_quality_says_why():
    _, fit = aligned(0, 12.0, 0.005)
    assert fit.quality.sigmas > MIN_SIGMAS
    assert fit.quality.correlation > 0.9
    assert 0.4 < fit.quality.cell_share <= 1.0
    assert 0.4 < fit.quality.pixel_share <= 1.0
    assert np.all(np.array(fit.quality.noise_std) <= np.sqrt(np.diag(fit.covariance)))


def test_exposure_does_not_matter():
    """Both fits share most of the noise: they agree better than their deviations say."""
    changes = []
    for seed in range(8):
        scene, (left, right) = rendered(seed, 12.0, 0.005)
        darker = np.rint(0.6 * right + 12.0).astype(np.uint8)
        bright, dark = (
            align_texture((left, each), PAPER_RIG, scene.extrinsics, scene.lane_yaw_rad)
            for each in (right, darker)
        )
        std = np.sqrt(np.diag(bright.covariance) + np.diag(dark.covariance))
        changes.append((bright.extrinsics.as_array() - dark.extrinsics.as_array()) / std)
    assert np.all(np.sqrt(np.mean(np.square(changes), axis=0)) < 1.0)


@pytest.mark.parametrize(("loss", "believed"), [(0.02, True), (0.2, False)])
def test_vignetting_of_one_camera_does_no_harm_or_is_no_witness(loss, believed):
    """What one camera loses in the corners makes textures differ: roll would be off twice its deviation."""
    column = np.linspace(-1.0, 1.0, PAPER_RIG.width)
    enough, ratios = [], []
    for seed in range(8):
        scene, (left, right) = rendered(seed, 12.0, 0.005)
        darker = np.rint((1.0 - loss * column**2) * right).astype(np.uint8)
        fit = align_texture((left, darker), PAPER_RIG, scene.extrinsics, scene.lane_yaw_rad)
        enough.append(fit.enough_texture)
        error = fit.extrinsics.as_array() - scene.extrinsics.as_array()
        ratios.append(error / np.sqrt(np.diag(fit.covariance)))
    assert sum(enough) >= 7 if believed else not any(enough)
    if believed:
        assert np.all(np.sqrt(np.mean(np.square(ratios), axis=0)) < 1.25)


def test_a_lane_of_paint_only_tells_nothing():
    scene, images = rendered(1, 0.0, 0.005)
    fit = align_texture(images, PAPER_RIG, scene.extrinsics, scene.lane_yaw_rad, limits_m=(-2.0, 2.0))
    assert isinstance(fit, NotFitted) or not fit.enough_texture


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_images_without_contrast(grey):
    flat = np.full((480, 640), grey, np.uint8)
    assert isinstance(align_texture((flat, flat), PAPER_RIG, Extrinsics(1.4, 0.05, 0.0)), NotFitted)
    assert isinstance(vertical_offset((flat, flat), PAPER_RIG, Extrinsics(1.4, 0.05, 0.0)), NotFitted)


@pytest.mark.parametrize("pitch_deg", [-60.0, 45.0, 89.0])
def test_a_camera_that_sees_no_road_ahead(pitch_deg):
    _, images = rendered(0, 12.0, 0.005)
    fit = align_texture(images, PAPER_RIG, Extrinsics(1.4, math.radians(pitch_deg), 0.0))
    assert isinstance(fit, NotFitted) or not fit.enough_texture


@pytest.mark.parametrize("rows", [-1.0, 0.0, 0.5, 1.0])
def test_vertical_offset_is_found(rows):
    scene, (left, right) = rendered(1, 12.0, 0.005)
    pair = left, moved_down(right, rows)
    measured = vertical_offset(pair, PAPER_RIG, scene.extrinsics, scene.lane_yaw_rad)
    assert measured.offset_px == pytest.approx(rows, abs=0.12)
    assert measured.std_px < 0.05
    assert abs(measured.roll_rad) < math.radians(0.1)
    assert measured.n_cells >= 12


def test_plane_and_pose_are_inverse():
    pose = Extrinsics(1.4, 0.07, -0.03)
    np.testing.assert_allclose(
        pose_from_plane(plane_from_pose(pose, PAPER_RIG), PAPER_RIG).as_array(), pose.as_array()
    )


def test_corridor_lies_where_it_is_said_to_be():
    pose, yaw = Extrinsics(1.4, 0.05, 0.0), 0.03
    grid = lay_out_samples(PAPER_RIG, pose, yaw, (-1.0, 2.0), 20.0)
    x, y = grid.cell_xy.T
    across = y + math.tan(yaw) * x
    assert np.all((across > -1.05) & (across < 2.05))
    assert np.all((x > 1.0) & (x < 20.5))
    assert grid.n_samples == grid.lengths.sum()


@pytest.mark.skipif(not FRAMES.is_dir(), reason=f"no real frames at {FRAMES}")
class TestRealFrames:
    """Against the lidar; height is compared with lidar - 15 mm, as the frames' README says."""

    def frames(self, tag):
        import csv  # noqa: PLC0415
        import json  # noqa: PLC0415

        rig = StereoRig.from_mapping(json.loads((FRAMES / "rig.json").read_text()))
        for row in csv.DictReader((FRAMES / "truth.csv").open()):
            if row["tag"] == tag:
                images = tuple(cv2.imread(str(FRAMES / s / f"{row['id']}.png"), 0) for s in ("left", "right"))
                angles = np.radians([float(row["lidar_pitch_deg"]), float(row["lidar_roll_deg"])])
                yield rig, images, np.array([float(row["lidar_height_m"]) - 0.015, *angles])

    def test_straight_frames_from_a_kerb(self):
        kerb = np.array([0.06, 0.0, math.radians(1.5)])
        errors, ratios, enough = [], [], []
        for rig, images, truth in self.frames("straight_lines"):
            fit = align_texture(images, rig, Extrinsics.from_array(truth + kerb))
            enough.append(fit.enough_texture)
            error = fit.extrinsics.as_array() - truth
            errors.append(np.abs(error))
            reference = np.array([0.003, math.radians(0.02), math.radians(0.05)])
            ratios.append(error / np.sqrt(np.diag(fit.covariance) + reference**2))
        assert np.mean(enough) > 0.9  # one shines
        assert np.all(np.median(errors, axis=0) < [0.010, math.radians(0.07), math.radians(0.3)])
        rms = np.sqrt(np.mean(np.square(ratios), axis=0))
        assert np.all((rms > 0.5) & (rms < 1.7))

    @pytest.mark.parametrize("tag", ["city_clutter", "curved_lines", "straight_one_line"])
    def test_what_is_believed_is_right(self, tag):
        for rig, images, truth in self.frames(tag):
            fit = align_texture(images, rig, Extrinsics.from_array(truth))
            if not isinstance(fit, NotFitted) and fit.sufficiency >= 1.0:
                error, std = np.abs(fit.extrinsics.as_array() - truth), np.sqrt(np.diag(fit.covariance))
                assert np.all(error < np.maximum(replace_roll(TOLERANCE), 3.0 * std)), error


def replace_roll(tolerance):
    """The cross slope of the lane may differ from that of the wider plane by more."""
    return np.array([*tolerance[:2], math.radians(1.2)])
