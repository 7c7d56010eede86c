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

"""Parameters of a road with L stripes, and the edges of these stripes in both images.

The parameters are height, pitch, roll, yaw and curvature of the lane, then the L middles of the stripes (at
x = 0, left positive), their L widths, and their L heights over the plane [m, rad, 1/m]. Bent stripes are arcs
about one common centre, which lies at x = 0 in the direction of the lane.
"""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import SIDES, camera_centre_m
from ..geometry.pose import road_from_camera_rotation
from ..geometry.rays import pixel_rays
from ..types import Array

# Distances at which a road line is projected into the image [m]; two points determine the image line.
_NEAR_M, _FAR_M = 5.0, 50.0
_LEAST_FALL = 1e-3  # least downward slope of a ray that meets the road: 1000 camera heights away
# Iterations of the search for the column of a bent line in a row. Each reduces the error to an eighth where
# the lane has turned by 30 deg, and to far less nearer to the camera.
_BEND_ITERATIONS = 4

N_POSE = 5  # parameters before those of the stripes


def predict_edges(parameters: Array, rig: StereoRig) -> Array:
    """Return the edges of straight stripes in both images, as lines u = a + m v.

    Bent stripes are replaced by their tangents at x = 0.

    Args:
        parameters: (B, 5 + 3 L) parameters of B roads.
        rig: Intrinsics and baseline.

    Returns:
        (B, 2 cameras, L stripes, 2 edges, 2): a [px] and m; the left edge first.
    """
    # Numbers of a road (B, 1, 1), of its stripes (B, L, 1), and of their edges (B, L, 2).
    height, pitch, roll, yaw = (parameters[:, index, None, None] for index in range(4))
    n_stripes = (parameters.shape[1] - N_POSE) // 3
    below = height - parameters[:, -n_stripes:, None]  # of the camera over each stripe
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    start, tangent = _edge_positions(parameters), np.tan(yaw)
    offsets = np.array([camera_centre_m(rig, side)[1] for side in SIDES])[:, None, None]
    pixels = []
    for ahead in (_NEAR_M, _FAR_M):
        # Body axes from road axes are the transpose of R_y(pitch) R_x(roll).
        aside, turned = start - tangent * ahead, sp * ahead - cp * below
        depth = cp * ahead + sp * below
        leftwards = (sr * turned + cr * aside)[:, None] - offsets
        pixels.append(
            (
                rig.cx - rig.fx * leftwards / depth[:, None],
                rig.cy - rig.fy * (cr * turned - sr * aside) / depth,
            )
        )
    (u0, v0), (u1, v1) = pixels
    lines = np.empty((*u0.shape, 2))
    slope = np.divide(u1 - u0, (v1 - v0)[:, None], out=lines[..., 1])
    np.subtract(u0, slope * v0[:, None], out=lines[..., 0])
    return lines


def bent_columns(parameters: Array, rows: Array, rig: StereoRig) -> Array:
    """Return the columns of the edges of bent stripes.

    Args:
        parameters: (5 + 3 L,) parameters of one road.
        rows: (...) rows [px], all below the horizon.
        rig: Intrinsics and baseline.

    Returns:
        (2 cameras, L stripes, 2 edges, ...) columns [px].
    """
    height, pitch, roll, yaw, curvature = parameters[:N_POSE]
    over = np.split(parameters[N_POSE:], 3)[2][:, None, None]
    line = predict_edges(parameters[None], rig)[0]
    flat = rows.ravel()
    columns = line[..., :1] + line[..., 1:] * flat
    start = _edge_positions(parameters[None])[0][..., None]
    rotation = road_from_camera_rotation(float(pitch), float(roll))
    for camera, side in enumerate(SIDES):
        centre = rotation @ camera_centre_m(rig, side) + np.array([0.0, 0.0, height])
        for _ in range(_BEND_ITERATIONS):
            ahead, aside, up = np.moveaxis(pixel_rays(rig, columns[camera], flat) @ rotation.T, -1, 0)
            depth = (over - centre[2]) / np.minimum(up, -_LEAST_FALL)
            x, y = centre[0] + depth * ahead, centre[1] + depth * aside
            error_m = _lateral_position(x, y, yaw, curvature) - start * np.cos(yaw)
            columns[camera] += error_m * rig.fx / depth
    bent: Array = columns.reshape(*columns.shape[:3], *rows.shape)
    return bent


def _lateral_position(x: Array, y: Array, yaw: float, curvature: float) -> Array:
    """Return the distance of road points from the lane's arc through the origin, > 0: left of it [m]."""
    along, aside = np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y
    # R - sqrt(along^2 + (R - aside)^2), rearranged so that it holds for a straight lane as well.
    root = np.sqrt((curvature * along) ** 2 + (1.0 - curvature * aside) ** 2)
    position: Array = (2.0 * aside - curvature * (along**2 + aside**2)) / (1.0 + root)
    return position


def _edge_positions(parameters: Array) -> Array:
    """Return the lateral positions of the left and right edges at x = 0 [m], (B, L, 2)."""
    n_stripes = (parameters.shape[1] - N_POSE) // 3
    middles = parameters[:, N_POSE : N_POSE + n_stripes, None]
    widths = parameters[:, N_POSE + n_stripes : N_POSE + 2 * n_stripes, None]
    positions: Array = middles + widths / 2.0 * np.array([1.0, -1.0])
    return positions
