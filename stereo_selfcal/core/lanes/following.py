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

"""Lines that are followed from one frame to the next, in place of a search for lines.

Between two frames a car pitches, drifts in its lane and turns by a few pixels. Stripe points near the line of
the frame before give the start of its fit, as a peak of the Hough transform does; from there on, a line that
was followed is fitted and judged as any other. Where a line has ended, it has no points, and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..types import Array
from .hough import peak_near
from .lane_pair import ImageLine
from .line_fit import fit_line
from .matching import Candidate, Candidates
from .stripe_points import StripePoints

_ENDS_PX = 1e-9  # least height of a line in an image: it has a direction


def follow_lines(points: StripePoints, expected: Sequence[Sequence[ImageLine]]) -> Candidates:
    """Return the lines of an image that are found near those expected.

    Args:
        points: Stripe points of the image, with its gradient and its noise.
        expected: Left and right boundaries, where they are expected.
    """
    left, right = (
        [found for line in side if (found := _follow(points, line)) is not None] for side in expected
    )
    return left, right


def _follow(points: StripePoints, line: ImageLine) -> Candidate | None:
    peak = peak_near(points, line.u_mid, line.slope, line.v_mid)
    if peak is None:
        return None
    fitted = fit_line(points.gradient, peak, points.noise_grey)
    return None if fitted is None else Candidate(fitted, peak.votes)


def moved_line(line: ImageLine, mapping: Array) -> ImageLine | None:
    """Return a line where a homography (3, 3) of the image moves it; None where it has no rows there.

    Args:
        line: The line.
        mapping: Points of the image of the line's end, from those of its beginning.
    """
    rows = np.array([line.rows.min(), line.rows.max()])
    points = np.column_stack([line.column_at(rows), rows, np.ones(2)]) @ mapping.T
    if not np.all(points[:, 2] > 0.0):
        return None
    (u0, v0), (u1, v1) = points[:, :2] / points[:, 2:]
    if not v1 - v0 > _ENDS_PX:
        return None
    v_mid = float(v0 + v1) / 2.0
    return replace(line, u_mid=float(u0 + u1) / 2.0, slope=float((u1 - u0) / (v1 - v0)), v_mid=v_mid)
