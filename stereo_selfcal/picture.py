"""Pictures by which a person judges a calibration at a glance; drawn with OpenCV, imports no ROS.

Colours are BGR. They are those of Okabe and Ito ("Color Universal Design", 2008), which people
with any kind of colour vision can tell apart; the verdict is also a word.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from .core.extrinsics import Array, Extrinsics
from .core.geometry import Side, apply_homography, horizon_row, image_from_road, road_from_image
from .core.images import Image
from .core.pattern import ImageLine, LanePattern
from .core.results import CalibrationResult
from .core.rig import StereoRig

Colour = tuple[int, int, int]

ORANGE: Colour = (0, 159, 230)
SKY_BLUE: Colour = (233, 180, 86)
GREEN: Colour = (115, 158, 0)
YELLOW: Colour = (66, 228, 240)
VERMILION: Colour = (0, 94, 213)
PURPLE: Colour = (167, 121, 204)
WHITE: Colour = (255, 255, 255)
DARK: Colour = (40, 40, 40)

# Metric grid on the road: cells of 1 m across and 5 m along, as far as paint can be judged.
GRID_ACROSS_M = 1.0
GRID_ALONG_M = 5.0
GRID_HALF_WIDTH_M = 4.0
GRID_FAR_M = 30.0
GRID_LABELS_M = (5.0, 10.0, 20.0, 30.0)
GRID_OPACITY = 0.45
LABEL_MARGIN = 0.06  # of the width, for a distance at the right edge

# Bird's-eye view: a lane to either side of the rig, stretched across the road, because the misfit
# between the cameras shows across the road and is a matter of millimetres.
BIRDS_EYE_FAR_M = 35.0
BIRDS_EYE_HALF_WIDTH_M = 3.5
BIRDS_EYE_ASPECT = 0.42  # height over width of the panel
BIRDS_EYE_NEAR_M = (2.0, 15.0)  # bounds of where the view begins: at the lower edge of the image

# A smaller image is enlarged to this width, so that sub-pixel differences and text can be seen.
MIN_WIDTH_PX = 960
# Text of this relative size is legible on a canvas of MIN_WIDTH_PX.
TEXT_SCALE = 0.55
FONT = cv2.FONT_HERSHEY_SIMPLEX

_GATE_COLUMNS = 3
_WHOLE = 100.0  # from here on three digits are a whole number
_UNITS = {"standard deviations": "std"}  # what is too long for a column

_SHIFT = 4  # OpenCV takes coordinates in 1/16 px
_NEAREST_DEPTH_M = 0.5  # road points nearer to the image plane are not drawn
_MAX_POINTS = 40  # more dots on a line would hide it
_POLYLINE_POINTS = 32


@dataclass(frozen=True, slots=True)
class _Canvas:
    """A picture ``scale`` times as large as the camera image it shows."""

    pixels: Image
    scale: float

    @property
    def thickness(self) -> int:
        """Line thickness [px] that looks the same in pictures of any size."""
        return max(1, round(float(self.pixels.shape[1]) / MIN_WIDTH_PX))

    def position(self, points: npt.ArrayLike) -> npt.NDArray[np.int32]:
        """Return image points (..., 2) [px] in this picture, in OpenCV's fixed-point numbers."""
        xy = (np.asarray(points, dtype=np.float64) + 0.5) * self.scale - 0.5  # pixel centres are integers
        return np.round(xy * (1 << _SHIFT)).astype(np.int32)

    def polyline(self, points: Array, colour: Colour, thickness: int | None = None) -> None:
        """Draw a polyline through image points (N, 2) [px], leaving out those far outside."""
        limit = 4.0 * max(self.pixels.shape[:2]) / self.scale
        for start, end in pairwise(points):
            if np.isfinite([start, end]).all() and np.abs([start, end]).max() < limit:
                (a, b), size = self.position([start, end]).tolist(), thickness or self.thickness
                cv2.line(self.pixels, a, b, colour, size, cv2.LINE_AA, _SHIFT)

    def dot(self, point: Array, radius_px: float, colour: Colour, thickness: int = -1) -> None:
        """Draw a dot, or with a positive thickness a ring."""
        radius = round(radius_px * self.thickness * (1 << _SHIFT))
        cv2.circle(self.pixels, self.position(point).tolist(), radius, colour, thickness, cv2.LINE_AA, _SHIFT)

    def text(self, text: str, x: float, y: float, colour: Colour = WHITE, size: float = 1.0) -> int:
        """Write on a dark plate, the lower left corner at (x, y) of this picture; return the width [px]."""
        scale = size * TEXT_SCALE * self.pixels.shape[1] / MIN_WIDTH_PX
        # The fonts of OpenCV 4 and 5 differ in width; what would run out of the picture is made smaller.
        wanted = cv2.getTextSize(text, FONT, scale, self.thickness)[0][0]
        scale *= min(1.0, max(self.pixels.shape[1] - x, 1) / max(wanted, 1))
        (width, height), below = cv2.getTextSize(text, FONT, scale, self.thickness)
        left, baseline, margin = round(x), round(y), 2 * self.thickness
        rows = slice(max(baseline - height - margin, 0), max(baseline + below, 0))
        columns = slice(max(left - margin, 0), max(left + width + margin, 0))
        self.pixels[rows, columns] = DARK
        cv2.putText(self.pixels, text, (left, baseline), FONT, scale, colour, self.thickness, cv2.LINE_AA)
        return int(width)


def draw_overview(left: Image, right: Image, rig: StereoRig, result: CalibrationResult) -> Image:
    """Compose verdict, camera view and bird's-eye view into one picture.

    Args:
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        result: Their calibration, accepted or not.

    Returns:
        (H', W', 3) uint8 BGR, at least :data:`MIN_WIDTH_PX` wide.
    """
    if left.size == 0:
        left = np.zeros((rig.height, rig.width), dtype=np.uint8)
    view = draw_camera_view(left, rig, result, max(1.0, MIN_WIDTH_PX / left.shape[1]))
    width = view.shape[1]
    panels = [_header(result, width), view, _legend(width)]
    if result.gates:
        panels.append(_gates(result, width))
    extrinsics = shown_extrinsics(result)
    if extrinsics is not None and _fits(rig, left, right):
        panels.append(draw_birds_eye(left, right, rig, extrinsics, width))
    return np.vstack(panels)


def shown_extrinsics(result: CalibrationResult) -> Extrinsics | None:
    """Return the pose to draw: the result, or what the last stage had found before the refusal."""
    if result.extrinsics is not None:
        return result.extrinsics
    return list(result.stages.values())[-1] if result.stages else None


def draw_camera_view(left: Image, rig: StereoRig, result: CalibrationResult, scale: float = 1.0) -> Image:
    """Draw points, lines, horizon and road grid over the image of the left camera.

    Args:
        left: (H, W) uint8 image of the left camera, not empty.
        rig: The rig it comes from.
        result: Its calibration, accepted or not.
        scale: Enlargement of the image.

    Returns:
        (scale H, scale W, 3) uint8 BGR.
    """
    size = (round(left.shape[1] * scale), round(left.shape[0] * scale))
    grey = cv2.resize(left, size, interpolation=cv2.INTER_LINEAR)
    canvas = _Canvas(np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8), scale)
    extrinsics = shown_extrinsics(result)
    if extrinsics is not None and _fits(rig, left):
        _draw_grid(canvas, rig, extrinsics)
        ends = np.array([0.0, rig.width - 1.0])
        horizon = np.column_stack([ends, horizon_row(rig, extrinsics, ends)])
        canvas.polyline(horizon, SKY_BLUE, 2 * canvas.thickness)
    above = 0.0 if result.pattern is None else float(result.pattern.vanishing_point[1])
    for line in result.unused_lines:
        ends = np.array([max(above, line.rows.min()), line.rows.max()])
        if ends[1] > ends[0]:  # what lies over the horizon is no line of the road
            canvas.polyline(np.column_stack([line.column_at(ends), ends]), ORANGE, canvas.thickness)
    if result.pattern is not None:
        _draw_pattern(canvas, result.pattern, left.shape[0])
    return canvas.pixels


def draw_birds_eye(
    left: Image, right: Image, rig: StereoRig, extrinsics: Extrinsics, width: int = MIN_WIDTH_PX
) -> Image:
    """Lay the road as both cameras see it over each other, seen from above.

    The left camera is red, the right one cyan: where they agree the road is grey, where they do
    not it has coloured fringes. Driving direction to the right, left of the road up.

    Args:
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        extrinsics: Its pose over the road.
        width: Width of the picture [px].

    Returns:
        (H', width, 3) uint8 BGR.
    """
    height = round(width * BIRDS_EYE_ASPECT)
    near_m = _near_edge_m(rig, extrinsics)
    along, across = width / (BIRDS_EYE_FAR_M - near_m), height / (2 * BIRDS_EYE_HALF_WIDTH_M)  # px per m
    canvas_from_road = np.array(
        [[along, 0.0, -along * near_m], [0.0, -across, across * BIRDS_EYE_HALF_WIDTH_M], [0.0, 0.0, 1.0]]
    )
    red = _from_above(left, rig, extrinsics, "left", canvas_from_road, (width, height))
    cyan = _from_above(right, rig, extrinsics, "right", canvas_from_road, (width, height))
    both = (red > 0) & (cyan > 0)
    if both.any():  # cameras of different brightness would tint all of the road
        gain = float(red[both].mean() / cyan[both].mean())
        cyan = np.clip(cyan * gain, 0, 255).astype(np.uint8)
    canvas = _Canvas(np.dstack([cyan, cyan, red]), 1.0)
    lower_edge = height - 0.35 * TEXT_SCALE * 30 * width / MIN_WIDTH_PX
    for x_m in np.arange(0.0, BIRDS_EYE_FAR_M, GRID_ALONG_M):
        column = along * (x_m - near_m)
        if column > 0:
            _blend_line(canvas, [[column, 0.0], [column, float(height)]])
            canvas.text(f"{x_m:.0f} m", column + 4, lower_edge, size=0.8)
    for y_m in np.arange(-math.floor(BIRDS_EYE_HALF_WIDTH_M), BIRDS_EYE_HALF_WIDTH_M, GRID_ACROSS_M):
        row = across * (BIRDS_EYE_HALF_WIDTH_M - y_m)
        _blend_line(canvas, [[0.0, row], [float(width), row]])
    _title(
        canvas,
        f"bird's-eye view, ahead is right: left camera red, right camera cyan, "
        f"1 m across = {across / along:.1f} x 1 m along",
    )
    return canvas.pixels


def _fits(rig: StereoRig, *images: Image) -> bool:
    """Whether the images are those the rig describes, so that its geometry applies to them."""
    return all(image.shape == (rig.height, rig.width) for image in images)


def _near_edge_m(rig: StereoRig, extrinsics: Extrinsics) -> float:
    """Return the distance at which the lower edge of the image meets the road, within bounds."""
    nearest, farthest = BIRDS_EYE_NEAR_M
    x_m = float(apply_homography(road_from_image(rig, extrinsics, "left"), [rig.cx, rig.height - 1.0])[0])
    return min(max(x_m, nearest), farthest) if x_m > 0 else nearest


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
    # Black pixels of the image are road too; 0 is kept for what is outside.
    return np.asarray(
        cv2.warpPerspective(np.maximum(image, 1), image_from_canvas, size, flags=flags), np.uint8
    )


def _draw_grid(canvas: _Canvas, rig: StereoRig, extrinsics: Extrinsics) -> None:
    """Draw the metric grid of the road, half transparent, with its distances."""
    matrix = image_from_road(rig, extrinsics, "left")
    # Under the image's lower edge, so that the lines run out of the picture.
    near_m = max(1.0, 0.5 * _near_edge_m(rig, extrinsics))
    painted = _Canvas(canvas.pixels.copy(), canvas.scale)
    along_m = np.geomspace(near_m, GRID_FAR_M, _POLYLINE_POINTS)
    across_m = np.linspace(-GRID_HALF_WIDTH_M, GRID_HALF_WIDTH_M, _POLYLINE_POINTS)
    for y_m in np.arange(-GRID_HALF_WIDTH_M, GRID_HALF_WIDTH_M + GRID_ACROSS_M, GRID_ACROSS_M):
        painted.polyline(_project(matrix, along_m, np.full_like(along_m, y_m)), YELLOW)
    for x_m in np.arange(GRID_ALONG_M, GRID_FAR_M + GRID_ALONG_M, GRID_ALONG_M):
        painted.polyline(_project(matrix, np.full_like(across_m, x_m), across_m), YELLOW)
    cv2.addWeighted(painted.pixels, GRID_OPACITY, canvas.pixels, 1 - GRID_OPACITY, 0, dst=canvas.pixels)
    for x_m in GRID_LABELS_M:
        points = _project(matrix, np.full_like(across_m, x_m), across_m)
        seen = points[points[:, 0] < (1 - LABEL_MARGIN) * rig.width]  # false for NaN
        if seen.size:
            x, y = canvas.position(seen[0]) / (1 << _SHIFT)  # the rightmost one
            canvas.text(f"{x_m:.0f} m", x + 6 * canvas.thickness, y, YELLOW, size=0.8)


def _project(matrix: Array, x_m: Array, y_m: Array) -> Array:
    """Project road points to the image, (N, 2); NaN for those not in front of the camera."""
    homogeneous = np.column_stack([x_m, y_m, np.ones_like(x_m)]) @ matrix.T
    depth_m = np.where(homogeneous[:, 2:] > _NEAREST_DEPTH_M, homogeneous[:, 2:], np.nan)
    return np.asarray(homogeneous[:, :2] / depth_m)


def _draw_pattern(canvas: _Canvas, pattern: LanePattern, height: int) -> None:
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
    """Return at most so many measured points of a line that it stays visible, (N, 2)."""
    every = max(1, math.ceil(line.rows.size / _MAX_POINTS))
    return np.column_stack([line.columns, line.rows])[::every]


def _blend_line(canvas: _Canvas, points: list[list[float]]) -> None:
    """Draw a faint line on the bird's-eye view."""
    painted = _Canvas(canvas.pixels.copy(), canvas.scale)
    painted.polyline(np.array(points), YELLOW)
    cv2.addWeighted(painted.pixels, 0.3, canvas.pixels, 0.7, 0, dst=canvas.pixels)


def _title(canvas: _Canvas, text: str) -> None:
    canvas.text(text, 0.5 * _line_height(canvas), _line_height(canvas), size=0.8)


def _line_height(canvas: _Canvas) -> float:
    """Distance of two lines of text [px]."""
    return 44 * TEXT_SCALE * float(canvas.pixels.shape[1]) / MIN_WIDTH_PX


def _header(result: CalibrationResult, width: int) -> Image:
    """Return the strip with the verdict in words and numbers."""
    verdict, colour = ("CALIBRATED", GREEN) if result.accepted else (f"REFUSED: {result.reason}", VERMILION)
    if result.accepted and result.n_frames > 1:
        verdict += f" from {result.n_frames} frames"
    lines = _numbers(result) if result.accepted else textwrap.wrap(_ascii(result.message), 95)
    strip = _Canvas(np.zeros((1, width, 3), dtype=np.uint8), 1.0)
    step = _line_height(strip)
    strip = _Canvas(np.full((round((len(lines) + 1.9) * step), width, 3), DARK, dtype=np.uint8), 1.0)
    cv2.rectangle(strip.pixels, (0, 0), (round(0.4 * step), strip.pixels.shape[0]), colour, cv2.FILLED)
    strip.text(verdict, 0.9 * step, 1.15 * step, size=1.3)
    for number, line in enumerate(lines):
        strip.text(line, 0.9 * step, (2.3 + number) * step)
    return strip.pixels


def _numbers(result: CalibrationResult) -> list[str]:
    pose, std = result.extrinsics, result.std
    if pose is None or std is None:
        return [_ascii(result.message)]
    return [
        f"height {pose.height_m:.4f} m (std {std.height_m * 1e3:.1f} mm)     "
        f"pitch {math.degrees(pose.pitch_rad):+.3f} deg (std {math.degrees(std.pitch_rad):.4f})     "
        f"roll {math.degrees(pose.roll_rad):+.3f} deg (std {math.degrees(std.roll_rad):.4f})",
        *textwrap.wrap(_ascii("; ".join(result.notes)), 95),
    ]


def _ascii(text: str) -> str:
    """OpenCV's fonts know nothing else."""
    return text.encode("ascii", "replace").decode()


def _gates(result: CalibrationResult, width: int) -> Image:
    """Return the strip with what each gate has measured beside its limit; the closed one stands out."""
    strip = _Canvas(np.zeros((1, width, 3), dtype=np.uint8), 1.0)
    step = 0.8 * _line_height(strip)
    n_rows = -(-len(result.gates) // _GATE_COLUMNS)
    strip = _Canvas(np.full((round((n_rows + 0.8) * step), width, 3), DARK, dtype=np.uint8), 1.0)
    for number, gate in enumerate(result.gates):
        column, row = divmod(number, n_rows)
        unit = _UNITS.get(gate.unit, gate.unit)
        text = f"{gate.name}: {_short(gate.value)} {unit} (limit {_short(gate.threshold)})"
        x = (column + 0.03) * width / _GATE_COLUMNS
        mark, colour = ("+", GREEN) if gate.passed else ("x", VERMILION)
        x += strip.text(mark, x, (row + 1) * step, colour, size=0.8) + 0.3 * step
        strip.text(_ascii(text), x, (row + 1) * step, WHITE if gate.passed else VERMILION, size=0.65)
    return strip.pixels


def _short(value: float) -> str:
    """Return three digits, and no exponent for what is large."""
    return f"{value:.0f}" if abs(value) >= _WHOLE else f"{value:.3g}"


def _legend(width: int) -> Image:
    """Return the strip that names the colours of the camera view."""
    strip = _Canvas(np.zeros((1, width, 3), dtype=np.uint8), 1.0)
    step = _line_height(strip)
    strip = _Canvas(np.full((round(1.5 * step), width, 3), DARK, dtype=np.uint8), 1.0)
    x = 0.5 * step
    for text, colour in (
        ("left camera:", WHITE),
        ("o measured edge", WHITE),
        ("- lane line", VERMILION),
        ("- other line", ORANGE),
        ("- horizon", SKY_BLUE),
        ("o lines meet", PURPLE),
        ("# road, 1 m x 5 m", YELLOW),
    ):
        x += strip.text(text, x, step, colour, size=0.9) + step
    return strip.pixels
