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

"""Messages of results and pictures."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, Quaternion, TransformStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from sensor_msgs.msg import Image as ImageMessage

from ..core.camera.plain_camera_info import PlainCameraInfo
from ..core.geometry.vehicle import RigidTransform
from ..core.types import Image
from ..files.frames import PlacedCamera
from ..published.transforms import NamedTransform, camera_transforms

_NS_PER_S = 1_000_000_000
_LAST_NS = 2**31 * _NS_PER_S - 1  # the seconds of builtin_interfaces/Time have 32 bits


def time_message(stamp_ns: int) -> Time:
    """Return a stamp [ns] as a message; one that it cannot hold as the nearest that it can.

    That of an image may have 4 294 967 295 ns, and so lie beyond the last second.
    """
    sec, nanosec = divmod(min(stamp_ns, _LAST_NS), _NS_PER_S)
    return Time(sec=sec, nanosec=nanosec)


def extrinsics_message(
    node: str, stamp_ns: int, parameters: Mapping[str, Any], gone: Iterable[str] = ()
) -> ParameterEvent:
    """Return the result as a parameter event.

    Args:
        node: Full name of the node that holds the parameters.
        stamp_ns: Stamp of the (last) frame [ns].
        parameters: Values by full name; they are in ``changed_parameters``, from the first result on.
        gone: Names of those that the event before had, and that this result does not say.
    """
    event = deleted_message(node, stamp_ns, gone)
    event.changed_parameters = [
        Parameter(name, value=value).to_parameter_msg() for name, value in parameters.items()
    ]
    return event


def deleted_message(node: str, stamp_ns: int, names: Iterable[str]) -> ParameterEvent:
    """Return the parameter event that withdraws a result.

    Args:
        node: Full name of the node that held the parameters.
        stamp_ns: Time of the withdrawal [ns].
        names: Full names of the parameters; they are in ``deleted_parameters``.
    """
    deleted = [Parameter(name, Parameter.Type.NOT_SET).to_parameter_msg() for name in names]
    return ParameterEvent(stamp=time_message(stamp_ns), node=node, deleted_parameters=deleted)


def quaternion_message(transform: RigidTransform) -> Quaternion:
    """Return the rotation of a transform as a unit quaternion with w >= 0."""
    x, y, z, w = transform.quaternion()
    return Quaternion(x=x, y=y, z=z, w=w)


def rigid_pose_message(transform: RigidTransform) -> Pose:
    """Return a transform as a pose: of its source frame in its target frame."""
    x, y, z = map(float, transform.translation_m)
    return Pose(position=Point(x=x, y=y, z=z), orientation=quaternion_message(transform))


def pose_message(placed: PlacedCamera, stamp_ns: int) -> PoseWithCovarianceStamped:
    """Return the pose of the camera in the vehicle, or over the road while the yaw is not known.

    Args:
        placed: The camera.
        stamp_ns: Stamp of the (last) frame [ns].
    """
    message = PoseWithCovarianceStamped()
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = placed.parent
    message.pose.pose = rigid_pose_message(placed.camera.transform)
    message.pose.covariance = placed.camera.covariance.ravel()
    return message


def transform_messages(placed: PlacedCamera, stamp_ns: int) -> list[TransformStamped]:
    """Return the camera (child) in the vehicle (parent): it maps p_camera to p_vehicle.

    Where the yaw is known, the frame of the road follows: a child of the vehicle, and nobody's parent.

    Args:
        placed: The camera; it has a name.
        stamp_ns: Stamp of the (last) frame [ns].
    """
    return [_transform_message(each, stamp_ns) for each in camera_transforms(placed)]


def _transform_message(named: NamedTransform, stamp_ns: int) -> TransformStamped:
    message = TransformStamped(child_frame_id=named.child)
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = named.parent
    moved = message.transform.translation
    moved.x, moved.y, moved.z = map(float, named.transform.translation_m)
    message.transform.rotation = quaternion_message(named.transform)
    return message


def image_message(picture: Image, frame: str, stamp_ns: int) -> ImageMessage:
    """Return a picture (H, W, 3) uint8 BGR as a message.

    Args:
        picture: The picture.
        frame: Frame of the camera.
        stamp_ns: Stamp of the frame in it [ns].
    """
    height, width = picture.shape[:2]
    message = ImageMessage(height=height, width=width, encoding="bgr8", step=3 * width)
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = frame
    message.data = array("B", picture.tobytes())  # rclpy checks other types byte by byte
    return message


def camera_info_message(info: PlainCameraInfo, stamp_ns: int) -> CameraInfo:
    """Return a CameraInfo as a message.

    Args:
        info: The CameraInfo.
        stamp_ns: Stamp of the (last) frame [ns].
    """
    message = CameraInfo(
        width=info.width,
        height=info.height,
        distortion_model=info.distortion_model,
        d=info.d.tolist(),
        k=info.k,
        r=info.rotation.ravel(),
        p=info.p,
        binning_x=info.binning_x,
        binning_y=info.binning_y,
    )
    roi = info.roi
    message.roi = RegionOfInterest(
        x_offset=roi.x_offset, y_offset=roi.y_offset, height=roi.height, width=roi.width
    )
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = info.frame_id
    return message


def no_camera_info_message(stamp_ns: int) -> CameraInfo:
    """Return the CameraInfo of a camera that is not calibrated: all zero, as sensor_msgs/CameraInfo has it.

    Args:
        stamp_ns: Time from which it is not [ns].
    """
    message = CameraInfo()
    message.header.stamp = time_message(stamp_ns)
    return message
