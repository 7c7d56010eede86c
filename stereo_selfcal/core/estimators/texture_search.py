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

"""The search for the plane under which both images of a road show the same, around a coarse one."""

from __future__ import annotations

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, plane_from_pose, pose_from_plane
from ..geometry.pose import Extrinsics
from ..rejection import Bound, NotFitted
from ..road.cell_grid import SampleGrid, lay_out_samples
from ..types import Array, Floats, Image
from .sampling import half_disparity, sample

# The search corrects errors of the start up to these: a kerb's height (60 mm), the pitching of a frame (0.5
# deg) and the cross slope of another lane (2 deg), each increased by a quarter.
SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD = 0.075, np.radians(0.65), np.radians(2.5)
SEARCH_RANGE = np.array([SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD])
Layout = tuple[float, tuple[float, float], float]  # arguments of lay_out_samples: yaw, limits, far end

_SEARCH_BLUR_PX = 2.0  # with this blur, the peak of the correlation extends over 2 px to either side
_SEARCH_KERNEL = (13, 1)
_SEARCH_STEP_PX = 1.0
_SEARCH_MOST_STEPS = 7  # steps to either side of the start, for each of the three numbers
_SEARCH_THINNING = 3

NOT_IN_VIEW = NotFitted("cells of the road in view", 0, Bound.LEAST, 1)


def search_plane(
    images: tuple[Image, Image], rig: StereoRig, start: DisparityPlane, layout: Layout
) -> DisparityPlane | NotFitted:
    """Try planes around the start; return the one with the largest sum of the cells' correlations.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        start: The plane to start from.
        layout: Heading against the lane [rad], right and left limit, and far end of the samples [m].
    """
    pose = pose_from_plane(start, rig)
    grid = lay_out_samples(rig, pose, *layout, thinning=_SEARCH_THINNING)
    if grid is None:
        return NOT_IN_VIEW
    changes = []
    for index, size in enumerate(SEARCH_RANGE):
        moved = pose.as_array()
        moved[index] += size
        change = plane_from_pose(Extrinsics.from_array(moved), rig).coefficients - start.coefficients
        reach = float(np.abs(grid.cell_rays @ change).max())
        n = min(_SEARCH_MOST_STEPS, int(np.ceil(reach / _SEARCH_STEP_PX)))
        changes.append(np.linspace(-1.0, 1.0, 2 * n + 1)[:, None] * change)
    combined = changes[0][:, None, None] + changes[1][None, :, None] + changes[2][None, None]
    candidates = combined.reshape(-1, 3)
    displacements = candidates @ grid.cell_rays.T
    most = int(np.ceil(np.abs(displacements).max())) + 1
    correlations = _correlate(images, grid, half_disparity(grid, start, rig), most)
    position = displacements + most
    below = position.astype(np.intp)
    part = position - below
    at = below * correlations.shape[1] + np.arange(correlations.shape[1])
    rise = np.diff(correlations, axis=0)
    score = (correlations.reshape(-1).take(at) + part * rise.reshape(-1).take(at)).sum(axis=1)
    return start.moved(candidates[int(np.argmax(score))])


def _correlate(images: tuple[Image, Image], grid: SampleGrid, half: Floats, most: int) -> Array:
    """Return the correlation in each cell for shifts of the right image by -most ... most px, (shifts, C)."""
    row = grid.v.astype(np.intp)
    sampled = np.bincount(row) > 0  # the blur runs along the rows, so only the sampled rows are needed
    rows_of_each = (each[: len(sampled)][sampled] for each in images)
    blurred = [cv2.GaussianBlur(rows, _SEARCH_KERNEL, _SEARCH_BLUR_PX) for rows in rows_of_each]
    grey = [np.asarray(image, np.uint8) for image in blurred]
    v = (np.cumsum(sampled) - 1).astype(np.float32)[row]
    shifts = np.arange(-most, most + 1, dtype=np.float32)[:, None]
    left = sample(grey[0], grid.u + half, v, cv2.INTER_LINEAR).astype(np.float32)
    rows = np.broadcast_to(v, (len(shifts), len(v)))
    right = sample(grey[1], grid.u - half - shifts, rows, cv2.INTER_LINEAR).astype(np.float32)
    # Sums of whole grey values are exact, so that the means can be removed from the products.
    sums = grid.segment_sums
    s_left, s_right = sums(left), sums(right)
    of_left = grid.cell_sums(sums(left * left) - s_left**2 / grid.lengths)
    of_right = sums(right * right) - s_right**2 / grid.lengths
    both = sums(left * right) - s_left * s_right / grid.lengths
    of_right, both = (grid.cell_sums(each.T).T for each in (of_right, both))
    correlations: Array = both / np.sqrt(of_left * of_right + 1e-6)
    return correlations
