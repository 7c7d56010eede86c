"""A refused frame names the camera that is at fault, or that the images are upside down."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from stereo_selfcal import Calibrator, RejectReason
from stereo_selfcal.synth.scenes import custom_scene

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
    assert result_of(flat, flat.copy() + 1).reason is RejectReason.NO_LINES_FOUND
    night = brighter(0.02)
    assert result_of(night(FRAME.left), night(FRAME.right) // 2).reason is RejectReason.NO_LINES_FOUND


def test_what_is_accepted_is_not_diagnosed():
    assert result_of(FRAME.left, FRAME.right).accepted
    both = brighter(1.2)
    assert result_of(both(FRAME.left), both(FRAME.right)).accepted
