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

"""Where edges are in rendered pictures, read by area, and where OpenCV projects them."""

from typing import NamedTuple

import numpy as np
from independent_camera import CAMERAS, OPTICAL_FROM_BODY, project, turn

REACH_PX = 3


class EdgePoint(NamedTuple):
    """A point of an edge along the road, on a whole row of both images.

    Attributes:
        row: The row [px].
        columns: Its columns in the left and in the right image [px].
        depth_m: Its depth before the cameras [m].
    """

    row: int
    columns: tuple[float, float]
    depth_m: float


def edge_point(scene, d_m, z_m, near_s_m):
    """Return the point of the edge (d, z) of a straight world near ``s`` that lies on a whole row."""

    def pixel(s, camera):
        point = [(s, d_m, z_m)]
        return project(scene.rig, scene.pose, camera, point, scene.lane_yaw_rad, scene.lateral_offset_m)[0]

    s, row = near_s_m, round(pixel(near_s_m, "left")[1])
    for _ in range(30):
        off, step = pixel(s, "left")[1] - row, 1e-3
        s -= off * step / (pixel(s + step, "left")[1] - row - off)
    columns = [pixel(s, camera)[0] for camera in CAMERAS]
    pose = scene.pose
    lane_from_body = turn("z", scene.lane_yaw_rad) @ turn("y", pose.pitch_rad) @ turn("x", pose.roll_rad)
    from_rig = np.array([s, d_m - scene.lateral_offset_m, z_m - pose.height_m])
    depth_m = (OPTICAL_FROM_BODY @ lane_from_body.T @ from_rig)[2]
    return EdgePoint(row, tuple(columns), float(depth_m))


def edge_column(picture, row, column, left_grey, right_grey, reach=REACH_PX):
    """Return where in a row the grey level changes from one value to another, by area [px]."""
    first = round(column) - reach
    values = picture[row, first : first + 2 * reach + 1].astype(np.float64)
    share = (values - left_grey) / (right_grey - left_grey)
    return first + 2 * reach + 0.5 - share.sum()


def edge_row(picture, column, row, upper_grey, lower_grey, reach=REACH_PX):
    """Return where in a column the grey level changes from one value to another, by area [px]."""
    return edge_column(picture.T, column, row, upper_grey, lower_grey, reach)


def stripe_column(picture, row, column, around_grey, reach=REACH_PX):
    """Return the middle of a thin stripe in a row, and how much grey it adds [px], [px x grey]."""
    first = round(column) - reach
    added = picture[row, first : first + 2 * reach + 1].astype(np.float64) - around_grey
    return first + (np.arange(added.size) * added).sum() / added.sum(), added.sum()
