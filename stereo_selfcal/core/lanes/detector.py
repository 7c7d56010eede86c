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

"""Line detectors: each finds the lines of one image that may be the boundaries of a lane.

A detector only proposes lines. The matching between the cameras, the fit and the gates decide whether two of
them bound a lane, in the same way for every detector.
"""

from __future__ import annotations

from typing import Protocol

from ..types import Image
from .hough import hough_peaks
from .line_fit import fit_lines
from .matching import Candidate, Candidates
from .stripe_points import StripePoints


class LineDetector(Protocol):
    """Finds the lines of one image: any function with these arguments."""

    def __call__(self, points: StripePoints, image: Image) -> Candidates:
        """Find the lines of one image.

        Args:
            points: Its stripe points, with the gradient and the noise of the image.
            image: (H, W) uint8, rectified.

        Returns:
            Lines that may be left boundaries of a lane, which run to the left going down, and lines that may
            be right boundaries. The votes of a line are its evidence, compared with the other lines of the
            same detector.
        """


def detect_by_hough(points: StripePoints, image: Image) -> Candidates:
    """Find lines by the Hough transform of the stripe points, and fit each of them to the gradient.

    This is the detector of the paper (section 2.2). Arguments and result are those of :class:`LineDetector`.
    """
    peaks = hough_peaks(points, image.shape)
    lines = fit_lines(points.gradient, [*peaks[0], *peaks[1]], points.noise_grey)
    left, right = (
        [Candidate(line, peak.votes) for peak, line in zip(each, own, strict=True) if line is not None]
        for each, own in zip(peaks, (lines[: len(peaks[0])], lines[len(peaks[0]) :]), strict=True)
    )
    return left, right
