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

"""The messages of ``~/markers``."""

from __future__ import annotations

from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ..core.geometry.pose import Extrinsics
from ..core.geometry.vehicle import CameraInVehicle
from ..core.types import Array
from ..published.markers import MarkerShape, result_markers
from .messages import rigid_pose_message, time_message


def markers_message(
    extrinsics: Extrinsics,
    lanes: tuple[Array, ...],
    parent_frame: str,
    stamp_ns: int,
    camera: CameraInVehicle | None = None,
) -> MarkerArray:
    """Return the markers of a result; those of the next result replace them, or are deleted by it.

    Args:
        extrinsics: The calibration.
        lanes: Lane lines on the road, each (N, 2) [m]; those of an earlier result are deleted.
        parent_frame: Name of the parent frame of ``camera``.
        stamp_ns: Stamp of the (last) frame [ns].
        camera: The camera in the vehicle; None: the parent frame is that of the road.
    """
    markers = [_marker(shape) for shape in result_markers(extrinsics, lanes, camera)]
    for marker in markers:
        marker.header.stamp = time_message(stamp_ns)
        marker.header.frame_id = parent_frame
    return MarkerArray(markers=markers)


def no_markers_message() -> MarkerArray:
    """Return the message that deletes all markers."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def _marker(shape: MarkerShape) -> Marker:
    blue, green, red = (value / 255 for value in shape.colour)
    x, y, z = shape.scale_m
    return Marker(
        ns=shape.namespace,
        id=shape.number,
        type=int(shape.kind),
        action=Marker.ADD if shape.shown else Marker.DELETE,
        pose=Pose() if shape.pose is None else rigid_pose_message(shape.pose),
        scale=Vector3(x=x, y=y, z=z),
        color=ColorRGBA(r=red, g=green, b=blue, a=shape.opacity),
        points=[Point(x=px, y=py, z=pz) for px, py, pz in shape.points_m],
        text=shape.text,
    )
