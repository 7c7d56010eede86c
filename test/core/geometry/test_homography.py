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

"""Road <-> image against cv2.projectPoints with turns about single axes, and against the paper."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from independent_camera import CAMERAS, project

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.core.geometry.homography import (
    apply_homography,
    camera_centre_m,
    camera_matrix,
    horizon_row,
    image_from_road,
    paper_projection,
    reduce_to_plane,
    road_from_image,
)

# Nothing in it is square or in the middle, so that no exchange of x and y goes unseen.
RIG = StereoRig(640, 480, 516.6, 490.0, 312.0, 247.0, 0.1481)
LEVEL = Extrinsics(1.4, 0.0, 0.0)
# Both sides compute with doubles; pixels go up to a few thousand.
ROUNDING_PX = 1e-7

poses = st.builds(
    Extrinsics,
    st.floats(0.3, 4.0),
    st.floats(-math.radians(20), math.radians(20)),
    st.floats(-math.radians(15), math.radians(15)),
)


def random_poses(n):
    rng = np.random.default_rng(7)
    return [Extrinsics(*rng.uniform((0.3, -0.35, -0.26), (4.0, 0.35, 0.26))) for _ in range(n)]


def road_points(n=50, seed=3):
    rng = np.random.default_rng(seed)
    # From 8 m on, points lie in front of the camera whatever the pose.
    return np.column_stack([rng.uniform(8, 60, n), rng.uniform(-6, 6, n)])


def on_road(points):
    return np.column_stack([points, np.zeros(len(points))])


def row_of(pose, point, camera="left"):
    return float(apply_homography(image_from_road(RIG, pose, camera), point)[1])


def column_of(pose, point, camera="left"):
    return float(apply_homography(image_from_road(RIG, pose, camera), point)[0])


@pytest.mark.parametrize("camera", CAMERAS)
def test_image_from_road_agrees_with_opencv(camera):
    points = road_points()
    for pose in random_poses(50):
        mapped = apply_homography(image_from_road(RIG, pose, camera), points)
        np.testing.assert_allclose(mapped, project(RIG, pose, camera, on_road(points)), atol=ROUNDING_PX)


@pytest.mark.parametrize("camera", CAMERAS)
def test_third_coordinate_is_the_depth(camera):
    x, y = 10.0, 2.0
    depth = (image_from_road(RIG, LEVEL, camera) @ [x, y, 1.0])[2]
    assert depth == pytest.approx(x)
    assert (image_from_road(RIG, LEVEL, camera) @ [-x, y, 1.0])[2] < 0


def test_disparity_is_positive_and_focal_length_times_baseline_over_depth():
    left, right = (column_of(LEVEL, (10.0, 1.0), camera) for camera in CAMERAS)
    assert left - right == pytest.approx(RIG.fx * RIG.baseline_m / 10.0)


def test_camera_centres_are_half_a_baseline_to_either_side():
    left, right = (camera_centre_m(RIG, camera) for camera in CAMERAS)
    assert left[1] > 0
    np.testing.assert_array_equal(left, -right)
    np.testing.assert_allclose(left - right, [0, RIG.baseline_m, 0])


def test_camera_matrix():
    np.testing.assert_array_equal(camera_matrix(RIG), [[RIG.fx, 0, RIG.cx], [0, RIG.fy, RIG.cy], [0, 0, 1]])


@pytest.mark.parametrize("camera", CAMERAS)
@given(pose=poses, x=st.floats(8, 60), y=st.floats(-6, 6))
def test_from_road_to_image_and_back(camera, pose, x, y):
    pixel = apply_homography(image_from_road(RIG, pose, camera), (x, y))
    back = apply_homography(road_from_image(RIG, pose, camera), pixel)
    # A homography at 0.3 m height stretches the rounding of a pixel (1e-13) to 60^2 / (500 * 0.3) m.
    np.testing.assert_allclose(back, (x, y), atol=1e-7)


@pytest.mark.parametrize("camera", CAMERAS)
@given(pose=poses, u=st.floats(0, 639), below=st.floats(5, 400))
def test_from_image_to_road_and_back(camera, pose, u, below):
    pixel = (u, float(horizon_row(RIG, pose, u)) + below)
    road = apply_homography(road_from_image(RIG, pose, camera), pixel)
    np.testing.assert_allclose(apply_homography(image_from_road(RIG, pose, camera), road), pixel, atol=1e-6)


def test_homography_keeps_the_shape_of_its_points():
    matrix = image_from_road(RIG, LEVEL, "left")
    points = road_points(12).reshape(3, 4, 2)
    mapped = apply_homography(matrix, points)
    assert mapped.shape == (3, 4, 2)
    np.testing.assert_allclose(mapped[2, 1], apply_homography(matrix, points[2, 1]), atol=ROUNDING_PX)


@pytest.mark.parametrize("camera", CAMERAS)
def test_horizon_is_where_very_distant_road_is_seen(camera):
    sideways = np.linspace(-0.5, 0.5, 11)
    far = on_road(1e9 * np.column_stack([np.ones(11), sideways]))
    for pose in random_poses(50):
        u, v = project(RIG, pose, camera, far).T
        # The horizon is infinitely far, these points 1e9 m: that is 1e-6 px short at 4 m of height.
        np.testing.assert_allclose(horizon_row(RIG, pose, u), v, atol=1e-5)


def test_horizon_of_a_level_camera_is_the_principal_row():
    np.testing.assert_allclose(horizon_row(RIG, LEVEL, [0, 300, 639]), RIG.cy)


def test_nose_down_moves_the_horizon_up_in_the_image():
    assert horizon_row(RIG, Extrinsics(1.4, 0.05, 0.0), RIG.cx) == pytest.approx(
        RIG.cy - RIG.fy * math.tan(0.05)
    )
    assert horizon_row(RIG, Extrinsics(1.4, 0.05, 0.0), RIG.cx) < RIG.cy


def test_right_side_down_lets_the_horizon_rise_to_the_right():
    """The picture turns against the camera: the right end of the horizon is higher, at a smaller row."""
    left_end, right_end = horizon_row(RIG, Extrinsics(1.4, 0.0, 0.03), [0, 639])
    assert right_end < RIG.cy < left_end


@pytest.mark.parametrize("camera", CAMERAS)
def test_right_side_down_shows_the_right_of_the_road_higher(camera):
    level, rolled = LEVEL, Extrinsics(1.4, 0.0, 0.03)
    assert row_of(rolled, (10.0, -3.0), camera) < row_of(level, (10.0, -3.0), camera)
    assert row_of(rolled, (10.0, 3.0), camera) > row_of(level, (10.0, 3.0), camera)


def test_nose_down_shows_the_road_higher_and_a_higher_camera_lower():
    point = (10.0, 0.0)
    assert row_of(Extrinsics(1.4, 0.05, 0.0), point) < row_of(LEVEL, point)
    assert row_of(Extrinsics(1.6, 0.0, 0.0), point) > row_of(LEVEL, point)


def test_left_of_the_road_is_left_in_the_image():
    assert column_of(LEVEL, (10.0, 2.0)) < column_of(LEVEL, (10.0, 0.0)) < column_of(LEVEL, (10.0, -2.0))


# The paper: X right, Y forward, Z up. Road (x, y) of ours is X = -y, Y = x.
OURS_TO_PAPER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_papers_matrix_reduced_to_the_road_is_ours(camera):
    for pose in random_poses(50):
        # Its alpha is minus our pitch, its beta our roll: written here anew, not by to_paper().
        t = paper_projection(RIG, pose.height_m, -pose.pitch_rad, pose.roll_rad, camera)
        ours = image_from_road(RIG, pose, camera)
        # Entries go up to 4 m * 500 px.
        np.testing.assert_allclose(reduce_to_plane(t) @ OURS_TO_PAPER, ours, atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_papers_matrix_projects_points_above_the_road_too(camera):
    rng = np.random.default_rng(5)
    points = np.column_stack([road_points(), rng.uniform(0, 2, 50)])
    in_paper = np.column_stack([-points[:, 1], points[:, 0], points[:, 2], np.ones(50)])
    for pose in random_poses(10):
        s_u, depth, s_v, s = (
            paper_projection(RIG, pose.height_m, -pose.pitch_rad, pose.roll_rad, camera) @ in_paper.T
        )
        np.testing.assert_allclose(s, depth)
        expected = project(RIG, pose, camera, points)
        np.testing.assert_allclose(np.column_stack([s_u / s, s_v / s]), expected, atol=ROUNDING_PX)
