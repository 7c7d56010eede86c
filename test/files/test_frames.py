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

"""Frames by their names: which axes a name stands for, and what has no name."""

import math

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, ConfigError, Extrinsics, StereoRig
from stereo_selfcal.core.camera.plain_camera_info import PlainCameraInfo
from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.geometry.vehicle import CameraAxes, PlaceInVehicle
from stereo_selfcal.files.frames import FROM_CAMERA_INFO, FrameNames, InfoFrames, name_camera, place_camera

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
ZED = InfoFrames("zed_left", "zed_right")
OPTICAL, BODY = CameraAxes.OPTICAL, CameraAxes.BODY


def result(yaw_std_deg=None):
    travel = None
    if yaw_std_deg is not None:
        variance = math.radians(yaw_std_deg) ** 2
        travel = Travel(0.03, 0.05, np.diag([variance, variance]), 20, 1.2, 25.0)
    covariance = np.eye(3) * 1e-6
    return CalibrationResult(
        "good", extrinsics=Extrinsics(1.4, 0.05, 0.01), covariance=covariance, travel=travel
    )


@pytest.mark.parametrize(
    ("asked", "infos", "axes", "name"),
    [
        ("stereo_camera", ZED, BODY, "stereo_camera"),
        ("zed_left", ZED, OPTICAL, "zed_left"),
        ("/zed_left", ZED, OPTICAL, "/zed_left"),
        (FROM_CAMERA_INFO, ZED, OPTICAL, "zed_left"),
        ("zed_left", InfoFrames("zed_left", "zed_left"), OPTICAL, "zed_left"),
        ("zed_left", InfoFrames(of_rig=True), BODY, "zed_left"),
        ("zed_left", InfoFrames("zed_left", "zed_right", of_rig=True), OPTICAL, "zed_left"),
        ("zed_left", InfoFrames(), BODY, "zed_left"),
        ("front_optical", InfoFrames("front_optical", "right_optical"), OPTICAL, "front_optical"),
        ("optical", ZED, BODY, "optical"),
        ("front_optical_mount", ZED, BODY, "front_optical_mount"),
    ],
)
def test_name_of_the_left_camera_is_optical_and_any_other_is_the_body(asked, infos, axes, name):
    named = name_camera(FrameNames(camera_frame=asked), infos)
    assert (named.axes, named.name, named.problem) == (axes, name, "")


@pytest.mark.parametrize(
    ("asked", "infos", "axes", "words"),
    [
        (
            FROM_CAMERA_INFO,
            InfoFrames("", "zed_right"),
            OPTICAL,
            "has no frame_id: set camera_frame to a name",
        ),
        (
            FROM_CAMERA_INFO,
            InfoFrames("zed_left", of_rig=True),
            OPTICAL,
            "the rig is given, so that there is none: set",
        ),
        (
            FROM_CAMERA_INFO,
            InfoFrames("road", ""),
            OPTICAL,
            "'road', which is that of the vehicle or of the road",
        ),
        (FROM_CAMERA_INFO, InfoFrames("base_footprint", ""), OPTICAL, "give the camera's driver a frame_id"),
        ("zed_right", ZED, BODY, "which is the right camera by its CameraInfo"),
        (
            "zed_right",
            ZED,
            BODY,
            "set camera_frame to a name of its own for the camera body, or to from_camera_info",
        ),
        ("zed_right", InfoFrames("", "zed_right"), BODY, "is 'zed_right', which is the right camera"),
        (
            "front_optical",
            ZED,
            OPTICAL,
            "'front_optical', an optical frame by its name, but the left CameraInfo has 'zed_left': set",
        ),
        ("/front_optical_frame ", ZED, OPTICAL, "or set camera_frame to from_camera_info"),
        ("front_optical", InfoFrames(), OPTICAL, "the left CameraInfo has no frame_id to say so: set"),
        (
            "front_optical",
            InfoFrames("zed_left", of_rig=True),
            OPTICAL,
            "the left images have 'zed_left': set camera_frame to a name of its own for the camera body, or "
            "set camera_frame to that name",
        ),
        (
            "front_optical_frame",
            InfoFrames(of_rig=True),
            OPTICAL,
            "there is no CameraInfo to say so, and no image has said so: set camera_frame to a name",
        ),
    ],
)
def test_camera_that_cannot_be_named_says_why_and_what_to_set(asked, infos, axes, words):
    named = name_camera(FrameNames(camera_frame=asked), infos)
    assert (named.axes, named.name) == (axes, "")
    assert words in named.problem and "\n" not in named.problem


@pytest.mark.parametrize("name", ["vehicle_frame", "road_frame", "camera_frame"])
@pytest.mark.parametrize("text", ["", " ", "/", " //"])
def test_empty_frame_is_refused(name, text):
    with pytest.raises(ConfigError, match=f"{name} is empty: the name of a frame is needed"):
        FrameNames(**{name: text}).check()


def test_camera_is_not_its_own_parent():
    for camera_frame in ("base_footprint", "/base_footprint"):
        with pytest.raises(ConfigError, match=r"camera_frame and vehicle_frame are both .* give"):
            FrameNames(camera_frame=camera_frame).check()
    for camera_frame in ("road", "/road", "road ", " //road"):
        for for_tf in (False, True):
            with pytest.raises(
                ConfigError, match=r"camera_frame and road_frame are both 'road': no frame .* must differ"
            ):
                FrameNames(camera_frame=camera_frame).check(for_tf)
    FrameNames(vehicle_frame="road").check(for_tf=True)  # as before there was a vehicle


def test_yaw_decides_the_parent():
    names, place = FrameNames(), PlaceInVehicle(1.7, 0.2)
    known = place_camera(result(0.1), RIG, FrameNames(place=place), ZED)
    assert (known.parent, known.child, known.yaw_remark) == ("base_footprint", "stereo_camera", "")
    assert known.camera.transform.translation_m == pytest.approx([1.7, 0.2, 1.4])
    unknown = place_camera(result(), RIG, FrameNames(place=place), ZED)
    assert (unknown.parent, unknown.child) == ("road", "stereo_camera")
    assert unknown.camera.transform.translation_m == pytest.approx([0.0, 0.0, 1.4])
    assert "the yaw is not known (no motion is seen between the frames: the car " in unknown.yaw_remark
    assert "1.5 s or 20 m apart, or show too few points beside the road), so" in unknown.yaw_remark
    assert "drive straight on for half a minute" in unknown.told
    vague = place_camera(result(1.2), RIG, names, ZED)
    assert vague.parent == "road" and "(std 1.200 deg, no better than that of any mount: " in vague.yaw_remark


@pytest.mark.parametrize("yaw_std_deg", [None, 0.1])
def test_vehicle_that_is_the_road_is_as_it_was_before_there_was_a_vehicle(yaw_std_deg):
    names = FrameNames(vehicle_frame="road", place=PlaceInVehicle(1.7, 0.2))
    placed = place_camera(result(yaw_std_deg), RIG, names, ZED)
    assert (placed.parent, placed.told) == ("road", "")
    assert placed.camera.transform.translation_m == pytest.approx([0.0, 0.0, 1.4])
    assert placed.camera.transform.roll_pitch_yaw() == pytest.approx((0.01, 0.05, 0.0))


def test_names_come_from_camera_info_as_it_is():
    infos = [
        PlainCameraInfo(info.width, info.height, "plumb_bob", info.d, info.k, info.r, info.p, frame_id=frame)
        for info, frame in zip(PlainCameraInfo.of_rig(RIG), ("/left_optical", "right_optical"), strict=True)
    ]
    cameras = StereoRectifier.from_camera_info(*infos)
    assert InfoFrames.of(cameras) == InfoFrames("left_optical", "right_optical")  # as tf2 has them
    assert InfoFrames.of(StereoRectifier.of_rig(RIG)) == InfoFrames(of_rig=True)
