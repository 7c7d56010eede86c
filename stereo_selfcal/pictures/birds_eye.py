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

"""The road from above, as both cameras see it. Where they disagree, coloured fringes appear."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import Side, apply_homography, image_from_road
from ..core.geometry.pose import Extrinsics
from ..core.geometry.travel import Travel
from ..core.types import Array, Image
from .canvas import BLUE, MIN_WIDTH_PX, TEXT_SCALE, YELLOW, Canvas
from .road_grid import GRID_ACROSS_M, GRID_ALONG_M, near_edge_m
from .travel_direction import LABEL_SIZE, draw_cased, draw_fan, fan_of, label_of, road_heading

# A lane to either side of the rig. The view is stretched across the road, because the misfit between the
# cameras shows across the road and is a matter of millimetres.
BIRDS_EYE_FAR_M = 35.0
BIRDS_EYE_HALF_WIDTH_M = 3.5
BIRDS_EYE_ASPECT = 0.42  # height over width of the panel


def draw_birds_eye(
    left: Image,
    right: Image,
    rig: StereoRig,
    extrinsics: Extrinsics,
    width: int = MIN_WIDTH_PX,
    travel: Travel | None = None,
    text_size: float = 1.0,
    titled: bool = True,
) -> Image:
    """Draw the road from above as both cameras see it, one over the other.

    The left camera is orange, the right one blue. Where they agree, the road is grey. Where they do not, it
    has coloured fringes. People who are blind to red or green see these colours, but not red and cyan. The
    heading of the camera is to the right, left of the road is up.

    Args:
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        extrinsics: Its pose over the road.
        width: Width of the picture [px].
        travel: Direction of travel, which tells the yaw; None to draw none.
        text_size: How many times as large text is as usual, for a picture that is shown smaller.
        titled: Whether a line of text says what the picture shows.

    Returns:
        (H', width, 3) uint8 BGR.
    """
    height = round(width * BIRDS_EYE_ASPECT)
    near_m = near_edge_m(rig, extrinsics)
    along, across = width / (BIRDS_EYE_FAR_M - near_m), height / (2 * BIRDS_EYE_HALF_WIDTH_M)  # px per m
    canvas_from_road = np.array(
        [[along, 0.0, -along * near_m], [0.0, -across, across * BIRDS_EYE_HALF_WIDTH_M], [0.0, 0.0, 1.0]]
    )
    orange = _from_above(left, rig, extrinsics, "left", canvas_from_road, (width, height))
    blue = _from_above(right, rig, extrinsics, "right", canvas_from_road, (width, height))
    both = (orange > 0) & (blue > 0)
    if both.any():  # else cameras of different brightness would tint the whole road
        gain = float(orange[both].mean() / blue[both].mean())
        blue = np.clip(blue * gain, 0, 255).astype(np.uint8)
    green = np.asarray(cv2.addWeighted(orange, 0.5, blue, 0.5, 0.0), np.uint8)
    canvas = Canvas(np.dstack([blue, green, orange]), 1.0, text_size)
    lower_edge = height - 0.35 * TEXT_SCALE * 30 * width / MIN_WIDTH_PX
    for x_m in np.arange(0.0, BIRDS_EYE_FAR_M, GRID_ALONG_M):
        column = along * (x_m - near_m)
        if column > 0:
            _blend_line(canvas, [[column, 0.0], [column, float(height)]])
            canvas.text(f"{x_m:.0f} m", column + 4, lower_edge, size=0.8)
    for y_m in np.arange(-math.floor(BIRDS_EYE_HALF_WIDTH_M), BIRDS_EYE_HALF_WIDTH_M, GRID_ACROSS_M):
        row = across * (BIRDS_EYE_HALF_WIDTH_M - y_m)
        _blend_line(canvas, [[0.0, row], [float(width), row]])
    if travel is not None:
        _draw_travel(canvas, canvas_from_road, near_m, travel)
    if titled:
        _title(
            canvas,
            f"bird's-eye view, ahead is right: left camera orange, right camera blue, "
            f"coloured fringes: misfit, 1 m across = {across / along:.1f} x 1 m along",
        )
    return canvas.pixels


def _from_above(
    image: Image,
    rig: StereoRig,
    extrinsics: Extrinsics,
    side: Side,
    canvas_from_road: Array,
    size: tuple[int, int],
) -> Image:
    """Return the road as one camera sees it on the canvas, (H, W) uint8, 0 where it sees none."""
    image_from_canvas = image_from_road(rig, extrinsics, side) @ np.linalg.inv(canvas_from_road)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    # Black pixels of the image are road too. The value 0 is kept for places outside the image.
    return np.asarray(
        cv2.warpPerspective(np.maximum(image, 1), image_from_canvas, size, flags=flags), np.uint8
    )


def _blend_line(canvas: Canvas, points: list[list[float]]) -> None:
    """Draw a faint line on the bird's-eye view."""
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
    painted.polyline(np.array(points), YELLOW)
    cv2.addWeighted(painted.pixels, 0.3, canvas.pixels, 0.7, 0, dst=canvas.pixels)


def _draw_travel(canvas: Canvas, canvas_from_road: Array, near_m: float, travel: Travel) -> None:
    """Draw the direction of travel, from under the camera on."""

    def ends(heading: Array) -> Array:
        road = np.outer([near_m, BIRDS_EYE_FAR_M], [1.0, heading[1] / heading[0]])
        return apply_homography(canvas_from_road, road)

    left, right = map(ends, fan_of(travel))
    middle, label, step = ends(road_heading(travel.yaw_rad)), label_of(travel), canvas.line_height
    draw_fan(canvas, left, right)
    draw_cased(canvas, middle)
    # Above a line that leads to the right, below one that leads to the left: it has most room there.
    x = canvas.pixels.shape[1] - LABEL_SIZE * canvas.text_width(label) - 0.5 * step
    share = (x - middle[0, 0]) / (middle[1, 0] - middle[0, 0])
    upper, lower = (float((1.0 - share) * line[0, 1] + share * line[1, 1]) for line in (left, right))
    y = upper - 0.4 * step if middle[1, 1] > middle[0, 1] else lower + step
    height = canvas.pixels.shape[0]
    canvas.text(label, x, min(max(y, 2.2 * step), height - 1.5 * step), BLUE, size=LABEL_SIZE)


def _title(canvas: Canvas, text: str) -> None:
    canvas.text(text, 0.5 * canvas.line_height, canvas.line_height, size=0.8)
