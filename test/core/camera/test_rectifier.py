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

"""Raw and shifted images become those of one rig: against a projection of its own, and against the result."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent_lens import raw_image, raw_pixel

from stereo_selfcal import CalibratorConfig, RigError, StereoRig, calibrate
from stereo_selfcal.core.camera.camera_info import CameraInfoError, CameraModel, InfoReason
from stereo_selfcal.core.camera.rectifier import StereoRectifier, rectification_maps, shifted
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

RIG = PAPER_RIG
COEFFICIENTS = {
    "plumb_bob": (-0.28, 0.07, 0.0008, -0.0005, 0.01),
    "rational_polynomial": (-0.2, 0.03, 0.0006, -0.0004, 0.002, 0.05, -0.01, 0.001),
    "equidistant": (-0.03, 0.006, -0.002, 0.0005),
}
MODELS = list(COEFFICIENTS)


# The rows are those of the rectification: what remains of an error of it is to be seen.
AS_RECTIFIED = CalibratorConfig.from_mapping({"alignment.correct": "none"})


@cache
def road():
    """Return a frame of the straight road and the pose that is found in it."""
    frame = named_scene("straight_road").frame(0)
    return frame, calibrate(frame.left, frame.right, RIG, config=AS_RECTIFIED).extrinsics.as_array()


def rotation(*angles_deg):
    return cv2.Rodrigues(np.radians(angles_deg))[0]


def raw_info(side="left", model="plumb_bob", rig=RIG, **changes):
    """Return the CameraInfo of a camera that is turned and distorts."""
    turned = {"left": rotation(0.4, -0.7, 0.3), "right": rotation(-0.3, 0.5, -0.6)}[side]
    f = 1.05 if side == "left" else 0.97
    k = [rig.fx * f, 0, rig.cx + 9, 0, rig.fy * f * 1.01, rig.cy - 7, 0, 0, 1]
    shift = -rig.fx * rig.baseline_m if side == "right" else 0.0
    p = [rig.fx, 0, rig.cx, shift, 0, rig.fy, rig.cy, 0, 0, 0, 1, 0]
    values = {
        "width": rig.width,
        "height": rig.height,
        "distortion_model": model,
        "k": k,
        "d": list(COEFFICIENTS.get(model, ())),
        "r": turned.ravel().tolist(),
        "p": p,
    }
    return SimpleNamespace(**{**values, **changes})


def pair_of(model, **changes):
    return raw_info("left", model, **changes), raw_info("right", model, **changes)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_maps_are_those_of_the_formulas(model, side):
    info = raw_info(side, model)
    maps = rectification_maps(CameraModel.read(info, side), tuple(info.p))
    rows, columns = np.mgrid[0 : RIG.height, 0 : RIG.width].astype(float)
    for found, expected in zip(maps, raw_pixel(info, columns, rows), strict=True):
        assert np.abs(found - expected).max() < 1e-3  # of single precision
    assert max(np.abs(maps[0] - columns).max(), np.abs(maps[1] - rows).max()) > 20


def test_maps_are_made_once_for_each_camera_info():
    rectification_maps.cache_clear()
    grey = np.full((RIG.height, RIG.width), 90, np.uint8)
    for _ in range(3):
        StereoRectifier.from_camera_info(*pair_of("plumb_bob"), rectified=False).apply(grey, grey)
    assert (rectification_maps.cache_info().misses, rectification_maps.cache_info().hits) == (2, 4)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_raw_images_calibrate_as_the_rectified_ones(model):
    frame, expected = road()
    infos = pair_of(model)
    raw = [raw_image(info, image) for info, image in zip(infos, (frame.left, frame.right), strict=True)]
    rectifier = StereoRectifier.from_camera_info(*infos, rectified=False)
    assert rectifier.rig.to_mapping() == pytest.approx(RIG.to_mapping(), rel=1e-12)
    assert not calibrate(*raw, RIG, config=AS_RECTIFIED).accepted
    found = calibrate(*rectifier.apply(*raw), rectifier.rig, config=AS_RECTIFIED)
    assert found.accepted, found.message
    change = np.abs(found.extrinsics.as_array() - expected)
    # Twice interpolated: within some standard deviations of the pixels' noise at a low contrast.
    assert (change < [4e-3, 4e-4, 2e-3]).all(), change


@pytest.mark.parametrize("shift_px", [-30.0, 12.25, 0.5])
def test_another_cx_of_the_right_camera(shift_px):
    """The right image lies ``shift_px`` farther left; by the CameraInfo it is put back."""
    frame, expected = road()
    moved = shifted(frame.right, -shift_px)
    infos = [raw_info(side, "", d=[]) for side in ("left", "right")]
    infos[1].p[2] -= shift_px
    with pytest.raises(RigError, match="differ in cx"):
        StereoRig.from_camera_info(*infos)
    rectifier = StereoRectifier.from_camera_info(*infos)
    found = calibrate(*rectifier.apply(frame.left, moved), rectifier.rig, config=AS_RECTIFIED)
    assert found.accepted, found.message
    change = np.abs(found.extrinsics.as_array() - expected)
    assert (change < [2e-3, 2e-4, 1e-3]).all(), change


@pytest.mark.parametrize("rectified", [True, False])
def test_cx_that_leaves_nothing_in_common_is_refused(rectified):
    left, right = pair_of("plumb_bob")
    right.p[2] = left.p[2] - 640.0
    StereoRectifier.from_camera_info(left, right, rectified=rectified)
    right.p[2] -= 1.0
    with pytest.raises(CameraInfoError, match="differ in cx"):
        StereoRectifier.from_camera_info(left, right, rectified=rectified)


NUMBERS = (
    st.floats(allow_nan=True, allow_infinity=True) | st.floats(-2, 2) | st.sampled_from([0.0, 1.0, 500.0])
)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_whatever_the_numbers_are_images_come_out_or_a_reason(data):
    """Numbers no camera has: finite ones may give any picture, but no crash and no other exception."""
    rig = StereoRig(48, 32, 40.0, 40.0, 20.0, 15.0, 0.2)
    infos = []
    for side in ("left", "right"):
        info = raw_info(side, data.draw(st.sampled_from([*MODELS, "", "fov"])), rig)
        for name in data.draw(st.lists(st.sampled_from("kdrp"), max_size=2)):
            values = list(getattr(info, name))
            if values:
                values[data.draw(st.integers(0, len(values) - 1))] = data.draw(NUMBERS)
            setattr(info, name, values)
        infos.append(info)
    image = np.arange(48 * 32, dtype=np.uint8).reshape(32, 48)
    for rectified in (True, False):
        try:
            rectifier = StereoRectifier.from_camera_info(*infos, rectified=rectified)
        except RigError as error:
            assert str(error)
            continue
        for out in rectifier.apply(image, image):
            assert (out.shape, out.dtype) == (image.shape, np.uint8)


def test_another_cx_of_a_raw_camera_is_mended_by_the_maps():
    left, right = pair_of("plumb_bob")
    right.p[2] += 20.0
    cameras = StereoRectifier.from_camera_info(left, right, rectified=False).cameras
    maps = rectification_maps(cameras[1], cameras[0].p)
    rows, columns = np.mgrid[0 : RIG.height, 0 : RIG.width].astype(float)
    np.testing.assert_allclose(maps[0], raw_pixel(right, columns, rows, left.p)[0], atol=1e-3)


def test_rectified_images_of_one_cx_are_not_touched():
    images = np.zeros((RIG.height, RIG.width), np.uint8), np.ones((RIG.height, RIG.width), np.uint8)
    infos = pair_of("plumb_bob")
    infos[1].p[2] += 0.009  # what calibration files leave of rounding
    rectifier = StereoRectifier.from_camera_info(*infos)
    assert all(a is b for a, b in zip(rectifier.apply(*images), images, strict=True))
    assert StereoRectifier(RIG).apply(*images)[1] is images[1]


def test_images_of_another_size_are_left_to_the_calibrator():
    small = np.zeros((240, 320), np.uint8)
    for rectified in (True, False):
        rectifier = StereoRectifier.from_camera_info(*pair_of("plumb_bob"), rectified=rectified)
        assert rectifier.apply(small, small)[0] is small
        assert rectifier.size_faults((640, 480), None) == []
        (fault,) = rectifier.size_faults((640, 480), (320, 240))
        assert fault.reason is InfoReason.IMAGE_SIZE and "the right image is 320 x 240" in fault.message


@pytest.mark.parametrize("shift_px", [3, -3, 0])
def test_shift_by_whole_pixels_is_a_copy(shift_px):
    image = np.random.default_rng(0).integers(0, 256, (5, 40), dtype=np.uint8)
    out = shifted(image, shift_px)
    inner = slice(3, -3)
    np.testing.assert_array_equal(out[:, inner], np.roll(image, shift_px, axis=1)[:, inner])
    assert (out[:, 0] == image[:, 0]).all() or shift_px < 0


@pytest.mark.parametrize("shift_px", [0.25, -0.5, 7.9, -12.3])
def test_shift_by_parts_of_a_pixel_is_exact_for_parabolas(shift_px):
    u = np.arange(200.0)

    def parabola(columns):
        return 20 + 0.02 * (columns - 100) ** 2

    image = np.rint(np.repeat(parabola(u)[None, :], 3, axis=0)).astype(np.uint8)
    out = shifted(image, shift_px)[1, 20:-20].astype(float)
    error = out - parabola(u - shift_px)[20:-20]
    assert np.abs(error).max() <= 1.2 and abs(error.mean()) < 0.05  # rounded to whole grey values, twice


def refused(match, reason, rectified=False, **changes):
    infos = raw_info("left"), raw_info("right", **changes)
    with pytest.raises(CameraInfoError, match=match) as caught:
        StereoRectifier.from_camera_info(*infos, rectified=rectified)
    assert caught.value.reason is reason


def test_unknown_distortion_model_is_refused_for_raw_images_only():
    refused("model 'fov', known are equidistant, plumb_bob", InfoReason.UNKNOWN_MODEL, distortion_model="fov")
    refused("model ''|has 5 distortion", InfoReason.MALFORMED, distortion_model="")
    StereoRectifier.from_camera_info(raw_info("left", "fov"), raw_info("right", "fov"))


@pytest.mark.parametrize(
    ("model", "count"), [("plumb_bob", 3), ("rational_polynomial", 7), ("equidistant", 0)]
)
def test_wrong_number_of_coefficients(model, count):
    refused(f"has {count} distortion", InfoReason.MALFORMED, distortion_model=model, d=[0.1] * count)


def test_no_coefficients_are_no_distortion():
    info = raw_info("left", d=[])
    maps = rectification_maps(CameraModel.read(info, "left"), tuple(info.p))
    info.d = [0.0] * 5
    rows, columns = np.mgrid[0 : RIG.height, 0 : RIG.width].astype(float)
    np.testing.assert_allclose(maps, raw_pixel(info, columns, rows), atol=1e-3)


@pytest.mark.parametrize("field", ["d", "r"])
def test_not_finite(field):
    values = getattr(raw_info(), field)
    refused("NaN or infinity in", InfoReason.NOT_FINITE, **{field: [np.nan, *values[1:]]})


@pytest.mark.parametrize(
    ("r", "words"),
    [
        ([0.0] * 9, "R is zero"),
        ([], "R is missing"),
        (np.diag([1.0, 1.0, 1.01]).ravel().tolist(), "is no rotation"),
        (np.diag([1.0, 1.0, -1.0]).ravel().tolist(), "is no rotation"),
    ],
)
def test_rotation_that_is_none(r, words):
    refused(words, InfoReason.NOT_A_ROTATION, r=r)
    StereoRectifier.from_camera_info(raw_info("left"), raw_info("right", r=r))  # rectified: not used


def region(**fields):
    values = dict.fromkeys(("x_offset", "y_offset", "width", "height"), 0) | fields
    return SimpleNamespace(**values, do_rectify=False)


def test_region_of_interest_and_binning():
    """A camera that sends a part of its pixels, two by two in one."""
    infos = pair_of("plumb_bob", roi=region(x_offset=100, y_offset=60, width=400, height=300))
    for info in infos:
        info.binning_x, info.binning_y = 2, 2
    whole = raw_info("left")
    rectifier = StereoRectifier.from_camera_info(*infos, rectified=False)
    rig = rectifier.rig
    assert (rig.width, rig.height, rig.baseline_m) == (200, 150, pytest.approx(RIG.baseline_m))
    assert (rig.fx, rig.cx) == (RIG.fx / 2, (RIG.cx - 100 + 0.5) / 2 - 0.5)
    maps = rectification_maps(rectifier.cameras[0], rectifier.cameras[0].p)
    # The middle of a pixel of the small image, in pixels of the whole sensor, there and back.
    rows, columns = np.mgrid[0:150, 0:200].astype(float)
    u, v = raw_pixel(whole, 2 * columns + 0.5 + 100, 2 * rows + 0.5 + 60)
    np.testing.assert_allclose(maps[0], (u - 100 - 0.5) / 2, atol=1e-3)
    np.testing.assert_allclose(maps[1], (v - 60 - 0.5) / 2, atol=1e-3)


def test_whole_region_and_binning_of_one_change_nothing():
    plain = raw_info()
    for roi in (region(), region(width=640, height=480)):
        info = raw_info(roi=roi, binning_x=1, binning_y=0)
        assert CameraModel.read(info, "left") == CameraModel.read(plain, "left")


@pytest.mark.parametrize("roi", [region(x_offset=10), region(x_offset=300, width=400, height=100)])
def test_region_outside_of_the_image(roi):
    refused("region of interest of", InfoReason.REGION, rectified=True, roi=roi)


def test_rectified_regions_of_both_cameras_may_lie_apart():
    """As the region moves the principal point, the right image is shifted back."""
    regions = [region(x_offset=x, y_offset=180, width=600, height=300) for x in (40, 20)]
    infos = [raw_info(side, roi=roi) for side, roi in zip(("left", "right"), regions, strict=True)]
    frame, expected = road()
    images = frame.left[180:, 40:], frame.right[180:, 20:620]
    rectifier = StereoRectifier.from_camera_info(*infos)
    assert rectifier.shift_px == -20
    found = calibrate(*rectifier.apply(*images), rectifier.rig, config=AS_RECTIFIED)
    assert found.accepted, found.message
    assert (np.abs(found.extrinsics.as_array() - expected) < [5e-3, 5e-4, 3e-3]).all()


def test_results_of_one_cx_are_the_same_bytes():
    frame, _ = road()
    rectifier = replace(StereoRectifier.from_camera_info(*pair_of("plumb_bob")), rig=RIG)
    config = CalibratorConfig(seed=3)
    direct = calibrate(frame.left, frame.right, RIG, 3, config)
    through = calibrate(*rectifier.apply(frame.left, frame.right), rectifier.rig, 3, config)
    assert direct.extrinsics == through.extrinsics
