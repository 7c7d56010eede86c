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

"""The road surface that was aligned, as cells over the image of a camera."""

from __future__ import annotations

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.evidence.road_surface import SurfaceCells
from ..core.geometry.homography import image_from_road
from ..core.road.cell_grid import CELL_RATIO, CELL_WIDTH_M
from ..core.types import Array
from .canvas import GREEN, VERMILION, Canvas

CELL_OPACITY = 0.3
# Cells are drawn a little smaller than they are, so that each can be seen.
_DRAWN = 0.9
# A cell off the plane has a cross of half its size.
_CROSS = 0.5


def draw_cells(canvas: Canvas, rig: StereoRig, cells: SurfaceCells) -> None:
    """Tint the cells of the road that lie in the plane; cross out those whose texture lies beside it.

    Cells without texture are left as they are.

    Args:
        canvas: The image of the left camera.
        rig: Its rig.
        cells: The road surface.
    """
    matrix = image_from_road(rig, cells.pose, "left")
    corners = _project(matrix, _quads(cells, _DRAWN))
    crosses = _project(matrix, _quads(cells, _CROSS))
    agrees, beside = cells.agrees, np.isfinite(cells.height_m) & ~cells.agrees
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
    for corner in corners[agrees & np.isfinite(corners).all(axis=(1, 2))]:
        painted.polygon(corner, GREEN)
    cv2.addWeighted(painted.pixels, CELL_OPACITY, canvas.pixels, 1 - CELL_OPACITY, 0, dst=canvas.pixels)
    for cross in crosses[beside & np.isfinite(crosses).all(axis=(1, 2))]:
        canvas.polyline(cross[[0, 2]], VERMILION)
        canvas.polyline(cross[[1, 3]], VERMILION)


def _quads(cells: SurfaceCells, part: float) -> Array:
    """Return the corners of the cells on the road (C, 4, 2) [m], made smaller by a factor."""
    x, y = cells.xy_m.astype(np.float64).T
    half = CELL_RATIO ** (0.5 * part)
    near, far = x / half, x * half
    right, left = y - 0.5 * part * CELL_WIDTH_M, y + 0.5 * part * CELL_WIDTH_M
    corners: Array = np.stack(
        [np.column_stack(corner) for corner in ((near, right), (near, left), (far, left), (far, right))],
        axis=1,
    )
    return corners


def _project(matrix: Array, road: Array) -> Array:
    """Return the places of road points (..., 2) in the image; NaN for those behind the camera."""
    homogeneous = np.concatenate([road, np.ones((*road.shape[:-1], 1))], axis=-1) @ matrix.T
    depth = np.where(homogeneous[..., 2:] > 0.0, homogeneous[..., 2:], np.nan)
    projected: Array = homogeneous[..., :2] / depth
    return projected
