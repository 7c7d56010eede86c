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

"""The image of a camera with what was found in it: road surface, points, lines, horizon, grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.evidence.road_surface import SurfaceCells
from ..core.geometry.homography import horizon_row
from ..core.geometry.pose import Extrinsics
from ..core.geometry.travel import Travel
from ..core.lanes.lane_pair import ImageLine, LanePattern
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from .canvas import (
    BLUE,
    DARK,
    GREEN,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    WHITE,
    YELLOW,
    Canvas,
    Colour,
    dark_strip,
)
from .road_grid import draw_grid
from .surface_cells import draw_cells
from .travel_direction import draw_travel_flag, draw_travel_line, shown_travel

_MAX_POINTS = 40  # more dots on a line would hide it
_POLYLINE_POINTS = 32
_LEGEND_SIZE = 0.9


def shown_extrinsics(result: CalibrationResult) -> Extrinsics | None:
    """Return the pose to draw: that of the result, or of a refused frame that of its last stage."""
    if result.extrinsics is not None:
        return result.extrinsics
    return list(result.stages.values())[-1] if result.stages else None


def fits(rig: StereoRig, *images: Image) -> bool:
    """Whether the images have the size of the rig, so that its geometry applies to them."""
    return all(image.shape == (rig.height, rig.width) for image in images)


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """What is drawn over an image of the left camera; None or empty where there is none.

    Attributes:
        pose: Pose whose horizon and grid are drawn.
        surface: The road surface.
        pattern: The two lane lines, with extra lines.
        lane_line: The single lane line of a frame without two.
        other_lines: Other lines that were found.
        stripes: (N, 2) image points [px] on stripes.
        travel: Direction of travel, which tells the yaw; it is drawn with the pose.
    """

    pose: Extrinsics | None = None
    surface: SurfaceCells | None = None
    pattern: LanePattern | None = None
    lane_line: ImageLine | None = None
    other_lines: tuple[ImageLine, ...] = ()
    stripes: Array | None = None
    travel: Travel | None = None

    @classmethod
    def of(
        cls,
        left: Image,
        rig: StereoRig | None,
        result: CalibrationResult | None,
        stripes: Array | None = None,
    ) -> Drawn:
        """Return what of a result can be drawn over an image; arguments as of :func:`draw_camera_view`."""
        if result is None:
            return cls(stripes=stripes)
        fitting = rig is not None and fits(rig, left)
        return cls(
            shown_extrinsics(result) if fitting else None,
            result.surface if fitting else None,
            result.pattern,
            result.lane_line,
            result.unused_lines,
            stripes,
            shown_travel(result) if fitting else None,
        )


def draw_camera_view(
    left: Image,
    rig: StereoRig | None,
    result: CalibrationResult | None,
    scale: float = 1.0,
    stripes: Array | None = None,
    text_size: float = 1.0,
) -> Image:
    """Draw road surface, points, lines, horizon, road grid and direction of travel over the left image.

    Args:
        left: (H, W) uint8 image of the left camera, not empty.
        rig: The rig it comes from, None if it is not known.
        result: Its calibration, accepted or not; None if there is none.
        scale: Enlargement of the image.
        stripes: (N, 2) image points [px] on stripes, whether or not a line was fitted to them.
        text_size: How many times as large text is as usual, for a picture that is shown smaller.

    Returns:
        (scale H, scale W, 3) uint8 BGR.
    """
    canvas = canvas_of(left, scale, text_size)
    drawn = Drawn.of(left, rig, result, stripes)
    if drawn.surface is not None and rig is not None:
        draw_cells(canvas, rig, drawn.surface)
    if drawn.pose is not None and rig is not None:
        if drawn.travel is not None:  # before the grid, so that its distances can be read
            draw_travel_line(canvas, rig, drawn.pose, drawn.travel)
        draw_grid(canvas, rig, drawn.pose)
    if drawn.stripes is not None:
        canvas.specks(drawn.stripes, ORANGE)
    if drawn.pose is not None and rig is not None:
        ends = np.array([0.0, rig.width - 1.0])
        horizon = np.column_stack([ends, horizon_row(rig, drawn.pose, ends)])
        canvas.polyline(horizon, SKY_BLUE, 2 * canvas.thickness)
        if drawn.travel is not None:
            draw_travel_flag(canvas, rig, drawn.pose, drawn.travel)
    above = _first_row(drawn, rig)
    for line in drawn.other_lines:
        ends = np.array([max(above, line.rows.min()), line.rows.max()])
        if ends[1] > ends[0]:  # a line above the horizon is no line of the road
            canvas.polyline(np.column_stack([line.column_at(ends), ends]), ORANGE, canvas.thickness)
    if drawn.pattern is not None:
        _draw_pattern(canvas, drawn.pattern, left.shape[0])
    if drawn.lane_line is not None:
        draw_line(canvas, drawn.lane_line, max(above, float(drawn.lane_line.rows.min())), left.shape[0])
    return canvas.pixels


def _first_row(drawn: Drawn, rig: StereoRig | None) -> float:
    """Return the row above which no line is one of the road [px]: where lines meet, else the horizon."""
    if drawn.pattern is not None:
        return float(drawn.pattern.vanishing_point[1])
    if drawn.pose is None or rig is None:
        return 0.0
    return max(float(horizon_row(rig, drawn.pose, rig.cx)), 0.0)


def canvas_of(image: Image, scale: float, text_size: float = 1.0) -> Canvas:
    """Return an enlarged grey image to draw on."""
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    grey = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    return Canvas(np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8), scale, text_size)


def legend(width: int, drawn: Drawn) -> Image:
    """Return the strip that names the colours of what is drawn in the camera view."""
    lines = drawn.pattern is not None or drawn.lane_line is not None
    entries: list[tuple[str, Colour]] = [("left camera:", WHITE)]
    for text, colour, shown in (
        (". stripe", ORANGE, drawn.stripes is not None),
        ("o measured edge", WHITE, lines),
        ("- lane line", VERMILION, lines),
        ("- other line", ORANGE, bool(drawn.other_lines)),
        ("- horizon", SKY_BLUE, drawn.pose is not None),
        ("o lines meet", PURPLE, drawn.pattern is not None),
        ("- direction of travel", BLUE, drawn.pose is not None and drawn.travel is not None),
        ("# road, 1 m x 5 m", YELLOW, drawn.pose is not None),
        ("# road surface", GREEN, drawn.surface is not None and bool(drawn.surface.agrees.any())),
        ("x beside it", VERMILION, drawn.surface is not None and _some_beside(drawn.surface)),
    ):
        if shown:
            entries.append((text, colour))
    if len(entries) == 1:
        entries.append(("no line and no road surface was found", WHITE))
    return legend_strip(width, entries)


def legend_strip(width: int, entries: list[tuple[str, Colour]]) -> Image:
    """Return a strip with words in their colours, smaller where they are many."""
    step = dark_strip(width, 1).line_height
    strip = dark_strip(width, 1.5 * step)
    x = 0.5 * step
    wanted = sum(strip.text_width(text) + step for text, _ in entries)
    size = min(_LEGEND_SIZE, (width - 2 * x) / wanted)
    for text, colour in entries:
        x += strip.text(text, x, step, colour, size=size) + size * step
    return strip.pixels


def _some_beside(surface: SurfaceCells) -> bool:
    return bool(np.any(np.isfinite(surface.height_m) & ~surface.agrees))


def _draw_pattern(canvas: Canvas, pattern: LanePattern, height: int) -> None:
    """Draw the lines of the left camera, the points they were measured at, and where they meet."""
    for line in pattern.lines[0]:
        draw_line(canvas, line, float(pattern.vanishing_point[1]), height)
    canvas.dot(pattern.vanishing_point, 7.0, DARK, 4 * canvas.thickness)
    canvas.dot(pattern.vanishing_point, 7.0, PURPLE, 2 * canvas.thickness)


def draw_line(
    canvas: Canvas, line: ImageLine, first_row: float, height: int, with_points: bool = True
) -> None:
    """Draw a lane line down to the bottom of the image.

    Args:
        canvas: The image.
        line: The line.
        first_row: Row where it begins [px].
        height: Height of the image [px].
        with_points: Whether to draw points it was measured at.
    """
    rows = np.linspace(first_row, height - 1.0, _POLYLINE_POINTS)
    canvas.polyline(np.column_stack([line.column_at(rows), rows]), VERMILION, 2 * canvas.thickness)
    for point in _some_points(line) if with_points else ():
        canvas.dot(point, 3.5, DARK)
        canvas.dot(point, 2.5, WHITE)


def _some_points(line: ImageLine) -> Array:
    """Return measured points of a line, (N, 2), so few that the line stays visible."""
    every = max(1, math.ceil(line.rows.size / _MAX_POINTS))
    return np.column_stack([line.columns, line.rows])[::every]
