"""The image of the left camera with what was found in it: points, lines, horizon and the grid of the road."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import horizon_row
from ..core.geometry.pose import Extrinsics
from ..core.lanes.lane_pair import ImageLine, LanePattern
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from .canvas import DARK, ORANGE, PURPLE, SKY_BLUE, VERMILION, WHITE, YELLOW, Canvas, dark_strip
from .road_grid import draw_grid

_MAX_POINTS = 40  # more dots on a line would hide it
_POLYLINE_POINTS = 32


def shown_extrinsics(result: CalibrationResult) -> Extrinsics | None:
    """Return the pose to draw: that of the result, or of a refused frame that of its last stage."""
    if result.extrinsics is not None:
        return result.extrinsics
    return list(result.stages.values())[-1] if result.stages else None


def fits(rig: StereoRig, *images: Image) -> bool:
    """Whether the images have the size of the rig, so that its geometry applies to them."""
    return all(image.shape == (rig.height, rig.width) for image in images)


def draw_camera_view(
    left: Image,
    rig: StereoRig | None,
    result: CalibrationResult | None,
    scale: float = 1.0,
    stripes: Array | None = None,
) -> Image:
    """Draw points, lines, horizon and road grid over the image of the left camera.

    Args:
        left: (H, W) uint8 image of the left camera, not empty.
        rig: The rig it comes from, None if it is not known.
        result: Its calibration, accepted or not; None if there is none.
        scale: Enlargement of the image.
        stripes: (N, 2) image points [px] on stripes, whether or not a line was fitted to them.

    Returns:
        (scale H, scale W, 3) uint8 BGR.
    """
    size = (round(left.shape[1] * scale), round(left.shape[0] * scale))
    grey = cv2.resize(left, size, interpolation=cv2.INTER_LINEAR)
    canvas = Canvas(np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8), scale)
    extrinsics = None if result is None else shown_extrinsics(result)
    if extrinsics is not None and rig is not None and fits(rig, left):
        draw_grid(canvas, rig, extrinsics)
    if stripes is not None:
        canvas.specks(stripes, ORANGE)
    if extrinsics is not None and rig is not None and fits(rig, left):
        ends = np.array([0.0, rig.width - 1.0])
        horizon = np.column_stack([ends, horizon_row(rig, extrinsics, ends)])
        canvas.polyline(horizon, SKY_BLUE, 2 * canvas.thickness)
    if result is None:
        return canvas.pixels
    above = 0.0 if result.pattern is None else float(result.pattern.vanishing_point[1])
    for line in result.unused_lines:
        ends = np.array([max(above, line.rows.min()), line.rows.max()])
        if ends[1] > ends[0]:  # a line above the horizon is no line of the road
            canvas.polyline(np.column_stack([line.column_at(ends), ends]), ORANGE, canvas.thickness)
    if result.pattern is not None:
        _draw_pattern(canvas, result.pattern, left.shape[0])
    return canvas.pixels


def legend(width: int, with_stripes: bool = False) -> Image:
    """Return the strip that names the colours of the camera view."""
    step = dark_strip(width, 1).line_height
    strip = dark_strip(width, 1.5 * step)
    x = 0.5 * step
    entries = [
        ("left camera:", WHITE),
        ("o measured edge", WHITE),
        ("- lane line", VERMILION),
        ("- other line", ORANGE),
        ("- horizon", SKY_BLUE),
        ("o lines meet", PURPLE),
        ("# road, 1 m x 5 m", YELLOW),
    ]
    if with_stripes:
        entries[0] = (". stripe", ORANGE)
    for text, colour in entries:
        x += strip.text(text, x, step, colour, size=0.9) + step
    return strip.pixels


def _draw_pattern(canvas: Canvas, pattern: LanePattern, height: int) -> None:
    """Draw the lines of the left camera, the points they were measured at, and where they meet."""
    for line in pattern.lines[0]:
        rows = np.linspace(float(pattern.vanishing_point[1]), height - 1.0, _POLYLINE_POINTS)
        canvas.polyline(np.column_stack([line.column_at(rows), rows]), VERMILION, 2 * canvas.thickness)
        for point in _some_points(line):
            canvas.dot(point, 3.5, DARK)
            canvas.dot(point, 2.5, WHITE)
    canvas.dot(pattern.vanishing_point, 7.0, DARK, 4 * canvas.thickness)
    canvas.dot(pattern.vanishing_point, 7.0, PURPLE, 2 * canvas.thickness)


def _some_points(line: ImageLine) -> Array:
    """Return measured points of a line, (N, 2), so few that the line stays visible."""
    every = max(1, math.ceil(line.rows.size / _MAX_POINTS))
    return np.column_stack([line.columns, line.rows])[::every]
