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

"""The image of the right camera with the lane lines, and where the road surface would have them.

A line of the left image that lies on the road has one place in the right image. Where a line that is taken
for paint lies elsewhere, it is above the road or below it, or one camera has turned.
"""

from __future__ import annotations

import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.plane import PlaneCamera, plane_from_pose
from ..core.geometry.pose import Extrinsics
from ..core.geometry.rays import pixel_rays
from ..core.lanes.lane_pair import ImageLine
from ..core.rejection import RejectReason
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from .camera_view import canvas_of, draw_line, fits, legend_strip
from .canvas import GREEN, VERMILION, WHITE, Canvas

# By these, lines and road surface contradict each other.
_REASONS = (RejectReason.TEXTURE_DISAGREES, RejectReason.LINES_INCONSISTENT, RejectReason.STAGES_DISAGREE)
_N_DASHES = 24
_ABOVE = 0.1  # of the height that is shown above the lines
_MOST_ASPECT = 0.6  # height over width of the part of the image that is shown


def contradicts(result: CalibrationResult) -> bool:
    """Whether a frame is refused because its lines and its road surface differ, and both can be drawn."""
    return result.reason in _REASONS and result.pattern is not None and _surface_pose(result) is not None


def draw_contradiction(right: Image, rig: StereoRig, result: CalibrationResult, scale: float) -> list[Image]:
    """Draw the lines of the right image, and dashed where the road surface has those of the left image.

    Args:
        right: (H, W) uint8 image of the right camera.
        rig: The rig it comes from.
        result: A refused result for which :func:`contradicts` holds.
        scale: Enlargement of the image.

    Returns:
        The part of the image with the lines, and its legend, (H', W', 3) uint8 BGR each; empty where the
        image has another size than the rig.
    """
    pose = _surface_pose(result)
    if result.pattern is None or pose is None or not fits(rig, right):
        return []
    canvas = canvas_of(right, scale)
    for of_left, of_right in zip(*result.pattern.lines, strict=True):
        first = float(result.pattern.vanishing_point[1])
        draw_line(canvas, of_right, first, rig.height, with_points=False)
        _draw_dashed(canvas, place_in_right_image(of_left, pose, rig, first))
    top = max(float(result.pattern.vanishing_point[1]) - _ABOVE * rig.height, 0.0)
    top = max(top, rig.height - _MOST_ASPECT * rig.width)
    entries = [
        ("right camera:", WHITE),
        ("- lane line", VERMILION),
        ("-- where the road surface has it", GREEN),
    ]
    view = canvas.pixels[round(top * scale) :]
    return [view, legend_strip(view.shape[1], entries)]


def place_in_right_image(line: ImageLine, pose: Extrinsics, rig: StereoRig, first_row: float) -> Array:
    """Return points (N, 2) [px] of the right image where a plane has a line of the left image.

    Args:
        line: The line of the left image.
        pose: Pose over the plane.
        rig: Intrinsics and baseline.
        first_row: Row where the line begins [px].
    """
    rows = np.linspace(first_row, rig.height - 1.0, 2 * _N_DASHES)
    columns = line.column_at(rows)
    plane = plane_from_pose(pose, rig, PlaneCamera.LEFT)
    disparity = plane.disparities(pixel_rays(rig, columns, rows))
    return np.column_stack([np.where(disparity > 0.0, columns - disparity, np.nan), rows])


def _surface_pose(result: CalibrationResult) -> Extrinsics | None:
    """Return the pose over the road surface: by its texture, else by dense disparities."""
    if result.surface is not None:
        return result.surface.pose
    return result.stages.get("coarse")


def _draw_dashed(canvas: Canvas, points: Array) -> None:
    for start in range(0, len(points) - 1, 2):
        canvas.polyline(points[start : start + 2], GREEN, 3 * canvas.thickness)
