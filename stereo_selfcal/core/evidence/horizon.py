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

"""Vertical offset between both images, measured along the horizon.

Two lines on a road without texture cannot tell a camera that has turned from another height. What lies at the
horizon (the edge of the land, trees, houses) is far away. Its disparity is nearly zero, so its rows can be
compared whatever the road is.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..estimators.sampling import half_disparity, sample
from ..geometry.homography import horizon_row
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.rays import pixel_rays
from ..rejection import Bound, NotFitted
from ..road.cell_grid import SampleGrid
from ..types import Array, Floats, Image
from .row_offset import SamplePositions, VerticalOffset, refine_offset, with_gradients

# Half the height of the band, over the width of the image. A horizon tilted by up to 3.4 deg lies in the band
# over its whole width; one tilted more, in the middle only. A higher band would include the road near by.
# Where the horizon is close to the border of the image, the second value is enough.
_HALF_BAND, _LEAST_HALF_BAND = 0.03, 0.018
_ROWS = 39  # of the band: all of its rows in an image 640 px wide
_CELLS = 24  # side by side: four times as many as offset and turn need
_CELL_COLUMNS = 4  # in each, farther apart than the blur reaches
# Where noise hides the gradients, a second layout follows: half as many cells, and every column that the blur
# leaves independent. With the paper's rig each cell has 6.5 times the samples. The first layout takes less
# time.
_WIDE_CELLS, _COLUMN_STEP = 12, 4
# Most of these cells must have a displacement: in noise of 20 %, six of twelve agreed by chance on a turn of
# 0.16 deg.
_LEAST_WIDE_CELLS = 10
# Largest offset that is searched, up and down, over the width of the image: a turn by 2 deg moves the rows at
# the border of the image by this.
_MAX_OFFSET = 1.0 / 64.0
_SHIFT_STEP = 2  # rows: the blurred images are still correlated over this distance
# Turns from which the best start is chosen: up to 20 times the limit for a rectified pair (0.1 deg).
_TURNS_RAD = np.radians(np.linspace(-2.0, 2.0, 41))
_PASSES = 2
_ALIGN = 256  # as in `core.geometry.plane`
# Where all edges are inclined, the offset can be measured only if the disparity is known. With the paper's
# rig, that of objects 40 m ahead and farther is zero to this standard deviation. Six cells are three for each
# unknown.
_DISPARITY_STD_PX, _LEAST_CELLS = 2.0, 6
# Objects before the horizon are nearer, and their inclined edges appear as a turn. In 33 recorded frames of
# roads, the turns by the horizon and by the road surface differ by this (RMS): several times their own
# standard deviations.
_FOREGROUND_STD_RAD = math.radians(0.04)


def horizon_offset(
    images: tuple[Image, Image], rig: StereoRig, extrinsics: Extrinsics
) -> VerticalOffset | NotFitted:
    """Measure the vertical offset between both images along the horizon.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        extrinsics: Pose over the road; it gives the row of the horizon, good to a few rows in the middle.

    Returns:
        The offset, or why there is none: the horizon is not in view, or has too little texture.
    """
    wide_columns = rig.width // (_WIDE_CELLS * _COLUMN_STEP)
    for cells, columns, least in (
        (_CELLS, _CELL_COLUMNS, _LEAST_CELLS),
        (_WIDE_CELLS, wide_columns, _LEAST_WIDE_CELLS),
    ):
        band = _lay_out(rig, extrinsics, cells, columns)
        if isinstance(band, NotFitted):
            return band
        seen = _compare(images, rig, extrinsics, band, least)
        if isinstance(seen, VerticalOffset):
            return replace(seen, roll_std_rad=math.hypot(seen.roll_std_rad, _FOREGROUND_STD_RAD))
    return seen


def _compare(
    images: tuple[Image, Image], rig: StereoRig, extrinsics: Extrinsics, band: SampleGrid, least_cells: int
) -> VerticalOffset | NotFitted:
    """Measure offset and turn in the cells of a band; ``least_cells`` must have a displacement."""
    max_offset = round(_MAX_OFFSET * rig.width)
    first = max(0, int(band.v.min()) - 2 * max_offset)
    last = int(band.v.max()) + 2 * max_offset
    left, right = (with_gradients(image[first:last]) for image in images)
    v = band.v - np.float32(first)
    usable = (np.arange(len(band.u)) < band.n_samples).astype(np.float32)
    # The road below the horizon has the disparity of its plane; above it, the disparity is zero.
    half = np.maximum(half_disparity(band, plane_from_pose(extrinsics, rig), rig), np.float32(0.0))
    positions = (band.u + half, band.u - half, v)
    start = _search(left[0], right[0], band, positions, band.cell_rays[:, 1] * -rig.fx, max_offset)
    variants: tuple[tuple[float, int] | tuple[()], ...] = ((), (_DISPARITY_STD_PX, least_cells))
    for disparity_terms in variants:  # the second: for a bare horizon that is inclined, or much noise
        seen = refine_offset(
            (left, right),
            band,
            positions,
            usable,
            rig,
            start,
            _PASSES,
            max_offset,
            cv2.INTER_LINEAR,
            *disparity_terms,
        )
        if isinstance(seen, VerticalOffset):
            return seen
    return seen


def _lay_out(rig: StereoRig, extrinsics: Extrinsics, cells: int, cell_columns: int) -> SampleGrid | NotFitted:
    """Lay out the cells of the band along the horizon.

    A segment is a part of a column, as the mean of a part of a row would remove a horizontal edge. The band
    is level: a wrong roll must not lead it away from the horizon.
    """
    middle = round(float(horizon_row(rig, extrinsics, rig.cx)))
    rows_in_view = min(middle, rig.height - 1 - middle) - round(_MAX_OFFSET * rig.width)
    half = min(round(_HALF_BAND * rig.width), rows_in_view)
    least = _LEAST_HALF_BAND * rig.width
    if half < least:
        return NotFitted("rows above and below the horizon that are in view", half, Bound.LEAST, least)
    n = cells * cell_columns
    u = (np.arange(n) + 0.5) * (rig.width / n)
    rows = np.linspace(middle - half, middle + half, _ROWS)
    total = n * _ROWS
    padded = -(-total // _ALIGN) * _ALIGN
    cell_starts = np.arange(cells) * cell_columns
    rays = pixel_rays(rig, u, middle)
    return SampleGrid(
        u=np.pad(np.repeat(u, _ROWS), (0, padded - total), mode="edge").astype(np.float32),
        v=np.pad(np.tile(rows, n), (0, padded - total), mode="edge").astype(np.float32),
        starts=np.arange(n) * _ROWS,
        lengths=np.full(n, _ROWS),
        segment_rays=rays,
        cell_starts=cell_starts,
        cell_lengths=np.full(cells, cell_columns),
        cell_rays=rays.reshape(cells, cell_columns, 3).mean(axis=1),
        cell_xy=np.zeros((cells, 2)),  # the cells are not on the road
        cell_area=np.zeros(cells),
        cell_strip=np.zeros(cells, np.intp),
    )


def _search(
    fixed: Floats,
    moving: Floats,
    band: SampleGrid,
    positions: SamplePositions,
    columns: Array,
    max_offset: int,
) -> tuple[float, float]:
    """Return offset [px] and turn [rad] under which the cells of both images correlate best."""
    at_left, at_right, v = positions
    cells = len(band.cell_starts)
    shifts = np.arange(-max_offset, max_offset + 1, _SHIFT_STEP)

    def centred(image: Floats, u: Floats, rows: Floats) -> Floats:
        values = sample(image, u, rows, cv2.INTER_LINEAR)[..., : band.n_samples]
        values = values.reshape(-1, cells, band.cell_lengths[0], _ROWS)
        return np.asarray(values - values.mean(axis=-1, keepdims=True), np.float32)

    reference = centred(fixed, at_left, v)[0]
    rows = v + shifts[:, None].astype(np.float32)
    moved = centred(moving, np.broadcast_to(at_right, rows.shape), rows)
    # Each cell is weighted by the contrast of its left image: an empty sky correlates by chance.
    both, squares = (
        np.einsum("hcsr,hcsr->hc", moved, each) for each in (np.broadcast_to(reference, moved.shape), moved)
    )
    curves = both / np.sqrt(np.maximum(squares, 1.0))
    # (offset, turn, cell)
    at = np.rint((shifts[:, None, None] + _TURNS_RAD[:, None] * columns + max_offset) / _SHIFT_STEP).astype(
        np.intp
    )
    within = (at >= 0) & (at < len(shifts))
    at = np.clip(at, 0, len(shifts) - 1)
    total = np.where(within, curves[at, np.arange(cells)], 0.0).sum(axis=-1)
    best = np.unravel_index(int(np.argmax(total)), total.shape)
    return float(shifts[best[0]]), float(_TURNS_RAD[best[1]])
