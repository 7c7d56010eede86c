"""Rows of both images compared along the horizon: a camera that has turned or sunk shows there.

Two lines on a road without texture cannot tell a turned camera from another height. What lies at the horizon
(the edge of the land, trees, houses) is far away, so that its disparity is next to nothing and its rows can
be compared whatever the road is.
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
from ..road.cell_grid import Corridor
from ..types import Array, Floats, Image
from .row_offset import Place, VerticalOffset, refine_offset, with_slopes

# Half the height of the band over the width of the image: a horizon tilted by 3.4 deg stays in it, of another
# what is nearer to the middle; a higher one would take in the road near by. Where the horizon is close to the
# border of the image, less will do.
_HALF_BAND, _LEAST_HALF_BAND = 0.03, 0.018
_ROWS = 39  # of the band: every one of an image 640 px wide
_CELLS = 24  # side by side: four times what is needed for the offset and the turn
_CELL_COLUMNS = 4  # in each, farther apart than the blur reaches
# In noise that drowns those: half as many cells, and every column the blur leaves independent, 6.5 times the
# samples in each with the paper's rig. Time is saved where this is not needed.
_WIDE_CELLS, _COLUMN_STEP = 12, 4
# Most of them have to show it: six of twelve, in noise of 20 %, agreed by chance on a turn of 0.16 deg.
_LEAST_WIDE_CELLS = 10
# Searched to either side, over the width of the image: a turn by 2 deg moves rows at its border so far.
_MOST = 1.0 / 64.0
_SHIFT_STEP = 2  # rows: the blur leaves correlation that far
# Turns tried to start with, to twenty times what a pair may have and still pass for rectified.
_TURNS_RAD = np.radians(np.linspace(-2.0, 2.0, 41))
_PASSES = 2
_ALIGN = 256  # as in `core.geometry.plane`
# Where nothing but slanted edges is seen, it counts that what is far away has next to no disparity: 40 m
# ahead and farther, with the paper's rig. Six cells are twice the numbers that are sought, and one more each.
_DISPARITY_STD_PX, _LEAST_CELLS = 2.0, 6
# What stands before the horizon is nearer, and its slanted edges pass for a turn: in recorded frames of roads
# the turn by the horizon and that by the asphalt differ by this (RMS of 33), several times what they promise.
_NEARER_STD_RAD = math.radians(0.04)


def horizon_offset(
    images: tuple[Image, Image], rig: StereoRig, extrinsics: Extrinsics
) -> VerticalOffset | NotFitted:
    """Measure the vertical offset between both images along the horizon.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        extrinsics: Where the horizon is, good to a few rows in the middle of the image.

    Returns:
        The offset, or why there is none: the horizon is not in view, or shows too little.
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
            return replace(seen, roll_std_rad=math.hypot(seen.roll_std_rad, _NEARER_STD_RAD))
    return seen


def _compare(
    images: tuple[Image, Image], rig: StereoRig, extrinsics: Extrinsics, band: Corridor, least_cells: int
) -> VerticalOffset | NotFitted:
    """Compare the rows of a band, in as many cells as it has."""
    most = round(_MOST * rig.width)
    first = max(0, int(band.v.min()) - 2 * most)
    last = int(band.v.max()) + 2 * most
    left, right = (with_slopes(image[first:last]) for image in images)
    v = band.v - np.float32(first)
    usable = (np.arange(len(band.u)) < band.n_samples).astype(np.float32)
    # The road below the horizon is nearer.
    half = np.maximum(half_disparity(band, plane_from_pose(extrinsics, rig), rig), np.float32(0.0))
    place = (band.u + half, band.u - half, v)
    start = _search(left[0], right[0], band, place, band.cell_rays[:, 1] * -rig.fx, most)
    known: tuple[tuple[float, int] | tuple[()], ...] = ((), (_DISPARITY_STD_PX, least_cells))
    for of_disparity in known:  # the latter for a bare horizon that is slanted, or much noise
        seen = refine_offset(
            (left, right), band, place, usable, rig, start, _PASSES, most, cv2.INTER_LINEAR, *of_disparity
        )
        if isinstance(seen, VerticalOffset):
            return seen
    return seen


def _lay_out(rig: StereoRig, extrinsics: Extrinsics, cells: int, cell_columns: int) -> Corridor | NotFitted:
    """Lay out the band: a segment is a piece of a column, so that its mean takes no horizontal edge away.

    The band is level: a wrong roll must not lead it away from the horizon.
    """
    middle = round(float(horizon_row(rig, extrinsics, rig.cx)))
    room = min(middle, rig.height - 1 - middle) - round(_MOST * rig.width)
    half = min(round(_HALF_BAND * rig.width), room)
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
    return Corridor(
        u=np.pad(np.repeat(u, _ROWS), (0, padded - total), mode="edge").astype(np.float32),
        v=np.pad(np.tile(rows, n), (0, padded - total), mode="edge").astype(np.float32),
        starts=np.arange(n) * _ROWS,
        lengths=np.full(n, _ROWS),
        segment_rays=rays,
        cell_starts=cell_starts,
        cell_lengths=np.full(cells, cell_columns),
        cell_rays=rays.reshape(cells, cell_columns, 3).mean(axis=1),
        cell_xy=np.zeros((cells, 2)),  # nowhere on the road
        cell_area=np.zeros(cells),
    )


def _search(
    fixed: Floats, moving: Floats, band: Corridor, place: Place, columns: Array, most: int
) -> tuple[float, float]:
    """Return offset [px] and turn [rad] under which the cells of both images correlate best."""
    at_left, at_right, v = place
    cells = len(band.cell_starts)
    shifts = np.arange(-most, most + 1, _SHIFT_STEP)

    def centred(image: Floats, u: Floats, rows: Floats) -> Floats:
        values = sample(image, u, rows, cv2.INTER_LINEAR)[..., : band.n_samples]
        values = values.reshape(-1, cells, band.cell_lengths[0], _ROWS)
        return np.asarray(values - values.mean(axis=-1, keepdims=True), np.float32)

    reference = centred(fixed, at_left, v)[0]
    rows = v + shifts[:, None].astype(np.float32)
    moved = centred(moving, np.broadcast_to(at_right, rows.shape), rows)
    # Weighed by the contrast of the left image: an empty sky correlates by chance.
    both, squares = (
        np.einsum("hcsr,hcsr->hc", moved, each) for each in (np.broadcast_to(reference, moved.shape), moved)
    )
    curves = both / np.sqrt(np.maximum(squares, 1.0))
    # (offset, turn, cell)
    at = np.rint((shifts[:, None, None] + _TURNS_RAD[:, None] * columns + most) / _SHIFT_STEP).astype(np.intp)
    within = (at >= 0) & (at < len(shifts))
    at = np.clip(at, 0, len(shifts) - 1)
    total = np.where(within, curves[at, np.arange(cells)], 0.0).sum(axis=-1)
    best = np.unravel_index(int(np.argmax(total)), total.shape)
    return float(shifts[best[0]]), float(_TURNS_RAD[best[1]])
