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

"""The camera in the vehicle's frame, against rotations that are composed here."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.geometry.vehicle import (
    CameraAxes,
    PlaceInVehicle,
    RigidTransform,
    camera_in_vehicle,
)

RIG = StereoRig(640, 480, 800.0, 800.0, 320.0, 240.0, 0.3)
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(-2.0))
COVARIANCE = np.diag([0.01, 0.002, 0.003]) ** 2
PLACE = PlaceInVehicle(1.7, -0.2)


def _travel(yaw_deg, std_deg=0.05):
    variance = math.radians(std_deg) ** 2
    return Travel(math.radians(yaw_deg), 0.05, np.diag([variance, variance]), 50, 1.3, 30.0)


def _axis(angle, axis):
    """Rodrigues' formula, written out."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def _fixed_axes(roll, pitch, yaw):
    return _axis(yaw, (0, 0, 1)) @ _axis(pitch, (0, 1, 0)) @ _axis(roll, (1, 0, 0))


def test_body_is_where_road_and_tape_measure_have_it_turned_by_the_yaw():
    camera = camera_in_vehicle(POSE, COVARIANCE, _travel(2.5), RIG, CameraAxes.BODY, PLACE)
    assert camera.yaw_known
    assert camera.transform.translation_m == pytest.approx([1.7, -0.2, 1.4])
    expected = _fixed_axes(POSE.roll_rad, POSE.pitch_rad, math.radians(2.5))
    assert camera.transform.rotation == pytest.approx(expected)
    ahead = camera.transform.rotation @ [1.0, 0.0, 0.0]
    assert ahead[1] > 0.0 > ahead[2]  # it points to the left, and down


def test_optical_frame_is_that_of_the_left_camera():
    of_body = camera_in_vehicle(POSE, COVARIANCE, _travel(2.5), RIG, CameraAxes.BODY, PLACE).transform
    optical = camera_in_vehicle(POSE, COVARIANCE, _travel(2.5), RIG, CameraAxes.OPTICAL, PLACE).transform
    # A point 10 m ahead, 1 m to the right of the left camera and 2 m below it.
    in_body = [10.0, 0.15 - 1.0, -2.0]
    assert optical.apply([1.0, 2.0, 10.0]) == pytest.approx(of_body.apply(in_body))


@pytest.mark.parametrize("travel", [None, _travel(2.5, std_deg=1.1)])
def test_unknown_yaw_is_zero_and_the_parent_is_the_road(travel):
    camera = camera_in_vehicle(POSE, COVARIANCE, travel, RIG, CameraAxes.BODY, PLACE)
    assert not camera.yaw_known
    assert camera.transform.translation_m == pytest.approx([0.0, 0.0, 1.4])
    assert camera.transform.roll_pitch_yaw() == pytest.approx((POSE.roll_rad, POSE.pitch_rad, 0.0))
    assert camera.parent_from_road.rotation == pytest.approx(np.eye(3))
    assert not np.any(camera.covariance[5]) and not np.any(camera.covariance[:2])


@pytest.mark.parametrize("axes", list(CameraAxes))
def test_covariance_is_that_of_drawn_transforms(axes):
    rng = np.random.default_rng(1)
    camera = camera_in_vehicle(POSE, COVARIANCE, _travel(2.5, 0.2), RIG, axes, PLACE)
    drawn = []
    for _ in range(4000):
        pose = Extrinsics.from_array(rng.multivariate_normal(POSE.as_array(), COVARIANCE))
        travel = _travel(2.5 + 0.2 * rng.standard_normal(), 0.2)
        moved = camera_in_vehicle(pose, COVARIANCE, travel, RIG, axes, PLACE).transform
        turn = moved.rotation @ camera.transform.rotation.T
        small = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        drawn.append([*(moved.translation_m - camera.transform.translation_m), *(np.array(small) / 2.0)])
    found = np.cov(np.array(drawn).T)
    scale = np.sqrt(np.maximum(np.diag(camera.covariance), 1e-16))
    assert found / np.outer(scale, scale) == pytest.approx(
        camera.covariance / np.outer(scale, scale), abs=0.08
    )


def test_road_frame_lies_under_the_camera_and_turns_with_it():
    camera = camera_in_vehicle(POSE, COVARIANCE, _travel(-3.0), RIG, CameraAxes.BODY, PLACE)
    assert camera.parent_from_road.translation_m == pytest.approx([1.7, -0.2, 0.0])
    in_road = camera.parent_from_road.inverse().after(camera.transform)
    assert in_road.translation_m == pytest.approx([0.0, 0.0, 1.4])
    assert in_road.roll_pitch_yaw() == pytest.approx((POSE.roll_rad, POSE.pitch_rad, 0.0))


@pytest.mark.parametrize("seed", range(20))
def test_angles_and_quaternion_give_the_rotation_back(seed):
    rng = np.random.default_rng(seed)
    matrix, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    matrix *= np.sign(np.linalg.det(matrix))
    transform = RigidTransform(matrix, np.zeros(3))
    assert _fixed_axes(*transform.roll_pitch_yaw()) == pytest.approx(matrix)
    x, y, z, w = transform.quaternion()
    angle, length = 2.0 * math.acos(min(1.0, w)), math.sqrt(x * x + y * y + z * z)
    assert w >= 0.0
    assert _axis(angle, (x / length, y / length, z / length)) == pytest.approx(matrix)


def test_angles_of_a_camera_that_looks_straight_down_give_the_rotation_back():
    matrix = _fixed_axes(0.0, math.pi / 2.0, 0.4)
    assert _fixed_axes(*RigidTransform(matrix, np.zeros(3)).roll_pitch_yaw()) == pytest.approx(matrix)
