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

"""The direction of travel over a picture of the road: a line under the camera, to where the car drives.

It is drawn where the yaw of the camera against it is known. Its uncertainty is a fan around the line.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import image_from_road
from ..core.geometry.pose import DEGREES, Extrinsics
from ..core.geometry.travel import Travel
from ..core.results import CalibrationResult
from ..core.types import Array
from .canvas import BLUE, WHITE, Canvas
from .road_grid import GRID_FAR_M, GRID_HALF_WIDTH_M, near_edge_m

LABEL_SIZE = 0.8  # that of the grid's distances
_FAN_OPACITY = 0.45
_LEAST_FAN_PX = 1.0  # a fan that is narrower lies under the line
_POLE = 1.2  # height of the label over the horizon, in lines of text
_BESIDE = 0.6  # distance of a label from what it names, in lines of text


def shown_travel(result: CalibrationResult) -> Travel | None:
    """Return the direction of travel to draw, None where it does not tell the yaw."""
    return result.travel if result.travel is not None and result.travel.tells_yaw else None


def label_of(travel: Travel) -> str:
    """Return the words beside the line."""
    yaw, std = DEGREES.text(travel.yaw_rad, "+"), DEGREES.number(float(travel.std[0]))
    return f"direction of travel: yaw {yaw} (std {std})"


def road_heading(yaw_rad: float) -> Array:
    """Return the direction of travel on the road (2,): ahead and to the left, of the camera's heading.

    Args:
        yaw_rad: Yaw of the camera against it [rad], > 0: the camera points left of it.
    """
    return np.array([np.cos(yaw_rad), -np.sin(yaw_rad)])


def fan_of(travel: Travel) -> tuple[Array, Array]:
    """Return the directions (2,) on the road one standard deviation to the left and to the right."""
    std_rad = float(travel.std[0])
    return road_heading(travel.yaw_rad - std_rad), road_heading(travel.yaw_rad + std_rad)


def vanishing_point(rig: StereoRig, pose: Extrinsics, heading: Array) -> Array:
    """Return where a direction on the road ends in the image of the left camera.

    Args:
        rig: The rig.
        pose: Its pose over the road.
        heading: (2,) direction on the road: ahead, to the left.

    Returns:
        (2,) image point [px], on the horizon; NaN where the camera does not look that way.
    """
    return _projected(image_from_road(rig, pose, "left"), [*heading, 0.0])


def draw_travel_line(canvas: Canvas, rig: StereoRig, pose: Extrinsics, travel: Travel) -> None:
    """Draw the direction of travel on the road under the left camera, up to the horizon.

    Args:
        canvas: The image.
        rig: Its rig.
        pose: Pose over the road.
        travel: The direction, which tells the yaw.
    """
    # From under the lower edge of the image, so that the line runs out of the picture.
    start_m = max(1.0, 0.5 * near_edge_m(rig, pose))
    matrix = image_from_road(rig, pose, "left")

    def ends(heading: Array) -> Array:
        return np.stack(
            [_projected(matrix, [*(start_m * heading), 1.0]), vanishing_point(rig, pose, heading)]
        )

    middle, (left, right) = ends(road_heading(travel.yaw_rad)), map(ends, fan_of(travel))
    if canvas.holds(np.concatenate([middle, left, right])):
        draw_fan(canvas, left, right)
        draw_cased(canvas, middle)


def draw_travel_flag(canvas: Canvas, rig: StereoRig, pose: Extrinsics, travel: Travel) -> None:
    """Mark where the car drives to, with a pole that carries the label; without one at the upper edge.

    The arguments are those of :func:`draw_travel_line`.
    """
    point = vanishing_point(rig, pose, road_heading(travel.yaw_rad))
    if not canvas.holds(point):
        return
    label, step = label_of(travel), canvas.line_height
    height, width = canvas.pixels.shape[:2]
    label_width = LABEL_SIZE * canvas.text_width(label)
    last_x = width - label_width - 0.5 * step
    (x, y), pole_px = canvas.pixel(point), _POLE * step
    if y > height + pole_px:  # all of it is below the image
        return
    if y - pole_px > step:
        draw_cased(canvas, np.array([point, point - [0.0, pole_px / canvas.scale]]))
        left, row = x - label_width / 2, min(y - pole_px, height - 0.3 * step)
    else:  # the horizon is at the upper edge, or above it: beside the line, away from the grid's distances
        left, right = x - _BESIDE * step - label_width, x + _BESIDE * step
        beyond = -np.tan(travel.yaw_rad) * GRID_FAR_M < -GRID_HALF_WIDTH_M
        left = right if (beyond and right < last_x) or left < 0.0 else left
        row = max(y, step)
    canvas.dot(point, 5.0, WHITE)
    canvas.dot(point, 3.5, BLUE)
    canvas.text(label, max(min(left, last_x), 0.5 * step), row, BLUE, size=LABEL_SIZE)


def draw_fan(canvas: Canvas, left: Array, right: Array) -> None:
    """Tint what lies between two lines (2, 2) [px], where they are more than a pixel apart at their end."""
    if np.abs(left[1] - right[1]).max() * canvas.scale <= _LEAST_FAN_PX:
        return
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
    painted.polygon(np.concatenate([left, right[::-1]]), BLUE)
    cv2.addWeighted(painted.pixels, _FAN_OPACITY, canvas.pixels, 1 - _FAN_OPACITY, 0, dst=canvas.pixels)


def draw_cased(canvas: Canvas, points: Array) -> None:
    """Draw a line that is no paint on the road: blue, with white along both sides."""
    canvas.polyline(points, WHITE, 4 * canvas.thickness)
    canvas.polyline(points, BLUE, 2 * canvas.thickness)


def _projected(matrix: Array, road: Array | list[float]) -> Array:
    """Return the image point (2,) of a homogeneous road point (3,); NaN behind the camera."""
    column, row, depth = matrix @ road
    projected: Array = np.array([column, row]) / (depth if depth > 0.0 else np.nan)
    return projected
