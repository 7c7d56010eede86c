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

"""What is said of a CameraInfo that is strange, and that nothing is said of one that is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from stereo_selfcal.core.camera.camera_info import CameraInfoError, CameraModel, InfoReason
from stereo_selfcal.core.camera.camera_info_checks import (
    check_claim,
    find_unusual_values,
    rectification_moves_px,
)
from stereo_selfcal.core.camera.rectifier import StereoRectifier

D = [-0.3, 0.1, 0.0, 0.0, 0.0]
R = [0.9999, 0.01, 0.01, -0.01, 0.9999, 0.0, -0.01, 0.0, 0.9999]
EYE = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]


def info(side="left", **changes):
    """Return a CameraInfo like KITTI's: K differs from P, D is not zero."""
    k = [984.0, 0, 690.0, 0, 980.0, 233.0, 0, 0, 1]
    shift = -721.5 * 0.54 if side == "right" else 0.0
    p = [721.5, 0, 609.5, shift, 0, 721.5, 172.8, 0, 0, 0, 1, 0]
    values = {"width": 1242, "height": 375, "distortion_model": "plumb_bob", "k": k, "d": D, "r": R, "p": p}
    return SimpleNamespace(**{**values, **changes})


def doubts(rectified=True, baseline_m=0.54, **changes):
    cameras = CameraModel.read(info(**changes), "left"), CameraModel.read(info("right"), "right")
    return {
        finding.reason: finding.message for finding in find_unusual_values(*cameras, baseline_m, rectified)
    }


def changed(values, **by_index):
    return [by_index.get(f"i{i}", value) for i, value in enumerate(values)]


@pytest.mark.parametrize("rectified", [True, False])
def test_nothing_is_said_of_a_good_one(rectified):
    assert doubts(rectified) == {}


@pytest.mark.parametrize(
    ("baseline_m", "usual"), [(0.031, True), (0.029, False), (1.99, True), (2.01, False)]
)
def test_usual_baselines(baseline_m, usual):
    assert (InfoReason.BASELINE_UNUSUAL not in doubts(baseline_m=baseline_m)) == usual


@pytest.mark.parametrize(
    ("baseline_m", "possible"), [(0.0051, True), (0.0049, False), (9.9, True), (10.1, False), (540.0, False)]
)
def test_possible_baselines(baseline_m, possible):
    """P[3] in millimetres makes a rig of half a kilometre: every height would be wrong by as much."""
    right = info("right")
    right.p[3] = -721.5 * baseline_m
    if possible:
        assert StereoRectifier.from_camera_info(info(), right).rig.baseline_m == pytest.approx(baseline_m)
        return
    with pytest.raises(CameraInfoError, match="pixels times metres") as caught:
        StereoRectifier.from_camera_info(info(), right)
    assert caught.value.reason is InfoReason.BASELINE_IMPLAUSIBLE


@pytest.mark.parametrize(("fx", "usual"), [(360.0, False), (361.5, True), (1440.0, True), (1445.0, False)])
def test_focal_lengths_of_k_and_p(fx, usual):
    k = changed(info().k, i0=fx, i4=fx)
    assert (InfoReason.FOCAL_LENGTHS_DISAGREE not in doubts(k=k)) == usual


def test_fisheye_lenses_are_zoomed_more():
    k = changed(info().k, i0=300.0, i4=300.0)
    assert InfoReason.FOCAL_LENGTHS_DISAGREE in doubts(k=k)
    assert doubts(k=k, distortion_model="equidistant") == {}


@pytest.mark.parametrize("matrix", ["k", "p"])
def test_principal_point_at_the_rim(matrix):
    """Half the resolution in K or P alone, or the row of another crop."""
    index = {"k": "i5", "p": "i6"}[matrix]
    for row, usual in ((330.0, False), (310.0, True), (50.0, False), (60.0, True)):
        found = doubts(**{matrix: changed(getattr(info(), matrix), **{index: row})})
        assert (InfoReason.PRINCIPAL_POINT not in found) == usual, row


def test_crop_may_have_its_principal_point_anywhere():
    roi = SimpleNamespace(x_offset=0, y_offset=150, width=1242, height=225)
    assert doubts(roi=roi) == {}


@pytest.mark.parametrize(
    ("changes", "rectified", "said"),
    [
        ({}, True, True),
        ({"d": [0.0] * 5}, True, False),
        ({"d": []}, True, False),
        ({"r": R}, True, False),
        ({"p": info().p}, True, False),
        ({}, False, False),  # raw images of aligned cameras
    ],
)
def test_calibration_of_a_single_raw_camera_on_a_rectified_topic(changes, rectified, said):
    k = info().k
    p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
    found = doubts(rectified, **{"k": k, "p": p, "r": EYE, "d": D, **changes})
    assert (InfoReason.SEEMS_UNRECTIFIED in found) == said
    if said:
        assert "set rectified: false" in found[InfoReason.SEEMS_UNRECTIFIED]


@pytest.mark.parametrize(
    ("left_p3", "right_p3", "said"),
    [(0.0, -389.6, False), (44.9, -344.7, False), (389.6, 0.0, True), (400.0, 10.4, True)],
)
def test_p3_of_the_left_camera_says_that_the_sign_may_be_wrong(left_p3, right_p3, said):
    """KITTI's colour cameras have one too, but theirs belong to a third camera at the origin."""
    left, right = info(), info("right")
    left.p[3], right.p[3] = left_p3, right_p3
    found = {doubt.reason: doubt.message for doubt in StereoRectifier.from_camera_info(left, right).doubts}
    assert (InfoReason.REFERENCE_IS_RIGHT in found) == said
    if said:
        assert f"{left_p3:g} in the left camera and {right_p3:g}" in found[InfoReason.REFERENCE_IS_RIGHT]
        assert "sign of P[3] is wrong" in found[InfoReason.REFERENCE_IS_RIGHT]


def test_nothing_is_said_of_k_when_it_is_not_given():
    assert doubts(k=[0.0] * 9) == {}


MATRIX = [721.5, 0, 609.5, 0, 721.5, 172.8, 0, 0, 1]
PLAIN = {"k": MATRIX, "d": [0.0] * 5, "r": EYE}


def claim(topic, rectified=True, **changes):
    """Check that of images on ``topic``; both cameras are alike."""
    cameras = [CameraModel.read(info(side, **changes), side) for side in ("left", "right")]
    check_claim(tuple(cameras), (topic.format("left"), topic.format("right")), rectified, "REMEDY")


RAW_TOPICS = ["/s/{}/image_raw", "/s/{}/image", "/s/{}/image_color", "/s/{}/image_raw/compressed", "/cam/{}"]
RECTIFIED_TOPICS = ["/s/{}/image_rect", "/s/{}/color/rect/image", "/s/{}/image_rect_raw", "/s/{}Rectified"]


@pytest.mark.parametrize("topic", RAW_TOPICS)
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"d": D}, "D is not zero"),
        ({"r": R}, "R is not the identity"),
        ({"k": changed(MATRIX, i2=600.0)}, "K is not P"),
        ({"d": [0.1] * 3, "distortion_model": "fov"}, "by an unknown amount"),
    ],
)
def test_raw_images_are_not_taken_for_rectified(topic, changes, why):
    with pytest.raises(CameraInfoError, match=rf"/left.* is not called rectified.*{why}.*REMEDY") as caught:
        claim(topic, **PLAIN | changes)
    assert caught.value.reason is InfoReason.NOT_RECTIFIED
    claim(topic, rectified=False, **PLAIN | changes)


@pytest.mark.parametrize("topic", RAW_TOPICS)
@pytest.mark.parametrize("k", [MATRIX, [0.0] * 9, changed(MATRIX, i2=609.59)])
def test_raw_images_that_need_no_rectification_are_rectified(topic, k):
    claim(topic, **PLAIN | {"k": k})


@pytest.mark.parametrize("topic", RECTIFIED_TOPICS)
def test_images_called_rectified_are_believed(topic):
    claim(topic)


@pytest.mark.parametrize("topic", ["/s/{}/image_rect", "/s/{}/color/rect/image", "/s/{}Rectified"])
def test_rectified_images_are_not_rectified_again(topic):
    with pytest.raises(CameraInfoError, match=r"called rectified.*a second time.*REMEDY") as caught:
        claim(topic, rectified=False)
    assert caught.value.reason is InfoReason.RECTIFIED_ALREADY
    claim(topic, rectified=False, **PLAIN)


def test_moved_pixels_are_those_of_the_formulas():
    """A shift of the principal point moves all by as much; a turn by an angle about f times it."""
    for model in ("plumb_bob", "rational_polynomial"):
        moved = CameraModel.read(
            info(**PLAIN | {"k": changed(MATRIX, i5=175.8), "distortion_model": model}), "left"
        )
        assert rectification_moves_px(moved) == pytest.approx(3.0, abs=1e-6)
    angle = 1e-3
    turned = [1.0, 0, 0, 0, 1.0, -angle, 0, angle, 1.0]
    moved_px = rectification_moves_px(CameraModel.read(info(**PLAIN | {"r": turned}), "left"))
    assert moved_px == pytest.approx(721.5 * angle, rel=0.1)
    fisheye = {"distortion_model": "equidistant", "d": [0.0] * 4}
    assert rectification_moves_px(CameraModel.read(info(**PLAIN | fisheye), "left")) > 10


def region(**values):
    return SimpleNamespace(**{"x_offset": 0, "y_offset": 0, "width": 0, "height": 0} | values)


BINNED = {"width": 1280, "height": 960, "binning_x": 2, "binning_y": 2}


def sensor_info(side, fx, cx, cy, **changes):
    k = [fx, 0, cx, 0, fx, cy, 0, 0, 1]
    p = [fx, 0, cx, -fx * 0.2 if side == "right" else 0.0, 0, fx, cy, 0, 0, 0, 1, 0]
    values = {"distortion_model": "", "k": k, "d": [], "r": EYE, "p": p}
    return SimpleNamespace(**values | changes)


def sensors(*numbers, **changes):
    return [sensor_info(side, *numbers, **changes) for side in ("left", "right")]


@pytest.mark.parametrize(
    ("numbers", "changes"),
    [
        ((500.0, 319.5, 239.5), BINNED),
        ((500.0, 250.0, 200.0), BINNED),
        (
            (500.0, 319.5, 239.5),
            {"width": 1280, "height": 960, "roi": region(x_offset=320, y_offset=240, width=640, height=480)},
        ),
    ],
)
def test_a_p_of_the_binned_image_does_not_go_together_with_binning(numbers, changes):
    with pytest.raises(
        CameraInfoError, match=r"(binning 2 x 2|region).*principal point of P.*640 x 480"
    ) as caught:
        StereoRectifier.from_camera_info(*sensors(*numbers, **changes))
    assert caught.value.reason is InfoReason.REGION


@pytest.mark.parametrize(
    ("changes", "size", "fx"),
    [
        (BINNED, (640, 480), 500.0),
        (BINNED, (1280, 960), 1000.0),  # the driver does not bin after all
        (
            {"width": 1280, "height": 960, "roi": region(y_offset=440, width=1280, height=520)},
            (1280, 520),
            1000.0,
        ),
        (
            {"width": 1280, "height": 960, "roi": region(y_offset=400, width=1280, height=560)},
            (1280, 960),
            1000.0,
        ),
    ],
)
def test_binning_and_region_are_applied_by_the_size_of_the_images(changes, size, fx):
    rectifier = StereoRectifier.from_camera_info(*sensors(1000.0, 639.5, 479.5, **changes))
    image = np.zeros(size[::-1], np.uint8)
    chosen = rectifier.for_images(image, image)
    assert (chosen.rig.width, chosen.rig.height, chosen.rig.fx) == (*size, fx)
    assert chosen.rig.baseline_m == pytest.approx(0.2)
    assert rectifier.size_faults(size, size) == []
    whole = size == (1280, 960)
    assert [doubt.reason is InfoReason.REGION_NOT_APPLIED for doubt in chosen.doubts] == [True] * (2 * whole)
