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

"""Transforms between frames, by their names: where the camera is in the vehicle, and its optical frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import BODY_FROM_OPTICAL
from ..core.geometry.vehicle import CameraAxes, RigidTransform, body_from_camera
from ..files.frames import PlacedCamera


@dataclass(frozen=True, slots=True, eq=False)
class NamedTransform:
    """One geometry_msgs/TransformStamped: it maps points of the child frame to the parent frame.

    Attributes:
        parent: Name of the parent frame.
        child: Name of the child frame.
        transform: parent_from_child.
    """

    parent: str
    child: str
    transform: RigidTransform


def camera_transforms(placed: PlacedCamera) -> list[NamedTransform]:
    """Return the camera in the vehicle: it maps p_camera to p_vehicle.

    Where the yaw is known, the frame of the road follows: a child of the vehicle, and nobody's parent.

    Args:
        placed: The camera; it has a name.
    """
    transforms = [NamedTransform(placed.parent, placed.child, placed.camera.transform)]
    if placed.camera.yaw_known:
        transforms.append(NamedTransform(placed.parent, placed.road, placed.camera.parent_from_road))
    return transforms


def optical_transforms(placed: PlacedCamera, rig: StereoRig, names: tuple[str, str]) -> list[NamedTransform]:
    """Return the optical frames of both cameras in the camera's frame; the left one may be that frame.

    Args:
        placed: The camera; it has a name.
        rig: The rig.
        names: Names of the optical frames, left and right.
    """
    camera_from_body = body_from_camera(placed.camera.axes, rig).inverse()
    of_left = body_from_camera(CameraAxes.OPTICAL, rig)
    of_right = RigidTransform(BODY_FROM_OPTICAL, of_left.translation_m * np.array([1.0, -1.0, 1.0]))
    return [
        NamedTransform(placed.child, name, camera_from_body.after(transform))
        for name, transform in zip(names, (of_left, of_right), strict=True)
        if name != placed.child
    ]
