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

"""Thirty lines that a user would write instead: OpenCV's block matching and a plane.

The matcher has the settings of OpenCV's own sample, and the region is what a road usually takes. Where the
plane is looked for, and within how many pixels, is the best of eight ways tried on the frames with lidar:
that flatters it.
"""

from __future__ import annotations

import cv2
import numpy as np

from stereo_selfcal import StereoRig
from stereo_selfcal.core.types import Image

from .frames import READABLE, Array, pose_of_plane

N_DISPARITIES, BLOCK_PX, FIXED_POINT = 96, 5, 16.0
# As in OpenCV's sample stereo_match.py.
SETTINGS = {
    "P1": 8 * BLOCK_PX**2,
    "P2": 32 * BLOCK_PX**2,
    "disp12MaxDiff": 1,
    "uniquenessRatio": 10,
    "speckleWindowSize": 100,
    "speckleRange": 2,
}
TRIALS, SCORED, INLIER_PX, ROUNDS, MIN_POINTS = 500, 4000, 0.5, 10, 500
NEAR_M, FAR_M, HALF_WIDTH_M = 4.0, 25.0, 4.0


def peer_pose(left: Image, right: Image, rig: StereoRig) -> Array | None:
    """Return height [mm], pitch and roll [deg] of the road plane, None where there is no plane.

    The plane is found by RANSAC in a region ahead of the cameras, in the lower half of the image. It is then
    fitted by least squares to what lies near it there.
    """
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=N_DISPARITIES, blockSize=BLOCK_PX, **SETTINGS
    )
    disparity = matcher.compute(left, right) / FIXED_POINT
    disparity[: rig.height // 2] = 0.0
    rows, columns = np.nonzero(disparity > 0)
    seen = disparity[rows, columns]
    rays = np.stack([np.ones(len(rows)), (rig.cx - columns) / rig.fx, (rig.cy - rows) / rig.fy], axis=1)
    depth_m = rig.fx * rig.baseline_m / seen
    aside_m = rays[:, 1] * depth_m + rig.baseline_m / 2.0
    region = (depth_m > NEAR_M) & (depth_m < FAR_M) & (np.abs(aside_m) < HALF_WIDTH_M)
    rays, seen = rays[region], seen[region]
    if len(rays) < MIN_POINTS:
        return None

    rng = np.random.default_rng(0)
    triples, score = rng.integers(len(rays), size=(TRIALS, 3)), rng.integers(len(rays), size=SCORED)
    regular = np.abs(np.linalg.det(rays[triples])) > np.finfo(np.float64).eps
    if not regular.any():
        return None
    planes = np.linalg.solve(rays[triples][regular], seen[triples][regular][..., None])[..., 0]
    votes = (np.abs(planes @ rays[score].T - seen[score]) < INLIER_PX).sum(axis=1)
    plane = planes[votes.argmax()]
    for _ in range(ROUNDS):
        near = np.abs(rays @ plane - seen) < INLIER_PX
        if near.sum() < MIN_POINTS:
            return None
        plane = np.linalg.lstsq(rays[near], seen[near], rcond=None)[0]
    pose: Array = np.array(pose_of_plane(plane, rig)) * READABLE
    return pose
