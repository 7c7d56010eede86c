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

"""A pinhole camera in the world, and how its rays meet planes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereo_selfcal import StereoRig
from stereo_selfcal.core.geometry.pose import BODY_FROM_OPTICAL, road_from_camera_rotation

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Camera:
    """One camera. The world has x along the lane, y left, z up.

    Attributes:
        rig: Size and intrinsics of its image.
        world_from_body: Rotation, shape (3, 3); the body has x forward, y left, z up.
        centre_m: Place of the camera, shape (3,).
        row_shift_px: What is added to the row of each image row before its rays are cast, shape (height,).
        col_shift_px: The same for the columns. A rolling shutter moves the rays of each row.
    """

    rig: StereoRig
    world_from_body: Array
    centre_m: Array
    row_shift_px: Array
    col_shift_px: Array

    @property
    def optical_from_world(self) -> Array:
        """Rotation to the optical axes: x right, y down, z forward."""
        rotation: Array = (self.world_from_body @ BODY_FROM_OPTICAL).T
        return rotation

    def directions(self, col: Array32, row: Array32) -> tuple[Array32, Array32, Array32]:
        """Return the rays of pixels in the world, scaled to a depth of one metre.

        Args:
            col: Columns after the shift [px].
            row: Rows after the shift [px].
        """
        rig, axes = self.rig, self.optical_from_world
        x = (col - np.float32(rig.cx)) * np.float32(1 / rig.fx)
        y = (row - np.float32(rig.cy)) * np.float32(1 / rig.fy)
        a = axes.astype(np.float32)
        return (
            a[0, 0] * x + a[1, 0] * y + a[2, 0],
            a[0, 1] * x + a[1, 1] * y + a[2, 1],
            a[0, 2] * x + a[1, 2] * y + a[2, 2],
        )

    def project(self, points_m: Array) -> Array:
        """Return column, row and depth of points of the world, shape (..., 3); shifts are not applied."""
        optical = (points_m - self.centre_m) @ self.optical_from_world.T
        depth = optical[..., 2]
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        col = self.rig.fx * optical[..., 0] / safe + self.rig.cx
        row = self.rig.fy * optical[..., 1] / safe + self.rig.cy
        return np.stack([col, row, depth], axis=-1)


@dataclass(frozen=True)
class Mount:
    """Where the middle of the baseline is in the world.

    Attributes:
        height_m: Height over the world's z = 0.
        pitch_rad: Rotation about y, > 0: nose down.
        roll_rad: Rotation about x, > 0: right side down.
        yaw_rad: Rotation about z, > 0: looks left of the lane.
        lateral_m: Place across the lane, > 0: left of its middle.
    """

    height_m: float
    pitch_rad: float
    roll_rad: float
    yaw_rad: float
    lateral_m: float

    @property
    def world_from_body(self) -> Array:
        """Rotation of the rig, shape (3, 3)."""
        return road_from_camera_rotation(self.pitch_rad, self.roll_rad, self.yaw_rad)

    @property
    def centre_m(self) -> Array:
        """Middle of the baseline, shape (3,)."""
        return np.array([0.0, self.lateral_m, self.height_m])


@dataclass(frozen=True)
class Turn:
    """How the right camera differs from what the rig says of it (right body in the left one's axes).

    Attributes:
        yaw_rad: > 0: it looks further left.
        pitch_rad: > 0: its nose is down.
        roll_rad: > 0: its right side is down.
        row_px: Its content lies so many rows further down.
    """

    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    row_px: float = 0.0


def camera_pair(
    rig: StereoRig, mount: Mount, turn: Turn, row_shift_px: Array, col_shift_px: Array
) -> tuple[Camera, Camera]:
    """Return the left and the right camera of a rig."""
    rotation = mount.world_from_body
    half = rotation @ np.array([0.0, rig.baseline_m / 2, 0.0])
    turned = rotation @ road_from_camera_rotation(turn.pitch_rad, turn.roll_rad, turn.yaw_rad)
    left = Camera(rig, rotation, mount.centre_m + half, row_shift_px, col_shift_px)
    right = Camera(rig, turned, mount.centre_m - half, row_shift_px - turn.row_px, col_shift_px)
    return left, right


def pose_over_plane(mount: Mount, plane: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return height [m], pitch and roll [rad] of a mount over the plane z = a + b x + c y.

    The road's axes are the plane's: z is its normal, and x lies under the camera's heading.
    """
    a, b, c = plane
    length = math.sqrt(1 + b * b + c * c)
    up = mount.world_from_body.T @ (np.array([-b, -c, 1.0]) / length)
    x, y, z = mount.centre_m
    height = (z - a - b * x - c * y) / length
    return height, -math.asin(up[0]), math.atan2(up[1], up[2])
