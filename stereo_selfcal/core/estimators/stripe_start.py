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

"""Where the fit of the stripes' grey values starts: yaw and positions by the lines, widths by both edges."""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import lane_in_road
from ..rejection import Bound, NotFitted
from ..types import Array, Image
from .row_blocks import BLOCK_ROWS

# Stripe widths tried at the start [m].
_WIDTHS_M = np.linspace(0.04, 0.70, 67)


def start_road(
    images: tuple[Image, Image],
    pattern: LanePattern,
    rig: StereoRig,
    start: Extrinsics,
    curvature_per_m: float,
) -> Array | NotFitted:
    """Return the parameters of the road to start from, (5 + 3 L,); the lines give yaw and positions."""
    yaw, *left_edges = lane_in_road(pattern, rig, start)
    widths = _start_widths(images, pattern, rig, start)
    heights = np.zeros(len(left_edges))
    road = np.array(
        [*start.as_array(), yaw, curvature_per_m, *(left_edges - widths / 2.0), *widths, *heights]
    )
    n_finite = int(np.count_nonzero(np.isfinite(road)))
    if n_finite < len(road):
        return NotFitted("numbers of the road that the lines determine", n_finite, Bound.LEAST, len(road))
    return road


def _start_widths(
    images: tuple[Image, Image], pattern: LanePattern, rig: StereoRig, start: Extrinsics
) -> Array:
    """Return the width (L,) of each stripe [m] whose right edge has the strongest fall of grey values."""
    horizon = float(pattern.vanishing_point[1])
    rows = np.arange(max(0, int(horizon) + 2 * BLOCK_ROWS), rig.height, 2)
    px_per_m = (rows - horizon) / start.height_m * rig.fx / rig.fy
    score = np.zeros((len(pattern.columns[0]), len(_WIDTHS_M)))
    for image, lines in zip(images, pattern.lines, strict=True):
        pixels = image[rows].astype(np.int16)  # differences may be negative
        for stripe, line in enumerate(lines):
            left = line.column_at(rows.astype(np.float64))[:, None]
            columns = np.rint(left + px_per_m[:, None] * _WIDTHS_M).astype(np.intp)
            seen = (columns > 0) & (columns < rig.width - 1) & (left > 0)
            columns = np.clip(columns, 1, rig.width - 2)
            before, after = (np.take_along_axis(pixels, columns + beside, axis=1) for beside in (-1, 1))
            falling = before - after
            score[stripe] += np.where(seen, falling, 0.0).sum(axis=0)
    widths: Array = _WIDTHS_M[np.argmax(score, axis=1)]
    return widths
