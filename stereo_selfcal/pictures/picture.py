"""Pictures by which a person judges a calibration at a glance; drawn with OpenCV, imports no ROS.

The colours are told apart by people with any kind of colour vision; the verdict is also a word.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import Side, apply_homography, horizon_row, image_from_road, road_from_image
from ..core.geometry.pose import POSE_COMPONENTS, Extrinsics
from ..core.lanes.lane_pair import ImageLine, LanePattern
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from .canvas import (
    DARK,
    GREEN,
    MIN_WIDTH_PX,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    TEXT_SCALE,
    VERMILION,
    WHITE,
    YELLOW,
    Canvas,
    StripContent,
    dark_strip,
    to_ascii,
    verdict_strip,
)

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
# A stream of pictures is looked at in a window and sent over a network: no wider than this.
MAX_STREAM_WIDTH_PX = 1280

_GATE_COLUMNS = 3
_GAP = 5 * " "  # between two components of a pose
_WHOLE = 100.0  # from here on three digits are a whole number
_UNITS = {"standard deviations": "std"}  # what is too long for a column

_NEAREST_DEPTH_M = 0.5  # road points nearer to the image plane are not drawn
_MAX_POINTS = 40  # more dots on a line would hide it
_POLYLINE_POINTS = 32


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
    panels = [verdict_strip(verdict_of(result), width), view, _legend(width)]
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
        stripes: (N, 2) places [px] where the edge of a stripe was marked, whatever became of them.

    Returns:
        (scale H, scale W, 3) uint8 BGR.
    """
    size = (round(left.shape[1] * scale), round(left.shape[0] * scale))
    grey = cv2.resize(left, size, interpolation=cv2.INTER_LINEAR)
    canvas = Canvas(np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8), scale)
    extrinsics = None if result is None else shown_extrinsics(result)
    if extrinsics is not None and rig is not None and _fits(rig, left):
        _draw_grid(canvas, rig, extrinsics)
    if stripes is not None:
        canvas.specks(stripes, ORANGE)
    if extrinsics is not None and rig is not None and _fits(rig, left):
        ends = np.array([0.0, rig.width - 1.0])
        horizon = np.column_stack([ends, horizon_row(rig, extrinsics, ends)])
        canvas.polyline(horizon, SKY_BLUE, 2 * canvas.thickness)
    if result is None:
        return canvas.pixels
    above = 0.0 if result.pattern is None else float(result.pattern.vanishing_point[1])
    for line in result.unused_lines:
        ends = np.array([max(above, line.rows.min()), line.rows.max()])
        if ends[1] > ends[0]:  # what lies over the horizon is no line of the road
            canvas.polyline(np.column_stack([line.column_at(ends), ends]), ORANGE, canvas.thickness)
    if result.pattern is not None:
        _draw_pattern(canvas, result.pattern, left.shape[0])
    return canvas.pixels


def draw_debug_image(
    left: Image,
    rig: StereoRig | None,
    result: CalibrationResult | None,
    verdict: StripContent,
    stripes: Array | None = None,
) -> Image:
    """Compose a verdict and the camera view into the picture of a stream.

    Args:
        left: (H, W) uint8 image of the left camera, not empty.
        rig: The rig it comes from, None if it is not known.
        result: The calibration to draw over it, None if there is none.
        verdict: What is to be said of it.
        stripes: (N, 2) places [px] where the edge of a stripe was marked.

    Returns:
        (H', W', 3) uint8 BGR, :data:`MIN_WIDTH_PX` to :data:`MAX_STREAM_WIDTH_PX` wide.
    """
    view = draw_camera_view(left, rig, result, _stream_width(left) / left.shape[1], stripes)
    width = view.shape[1]
    return np.vstack([verdict_strip(verdict, width), view, _legend(width, with_stripes=True)])


def draw_fringes(
    left: Image, right: Image, rig: StereoRig, extrinsics: Extrinsics, verdict: StripContent
) -> Image:
    """Compose a verdict and the bird's-eye view into the picture of a stream.

    Args:
        left: (H, W) uint8 image of the left camera, of the rig's size.
        right: The same of the right camera.
        rig: The rig both images come from.
        extrinsics: Its pose over the road.
        verdict: What is to be said of it.

    Returns:
        (H', W', 3) uint8 BGR, as wide as :func:`draw_debug_image` of the same images.
    """
    width = _stream_width(left)
    return np.vstack([verdict_strip(verdict, width), draw_birds_eye(left, right, rig, extrinsics, width)])


def draw_notice(verdict: StripContent) -> Image:
    """Return a picture that says in words why there is nothing to show."""
    return verdict_strip(verdict, MIN_WIDTH_PX, round(MIN_WIDTH_PX * BIRDS_EYE_ASPECT))


def _stream_width(left: Image) -> int:
    """Return how wide a picture of a stream is [px]."""
    return int(min(max(left.shape[1], MIN_WIDTH_PX), MAX_STREAM_WIDTH_PX))


def draw_birds_eye(
    left: Image, right: Image, rig: StereoRig, extrinsics: Extrinsics, width: int = MIN_WIDTH_PX
) -> Image:
    """Lay the road as both cameras see it over each other, seen from above.

    The left camera is orange, the right one blue: where they agree the road is grey, where they do
    not it has coloured fringes, which red and cyan ones would not be for people who are blind to red or
    green. Driving direction to the right, left of the road up.

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
    orange = _from_above(left, rig, extrinsics, "left", canvas_from_road, (width, height))
    blue = _from_above(right, rig, extrinsics, "right", canvas_from_road, (width, height))
    both = (orange > 0) & (blue > 0)
    if both.any():  # cameras of different brightness would tint all of the road
        gain = float(orange[both].mean() / blue[both].mean())
        blue = np.clip(blue * gain, 0, 255).astype(np.uint8)
    green = np.asarray(cv2.addWeighted(orange, 0.5, blue, 0.5, 0.0), np.uint8)
    canvas = Canvas(np.dstack([blue, green, orange]), 1.0)
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
        f"bird's-eye view, ahead is right: left camera orange, right camera blue, "
        f"coloured fringes: misfit, 1 m across = {across / along:.1f} x 1 m along",
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


def _draw_grid(canvas: Canvas, rig: StereoRig, extrinsics: Extrinsics) -> None:
    """Draw the metric grid of the road, half transparent, with its distances."""
    matrix = image_from_road(rig, extrinsics, "left")
    # Under the image's lower edge, so that the lines run out of the picture.
    near_m = max(1.0, 0.5 * _near_edge_m(rig, extrinsics))
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
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
            x, y = canvas.pixel(seen[0])  # the rightmost one
            canvas.text(f"{x_m:.0f} m", x + 6 * canvas.thickness, y, YELLOW, size=0.8)


def _project(matrix: Array, x_m: Array, y_m: Array) -> Array:
    """Project road points to the image, (N, 2); NaN for those not in front of the camera."""
    homogeneous = np.column_stack([x_m, y_m, np.ones_like(x_m)]) @ matrix.T
    depth_m = np.where(homogeneous[:, 2:] > _NEAREST_DEPTH_M, homogeneous[:, 2:], np.nan)
    return np.asarray(homogeneous[:, :2] / depth_m)


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
    """Return at most so many measured points of a line that it stays visible, (N, 2)."""
    every = max(1, math.ceil(line.rows.size / _MAX_POINTS))
    return np.column_stack([line.columns, line.rows])[::every]


def _blend_line(canvas: Canvas, points: list[list[float]]) -> None:
    """Draw a faint line on the bird's-eye view."""
    painted = Canvas(canvas.pixels.copy(), canvas.scale)
    painted.polyline(np.array(points), YELLOW)
    cv2.addWeighted(painted.pixels, 0.3, canvas.pixels, 0.7, 0, dst=canvas.pixels)


def _title(canvas: Canvas, text: str) -> None:
    canvas.text(text, 0.5 * canvas.line_height, canvas.line_height, size=0.8)


def verdict_of(result: CalibrationResult) -> StripContent:
    """Return what is to be said of a result, in words and numbers."""
    if not result.accepted:
        return StripContent(f"REFUSED: {result.reason}", VERMILION, (result.message,))
    frames = f" from {result.n_frames} frames" if result.n_frames > 1 else ""
    return StripContent(f"CALIBRATED{frames}", GREEN, numbers(result))


def numbers(result: CalibrationResult) -> tuple[str, ...]:
    """Return the lines with an accepted result and what is to be noted of it."""
    pose, std = result.extrinsics, result.std
    if pose is None or std is None:
        return (result.message,)
    line = _GAP.join(f"{each.label} {each.describe(pose, std, fine=False)}" for each in POSE_COMPONENTS)
    return (line, "; ".join(result.notes)) if result.notes else (line,)


def _gates(result: CalibrationResult, width: int) -> Image:
    """Return the strip with the value of each gate beside its limit; a gate that refuses stands out."""
    step = 0.8 * dark_strip(width, 1).line_height
    n_rows = -(-len(result.gates) // _GATE_COLUMNS)
    strip = dark_strip(width, (n_rows + 0.8) * step)
    for number, gate in enumerate(result.gates):
        column, row = divmod(number, n_rows)
        unit = _UNITS.get(gate.unit, gate.unit)
        value = f"{_short(gate.value)} {unit}".rstrip()
        text = f"{gate.label}: {value} ({gate.bound} {_short(gate.threshold)})"
        x = (column + 0.03) * width / _GATE_COLUMNS
        mark, colour = ("+", GREEN) if gate.passed else ("x", VERMILION)
        x += strip.text(mark, x, (row + 1) * step, colour, size=0.8) + 0.3 * step
        strip.text(to_ascii(text), x, (row + 1) * step, WHITE if gate.passed else VERMILION, size=0.65)
    return strip.pixels


def _short(value: float) -> str:
    """Return three digits, and no exponent for what is large."""
    return f"{value:.0f}" if abs(value) >= _WHOLE else f"{value:.3g}"


def _legend(width: int, with_stripes: bool = False) -> Image:
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
