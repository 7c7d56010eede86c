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

"""A right camera that has turned is put right by its CameraInfo: against a projection of its own."""

import math
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from independent_camera import OPTICAL_FROM_BODY, turn
from independent_lens import raw_image, raw_pixel

from stereo_selfcal import StereoRig
from stereo_selfcal.core.camera.camera_info import CameraInfoError, CameraModel, InfoReason
from stereo_selfcal.core.camera.camera_info_checks import check_claim
from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo
from stereo_selfcal.core.camera.rectifier import StereoRectifier, rectification_maps
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.camera_info_repair import LEAST_STD, repair_camera_info, surely_off
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

RIG = PAPER_RIG
# Pitch, roll, yaw of the right camera.
TURN_DEG = 0.1, 0.2, 0.1
NAMES = "pitch", "roll", "yaw"


def alignment(angles_deg=TURN_DEG, std_deg=0.005):
    std_rad = np.radians(np.broadcast_to(std_deg, 3))
    return Alignment(*np.radians(angles_deg), np.diag(std_rad**2))


def left_from_right(pitch_deg, roll_deg, yaw_deg):
    """Return the rotation of the right optical frame, by turns of its body about single axes."""
    body = turn("z", math.radians(yaw_deg)) @ turn("y", math.radians(pitch_deg))
    return OPTICAL_FROM_BODY @ body @ turn("x", math.radians(roll_deg)) @ OPTICAL_FROM_BODY.T


def seen_by_turned(angles_deg, points):
    """Return the pixels in which the turned right camera and the left one see points of the left (N, 3)."""
    k = np.array([[RIG.fx, 0, RIG.cx], [0, RIG.fy, RIG.cy], [0, 0, 1.0]])
    centre = np.array([RIG.baseline_m, 0.0, 0.0])
    in_right = (points - centre) @ left_from_right(*angles_deg)
    pixels = [each @ k.T for each in (in_right, points - centre, points)]
    return [each[:, :2] / each[:, 2:] for each in pixels]


def raw_infos(**changes):
    """Return the CameraInfo of a pair that distorts, and is turned before it is rectified."""
    infos = []
    for side, angles in (("left", (0.4, -0.7, 0.3)), ("right", (-0.3, 0.5, -0.6))):
        shift = -RIG.fx * RIG.baseline_m if side == "right" else 0.0
        values = {
            "width": RIG.width,
            "height": RIG.height,
            "distortion_model": "plumb_bob",
            "k": [RIG.fx * 1.05, 0, RIG.cx + 9, 0, RIG.fy * 1.06, RIG.cy - 7, 0, 0, 1],
            "d": [-0.28, 0.07, 0.0008, -0.0005, 0.01],
            "r": cv2.Rodrigues(np.radians(angles))[0].ravel().tolist(),
            "p": [RIG.fx, 0, RIG.cx, shift, 0, RIG.fy, RIG.cy, 0, 0, 0, 1, 0],
        }
        infos.append(PlainCameraInfo.of(SimpleNamespace(**values | changes)))
    return infos


def points_ahead(n=400):
    """Return points in front of both cameras, near and far, that both see well inside their images."""
    rng = np.random.default_rng(3)
    depth = rng.uniform(3.0, 80.0, n)
    x, y = rng.uniform(-0.5, 0.5, n), rng.uniform(-0.38, 0.38, n)
    return np.column_stack([x * depth, y * depth, depth])


def sampled(maps, pixels):
    """Return where the maps say that rectified pixels (N, 2) lie in the image, (N, 2)."""
    columns, rows = np.floor(pixels).astype(int).T
    u, v = (pixels % 1.0).T
    at = [
        (1 - v) * ((1 - u) * each[rows, columns] + u * each[rows, columns + 1])
        + v * ((1 - u) * each[rows + 1, columns] + u * each[rows + 1, columns + 1])
        for each in maps
    ]
    return np.column_stack(at)


def displacement_px(image, reference):
    """Return by how much an image is moved against another one, in x and y [px], by their grey values."""
    middle = np.s_[6:-6, 6:-6]
    down, right = (each[middle].ravel() for each in np.gradient(reference.astype(float)))
    change = (reference.astype(float) - image)[middle].ravel()
    return np.linalg.lstsq(np.column_stack([right, down]), change, rcond=None)[0]


def inside(pixels):
    return ((pixels > 2) & (pixels < np.array([RIG.width, RIG.height]) - 3)).all(axis=1)


@pytest.mark.parametrize("angles_deg", [TURN_DEG, (0.1, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.2)])
def test_rectified_pixels_of_the_corrected_pair_are_those_of_a_camera_that_never_turned(angles_deg):
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment(angles_deg))
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    assert rectifier.turned and rectifier.rig == RIG and not rectifier.doubts
    maps = rectification_maps(rectifier.cameras[1], rectifier.cameras[0].p)
    turned, unturned, in_left = seen_by_turned(angles_deg, points_ahead())
    seen = inside(turned) & inside(unturned)
    assert seen.sum() > 300
    found = sampled(maps, unturned[seen])
    assert np.abs(found - turned[seen]).max() < 0.02
    # Without the correction, rows and disparities are off by up to some pixels.
    assert np.abs(turned - unturned)[seen].max() > 0.5
    assert np.abs(in_left[:, 1] - unturned[:, 1]).max() < 1e-9


def test_the_fields_of_a_corrected_pair_of_rectified_images():
    originals = PlainCameraInfo.of_rig(RIG)
    pair = repair_camera_info(*originals, alignment())
    assert pair.corrected == NAMES and pair.originals == originals
    for info, original in zip((pair.left, pair.right), originals, strict=True):
        np.testing.assert_array_equal(info.k.reshape(3, 3), original.p.reshape(3, 4)[:, :3])
        np.testing.assert_array_equal(info.p, original.p)
        assert not info.d.any() and info.distortion_model == "plumb_bob"
    np.testing.assert_array_equal(pair.left.r, np.eye(3).ravel())
    np.testing.assert_allclose(pair.right.rotation, left_from_right(*TURN_DEG), atol=1e-12)


def test_the_image_of_a_turned_camera_becomes_that_of_one_that_never_turned():
    frame = named_scene("straight_road").frame(0)
    smooth = cv2.GaussianBlur(frame.right, (0, 0), 2.0)  # interpolated twice, it loses nothing
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    turned_info = SimpleNamespace(
        width=RIG.width,
        height=RIG.height,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=pair.right.k,
        r=left_from_right(*TURN_DEG).ravel(),
        p=pair.right.p,
    )
    turned = raw_image(turned_info, smooth)
    left, right = StereoRectifier.from_camera_info(pair.left, pair.right).apply(frame.left, turned)
    assert left is frame.left
    assert np.abs(displacement_px(right, smooth)).max() < 0.02
    assert np.abs(displacement_px(turned, smooth)).max() > 0.5
    edge = right[:, [0, -1]].astype(int)
    assert edge.min() > 0  # the border is repeated, there is no black wedge


def test_raw_images_are_rectified_to_a_camera_that_never_turned():
    """By the lens formulas: the raw pixel of a true rectified pixel."""
    left, right = raw_infos()
    pair = repair_camera_info(left, right, alignment(), rectified=False)
    assert pair.left is left and pair.corrected == NAMES
    for name in ("k", "d", "p"):
        np.testing.assert_array_equal(getattr(pair.right, name), getattr(right, name))
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right, rectified=False)
    maps = rectification_maps(rectifier.cameras[1], rectifier.cameras[0].p)
    believed, unturned, _ = seen_by_turned(TURN_DEG, points_ahead())
    seen = inside(believed) & inside(unturned)
    expected = np.column_stack(raw_pixel(right, *believed[seen].T))
    assert np.abs(sampled(maps, unturned[seen]) - expected).max() < 0.02


@pytest.mark.parametrize("rectified", [True, False])
def test_a_corrected_pair_is_corrected_further(rectified):
    """Half of the turn, and then what is left of it."""
    infos = PlainCameraInfo.of_rig(RIG) if rectified else raw_infos()
    whole = repair_camera_info(*infos, alignment((0.0, 0.0, 0.2)), rectified)
    half = repair_camera_info(*infos, alignment((0.0, 0.0, 0.1)), rectified)
    twice = repair_camera_info(half.left, half.right, alignment((0.0, 0.0, 0.1)), rectified)
    np.testing.assert_allclose(twice.right.r, whole.right.r, atol=1e-12)
    assert twice.originals == (half.left, half.right)


@pytest.mark.parametrize(
    ("n_std", "corrected"),
    [
        ((2.99, 3.01, -3.01), ("roll", "yaw")),
        ((3.01, -2.99, 0.0), ("pitch",)),
        ((-2.9, 2.9, 2.9), ()),
        ((math.nan, 0.0, 5.0), ("yaw",)),
    ],
)
def test_angles_are_corrected_from_three_standard_deviations_on(n_std, corrected):
    std_deg = 0.02, 0.1, 0.05
    found = alignment(np.multiply(n_std, std_deg), std_deg)
    assert LEAST_STD == 3.0 and surely_off(found) == corrected
    originals = PlainCameraInfo.of_rig(RIG)
    pair = repair_camera_info(*originals, found)
    assert pair.corrected == corrected
    assert ((pair.left, pair.right) == originals) is (not corrected)
    expected = [
        deg if name in corrected else 0.0
        for name, deg in zip(NAMES, np.degrees(found.as_array()), strict=True)
    ]
    np.testing.assert_allclose(pair.right.rotation, left_from_right(*expected), atol=1e-12)
    assert ("as it was: no angle" in pair.describe()) is (not corrected)


def test_what_is_not_seen_is_not_corrected():
    found = Alignment(0.01, 0.01, 0.01, np.diag([1e-8, math.inf, 1.0]))
    assert surely_off(found) == ("pitch",)
    assert surely_off(replace(found, covariance=np.full((3, 3), math.nan))) == ()
    assert surely_off(Alignment(0.0, 0.0, 0.0, np.zeros((3, 3)))) == ()


def test_without_a_measured_alignment_the_pair_is_as_it_was():
    originals = PlainCameraInfo.of_rig(RIG)
    pair = repair_camera_info(*originals, None)
    assert (pair.left, pair.right) == originals and pair.corrected == ()
    assert pair.describe() == "as it was: the alignment of the cameras was not measured"


def test_rectified_images_with_the_camera_info_of_raw_cameras_get_a_pair_of_their_own():
    """K, D and R of the raw cameras are past for images that image_proc has rectified with them."""
    pair = repair_camera_info(*raw_infos(), alignment())
    np.testing.assert_allclose(pair.right.rotation, left_from_right(*TURN_DEG), atol=1e-12)
    assert StereoRectifier.from_camera_info(pair.left, pair.right).turned
    assert not StereoRectifier.from_camera_info(*raw_infos()).turned


def changed(info, **changes):
    return replace(info, **{name: np.asarray(value, dtype=float) for name, value in changes.items()})


def test_rectified_images_stay_as_they_are_where_r_is_no_correction():
    """Bit by bit, and with the reason where R might have been meant as one."""
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    image = np.random.default_rng(0).integers(0, 255, (RIG.height, RIG.width), dtype=np.uint8)
    large = left_from_right(0.0, 0.0, 6.0).ravel()
    k, d = [*pair.right.k[:2], pair.right.k[2] + 5, *pair.right.k[3:]], [-0.1, 0.0, 0.0, 0.0, 0.0]
    cases = {
        "unturned": (pair.left, changed(pair.right, r=np.eye(3).ravel()), None),
        "large": (pair.left, changed(pair.right, r=large), "at most 5 deg"),
        "other left": (changed(pair.left, k=k), pair.right, "in the right one alone"),
        "raw k": (pair.left, changed(pair.right, k=k), None),
        "raw d": (pair.left, changed(pair.right, d=d), None),
    }
    for name, (left, right, doubt) in cases.items():
        rectifier = StereoRectifier.from_camera_info(left, right)
        assert rectifier.apply(image, image)[1] is image, name
        said = [each.message for each in rectifier.doubts if each.reason is InfoReason.ROTATION_NOT_APPLIED]
        assert bool(said) is (doubt is not None) and (doubt is None or doubt in said[0]), name
    assert StereoRectifier.from_camera_info(pair.left, pair.right).apply(image, image)[1] is not image


@pytest.mark.parametrize("topic", ["/s/{}/image_rect", "/s/{}/image_raw", "/cam/{}"])
@pytest.mark.parametrize("rectified", [True, False])
def test_a_corrected_pair_is_taken_whatever_the_images_are_called(topic, rectified):
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right, rectified)
    check_claim(rectifier.cameras, (topic.format("left"), topic.format("right")), rectified, "")
    image = np.random.default_rng(0).integers(0, 255, (RIG.height, RIG.width), dtype=np.uint8)
    other = StereoRectifier.from_camera_info(pair.left, pair.right, not rectified)
    both = [each.apply(image, image)[1][8:-8, 8:-8] for each in (rectifier, other)]
    np.testing.assert_array_equal(*both)


def test_a_correction_is_a_change_of_the_cameras():
    before = StereoRectifier.from_camera_info(*PlainCameraInfo.of_rig(RIG))
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    after = StereoRectifier.from_camera_info(pair.left, pair.right)
    assert before.rig == after.rig and not before.sees_as(after) and after.sees_as(after)


def test_another_cx_of_the_right_camera_is_mended_with_the_turn():
    originals = list(PlainCameraInfo.of_rig(RIG))
    p = originals[1].p.copy()
    p[2] -= 12.25
    originals[1] = changed(originals[1], p=p, k=p.reshape(3, 4)[:, :3].ravel())
    pair = repair_camera_info(*originals, alignment())
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    maps = rectification_maps(rectifier.cameras[1], rectifier.cameras[0].p)
    turned, unturned, _ = seen_by_turned(TURN_DEG, points_ahead())
    turned[:, 0] -= 12.25
    seen = inside(turned) & inside(unturned)
    assert np.abs(sampled(maps, unturned[seen]) - turned[seen]).max() < 0.02
    image = np.random.default_rng(0).integers(0, 255, (RIG.height, RIG.width), dtype=np.uint8)
    moved = rectifier.apply(image, image)[1]
    np.testing.assert_array_equal(
        moved, cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    )


def test_region_and_binning_stay_and_hold_for_the_corrected_pair():
    """The sensor is twice as large and binned; K, P and the turn of its images are those of RIG."""
    infos = []
    for info in PlainCameraInfo.of_rig(RIG):
        p, k = info.p.reshape(3, 4).copy(), info.k.reshape(3, 3).copy()
        for matrix in (p, k):
            matrix[:2, :2] *= 2
            matrix[:2, 2] = 2 * (matrix[:2, 2] + 0.5) - 0.5
        p[:, 3] *= 2
        binned = replace(info, width=2 * RIG.width, height=2 * RIG.height, binning_x=2, binning_y=2)
        infos.append(replace(binned, p=p.ravel(), k=k.ravel()))
    pair = repair_camera_info(*infos, alignment())
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    assert rectifier.turned and rectifier.rig.to_mapping() == pytest.approx(RIG.to_mapping())
    plain = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    expected = rectification_maps(CameraModel.read(plain.right, "right"), tuple(plain.left.p))
    found = rectification_maps(rectifier.cameras[1], rectifier.cameras[0].p)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_a_rig_alone_cannot_turn_images_and_says_what_can():
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment())
    with pytest.raises(CameraInfoError, match="use StereoRectifier") as caught:
        StereoRig.from_camera_info(pair.left, pair.right)
    assert caught.value.reason is InfoReason.ROTATION_NOT_APPLIED
    assert StereoRig.from_camera_info(*pair.originals) == RIG


def test_the_turn_is_told():
    pair = repair_camera_info(*PlainCameraInfo.of_rig(RIG), alignment((0.0, 0.0, 0.25)))
    rectifier = StereoRectifier.from_camera_info(pair.left, pair.right)
    assert rectifier.turn_text == "R turns the right images by 0.250 deg"
    assert StereoRectifier.of_rig(RIG).turn_text == ""
