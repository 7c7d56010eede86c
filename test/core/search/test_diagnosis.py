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

"""A refused frame names the camera that is at fault, or that the images are upside down."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig, RejectReason
from stereo_selfcal.core.search import diagnosis
from stereo_selfcal.core.search.both_images import BothImages, Relation, same_picture
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import NAMED_SCENES, custom_scene, random_scene

SCENE = custom_scene(
    height_m=1.25, pitch_rad=math.radians(2.0), roll_rad=math.radians(-0.6), n_frames=1, seed=4
)
FRAME, RIG = SCENE.frame(0), SCENE.scene.rig
PAIR = {"left": FRAME.left, "right": FRAME.right}
SIDES = ("left", "right")


def result_of(left, right):
    return Calibrator(RIG).calibrate_frame(left, right)


def with_one(side, change):
    """Return the result where the image of one camera is changed."""
    images = PAIR | {side: change(PAIR[side])}
    return result_of(images["left"], images["right"])


def turned(image):
    return np.ascontiguousarray(image[::-1, ::-1])


def brighter(factor, offset=0.0):
    return lambda image: np.clip(np.rint(image * factor + offset), 0, 255).astype(np.uint8)


def glare(image):
    v, u = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    light = 400.0 * np.exp(-((u - 380.0) ** 2 + (v - 400.0) ** 2) / 2.0 / 160.0**2)
    return np.clip(image + light, 0, 255).astype(np.uint8)


def blurred(sigma_px):
    return lambda image: cv2.GaussianBlur(image, (0, 0), sigma_px)


@pytest.fixture(scope="module")
def frames_of_many_roads():
    """Return (left, right, rig) of all kinds of rendered roads."""
    scenes = [random_scene(np.random.default_rng(seed), 0.02) for seed in range(6)]
    scenes += [named.scene_at(0) for named in NAMED_SCENES]
    return [(*render(scene, np.random.default_rng(0)), scene.rig) for scene in scenes]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [1.4, 1.8])
def test_paint_that_clips_in_one_camera_is_overexposure_of_that_camera(side, factor):
    result = with_one(side, brighter(factor))
    assert result.reason is RejectReason.IMAGE_EXPOSURE
    assert result.message.startswith(f"the {side} camera is overexposed: of the {side} image's paint")
    assert result.rejection.value > 50.0 and result.rejection.unit == "%"
    assert result.message.endswith("set both cameras to one exposure that does not clip paint")


@pytest.mark.parametrize("side", SIDES)
def test_glare_in_one_camera_is_overexposure_of_that_camera(side):
    result = with_one(side, glare)
    assert result.reason is RejectReason.IMAGE_EXPOSURE
    assert f"the {side} camera is overexposed" in result.message


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [0.0, 0.1, 0.25])
def test_one_camera_that_is_dark_or_black_is_named(side, factor):
    result = with_one(side, brighter(factor))
    if result.accepted:  # a quarter of the contrast may be enough
        assert factor > 0.2
        return
    assert result.reason is RejectReason.IMAGE_EXPOSURE
    assert f"the {side} image is darker than the other one" in result.message
    assert result.rejection.value == pytest.approx(PAIR[side].mean() * factor, abs=1.0)
    assert f"uncover the {side} camera" in result.message


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("change", [lambda image: np.full_like(image, 128), brighter(0.05, 110.0)])
def test_one_camera_that_shows_nothing_is_named(side, change):
    result = with_one(side, change)
    assert result.reason is RejectReason.IMAGE_EXPOSURE
    assert f"the {side} image shows almost nothing" in result.message


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("sigma_px", [2.5, 6.0])
def test_one_camera_that_is_blurred_is_named(side, sigma_px):
    result = with_one(side, blurred(sigma_px))
    assert result.reason is RejectReason.IMAGE_BLURRED
    assert f"the {side} image is more blurred than the other one" in result.message
    assert f"focus and clean the lens of the {side} camera" in result.message


def test_one_picture_from_both_cameras_is_told():
    result = result_of(FRAME.left, FRAME.left)
    assert result.reason is RejectReason.LINES_NOT_MATCHED
    assert "the left and the right image are the same picture" in result.message


@pytest.mark.parametrize(
    ("left", "right", "which", "remedy"),
    [
        (turned(FRAME.right), turned(FRAME.left), "both images are", "exchange left and right"),
        (turned(FRAME.left), turned(FRAME.right), "both images are", "turn both images by 180 deg,"),
        (turned(FRAME.left), FRAME.right, "the left image is", "turn the left image by 180 deg"),
        (FRAME.left, turned(FRAME.right), "the right image is", "turn the right image by 180 deg"),
    ],
)
def test_cameras_that_hang_upside_down_are_told(left, right, which, remedy):
    result = result_of(left, right)
    assert result.reason is RejectReason.IMAGES_UPSIDE_DOWN
    assert result.message.startswith(f"{which} upside down: ")
    assert remedy in result.message
    assert "or, where nothing hangs upside down, drive on a straight road" in result.message


def test_a_principal_point_at_the_border_can_be_turned():
    rig = replace(RIG, cx=float(RIG.width), cy=float(RIG.height))
    result = Calibrator(rig).calibrate_frame(turned(FRAME.right), turned(FRAME.left))
    assert not result.accepted


def test_a_fault_of_neither_camera_keeps_its_reason():
    assert result_of(FRAME.right, FRAME.left).reason is RejectReason.CAMERAS_SWAPPED
    flat = np.full_like(FRAME.left, 90)
    assert result_of(flat, flat.copy() + 1).reason is RejectReason.ROAD_NOT_SEEN
    night = brighter(0.02)
    assert result_of(night(FRAME.left), night(FRAME.right) // 2).reason is RejectReason.NO_LINES_FOUND


def test_what_is_accepted_is_not_diagnosed():
    assert result_of(FRAME.left, FRAME.right).accepted
    both = brighter(1.2)
    assert result_of(both(FRAME.left), both(FRAME.right)).accepted


def noisy(image, grey=3.0):
    noise = np.random.default_rng(7).normal(0.0, grey, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def as_jpeg(image, quality=50):
    return cv2.imdecode(
        cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE
    )


@pytest.mark.parametrize("change", [noisy, as_jpeg, brighter(0.8, 10.0)])
@pytest.mark.parametrize("side", SIDES)
def test_one_picture_with_noise_or_compressed_anew_is_told(side, change):
    result = result_of(PAIR[side], change(PAIR[side]))
    assert result.reason is RejectReason.LINES_NOT_MATCHED
    assert "the left and the right image are the same picture" in result.message
    assert result.message.endswith("give the topics of two cameras, and check their drivers")
    assert result.rejection.value > result.rejection.threshold


def test_no_pair_of_two_cameras_is_one_picture_or_mirrored(frames_of_many_roads):
    for left, right, rig in frames_of_many_roads:
        assert same_picture((left, right), rig, CalibratorConfig()) is None
        assert BothImages.of((left, right)).relation is Relation.AS_IT_IS


def test_far_roads_of_a_narrow_rig_are_not_taken_for_one_picture():
    """There, both cameras see the road at the same place but for a pixel or two."""
    narrow = replace(RIG, baseline_m=0.01)
    assert same_picture((FRAME.left, noisy(FRAME.left)), narrow, CalibratorConfig()) is None
    assert same_picture((FRAME.left, FRAME.left), narrow, CalibratorConfig()) is not None


def test_an_overlay_in_both_images_does_not_make_them_one_picture():
    images = [image.copy() for image in (FRAME.left, FRAME.right)]
    for image in images:
        cv2.putText(image, "2026-05-01 12:00:00", (150, 470), cv2.FONT_HERSHEY_SIMPLEX, 1.0, 255, 2)
    assert same_picture((images[0], images[1]), RIG, CalibratorConfig()) is None


SIDEWAYS = custom_scene(
    height_m=1.4,
    pitch_rad=math.radians(3.0),
    roll_rad=0.0,
    lateral_offset_m=0.3,
    lane_yaw_rad=0.01,
    n_frames=1,
    seed=2,
).frame(0)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(
    ("relation", "words"),
    [(Relation.FLIPPED, "mirrored upside down"), (Relation.MIRRORED, "mirrored left to right")],
)
def test_one_image_that_is_mirrored_is_told(side, relation, words):
    images = {"left": SIDEWAYS.left, "right": SIDEWAYS.right}
    images[side] = relation.applied_to(images[side])
    result = result_of(images["left"], images["right"])
    assert result.reason is RejectReason.IMAGES_MIRRORED
    assert result.message.startswith(f"the {side} image is {words} against the other one: ")
    assert f"check the mirror and flip settings of the {side} camera" in result.message


def test_both_images_flipped_are_upside_down():
    result = result_of(FRAME.left[::-1], FRAME.right[::-1])
    assert result.reason is RejectReason.IMAGES_UPSIDE_DOWN
    assert "flip both back" in result.message


def test_lines_are_looked_for_upside_down_only_where_the_images_may_be(monkeypatch):
    """It takes as long as half of the other work on a refused frame."""
    looked = []
    monkeypatch.setattr(diagnosis, "_both_upside_down", lambda *_: looked.append(True))
    one_line = replace(SCENE.scene, road=replace(SCENE.scene.road, lines=SCENE.scene.road.lines[:1]))
    left, right = render(one_line, np.random.default_rng(1))
    assert not result_of(left, right).accepted and not looked
    assert not result_of(turned(right), turned(left)).accepted and looked


@pytest.mark.parametrize("percent", [0.0, 50.0, 99.8, 100.0])
@pytest.mark.parametrize(("size", "most"), [(1, 255), (2, 255), (50, 3), (20_000, 255)])
def test_percentiles_of_grey_values_are_those_of_sorted_ones(size, most, percent):
    values = np.random.default_rng(size).integers(0, most + 1, (1, size), np.uint8)
    assert diagnosis._percentile(values, percent) == pytest.approx(np.percentile(values, percent))
