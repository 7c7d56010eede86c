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

"""The camera in the vehicle's frame: one transform of what the road, the travel and a tape measure tell.

The vehicle's frame lies on the road: x along the direction of travel, y to the left, z up (REP-103; REP-120
calls such a frame ``base_footprint``). The road tells height, pitch and roll, the direction of travel tells
the yaw; where the frame's origin is, no road shows. While the yaw is not known, the parent is the frame of
the road: its origin lies under the middle of the baseline, and its x axis points along the camera's heading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..types import Array
from .pose import BODY_FROM_OPTICAL, POSE_NAMES, Extrinsics, road_from_camera_rotation
from .travel import Travel

_FORWARD, _LEFT, _UP = np.eye(3)
# Beyond, yaw and roll turn about the same axis.
_LOCKED = 1.0 - 1e-12


class CameraAxes(Enum):
    """Which frame of the camera a transform carries to the vehicle."""

    BODY = "body"  # origin in the middle of the baseline; x forward, y left, z up
    OPTICAL = "optical"  # origin in the left camera; x right, y down, z forward


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """``p_target = rotation p_source + translation_m``.

    Attributes:
        rotation: (3, 3) target_from_source.
        translation_m: (3,) origin of the source frame in the target frame [m].
    """

    rotation: Array
    translation_m: Array

    def apply(self, points_m: npt.ArrayLike) -> Array:
        """Return points (..., 3) of the source frame in the target frame [m]."""
        moved: Array = np.asarray(points_m, np.float64) @ self.rotation.T + self.translation_m
        return moved

    def after(self, first: RigidTransform) -> RigidTransform:
        """Return the transform that applies another one first."""
        return RigidTransform(self.rotation @ first.rotation, self.apply(first.translation_m))

    def inverse(self) -> RigidTransform:
        """Return source_from_target."""
        back = self.rotation.T
        return RigidTransform(back, -back @ self.translation_m)

    def roll_pitch_yaw(self) -> tuple[float, float, float]:
        """Return the angles about the fixed axes x, y, z [rad], as URDF and tf2 have them."""
        sin_pitch = -float(self.rotation[2, 0])
        if abs(sin_pitch) > _LOCKED:  # only the sum or the difference of roll and yaw is told: all is yaw
            yaw = math.atan2(-float(self.rotation[0, 1]), float(self.rotation[1, 1]))
            return 0.0, math.copysign(math.pi / 2.0, sin_pitch), yaw
        roll = math.atan2(float(self.rotation[2, 1]), float(self.rotation[2, 2]))
        yaw = math.atan2(float(self.rotation[1, 0]), float(self.rotation[0, 0]))
        return roll, math.asin(sin_pitch), yaw

    def quaternion(self) -> tuple[float, float, float, float]:
        """Return the rotation as a unit quaternion (x, y, z, w) with w >= 0."""
        # The greatest of four squares is at least 1, so no division is by a small number (Shepperd, 1978).
        r = self.rotation
        trace = float(np.trace(r))
        squares = np.array([*(1.0 - trace + 2.0 * np.diag(r)), 1.0 + trace])
        products = np.array(
            [
                [squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
                [r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
                [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], r[1, 0] - r[0, 1]],
                [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]],
            ]
        )
        row = products[int(squares.argmax())]
        unit = row / np.linalg.norm(row)
        x, y, z, w = map(float, unit if unit[3] >= 0.0 else -unit)
        return x, y, z, w

    def as_dict(self) -> dict[str, float]:
        """Return x, y, z [m], then roll, pitch, yaw [rad] about fixed axes, by these names."""
        translation = dict(zip(("x", "y", "z"), map(float, self.translation_m), strict=True))
        return translation | dict(zip(("roll", "pitch", "yaw"), self.roll_pitch_yaw(), strict=True))


def body_from_camera(axes: CameraAxes, rig: StereoRig) -> RigidTransform:
    """Return the transform from a frame of the camera to its body, in the middle of the baseline."""
    if axes is CameraAxes.BODY:
        return RigidTransform(np.eye(3), np.zeros(3))
    return RigidTransform(BODY_FROM_OPTICAL, rig.baseline_m / 2.0 * _LEFT)


@dataclass(frozen=True, slots=True)
class PlaceInVehicle:
    """Where the middle of the baseline is in the vehicle's frame, as somebody has measured it.

    Attributes:
        x_m: How far ahead of the frame's origin [m].
        y_m: How far to the left of it [m].
    """

    x_m: float = 0.0
    y_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraInVehicle:
    """The camera in the frame of the vehicle; of the road while its yaw is not known.

    Attributes:
        transform: parent_from_camera.
        covariance: (6, 6) of x, y, z [m] and the rotations about the parent's fixed axes x, y, z [rad], the
            order of geometry_msgs/PoseWithCovariance. What somebody has measured has no variance here.
        axes: Which frame of the camera it is.
        yaw_known: Whether the parent is the vehicle's frame.
        parent_from_road: The road's frame in the parent frame; the same frame while the yaw is not known.
    """

    transform: RigidTransform
    covariance: Array
    axes: CameraAxes
    yaw_known: bool
    parent_from_road: RigidTransform


def camera_in_vehicle(
    pose: Extrinsics,
    covariance: Array,
    travel: Travel | None,
    rig: StereoRig,
    axes: CameraAxes = CameraAxes.BODY,
    place: PlaceInVehicle | None = None,
) -> CameraInVehicle:
    """Return the camera in the vehicle's frame.

    Args:
        pose: Pose over the road: of the mount, or of a moment.
        covariance: (3, 3) of it.
        travel: The camera against the direction of travel; None where it is not known.
        rig: The rig, for its baseline.
        axes: Which frame of the camera is wanted.
        place: Where the middle of the baseline is in the vehicle's frame; it is used where the yaw is known.
    """
    known = travel if travel is not None and travel.tells_yaw else None
    yaw_rad = 0.0 if known is None else known.yaw_rad
    here = PlaceInVehicle() if place is None or known is None else place
    of_body = RigidTransform(
        road_from_camera_rotation(pose.pitch_rad, pose.roll_rad, yaw_rad),
        np.array([here.x_m, here.y_m, pose.height_m]),
    )
    from_camera = body_from_camera(axes, rig)
    turns = _turns(pose, yaw_rad)
    moves = np.cross(turns.T, of_body.rotation @ from_camera.translation_m).T
    moves[:, POSE_NAMES.index("height_m")] += _UP
    if known is None:
        # The road's frame turns with the camera: its yaw is zero by definition.
        turns[2] = 0.0
    jacobian = np.vstack([moves, turns])
    whole = np.zeros((4, 4))
    whole[:3, :3] = covariance
    if known is not None:
        whole[3, 3] = float(known.covariance[0, 0])
    parent_from_road = RigidTransform(
        road_from_camera_rotation(0.0, 0.0, yaw_rad), np.array([here.x_m, here.y_m, 0.0])
    )
    return CameraInVehicle(
        of_body.after(from_camera),
        jacobian @ whole @ jacobian.T,
        axes,
        known is not None,
        parent_from_road,
    )


def _turns(pose: Extrinsics, yaw_rad: float) -> Array:
    """Return the rotations (3, 4) about the parent's axes by height, pitch, roll and yaw [rad/unit].

    The roll turns about the x axis that pitch and yaw have turned, the pitch about the y axis that the yaw
    has turned.
    """
    turns = np.zeros((3, 4))
    turns[:, POSE_NAMES.index("pitch_rad")] = road_from_camera_rotation(0.0, 0.0, yaw_rad) @ _LEFT
    tilted = road_from_camera_rotation(pose.pitch_rad, 0.0, yaw_rad)
    turns[:, POSE_NAMES.index("roll_rad")] = tilted @ _FORWARD
    turns[:, 3] = _UP
    return turns
