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

"""Projection derived without the estimator's geometry: turns about single axes, and cv2.projectPoints."""

from dataclasses import replace

import cv2
import numpy as np

from stereo_selfcal.core.lanes.lane_pair import ImageLine, LanePattern

CAMERAS = ("left", "right")
# x right, y down, z forward of a camera, each written in body axes (x forward, y left, z up).
OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def turn(axis, angle_rad):
    """Return the right-handed rotation about a body axis, (3, 3)."""
    return cv2.Rodrigues(np.eye(3)["xyz".index(axis)] * angle_rad)[0]


def project(rig, pose, camera, points_m, lane_yaw_rad=0.0, lateral_m=0.0):
    """Project points (n, 3) of the lane frame; the road frame if neither yaw nor offset. Returns (n, 2)."""
    lane_from_body = turn("z", lane_yaw_rad) @ turn("y", pose.pitch_rad) @ turn("x", pose.roll_rad)
    to_camera = {"left": rig.baseline_m / 2, "right": -rig.baseline_m / 2}[camera]
    centre = np.array([0.0, lateral_m, pose.height_m]) + lane_from_body @ [0.0, to_camera, 0.0]
    rotation = OPTICAL_FROM_BODY @ lane_from_body.T
    matrix = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 1, 3)
    pixels, _ = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], -rotation @ centre, matrix, None)
    return pixels.reshape(-1, 2)


def seen_turned(rig, points, pitch_rad=0.0, roll_rad=0.0, yaw_rad=0.0):
    """Return where a camera that is turned (REP-103) sees what it sees at ``points`` (n, 2) if it is not."""
    straight_from_turned = turn("z", yaw_rad) @ turn("y", pitch_rad) @ turn("x", roll_rad)
    matrix = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    rays = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(matrix).T
    turned = OPTICAL_FROM_BODY @ straight_from_turned.T @ OPTICAL_FROM_BODY.T @ rays.T
    pixels, _ = cv2.projectPoints(turned.T.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, None)
    return pixels.reshape(-1, 2)


def image_line(rig, pose, camera, position_m, lane_yaw_rad=0.0, lateral_m=0.0):
    """Return (slope du/dv, column at row 0) of a line along the lane at ``position_m`` to its left."""
    ends = [(5.0, position_m, 0.0), (60.0, position_m, 0.0)]
    (u0, v0), (u1, v1) = project(rig, pose, camera, ends, lane_yaw_rad, lateral_m)
    slope = (u1 - u0) / (v1 - v0)
    return slope, u0 - slope * v0


def ideal_pattern(
    rig, pose, positions_m=(1.75, -1.75), lane_yaw_rad=0.0, lateral_m=0.0, columns=None, std=(0.02, 2e-4)
):
    """Return the pattern of two perfect lines, sampled every 10 px from 90 % of the horizon's height down.

    Args:
        rig: Both cameras.
        pose: Extrinsics.
        positions_m: Left and right boundary, left positive.
        lane_yaw_rad: Yaw of the camera against the lane.
        lateral_m: Position of the camera beside the middle of the lane.
        columns: Function of (camera index, line index, rows) with an addition to the columns [px].
        std: Standard deviations that the lines claim: u_mid [px], slope.
    """
    straight = [
        [image_line(rig, pose, camera, y, lane_yaw_rad, lateral_m) for y in positions_m] for camera in CAMERAS
    ]
    (slope_a, at_0_a), (slope_b, at_0_b) = straight[0]
    row = (at_0_b - at_0_a) / (slope_a - slope_b)
    vanishing_point = np.array([at_0_a + slope_a * row, row])
    bottom = rig.height - 1.0
    rows = np.arange(bottom - 0.9 * (bottom - row), rig.height, 10.0)
    added = columns or (lambda camera, line, rows: np.zeros_like(rows))
    lines = [[], []]
    for i, j in np.ndindex(2, 2):
        u = straight[i][j][1] + straight[i][j][0] * rows + added(i, j, rows)
        v_mid = float(rows.mean())
        slope, u_mid = np.polyfit(rows - v_mid, u, 1)
        covariance = np.diag(np.square(std))
        weights = np.ones_like(rows)
        lines[i].append(
            ImageLine(u_mid, slope, v_mid, covariance, rows, u, weights, 10 * len(rows), 12.0, 100.0)
        )
    sampled = np.array([[line.column_at(rows) for line in pair] for pair in lines])
    return LanePattern(tuple(lines[0]), tuple(lines[1]), vanishing_point, rows, sampled)


def with_columns(pattern, columns):
    """Return the pattern with other columns (2, 2, N) [px], and the straight lines through them."""
    lines = [
        tuple(
            replace(line, u_mid=u_mid, slope=slope)
            for line, (slope, u_mid) in (
                (line, np.polyfit(pattern.rows - line.v_mid, columns[i, j], 1)) for j, line in enumerate(pair)
            )
        )
        for i, pair in enumerate((pattern.left, pattern.right))
    ]
    return replace(pattern, left=lines[0], right=lines[1], columns=columns)


def drawn(pattern, rng):
    """Return the pattern with each line moved by a draw of its own covariance."""
    columns = pattern.columns.copy()
    for i, lines in enumerate((pattern.left, pattern.right)):
        for j, line in enumerate(lines):
            u, slope = rng.multivariate_normal((0, 0), line.covariance)
            columns[i, j] += u + slope * (pattern.rows - line.v_mid)
    return with_columns(pattern, columns)


def of_turned_camera(pattern, rig, **angles_rad):
    """Return the pattern as the same left camera and a right one that is turned see it."""
    columns = pattern.columns.copy()
    for j, line in enumerate(pattern.columns[1]):
        (u0, v0), (u1, v1) = seen_turned(rig, np.column_stack([line, pattern.rows])[[0, -1]], **angles_rad)
        columns[1, j] = u0 + (pattern.rows - v0) * (u1 - u0) / (v1 - v0)
    return with_columns(pattern, columns)
