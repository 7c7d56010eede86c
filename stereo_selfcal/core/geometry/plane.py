"""The road as a plane of disparities, and the pose over it."""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..types import Array
from .pose import Extrinsics, road_from_camera_rotation


def plane_from_pose(extrinsics: Extrinsics, rig: StereoRig) -> Array:
    """Return the plane (3,) whose disparities [px] are plane @ (1, y, z)."""
    up = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)[2]
    plane: Array = -rig.fx * rig.baseline_m / extrinsics.height_m * up
    return plane


def pose_from_plane(plane: Array, rig: StereoRig) -> Extrinsics:
    """Return the pose of the rig over the plane: the inverse of :func:`plane_from_pose`."""
    roll = np.arctan2(-plane[1], -plane[2])
    pitch = np.arctan2(plane[0], np.hypot(plane[1], plane[2]))
    return Extrinsics(float(rig.fx * rig.baseline_m / np.linalg.norm(plane)), float(pitch), float(roll))


def jacobian_pose_wrt_plane(plane: Array, rig: StereoRig) -> Array:
    """Return the derivative (3, 3) of height [m], pitch and roll [rad] by the plane."""
    step = 1e-6 * float(np.linalg.norm(plane))
    return np.column_stack(
        [
            (pose_from_plane(plane + s, rig).as_array() - pose_from_plane(plane - s, rig).as_array())
            / (2.0 * step)
            for s in np.eye(3) * step
        ]
    )
