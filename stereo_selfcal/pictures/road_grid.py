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

"""The metric grid on the road that pictures show, and where the road comes into view."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import apply_homography, image_from_road, road_from_image
from ..core.geometry.pose import Extrinsics
from ..core.types import Array
from .canvas import YELLOW, Canvas

# Cells of 1 m across and 5 m along, as far as paint can be judged.
GRID_ACROSS_M = 1.0
GRID_ALONG_M = 5.0
GRID_HALF_WIDTH_M = 4.0
GRID_FAR_M = 30.0
GRID_LABELS_M = (5.0, 10.0, 20.0, 30.0)
GRID_OPACITY = 0.45
LABEL_MARGIN = 0.06  # of the width, for a distance at the right edge
# Bounds of where the road comes into view at the lower edge of the image.
NEAR_EDGE_M = (2.0, 15.0)

_NEAREST_DEPTH_M = 0.5  # road points nearer to the image plane are not drawn
_POLYLINE_POINTS = 32
_LABEL_HEIGHT = 0.5  # of a line of text: a distance with its plate


def near_edge_m(rig: StereoRig, extrinsics: Extrinsics) -> float:
    """Return the distance at which the lower edge of the image meets the road, within bounds."""
    nearest, farthest = NEAR_EDGE_M
    x_m = float(apply_homography(road_from_image(rig, extrinsics, "left"), [rig.cx, rig.height - 1.0])[0])
    return min(max(x_m, nearest), farthest) if x_m > 0 else nearest


def draw_grid(canvas: Canvas, rig: StereoRig, extrinsics: Extrinsics) -> None:
    """Draw the metric grid of the road, half transparent, with its distances."""
    matrix = image_from_road(rig, extrinsics, "left")
    # Under the image's lower edge, so that the lines run out of the picture.
    near_m = max(1.0, 0.5 * near_edge_m(rig, extrinsics))
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
    along_m = np.geomspace(near_m, GRID_FAR_M, _POLYLINE_POINTS)
    across_m = np.linspace(-GRID_HALF_WIDTH_M, GRID_HALF_WIDTH_M, _POLYLINE_POINTS)
    for y_m in np.arange(-GRID_HALF_WIDTH_M, GRID_HALF_WIDTH_M + GRID_ACROSS_M, GRID_ACROSS_M):
        painted.polyline(_project(matrix, along_m, np.full_like(along_m, y_m)), YELLOW)
    for x_m in np.arange(GRID_ALONG_M, GRID_FAR_M + GRID_ALONG_M, GRID_ALONG_M):
        painted.polyline(_project(matrix, np.full_like(across_m, x_m), across_m), YELLOW)
    cv2.addWeighted(painted.pixels, GRID_OPACITY, canvas.pixels, 1 - GRID_OPACITY, 0, dst=canvas.pixels)
    last_y = math.inf
    for x_m in GRID_LABELS_M:
        points = _project(matrix, np.full_like(across_m, x_m), across_m)
        seen = points[points[:, 0] < (1 - LABEL_MARGIN) * rig.width]  # false for NaN
        if seen.size:
            x, y = canvas.pixel(seen[0])  # the rightmost one
            if last_y - y < _LABEL_HEIGHT * canvas.line_height:
                continue  # it would cover the nearer one
            if 0.5 * canvas.line_height < y < canvas.pixels.shape[0] - 0.2 * canvas.line_height:
                last_y = y
                canvas.text(f"{x_m:.0f} m", x + 6 * canvas.thickness, y, YELLOW, size=0.8)


def _project(matrix: Array, x_m: Array, y_m: Array) -> Array:
    """Project road points to the image, (N, 2); NaN for those not in front of the camera."""
    homogeneous = np.column_stack([x_m, y_m, np.ones_like(x_m)]) @ matrix.T
    depth_m = np.where(homogeneous[:, 2:] > _NEAREST_DEPTH_M, homogeneous[:, 2:], np.nan)
    return np.asarray(homogeneous[:, :2] / depth_m)
