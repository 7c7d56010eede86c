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

"""The stripes of a frame before in the next one: found again along their lines, and fitted once more.

Between two frames a car drifts in its lane, turns and pitches. The left edges of the boundaries are measured
in the left image near where they are expected; from where they meet follows the pitch, and from where they
lie the yaw and their distances. This is good to a pixel or two, and the fit of the grey values does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..lanes.hough import HoughPeak
from ..lanes.lane_pair import ExtraLine, ImageLine, LanePattern
from ..lanes.line_fit import fit_lines
from ..lanes.line_geometry import lane_in_road
from ..lanes.stripe_points import edge_response, noise_grey
from ..rejection import Bound, NotFitted
from ..road.stripe_model import predict_edges
from ..types import Array, Image
from .line_covariance import Bends, bends_of_lines
from .stripe_fit import StripeFit, refine_again


@dataclass(frozen=True, slots=True, eq=False)
class FollowedStripes:
    """Stripes that were found again.

    Attributes:
        fit: The fit of their grey values.
        pattern: Their lines under it.
        bends: Curvatures of the boundaries, as the left image shows them.
    """

    fit: StripeFit
    pattern: LanePattern
    bends: Bends


def follow_stripes(
    images: tuple[Image, Image],
    rig: StereoRig,
    start: Extrinsics,
    before: StripeFit,
    pattern: LanePattern,
) -> FollowedStripes | NotFitted:
    """Find and fit the stripes of a frame before in the next one.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        start: Pose that is expected.
        before: The fit in the frame before, of a straight lane.
        pattern: Its lines.

    Returns:
        The stripes, or why there are none.
    """
    expected = _lines_under(before.road_under(start), pattern, rig)
    found = _found_again(images[0], expected, rig)
    if found is None:
        return NotFitted("boundaries of the lane before that are found again", 0, Bound.LEAST, 2)
    pitch_rad = start.pitch_rad - float(found.vanishing_point[1] - expected.vanishing_point[1]) / rig.fy
    start = replace(start, pitch_rad=pitch_rad)
    yaw_rad, *left_edges_m = lane_in_road(found, rig, start)
    moved = replace(
        before,
        lane_yaw_rad=float(yaw_rad),
        positions_m=np.array(left_edges_m) - before.widths_m / 2.0,
    )
    fit = refine_again(images, rig, before, moved.road_under(start))
    if isinstance(fit, NotFitted):
        return fit
    bends = bends_of_lines(found.left, float(found.vanishing_point[1]), rig, start.height_m)
    return FollowedStripes(fit, _lines_under(fit.road_under(fit.extrinsics), pattern, rig), bends)


def _lines_under(road: Array, pattern: LanePattern, rig: StereoRig) -> LanePattern:
    """Return the left edges of the stripes of a road as lines of both images, with the rows of a pattern."""
    edges = predict_edges(road[None], rig)[0, :, :, 0]
    left, right = (
        [_moved(line, *edge) for line, edge in zip(lines, edges_of_camera, strict=True)]
        for lines, edges_of_camera in zip(pattern.lines, edges, strict=True)
    )
    return _pattern_of(left, right, pattern)


def _moved(line: ImageLine, start_px: float, slope: float) -> ImageLine:
    """Return a line with the same rows and stripe elsewhere."""
    u_mid = float(start_px + slope * line.v_mid)
    return replace(line, u_mid=u_mid, slope=float(slope), columns=start_px + slope * line.rows)


def _pattern_of(left: list[ImageLine], right: list[ImageLine], pattern: LanePattern) -> LanePattern:
    """Return a pattern with other lines."""
    first, second = left[:2]
    rise = first.slope - second.slope
    row = first.v_mid
    if rise:
        row += (float(second.column_at(np.array(first.v_mid))) - first.u_mid) / rise
    vanishing = np.array([float(first.column_at(np.array(row))), row])
    extra = tuple(
        ExtraLine(in_left, in_right, line.height_std_m)
        for in_left, in_right, line in zip(left[2:], right[2:], pattern.extra_lines, strict=True)
    )
    boundaries = replace(
        pattern, left=(left[0], left[1]), right=(right[0], right[1]), vanishing_point=vanishing
    )
    return boundaries.joined(extra)


def _found_again(image: Image, expected: LanePattern, rig: StereoRig) -> LanePattern | None:
    """Return lines as the left image shows them; None where a boundary is not found near its place.

    Another line that is not found stays where it is expected.
    """
    first_row = int(np.clip(expected.vanishing_point[1], 0, rig.height - 1))
    gradient = np.zeros(image.shape, np.float32)
    gradient[first_row:] = edge_response(image[first_row:], 1)
    lines = expected.lines[0]
    peaks = [
        HoughPeak(
            line.u_mid, line.slope, line.v_mid, 0.0, line.contrast, line.width_px, first_row, rig.height - 1
        )
        for line in lines
    ]
    found = fit_lines(gradient, peaks, noise_grey(image))
    if found[0] is None or found[1] is None:
        return None
    left = [one or line for one, line in zip(found, lines, strict=True)]
    return _pattern_of(left, list(expected.lines[1]), expected)
