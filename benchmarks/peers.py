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

"""What a user would pick instead: dense disparity and a plane, v-disparity, or the lanes' vanishing point.

Each is written anew from the formulas of its paper, and given what flatters it: it looks only
below the true horizon, and their parameters were chosen on development frames, not on those measured.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pyransac3d

from stereo_selfcal import StereoRig
from stereo_selfcal.core.geometry.homography import horizon_row
from stereo_selfcal.synth.renderer import Frame
from stereo_selfcal.synth.world import Scene

from .frames import Array, pose_of_plane

N_DISPARITIES = 64
BLOCK_PX = 5
SUBPIXEL = 16.0  # StereoSGBM's disparities are sixteenths
# Smoothness as OpenCV's own samples set it, for a jump of one disparity and of more. It helps under
# noise, but draws slanted ground towards whole disparities; StereoSGBM_create's default is none. Both
# are measured.
SMOOTHNESS = {"smooth": (8 * BLOCK_PX**2, 32 * BLOCK_PX**2), "default": (0, 0)}
UNIQUENESS_PERCENT = 10

HORIZON_MARGIN_PX = 10
MIN_POINTS = 200

RANSAC_TRIALS = 500
RANSAC_SAMPLE = 4000  # points a plane is scored on
RANSAC_INLIER_PX = 1.0
LEAST_SQUARES_ROUNDS = 3

V_DISPARITY_BINS_PER_PX = 4
V_DISPARITY_MIN_PX = 1.0
V_DISPARITY_MIN_SHARE = 0.02  # of a row's points; below it a bin is noise
HOUGH_HORIZON_STEP_PX = 0.25
HOUGH_SLOPES = np.linspace(
    0.01, 0.3, 581
)  # disparity per row; the rig's baseline over height is 0.04 ... 0.14

PLANE_INLIER_M = 0.05
PLANE_TRIALS = 500
PLANE_MAX_DEPTH_M = 25.0
PLANE_SAMPLE = 5000

CANNY = (50, 150)
BLUR_PX = 5
SEGMENT_VOTES = 60
SEGMENT_MIN_PX = 60
SEGMENT_GAP_PX = 20
SEGMENT_MIN_SLOPE = 0.25

Pose = tuple[float, float, float]  # height [m], pitch, roll [rad]; NaN for what a method does not estimate


@dataclass(frozen=True, slots=True)
class Pair:
    """One frame as a peer gets it.

    Attributes:
        left: Left image.
        right: Right image.
        rig: The rig.
        first_row: First row that is surely road.
        smoothness: Key of SMOOTHNESS.
    """

    left: Frame
    right: Frame
    rig: StereoRig
    first_row: int
    smoothness: str = "default"

    @classmethod
    def of(cls, scene: Scene, left: Frame, right: Frame) -> Pair:
        """Take a frame, with its true horizon."""
        rows = horizon_row(scene.rig, scene.extrinsics, np.array([0.0, scene.rig.width - 1.0]))
        return cls(left, right, scene.rig, max(0, math.ceil(float(rows.max())) + HORIZON_MARGIN_PX))


def disparity_points(pair: Pair) -> tuple[Array, Array, Array]:
    """Return columns, rows and disparities of StereoSGBM below the horizon."""
    small_jump, large_jump = SMOOTHNESS[pair.smoothness]
    matcher = cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=N_DISPARITIES,
        blockSize=BLOCK_PX,
        P1=small_jump,
        P2=large_jump,
        uniquenessRatio=UNIQUENESS_PERCENT,
    )
    disparity = matcher.compute(pair.left, pair.right).astype(np.float64) / SUBPIXEL
    rows, columns = np.nonzero(disparity[pair.first_row :] > 0)
    rows += pair.first_row
    if len(rows) < MIN_POINTS:
        raise ValueError(f"{len(rows)} disparities: too few for a plane")
    return columns.astype(np.float64), rows.astype(np.float64), disparity[rows, columns]


def ransac_plane(pair: Pair) -> Pose:
    """StereoSGBM, RANSAC on the disparity plane, least squares on its inliers."""
    columns, rows, disparity = disparity_points(pair)
    rig, rng = pair.rig, np.random.default_rng(0)
    rays = np.stack([np.ones_like(columns), -(columns - rig.cx) / rig.fx, -(rows - rig.cy) / rig.fy], axis=1)
    score = rng.integers(len(rays), size=RANSAC_SAMPLE)
    chosen = rng.integers(len(rays), size=(RANSAC_TRIALS, 3))
    triples = rays[chosen]
    regular = np.abs(np.linalg.det(triples)) > np.finfo(np.float64).eps
    planes = np.linalg.solve(triples[regular], disparity[chosen][regular][..., None])[..., 0]
    misfit = np.abs(planes @ rays[score].T - disparity[score])
    plane = planes[np.argmax((misfit < RANSAC_INLIER_PX).sum(axis=1))]
    for _ in range(LEAST_SQUARES_ROUNDS):
        inliers = np.abs(rays @ plane - disparity) < RANSAC_INLIER_PX
        plane = np.linalg.lstsq(rays[inliers], disparity[inliers], rcond=None)[0]
    return pose_of_plane(plane, rig)


def v_disparity(pair: Pair) -> Pose:
    """StereoSGBM and a Hough line in the v-disparity image (Labayrade et al., 2002); roll is taken as 0."""
    _, rows, disparity = disparity_points(pair)
    rig = pair.rig
    n_bins = N_DISPARITIES * V_DISPARITY_BINS_PER_PX
    bins = np.minimum((disparity * V_DISPARITY_BINS_PER_PX).astype(np.intp), n_bins - 1)
    counts = np.bincount(rows.astype(np.intp) * n_bins + bins, minlength=rig.height * n_bins)
    counts = counts.reshape(rig.height, n_bins)
    row, column = np.nonzero(counts > V_DISPARITY_MIN_SHARE * np.maximum(counts.sum(axis=1), 1)[:, None])
    votes, level = counts[row, column], (column + 0.5) / V_DISPARITY_BINS_PER_PX
    far = level < V_DISPARITY_MIN_PX
    row, votes, level = row[~far], votes[~far], level[~far]
    horizons = row[:, None] - level[:, None] / HOUGH_SLOPES  # one curve of the Hough space per bin
    first, n_cells = -float(rig.height), round(2 * rig.height / HOUGH_HORIZON_STEP_PX)
    cells = np.rint((horizons - first) / HOUGH_HORIZON_STEP_PX).astype(np.intp)
    inside = (cells >= 0) & (cells < n_cells)
    slopes = np.broadcast_to(np.arange(len(HOUGH_SLOPES)), cells.shape)
    flat = slopes[inside] * n_cells + cells[inside]
    weights = np.broadcast_to(votes[:, None], cells.shape)[inside]
    space = np.bincount(flat, weights=weights, minlength=len(HOUGH_SLOPES) * n_cells)
    best_slope, best_cell = divmod(int(space.argmax()), n_cells)
    slope, horizon = HOUGH_SLOPES[best_slope], first + best_cell * HOUGH_HORIZON_STEP_PX
    pitch = math.atan((rig.cy - horizon) / rig.fy)
    return rig.fx * rig.baseline_m * math.cos(pitch) / (slope * rig.fy), pitch, math.nan


def pyransac_plane(pair: Pair) -> Pose:
    """StereoSGBM, points in space, pyransac3d's plane."""
    columns, rows, disparity = disparity_points(pair)
    rig, rng = pair.rig, np.random.default_rng(0)
    depth = rig.fx * rig.baseline_m / disparity
    near = np.flatnonzero(depth < PLANE_MAX_DEPTH_M)
    near = near[rng.permutation(len(near))[:PLANE_SAMPLE]]
    depth = depth[near]
    left = -(columns[near] - rig.cx) / rig.fx * depth + rig.baseline_m / 2
    points = np.stack([depth, left, -(rows[near] - rig.cy) / rig.fy * depth], axis=1)
    random.seed(0)  # pyransac3d draws from the global generator
    equation, _ = pyransac3d.Plane().fit(points, thresh=PLANE_INLIER_M, maxIteration=PLANE_TRIALS)
    if len(equation) != 4:
        raise ValueError("no plane found")
    normal, offset = np.array(equation[:3]), float(equation[3])
    if normal[2] < 0:
        normal, offset = -normal, -offset
    length = float(np.linalg.norm(normal))
    x, y, z = normal / length
    # In the body frame the road's normal is (-sin p, cos p sin r, cos p cos r).
    return offset / length, math.asin(-x), math.atan2(y, z)


def vanishing_point(pair: Pair) -> Pose:
    """Canny, probabilistic Hough, and where the lanes' segments meet; pitch only, roll is taken as 0."""
    edges = cv2.Canny(cv2.GaussianBlur(pair.left, (BLUR_PX, BLUR_PX), 0), *CANNY)
    edges[: pair.first_row] = 0
    found = cv2.HoughLinesP(
        edges, 1, math.pi / 180, SEGMENT_VOTES, minLineLength=SEGMENT_MIN_PX, maxLineGap=SEGMENT_GAP_PX
    )
    if found is None:
        raise ValueError("no segments")
    segments = found.reshape(-1, 4).astype(np.float64)
    step = segments[:, 2:] - segments[:, :2]
    steep = np.abs(step[:, 1]) > SEGMENT_MIN_SLOPE * np.abs(step[:, 0])
    segments, step = segments[steep], step[steep]
    rises = step[:, 0] * step[:, 1] < 0
    if not rises.any() or rises.all():
        raise ValueError("segments on one side only")
    # Rows of n . (u, v) = n . start, each as long as its segment: longer ones count more.
    normals = np.stack([-step[:, 1], step[:, 0]], axis=1)
    offsets = np.einsum("ij,ij->i", normals, segments[:, :2])
    point = np.linalg.lstsq(normals, offsets, rcond=None)[0]
    return math.nan, math.atan((pair.rig.cy - float(point[1])) / pair.rig.fy), math.nan


def _with(smoothness: str, method: Callable[[Pair], Pose]) -> Callable[[Pair], Pose]:
    """Return the method on disparities of one smoothness."""
    return lambda pair: method(replace(pair, smoothness=smoothness))


_DENSE = {
    "RANSAC disparity plane + least squares": ransac_plane,
    "v-disparity, Hough": v_disparity,
    "pyransac3d plane": pyransac_plane,
}
PEERS: dict[str, Callable[[Pair], Pose]] = {
    f"SGBM ({smoothness}) + {name}": _with(smoothness, method)
    for name, method in _DENSE.items()
    for smoothness in SMOOTHNESS
} | {"vanishing point of the lanes (Canny, Hough)": vanishing_point}
