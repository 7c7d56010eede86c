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

"""Messages of plain values without ROS, with the classes of rosbags: the counterpart of `ros/messages.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from ..core.camera.plain_camera_info import PlainCameraInfo
from ..core.geometry.vehicle import RigidTransform
from ..core.types import Array, Image
from ..published.markers import MarkerShape
from ..published.status import StatusReport
from ..published.transforms import NamedTransform

_NS_PER_S = 1_000_000_000
_LAST_NS = 2**31 * _NS_PER_S - 1  # the seconds of builtin_interfaces/Time have 32 bits
_MARKER_ADD, _MARKER_DELETE = 0, 2  # of visualization_msgs/Marker
# Fields of rcl_interfaces/ParameterValue with their number in ParameterType, by the type of the value.
_PARAMETER_FIELDS: dict[type, tuple[int, str]] = {
    bool: (1, "bool_value"),
    int: (2, "integer_value"),
    float: (3, "double_value"),
    str: (4, "string_value"),
}
_PARAMETER_LISTS: dict[type, tuple[int, str]] = {
    bool: (6, "bool_array_value"),
    int: (7, "integer_array_value"),
    float: (8, "double_array_value"),
    str: (9, "string_array_value"),
}
_NUMPY_NAMES = {"byte": "uint8", "octet": "uint8", "char": "uint8"}

STORE = get_typestore(Stores.ROS2_JAZZY)


def serialize(message: Any, kind: str) -> bytes | memoryview:
    """Return the bytes of a message of a type."""
    return STORE.serialize_cdr(message, kind)


def make(kind: str, **fields: Any) -> Any:
    """Return a message; the fields that are not given are zero or empty, as in ROS.

    Args:
        kind: Its type, as ``geometry_msgs/msg/Point``.
        fields: Its fields.
    """
    message = STORE.types[kind]
    given = {"w": 1.0} | fields if kind == "geometry_msgs/msg/Quaternion" else fields
    names = {name for name, _ in STORE.fielddefs[kind][1]}
    assert set(given) <= names, f"{kind} has no {set(given) - names}"
    values = (given[name] if name in given else _empty(node) for name, node in STORE.fielddefs[kind][1])
    return message(*values)


def _empty(node: Any) -> Any:
    """Return the value of a field that is not given."""
    node_type, description = node
    if node_type == Nodetype.NAME:
        return make(description)
    if node_type == Nodetype.BASE:
        return _zero(description[0])
    (inner_type, inner), length = description
    if inner_type == Nodetype.BASE and inner[0] not in ("string", "wstring"):
        return np.zeros(length, dtype=_NUMPY_NAMES.get(inner[0], inner[0]))
    return [_empty((inner_type, inner)) for _ in range(length if node_type == Nodetype.ARRAY else 0)]


@lru_cache(maxsize=32)
def _zero(name: str) -> Any:
    if name in ("string", "wstring"):
        return ""
    return False if name == "bool" else 0.0 if name.startswith("float") else 0


def time_message(stamp_ns: int) -> Any:
    """Return a stamp [ns]; one that a message cannot hold as the nearest that it can."""
    sec, nanosec = divmod(min(max(stamp_ns, 0), _LAST_NS), _NS_PER_S)
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def header(stamp_ns: int, frame: str = "") -> Any:
    """Return the header of a message."""
    return make("std_msgs/msg/Header", stamp=time_message(stamp_ns), frame_id=frame)


def jpeg_message(image: Image, quality: int, frame: str, stamp_ns: int) -> Any:
    """Return an image as a JPEG.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        quality: Quality of the JPEG, up to 100.
        frame: Frame of the camera.
        stamp_ns: Stamp of the image [ns].
    """
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    # As compressed_image_transport writes it: the encoding of the image, then that of the JPEG if it has one.
    encoding = "mono8; jpeg compressed " if image.ndim == 2 else "bgr8; jpeg compressed bgr8"
    return make(
        "sensor_msgs/msg/CompressedImage",
        header=header(stamp_ns, frame),
        format=encoding,
        data=content.reshape(-1),
    )


def camera_info_message(info: PlainCameraInfo, frame: str, stamp_ns: int) -> Any:
    """Return a CameraInfo of whole images."""
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header(stamp_ns, frame),
        width=info.width,
        height=info.height,
        distortion_model=info.distortion_model,
        d=info.d,
        k=info.k,
        r=info.rotation.ravel(),
        p=info.p,
    )


def pose_message(transform: RigidTransform, covariance: Array, parent: str, stamp_ns: int) -> Any:
    """Return a transform as the pose of its source frame, with its covariance (6, 6)."""
    pose = make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(transform), covariance=covariance.ravel())
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    return make(kind, header=header(stamp_ns, parent), pose=pose)


def transforms_message(transforms: Sequence[NamedTransform], stamp_ns: int) -> Any:
    """Return transforms as tf2 takes them."""
    messages = [
        make(
            "geometry_msgs/msg/TransformStamped",
            header=header(stamp_ns, each.parent),
            child_frame_id=each.child,
            transform=make(
                "geometry_msgs/msg/Transform",
                translation=_xyz("Vector3", each.transform.translation_m),
                rotation=_quaternion(each.transform),
            ),
        )
        for each in transforms
    ]
    return make("tf2_msgs/msg/TFMessage", transforms=messages)


def markers_message(shapes: Sequence[MarkerShape], frame: str, stamp_ns: int) -> Any:
    """Return markers in a frame."""
    markers = [_marker(shape, header(stamp_ns, frame)) for shape in shapes]
    return make("visualization_msgs/msg/MarkerArray", markers=markers)


def parameters_message(node: str, parameters: Mapping[str, Any], stamp_ns: int) -> Any:
    """Return parameters as an event of a node, which has changed them."""
    changed = [
        make("rcl_interfaces/msg/Parameter", name=name, value=_parameter_value(value))
        for name, value in parameters.items()
    ]
    kind = "rcl_interfaces/msg/ParameterEvent"
    return make(kind, stamp=time_message(stamp_ns), node=node, changed_parameters=changed)


def diagnostics_message(reports: Sequence[StatusReport], hardware_id: str, stamp_ns: int) -> Any:
    """Return reports for ``/diagnostics``."""
    statuses = [
        make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=int(report.level),
            name=report.name,
            message=report.message,
            hardware_id=hardware_id,
            values=[
                make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in report.values.items()
            ],
        )
        for report in reports
    ]
    return make("diagnostic_msgs/msg/DiagnosticArray", header=header(stamp_ns), status=statuses)


def _marker(shape: MarkerShape, head: Any) -> Any:
    blue, green, red = (value / 255 for value in shape.colour)
    return make(
        "visualization_msgs/msg/Marker",
        header=head,
        ns=shape.namespace,
        id=shape.number,
        type=int(shape.kind),
        action=_MARKER_ADD if shape.shown else _MARKER_DELETE,
        pose=make("geometry_msgs/msg/Pose") if shape.pose is None else _pose(shape.pose),
        scale=_xyz("Vector3", shape.scale_m),
        color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=shape.opacity),
        points=[_xyz("Point", point_m) for point_m in shape.points_m],
        text=shape.text,
    )


def _parameter_value(value: Any) -> Any:
    if isinstance(value, list | tuple):
        number, field = _PARAMETER_LISTS[type(value[0]) if value else float]
        filled = list(value) if field == "string_array_value" else np.array(value)
        return make("rcl_interfaces/msg/ParameterValue", type=number, **{field: filled})
    number, field = _PARAMETER_FIELDS[type(value)]
    return make("rcl_interfaces/msg/ParameterValue", type=number, **{field: value})


def _pose(transform: RigidTransform) -> Any:
    position = _xyz("Point", transform.translation_m)
    return make("geometry_msgs/msg/Pose", position=position, orientation=_quaternion(transform))


def _quaternion(transform: RigidTransform) -> Any:
    x, y, z, w = transform.quaternion()
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _xyz(kind: str, values: Sequence[float] | Array) -> Any:
    x, y, z = map(float, values)
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)
