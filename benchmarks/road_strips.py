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

"""How the plane of dense disparity depends on how much of the road it is fitted to."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.geometry.plane import plane_from_pose

from .frames import READABLE, Array, pose_of_plane
from .options import Options
from .road_pairs import DISPARITY_OFFSET, RoadPair, kitti_odometry02
from .table import Table

# The strips of road that the plane is fitted to, and how: as the reference of the recording.
STRIPS_M = (1.2, 1.6, 2.0, 3.0, 4.0, 6.0)
N_DISPARITIES, BLOCK_PX, FIXED_POINT = 128, 5, 16
NEAR_M, FAR_M = 5.5, 20.0
INLIER_PX, ROUNDS = 1.0, 10


def strip_table(_: Options) -> Iterator[Table]:
    """Fit the plane of every frame of the recording to strips of road.

    Raises:
        NothingToMeasureError: The recording is not there.
    """
    table = Table(
        "strips",
        "The plane of dense disparity, by the strip of road it is fitted to (KITTI odometry 02)",
        ["strip, to either side of the camera", "dh mm", "dpitch deg", "droll deg"],
        "OpenCV SGBM, least squares on what lies within a pixel of the plane, 5.5 to 20 m ahead; mean of 20 "
        "frames less the mean of the reference. Ours is the plane of the own lane: a road that is bent "
        "across has another one for each strip.",
    )
    pairs = list(kitti_odometry02())
    reference = np.mean([pair.low for pair in pairs], axis=0)
    points = [_disparities(pair) for pair in pairs]
    for half_width_m in STRIPS_M:
        poses = [_strip_pose(pair, seen, half_width_m) for pair, seen in zip(pairs, points, strict=True)]
        off = np.mean(poses, axis=0) + DISPARITY_OFFSET - reference
        table.add(f"{half_width_m:g} m", f"{off[0]:+.0f}", f"{off[1]:+.2f}", f"{off[2]:+.2f}")
    yield table


def _disparities(pair: RoadPair) -> tuple[Array, Array]:
    """Return rays (1, y, z) of the left camera, (N, 3), and their disparities [px], (N,)."""
    matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=N_DISPARITIES, blockSize=BLOCK_PX)
    disparity = matcher.compute(pair.left, pair.right).astype(np.float64) / FIXED_POINT
    rows, columns = np.nonzero(disparity > 0)
    rig = pair.rig
    rays = np.stack([np.ones(len(rows)), (rig.cx - columns) / rig.fx, (rig.cy - rows) / rig.fy], axis=1)
    return rays, disparity[rows, columns]


def _strip_pose(pair: RoadPair, points: tuple[Array, Array], half_width_m: float) -> Array:
    """Return height [mm], pitch and roll [deg] of the plane of a strip of road."""
    rays, disparity = points
    rig = pair.rig
    start = Extrinsics.from_array((pair.low - DISPARITY_OFFSET) / READABLE)
    plane = plane_from_pose(start, rig).coefficients
    depth_m = rig.fx * rig.baseline_m / disparity
    aside_m = rays[:, 1] * depth_m + rig.baseline_m / 2.0
    strip = (np.abs(aside_m) < half_width_m) & (depth_m > NEAR_M) & (depth_m < FAR_M)
    rays, disparity = rays[strip], disparity[strip]
    for _ in range(ROUNDS):
        near = np.abs(rays @ plane - disparity) < INLIER_PX
        plane = np.linalg.lstsq(rays[near], disparity[near], rcond=None)[0]
    pose: Array = np.array(pose_of_plane(plane, rig)) * READABLE
    return pose
