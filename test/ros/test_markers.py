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

"""Markers in the vehicle's frame, against rotations that are composed here."""

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from independent_camera import turn
from visualization_msgs.msg import Marker

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.geometry.vehicle import CameraAxes, PlaceInVehicle, camera_in_vehicle
from stereo_selfcal.ros.markers import markers_message

RIG = ros_graph.RIG
POSE = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))
LANES = (np.array([[5.0, 1.75], [30.0, 1.7]]), np.array([[5.0, -1.75], [30.0, -1.8]]))
YAW = math.radians(2.5)
PLACE = PlaceInVehicle(1.7, -0.2)
MOUNT = np.array([PLACE.x_m, PLACE.y_m, 0.0])


def camera(std_deg=0.05, axes=CameraAxes.BODY):
    travel = Travel(YAW, 0.05, np.eye(2) * math.radians(std_deg) ** 2, 50, 1.3, 30.0)
    return camera_in_vehicle(POSE, np.eye(3) * 1e-6, travel, RIG, axes, PLACE)


def markers_of(camera, lanes=LANES, frame="base_footprint"):
    return {(m.ns, m.id): m for m in markers_message(POSE, lanes, frame, 0, camera).markers}


def rotated(q, vector):
    """Rotate by a quaternion with the sandwich product."""
    w, u = q.w, np.array([q.x, q.y, q.z])
    return vector + 2 * np.cross(u, np.cross(u, vector) + w * vector)


def xyz(point):
    return np.array([point.x, point.y, point.z])


@pytest.mark.parametrize("axes", list(CameraAxes))
def test_road_lanes_and_camera_are_carried_into_the_vehicle(axes):
    """The same for both frames of the camera: all of them are drawn by the middle of the baseline."""
    markers = markers_of(camera(axes=axes))
    assert {m.header.frame_id for m in markers.values()} == {"base_footprint"}
    assert all(m.action == Marker.ADD for m in markers.values())
    for number, lane in enumerate(LANES):
        points = np.array([xyz(p) for p in markers[("lane_lines", number)].points])
        expected = [turn("z", YAW) @ [x, y, 0.0] + MOUNT for x, y in lane]
        np.testing.assert_allclose(points[:, :2], np.array(expected)[:, :2], atol=1e-12)
        assert (points[:, 2] > 0.0).all()  # on the road, not in it
    arrow = markers[("camera", 0)]
    np.testing.assert_allclose(xyz(arrow.pose.position), MOUNT + 1.4 * np.eye(3)[2], atol=1e-12)
    expected = turn("z", YAW) @ turn("y", POSE.pitch_rad) @ turn("x", POSE.roll_rad)
    for axis in np.eye(3):
        np.testing.assert_allclose(rotated(arrow.pose.orientation, axis), expected @ axis, atol=1e-12)
    road = markers[("road", 0)]
    near_left = np.array([-road.scale.x / 2, road.scale.y / 2, road.scale.z / 2])
    corner = rotated(road.pose.orientation, near_left) + xyz(road.pose.position)
    np.testing.assert_allclose(corner, turn("z", YAW) @ [0.0, 4.0, 0.0] + MOUNT, atol=1e-12)
    text = markers[("camera", 1)]
    assert text.text.endswith(", yaw +2.50 deg")
    np.testing.assert_allclose(xyz(text.pose.position)[:2], MOUNT[:2])


def test_axes_of_the_vehicle_lie_at_its_origin_and_the_car_drives_along_x():
    markers = markers_of(camera())
    for number, (axis, colour) in enumerate(zip(np.eye(3), ("r", "g", "b"), strict=True)):
        marker = markers[("vehicle", number)]
        start, end = map(xyz, marker.points)
        np.testing.assert_allclose(start, 0.0)
        np.testing.assert_allclose(end, axis)
        assert {name: getattr(marker.color, name) for name in "rgb"} == {
            name: float(name == colour) for name in "rgb"
        }
    start, end = map(xyz, markers[("travel", 0)].points)
    direction = (end - start) / np.linalg.norm(end - start)
    np.testing.assert_allclose(direction, [1.0, 0.0, 0.0], atol=1e-12)
    assert start[1] == PLACE.y_m and 0.0 < start[2] < 0.1 and start[0] > PLACE.x_m
    # Seen from the camera, whose heading is turned to the left of it, it leads to the right.
    in_road = turn("z", YAW).T @ direction
    assert in_road[1] == pytest.approx(-math.sin(YAW))


@pytest.mark.parametrize("unknown", [None, camera(std_deg=1.1)])
def test_while_the_yaw_is_unknown_markers_are_those_of_the_road(unknown):
    """Axes and direction of an earlier result, in another frame maybe, are deleted."""
    markers = markers_of(unknown, frame="road")
    gone = {("vehicle", 0), ("vehicle", 1), ("vehicle", 2), ("travel", 0)}
    assert {key for key, marker in markers.items() if marker.action == Marker.DELETE} == gone
    assert "yaw" not in markers[("camera", 1)].text
    arrow, road = markers[("camera", 0)], markers[("road", 0)]
    np.testing.assert_allclose(xyz(arrow.pose.position), [0.0, 0.0, 1.4])
    assert rotated(arrow.pose.orientation, np.array([1.0, 0.0, 0.0]))[1] == pytest.approx(0.0, abs=1e-12)
    assert (road.pose.position.x, road.pose.position.y) == (15.0, 0.0)
    points = np.array([xyz(p) for p in markers[("lane_lines", 0)].points])
    np.testing.assert_allclose(points[:, :2], LANES[0])


def test_lanes_that_are_not_known_are_deleted_in_the_vehicle_too():
    markers = markers_of(camera(), lanes=())
    assert [markers[("lane_lines", number)].action for number in (0, 1)] == [Marker.DELETE] * 2
