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

"""The rig: from numbers, data sheets and CameraInfo messages, and everything that is refused."""

import math
from dataclasses import FrozenInstanceError
from types import SimpleNamespace

import numpy as np
import pytest

from stereo_selfcal import RigError, SelfcalError, StereoRig

GOOD = {
    "width": 640,
    "height": 480,
    "fx": 516.6,
    "fy": 510.0,
    "cx": 319.5,
    "cy": 239.5,
    "baseline_m": 0.1481,
}
NUMBERS = [name for name in GOOD if name not in ("cx", "cy")]


def camera_info(side="left", spelling=str.lower, **changes):
    """Return a CameraInfo as the stereo calibration of ROS writes it."""
    shift = -GOOD["fx"] * GOOD["baseline_m"] if side == "right" else 0.0
    # K is of the raw image: it must not be used, and differs on purpose.
    k = [500.0, 0, 310.0, 0, 500.0, 230.0, 0, 0, 1]
    p = [GOOD["fx"], 0, GOOD["cx"], shift, 0, GOOD["fy"], GOOD["cy"], 0, 0, 0, 1, 0]
    values = {"width": 640, "height": 480, spelling("k"): k, spelling("p"): p, **changes}
    return SimpleNamespace(**values)


def changed(values, index, value):
    return [value if i == index else old for i, old in enumerate(values)]


def test_values_are_plain_python_numbers():
    rig = StereoRig(np.int32(640), np.float64(480), np.float32(500), 500, np.int64(320), 240, np.float16(0.5))
    assert [type(value) for value in rig.to_mapping().values()] == [
        int,
        int,
        float,
        float,
        float,
        float,
        float,
    ]
    assert rig == StereoRig(640, 480, 500.0, 500.0, 320.0, 240.0, 0.5)


def test_is_frozen_and_usable_as_a_key():
    rig = StereoRig(**GOOD)
    assert {rig: 1}[StereoRig(**GOOD)] == 1
    with pytest.raises(FrozenInstanceError):
        rig.fx = 1.0


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("value", [True, False, np.True_, "500", None, [500.0], 1j])
def test_what_is_no_number_is_refused_by_name(name, value):
    with pytest.raises(RigError, match=rf"rig\.{name} is .*a number is needed"):
        StereoRig(**{**GOOD, name: value})


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_by_name(name, value):
    with pytest.raises(RigError, match=rf"rig\.{name} is (nan|-?inf), a finite number is needed"):
        StereoRig(**{**GOOD, name: value})


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [0, -1])
def test_zero_and_negative_are_refused_by_name(name, value):
    with pytest.raises(RigError, match=rf"rig\.{name} is {value}\S*, it must be greater than zero"):
        StereoRig(**{**GOOD, name: value})


@pytest.mark.parametrize("name", ["width", "height"])
def test_part_of_a_pixel_is_refused(name):
    with pytest.raises(RigError, match=rf"rig\.{name} is 100\.5, whole pixels"):
        StereoRig(**{**GOOD, name: 100.5})


@pytest.mark.parametrize(("name", "limit"), [("cx", 640), ("cy", 480)])
def test_principal_point_inside_the_image(name, limit):
    for inside in (0, limit):
        StereoRig(**{**GOOD, name: inside})
    for outside in (-0.01, limit + 0.01):
        with pytest.raises(
            RigError, match=r"principal point .* outside the 640 x 480 image: check cx and cy"
        ):
            StereoRig(**{**GOOD, name: outside})


def test_a_rig_error_is_a_value_error_of_the_package():
    assert issubclass(RigError, SelfcalError)
    assert issubclass(RigError, ValueError)


@pytest.mark.parametrize("left", [str.lower, str.upper])
@pytest.mark.parametrize("right", [str.lower, str.upper])
def test_camera_info_of_ros_1_and_2(left, right):
    rig = StereoRig.from_camera_info(camera_info("left", left), camera_info("right", right))
    # -fx b / fx does not cancel to the last bit.
    assert rig.to_mapping() == pytest.approx(GOOD, rel=1e-12)


def test_camera_info_with_numpy_arrays_as_rclpy_has_them():
    infos = [camera_info(side) for side in ("left", "right")]
    for info in infos:
        info.k, info.p = np.array(info.k), np.array(info.p)
    assert StereoRig.from_camera_info(*infos).to_mapping() == pytest.approx(GOOD, rel=1e-12)


def test_camera_info_takes_the_difference_of_both_shifts():
    left, right = camera_info("left"), camera_info("right")
    left.p, right.p = changed(left.p, 3, 10.0), changed(right.p, 3, right.p[3] + 10.0)
    assert StereoRig.from_camera_info(left, right).baseline_m == pytest.approx(GOOD["baseline_m"], rel=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("matrix", ["k", "p"])
class TestBadCameraInfo:
    def refuse(self, side, match, **changes):
        infos = {name: camera_info(name) for name in ("left", "right")}
        infos[side] = camera_info(side, **changes)
        with pytest.raises(RigError, match=match):
            StereoRig.from_camera_info(infos["left"], infos["right"])

    def test_uncalibrated(self, side, matrix):
        """Without P; K is not used of rectified cameras, but that both are 0 says more than that P is."""
        changes = {"p": changed(camera_info(side).p, 0, 0.0)}
        name = r"no projection matrix \(P\[0\] = 0\)"
        if matrix == "k":
            changes["k"] = changed(camera_info(side).k, 0, 0.0)
            name = r"is uncalibrated \(K\[0\] = 0 and P\[0\] = 0\)"
        self.refuse(side, f"{side} CameraInfo .*{name}.*calibrate", **changes)

    @pytest.mark.parametrize("values", [None, [], [1.0] * 10])
    def test_without_its_matrix(self, side, matrix, values):
        self.refuse(
            side, rf"{side} CameraInfo has no matrix {matrix.upper()} of \d+ values", **{matrix: values}
        )

    @pytest.mark.parametrize("value", [math.nan, math.inf])
    def test_not_finite(self, side, matrix, value):
        values = changed(getattr(camera_info(side), matrix), 1, value)
        self.refuse(side, f"{side} CameraInfo has NaN or infinity in {matrix.upper()}", **{matrix: values})


@pytest.mark.parametrize("size", [{"width": 320}, {"height": 240}])
def test_camera_infos_of_two_sizes(size):
    with pytest.raises(RigError, match=r"left CameraInfo is 640 x 480, right is .*one size"):
        StereoRig.from_camera_info(camera_info("left"), camera_info("right", **size))


@pytest.mark.parametrize(("name", "index"), [("fx", 0), ("cx", 2), ("fy", 5), ("cy", 6)])
def test_a_pair_not_rectified_to_one_matrix(name, index):
    left, right = camera_info("left"), camera_info("right")
    # Either side of the tolerance of 0.01 px.
    right.p = changed(right.p, index, left.p[index] + 0.009)
    StereoRig.from_camera_info(left, right)
    right.p = changed(right.p, index, left.p[index] + 0.011)
    with pytest.raises(
        RigError, match=f"P of the cameras differ in {name}: .*, at most 0.01 px apart allowed: rectify"
    ):
        StereoRig.from_camera_info(left, right)


def test_k_of_zeros_is_enough_where_p_is_filled():
    infos = [camera_info(side, k=[0.0] * 9) for side in ("left", "right")]
    assert StereoRig.from_camera_info(*infos).to_mapping() == pytest.approx(GOOD, rel=1e-12)


@pytest.mark.parametrize(
    ("left_p3", "right_p3", "words"),
    [
        (
            0.0,
            0.0,
            r"baseline of zero \(P\[3\] is 0 in both cameras, as .* alone: calibrate them as a stereo",
        ),
        (-76.5, -76.5, r"P\[3\] is -76\.5 in both cameras, so both have the CameraInfo of one"),
        (12.0, 12.0, r"P\[3\] is 12 in both cameras"),
        (
            0.0,
            76.5,
            r"negative baseline \(-0\.1481 m\): P\[3\] is 0 in the left camera and 76\.5 in the right one: "
            r"0 and -76\.5 .* needed; .* the sign of P\[3\] is wrong: .* are swapped: exchange the topics",
        ),
        (
            -76.5,
            0.0,
            r"P\[3\] is -76\.5 in the left camera and 0 in the right one: the CameraInfo of left and ",
        ),
        (-38.25, 38.25, r"-38\.25 in the left camera and 38\.25 in the right one: 0 and -76\.5 .*sign"),
        (
            0.0,
            -76508.5,
            r"148\.1 m \(P\[3\] is 0 in the left camera and -76508\.5 in the right.*not millimetres",
        ),
    ],
)
def test_a_p3_that_cannot_be_is_told_with_its_values_and_what_it_can_mean(left_p3, right_p3, words):
    left, right = camera_info("left"), camera_info("right")
    left.p, right.p = changed(left.p, 3, left_p3), changed(right.p, 3, right_p3)
    with pytest.raises(RigError, match=words):
        StereoRig.from_camera_info(left, right)


def test_cameras_one_above_the_other_are_no_pair_side_by_side():
    left, right = camera_info("left"), camera_info("right")
    right.p = changed(changed(right.p, 3, 0.0), 7, -75.5)
    with pytest.raises(RigError, match=r"P\[7\] is 0 in the left one and -75\.5 .* one above the other"):
        StereoRig.from_camera_info(left, right)


def test_data_sheet_of_the_paper():
    """Table I: 6.28 mm over 7.78 mm of 640 px are 516.6 px; 774.9 px over the assumed 3.89 mm of 480 px."""
    rig = StereoRig.from_sensor(640, 480, 6.28, 7.78, 0.1481)
    assert (round(rig.fx, 1), rig.fy) == (516.6, rig.fx)
    # Pixel centres have whole coordinates, so the middle of 640 columns is 319.5.
    assert (rig.cx, rig.cy, rig.baseline_m) == (319.5, 239.5, 0.1481)
    assert round(StereoRig.from_sensor(640, 480, 6.28, 7.78, 0.1481, ccd_height_mm=3.89).fy, 1) == 774.9


@pytest.mark.parametrize("name", ["focal_mm", "ccd_width_mm", "ccd_height_mm"])
@pytest.mark.parametrize("value", [0, -1.0, math.nan])
def test_data_sheet_with_a_length_that_cannot_be(name, value):
    lengths = {"focal_mm": 6.28, "ccd_width_mm": 7.78, "ccd_height_mm": 3.89, name: value}
    with pytest.raises(RigError, match=f"{name} is .*greater than zero"):
        StereoRig.from_sensor(640, 480, baseline_m=0.1481, **lengths)


def test_mapping_there_and_back():
    rig = StereoRig(**GOOD)
    assert rig.to_mapping() == GOOD
    assert StereoRig.from_mapping(rig.to_mapping()) == rig


def test_mapping_with_missing_and_unknown_keys():
    values = {**GOOD, "f": 1.0, "b": 2.0}
    del values["fx"], values["baseline_m"]
    with pytest.raises(
        RigError, match=r"rig lacks fx, baseline_m and has unknown f, b: its keys are width, .*"
    ):
        StereoRig.from_mapping(values)
    with pytest.raises(RigError, match="rig has unknown f: its keys"):
        StereoRig.from_mapping({**GOOD, "f": 1.0})
    with pytest.raises(RigError, match="rig lacks width, height"):
        StereoRig.from_mapping({})
