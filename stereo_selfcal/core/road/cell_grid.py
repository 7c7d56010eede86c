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

"""The strip of road ahead of the camera as a list of samples, grouped into cells of a few square metres.

The samples are laid out in the image that a camera in the middle of the baseline would have. A point of
disparity d that this camera sees at the column u is at u + d / 2 in the left image and at u - d / 2 in the
right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, plane_from_pose
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.rays import pixel_rays
from ..types import Array, Floats, Indices, Mask

# Half of the widest motorway lanes (3.75 m) and the stripe beside it.
HALF_WIDTH_M = 2.5
FAR_M = 30.0

# Width of a cell across the road: five cells distinguish a crown from a slope.
CELL_WIDTH_M = 1.0
# Ratio of the far and the near distance of a cell. It limits the change of disparity within a cell. At 7 m, a
# cell is 1 m long.
CELL_RATIO = 1.15
# Least distance of samples on the road. Closer ones add no information: the grains of a road surface are 5 to
# 16 mm.
SPACING_M = 0.025
# At this disparity, a tenth of a pixel is a fortieth of the camera's height, 35 mm. This is as large as the
# height differences that have to be distinguished, so cells farther away give no information.
_LEAST_DISPARITY_OF_CELLS_PX = 4.0
_MARGIN_PX = 8  # reach of interpolation and blur
_LEAST_SAMPLES = 6  # least samples of a row in a cell: with fewer, removing their mean removes the texture
_ALIGN = 256  # samples are shaped (N / 256, 256), because OpenCV's images have at most 32 767 columns


@dataclass(frozen=True, slots=True, eq=False)
class SampleGrid:
    """Samples of the road, sorted by cell. The samples of one row in one cell are a segment.

    Attributes:
        u: (N,) columns in the middle image [px], padded to whole lines of 256.
        v: (N,) rows [px].
        starts: (S,) index of the first sample of each segment.
        lengths: (S,) number of samples of each segment.
        segment_rays: (S, 3) rays (1, y, z) through the middle of each segment.
        cell_starts: (C,) index of the first segment of each cell.
        cell_lengths: (C,) number of segments of each cell.
        cell_rays: (C, 3) rays through the middle of each cell.
        cell_xy: (C, 2) positions of the cells on the road [m].
        cell_area: (C,) areas of the cells [m^2].
        cell_strip: (C,) strip along the road in which each cell lies, 0 for the leftmost one.
    """

    u: Floats
    v: Floats
    starts: Indices
    lengths: Indices
    segment_rays: Array
    cell_starts: Indices
    cell_lengths: Indices
    cell_rays: Array
    cell_xy: Array
    cell_area: Array
    cell_strip: Indices

    def segment_sums(self, values: Floats) -> Array:
        """Sum samples (..., N) over segments, shape (..., S)."""
        samples = values[..., : self.n_samples]
        sums: Array = np.add.reduceat(samples, self.starts, axis=-1).astype(np.float64)
        return sums

    def cell_sums(self, values: Array) -> Array:
        """Sum segments (S, ...) over cells, shape (C, ...)."""
        sums: Array = np.add.reduceat(values, self.cell_starts, axis=0)
        return sums

    def sums_over_cells(self, values: Floats) -> Array:
        """Sum samples (..., N) over cells, shape (..., C)."""
        samples = values[..., : self.n_samples]
        sums: Array = np.add.reduceat(samples, self.starts[self.cell_starts], axis=-1).astype(np.float64)
        return sums

    @property
    def n_samples(self) -> int:
        """Number of samples without the padding."""
        return int(self.starts[-1] + self.lengths[-1])

    def to_samples(self, per_segment: Array) -> Floats:
        """Repeat values (..., S) of each segment for its samples, shape (..., N)."""
        repeated = np.zeros((*per_segment.shape[:-1], len(self.u)), np.float32)
        repeated[..., : self.n_samples] = np.repeat(per_segment.astype(np.float32), self.lengths, axis=-1)
        return repeated

    def to_segments(self, per_cell: Array) -> Array:
        """Repeat a value of each cell for its segments, shape (S,)."""
        return np.repeat(per_cell, self.cell_lengths)


def lay_out_samples(
    rig: StereoRig,
    pose: Extrinsics,
    lane_yaw_rad: float = 0.0,
    limits_m: tuple[float, float] = (-HALF_WIDTH_M, HALF_WIDTH_M),
    far_m: float = FAR_M,
    thinning: int = 1,
) -> SampleGrid | None:
    """Lay out the samples of the road ahead of the camera.

    Args:
        rig: Intrinsics and baseline.
        pose: Pose of the rig over the road; its error is at most a fraction of the lane width.
        lane_yaw_rad: Heading of the camera against the lane [rad].
        limits_m: Right and left limit of the strip beside the camera's path [m], left positive.
        far_m: Distance of the strip's end [m].
        thinning: Factor on the distance between samples, in both directions.

    Returns:
        The samples, or None where the image shows too little of the strip.
    """
    plane = plane_from_pose(pose, rig)
    rows = np.arange(_MARGIN_PX // 2, rig.height - _MARGIN_PX // 2)
    middle = float(np.clip(rig.cx + rig.fx * np.tan(lane_yaw_rad), 0, rig.width))
    disparity = plane.disparities(pixel_rays(rig, middle, rows))
    ahead = rig.fx * rig.baseline_m / np.maximum(disparity, _LEAST_DISPARITY_OF_CELLS_PX)
    visible = (disparity > _LEAST_DISPARITY_OF_CELLS_PX) & (ahead < far_m)
    if not visible.any():
        return None
    rows, ahead, disparity = rows[visible], ahead[visible], disparity[visible]
    spaced = _spaced(ahead, SPACING_M * thinning, thinning)
    rows, ahead, disparity = rows[spaced], ahead[spaced], disparity[spaced]
    n_cells = _n_strips(limits_m)
    lateral = np.linspace(limits_m[1], limits_m[0], n_cells + 1)  # from left to right, as columns
    columns = middle - rig.fx * lateral / ahead[:, None]
    reach = disparity[:, None] / 2.0 + _MARGIN_PX
    columns = np.clip(columns, reach, rig.width - 1 - reach)
    steps = np.maximum(1, (SPACING_M * thinning * rig.fx / ahead).astype(np.intp))
    steps = np.maximum(steps, thinning)
    first = np.ceil(columns[:, :-1]).astype(np.intp)
    lengths = (np.ceil(columns[:, 1:]).astype(np.intp) - first) // steps[:, None]
    band = np.floor(np.log(far_m / ahead) / np.log(CELL_RATIO)).astype(np.intp)
    cell = band[:, None] * n_cells + np.arange(n_cells)
    row = np.broadcast_to(rows[:, None], cell.shape)
    step = np.broadcast_to(steps[:, None], cell.shape)
    keep = lengths >= _LEAST_SAMPLES
    if not keep.any():
        return None
    first, lengths, cell, row, step = (a[keep] for a in (first, lengths, cell, row, step))
    order = np.lexsort((row, cell))
    first, lengths, cell, row, step = (a[order] for a in (first, lengths, cell, row, step))
    return _assemble(rig, plane, pose, first, lengths, cell, row, step, n_cells)


def strip_of(aside_m: Array, limits_m: tuple[float, float]) -> Indices:
    """Return the strip along the road in which points lie, (N,); 0 is the leftmost one.

    Args:
        aside_m: (N,) distances from the camera's path along the lane, to the left [m].
        limits_m: Right and left limit of the sampled road [m].
    """
    right_m, left_m = limits_m
    n_strips = _n_strips(limits_m)
    strips = np.floor((left_m - aside_m) / (left_m - right_m) * n_strips).astype(np.intp)
    return np.clip(strips, 0, n_strips - 1)


def _n_strips(limits_m: tuple[float, float]) -> int:
    return max(1, round((limits_m[1] - limits_m[0]) / CELL_WIDTH_M))


def _spaced(ahead: Array, spacing_m: float, thinning: int) -> Mask:
    """Choose rows that lie at least a spacing apart on the road; begin with the nearest row."""
    chosen = np.zeros(len(ahead), dtype=bool)
    # The distance between rows grows towards the horizon. Near rows are skipped, so that the spacing is
    # uniform.
    gaps = np.abs(np.diff(ahead, append=ahead[-1]))
    skip = np.maximum(thinning, (spacing_m / np.maximum(gaps, 1e-9)).astype(np.intp))
    skip[-1] = skip[-2] if len(skip) > 1 else 1
    steps = np.minimum(skip, 8 * thinning).tolist()
    kept, i = [], len(steps) - 1
    while i >= 0:
        kept.append(i)
        i -= steps[i]
    chosen[kept] = True
    return chosen


def _assemble(
    rig: StereoRig,
    plane: DisparityPlane,
    pose: Extrinsics,
    first: Indices,
    lengths: Indices,
    cell: Indices,
    row: Indices,
    step: Indices,
    n_columns: int,
) -> SampleGrid:
    """Compute the samples of the segments, and the rays, positions and areas of segments and cells."""
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    total = int(lengths.sum())
    padded = -(-total // _ALIGN) * _ALIGN
    # The values are whole numbers far below 2^24, which single precision holds exactly.
    u, v = np.empty(padded, np.float32), np.empty(padded, np.float32)
    u[:total] = np.arange(total, dtype=np.float32)
    u[:total] *= np.repeat(step.astype(np.float32), lengths)
    u[:total] += np.repeat((first - starts * step).astype(np.float32), lengths)
    v[:total] = np.repeat(row.astype(np.float32), lengths)
    u[total:], v[total:] = u[total - 1], v[total - 1]
    middle = first + (lengths - 1) * step / 2.0
    rays = pixel_rays(rig, middle, row)
    cell_starts = np.concatenate([[0], np.nonzero(np.diff(cell))[0] + 1])
    cell_lengths = np.diff(np.append(cell_starts, len(cell)))
    # Positions on the road: the rays are scaled by the depth and rotated into road axes.
    depth = rig.fx * rig.baseline_m / plane.disparities(rays)
    turn = road_from_camera_rotation(pose.pitch_rad, pose.roll_rad)[:2]
    xy = (rays * depth[:, None]) @ turn.T
    weights = lengths * step * depth**3  # a pixel's area on the road grows with the cube of its distance
    total_weight = np.add.reduceat(weights, cell_starts)
    cell_xy = np.add.reduceat(xy * weights[:, None], cell_starts) / total_weight[:, None]
    cell_rays = np.add.reduceat(rays * weights[:, None], cell_starts) / total_weight[:, None]
    spread = np.maximum.reduceat(xy[:, 0], cell_starts) - np.minimum.reduceat(xy[:, 0], cell_starts)
    width = np.add.reduceat(lengths * step * depth / rig.fx, cell_starts) / cell_lengths
    gap = spread / np.maximum(cell_lengths - 1, 1)
    return SampleGrid(
        u=u,
        v=v,
        starts=starts,
        lengths=lengths,
        segment_rays=rays,
        cell_starts=cell_starts,
        cell_lengths=cell_lengths,
        cell_rays=cell_rays,
        cell_xy=cell_xy,
        cell_area=(spread + gap) * width,
        cell_strip=cell[cell_starts] % n_columns,
    )
