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

"""The road as a plane of disparities, and the pose over it.

The disparity of a plane is linear in the image: ``d = p @ (1, y, z)`` with the ray (1, y, z) through a pixel.
The cameras see a point at different pixels, so the three numbers p depend on the camera whose pixels are
used.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..camera.rig import StereoRig
from ..numerics.derivatives import central_difference
from ..types import Array
from .pose import Extrinsics, road_from_camera_rotation

_STEP = 1e-6  # step of the numerical derivative, relative to the length of p


class PlaneCamera(Enum):
    """The camera whose rays a plane of disparities takes."""

    LEFT = "left camera"
    MIDDLE = "camera in the middle of the baseline"


@dataclass(frozen=True, slots=True, eq=False)
class DisparityPlane:
    """A road plane, described by its disparities.

    Attributes:
        coefficients: (3,) p; the product of p and the ray (1, y, z) is the disparity [px].
        camera: The camera whose rays are used.
    """

    coefficients: Array
    camera: PlaneCamera

    def disparities(self, rays: Array) -> Array:
        """Return the disparities (...) [px] at the rays (..., 3) of the plane's camera."""
        disparities: Array = rays @ self.coefficients
        return disparities

    def height_m(self, rig: StereoRig) -> float:
        """Return the height of the plane's camera over the road [m]."""
        return float(rig.fx * rig.baseline_m / np.linalg.norm(self.coefficients))

    def moved(self, change: Array) -> DisparityPlane:
        """Return the plane of the same camera whose coefficients differ by ``change`` (3,)."""
        return DisparityPlane(self.coefficients + change, self.camera)

    def of_camera(self, camera: PlaneCamera, rig: StereoRig) -> DisparityPlane:
        """Return the same road plane for the rays of another camera."""
        if camera is self.camera:
            return self
        # The middle camera sees a point half its disparity farther left than the left camera. With the ray of
        # the left camera, p_left @ ray = p_middle @ ray + p_middle[1] / fx * disparity / 2.
        half = self.coefficients[1] / rig.fx / 2.0
        return DisparityPlane(
            self.coefficients / (1.0 - half if camera is PlaneCamera.LEFT else 1.0 + half), camera
        )


def plane_from_pose(
    extrinsics: Extrinsics, rig: StereoRig, camera: PlaneCamera = PlaneCamera.MIDDLE
) -> DisparityPlane:
    """Return the disparity plane of a road from the pose of the rig over it."""
    up = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)[2]
    middle = DisparityPlane(-rig.fx * rig.baseline_m / extrinsics.height_m * up, PlaneCamera.MIDDLE)
    return middle.of_camera(camera, rig)


def pose_from_plane(plane: DisparityPlane, rig: StereoRig) -> Extrinsics:
    """Return the pose of the rig over a road plane: the inverse of :func:`plane_from_pose`."""
    return Extrinsics.from_array(_poses(plane.coefficients, plane.camera, rig))


def jacobian_pose_wrt_plane(plane: DisparityPlane, rig: StereoRig) -> Array:
    """Return the derivative (3, 3) of height [m], pitch and roll [rad] by the coefficients of a plane."""
    step = _STEP * float(np.linalg.norm(plane.coefficients))
    jac_transposed = central_difference(lambda p: _poses(p, plane.camera, rig), plane.coefficients, step)
    return np.transpose(jac_transposed)


def _poses(coefficients: Array, camera: PlaneCamera, rig: StereoRig) -> Array:
    """Return height [m] of the middle of the baseline, pitch, roll [rad] over planes, all (..., 3)."""
    ahead, aside, down = coefficients[..., 0], coefficients[..., 1], coefficients[..., 2]
    roll = np.arctan2(-aside, -down)
    pitch = np.arctan2(ahead, np.hypot(aside, down))
    height = rig.fx * rig.baseline_m / np.sqrt((coefficients * coefficients).sum(axis=-1))
    if camera is PlaneCamera.LEFT:
        # The left camera is half a baseline to the left of the middle, so a positive roll lifts it.
        height = height - np.cos(pitch) * np.sin(roll) * rig.baseline_m / 2.0
    return np.stack([height, pitch, roll], axis=-1)
