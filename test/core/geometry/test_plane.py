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

import numpy as np
import pytest

from stereo_selfcal.core.geometry.homography import SIDES, apply_homography, image_from_road
from stereo_selfcal.core.geometry.plane import (
    DisparityPlane,
    PlaneCamera,
    jacobian_pose_wrt_plane,
    plane_from_pose,
    pose_from_plane,
)
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.rays import pixel_rays
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, -0.07)
ROAD_M = np.array([[6.0, 1.5], [15.0, -2.0], [40.0, 0.3]])


def seen():
    """Return the columns (2, N) of road points in both cameras, and their rows (N,)."""
    pixels = np.array([apply_homography(image_from_road(PAPER_RIG, POSE, side), ROAD_M) for side in SIDES])
    assert pixels[0, :, 1] == pytest.approx(pixels[1, :, 1])
    return pixels[:, :, 0], pixels[0, :, 1]


@pytest.mark.parametrize("camera", PlaneCamera)
def test_disparities_are_those_that_the_cameras_see(camera):
    columns, rows = seen()
    u = columns[0] if camera is PlaneCamera.LEFT else columns.mean(axis=0)
    plane = plane_from_pose(POSE, PAPER_RIG, camera)
    assert plane.camera is camera
    disparities = plane.disparities(pixel_rays(PAPER_RIG, u, rows))
    assert disparities == pytest.approx(columns[0] - columns[1], rel=1e-12)


@pytest.mark.parametrize("camera", PlaneCamera)
def test_pose_comes_back(camera):
    pose = pose_from_plane(plane_from_pose(POSE, PAPER_RIG, camera), PAPER_RIG)
    assert pose.as_array() == pytest.approx(POSE.as_array(), rel=1e-12)


@pytest.mark.parametrize("camera", PlaneCamera)
@pytest.mark.parametrize("other", PlaneCamera)
def test_one_road_by_the_rays_of_another_camera(camera, other):
    plane = plane_from_pose(POSE, PAPER_RIG, camera).of_camera(other, PAPER_RIG)
    assert plane.camera is other
    assert plane.coefficients == pytest.approx(
        plane_from_pose(POSE, PAPER_RIG, other).coefficients, rel=1e-12
    )


@pytest.mark.parametrize("camera", PlaneCamera)
def test_jacobian_is_the_inverse_of_how_the_plane_moves_with_the_pose(camera):
    step = 1e-6
    moved = [
        (
            plane_from_pose(Extrinsics.from_array(POSE.as_array() + change), PAPER_RIG, camera).coefficients
            - plane_from_pose(Extrinsics.from_array(POSE.as_array() - change), PAPER_RIG, camera).coefficients
        )
        / (2.0 * step)
        for change in step * np.eye(3)
    ]
    plane = plane_from_pose(POSE, PAPER_RIG, camera)
    product = jacobian_pose_wrt_plane(plane, PAPER_RIG) @ np.column_stack(moved)
    assert product == pytest.approx(np.eye(3), abs=1e-7)


def test_height_is_that_of_the_planes_camera():
    """Roll to the right lifts the left camera."""
    tilted = Extrinsics(1.4, 0.0, 0.1)
    middle, left = (
        plane_from_pose(tilted, PAPER_RIG, camera) for camera in (PlaneCamera.MIDDLE, PlaneCamera.LEFT)
    )
    assert middle.height_m(PAPER_RIG) == pytest.approx(1.4)
    lift_m = np.sin(0.1) * PAPER_RIG.baseline_m / 2.0
    assert left.height_m(PAPER_RIG) == pytest.approx(1.4 + lift_m)


def test_a_plane_that_is_moved_is_of_the_same_camera():
    plane = DisparityPlane(np.array([1.0, 2.0, -30.0]), PlaneCamera.LEFT).moved(np.array([0.5, 0.0, 1.0]))
    assert plane.coefficients.tolist() == [1.5, 2.0, -29.0]
    assert plane.camera is PlaneCamera.LEFT


def test_ray_through_the_principal_point_goes_straight_ahead():
    assert pixel_rays(PAPER_RIG, PAPER_RIG.cx, PAPER_RIG.cy).tolist() == [1.0, 0.0, 0.0]


def test_rays_point_to_the_right_and_down_where_columns_and_rows_grow():
    ray = pixel_rays(PAPER_RIG, PAPER_RIG.cx + PAPER_RIG.fx, PAPER_RIG.cy + 2.0 * PAPER_RIG.fy)
    assert ray.tolist() == [1.0, -1.0, -2.0]


def test_columns_and_rows_of_rays_broadcast():
    assert pixel_rays(PAPER_RIG, np.zeros((2, 5)), np.arange(5)).shape == (2, 5, 3)
    assert pixel_rays(PAPER_RIG, np.zeros(5), 7.0).shape == (5, 3)
