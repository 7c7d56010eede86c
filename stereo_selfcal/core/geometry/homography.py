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

"""Road <-> image geometry of the rig: homographies of each camera, and the paper's matrix T.

Frames and signs are those of :mod:`stereo_selfcal.core.geometry.pose`; the road is the plane z = 0.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..numerics.linear import invert
from ..rejection import NotFitted
from ..types import Array
from .pose import BODY_FROM_OPTICAL, Extrinsics, road_from_camera_rotation

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

# y coordinate of a camera centre in the body frame, as a fraction of the baseline (y points left).
_OFFSET_ALONG_BASELINE: dict[Side, float] = {"left": 0.5, "right": -0.5}


def camera_matrix(rig: StereoRig) -> Array:
    """Return the intrinsic matrix K of either rectified camera, shape (3, 3)."""
    return np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])


def camera_centre_m(rig: StereoRig, side: Side) -> Array:
    """Return the centre of a camera in the body frame [m], shape (3,)."""
    return np.array([0.0, _OFFSET_ALONG_BASELINE[side] * rig.baseline_m, 0.0])


def image_from_road(rig: StereoRig, extrinsics: Extrinsics, side: Side) -> Array:
    """Return the homography from road (x [m], y [m], 1) to image (u [px], v [px], 1).

    The third homogeneous coordinate is the depth along the optical axis [m]: positive in front
    of the camera (Hartley & Zisserman, Multiple View Geometry, section 8.1.1: K [r1 r2 t]).

    Returns:
        (3, 3) matrix.
    """
    camera_from_road = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad).T
    translation = -extrinsics.height_m * camera_from_road[:, 2] - camera_centre_m(rig, side)
    body_from_plane = np.column_stack([camera_from_road[:, 0], camera_from_road[:, 1], translation])
    matrix: Array = camera_matrix(rig) @ BODY_FROM_OPTICAL.T @ body_from_plane
    return matrix


def road_from_image(rig: StereoRig, extrinsics: Extrinsics, side: Side) -> Array:
    """Return the inverse perspective: the homography from image pixels to the road, shape (3, 3).

    A camera within the plane of the road sees it as a line: then all numbers are NaN.
    """
    inverse = invert(image_from_road(rig, extrinsics, side), "numbers of the homography to the road")
    return np.full((3, 3), np.nan) if isinstance(inverse, NotFitted) else inverse


def apply_homography(matrix: Array, points: npt.ArrayLike) -> Array:
    """Map points of shape (..., 2) through a (3, 3) homography."""
    xy = np.asarray(points, dtype=np.float64)
    homogeneous = xy @ matrix[:, :2].T + matrix[:, 2]
    mapped: Array = homogeneous[..., :2] / homogeneous[..., 2:]
    return mapped


def horizon_row(rig: StereoRig, extrinsics: Extrinsics, u: npt.ArrayLike) -> Array:
    """Return the row [px] of the road's horizon at columns ``u`` [px], the same in both cameras."""
    up_in_body = road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad)[2]
    y_body = -(np.asarray(u, dtype=np.float64) - rig.cx) / rig.fx
    z_body = -(up_in_body[0] + up_in_body[1] * y_body) / up_in_body[2]
    row: Array = rig.cy - rig.fy * z_body
    return row


def paper_projection(rig: StereoRig, height_m: float, alpha_rad: float, beta_rad: float, side: Side) -> Array:
    """Return the paper's matrix T (section 2.1, equation 1), shape (4, 4).

    Paper axes: X right, Y forward, Z up. T maps (X, Y, Z, 1) of the road frame to
    (s u, depth, s v, s): the second row is the depth, irrelevant in the image.

    Args:
        rig: Intrinsics and baseline (K_u f is ``fx``, C_u is ``cx``, ...).
        height_m: The paper's H [m].
        alpha_rad: The paper's pitch, > 0: nose up [rad].
        beta_rad: The paper's roll, > 0: right side down [rad].
        side: Which camera; it is displaced by b / 2 along X.
    """
    ca, sa = np.cos(alpha_rad), np.sin(alpha_rad)
    cb, sb = np.cos(beta_rad), np.sin(beta_rad)
    # X points to the right, so the left camera is at -b/2. It sees every point b/2 farther to the right.
    shift_m = _OFFSET_ALONG_BASELINE[side] * rig.baseline_m
    camera_from_road = np.array(
        [
            [cb, sb * sa, -sb * ca, sb * ca * height_m],
            [0.0, ca, sa, -sa * height_m],
            [sb, -cb * sa, cb * ca, -cb * ca * height_m],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    pixels_from_camera = np.array(
        [
            [rig.fx, rig.cx, 0.0, rig.fx * shift_m],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, rig.cy, -rig.fy, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ]
    )
    projection: Array = pixels_from_camera @ camera_from_road
    return projection


def reduce_to_plane(projection: Array) -> Array:
    """Reduce the paper's T (4, 4) to M_persp (3, 3) by removing the depth row and the height column."""
    return projection[np.ix_([0, 2, 3], [0, 1, 3])]
