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

"""The canvas of all pictures: lines, dots and text of a size that suits any camera. It imports no ROS.

Colours are BGR. They are those of Okabe and Ito ("Color Universal Design", 2008), which people
with any kind of colour vision can tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from ..core.types import Array, Image

Colour = tuple[int, int, int]

ORANGE: Colour = (0, 159, 230)
SKY_BLUE: Colour = (233, 180, 86)
GREEN: Colour = (115, 158, 0)
YELLOW: Colour = (66, 228, 240)
VERMILION: Colour = (0, 94, 213)
PURPLE: Colour = (167, 121, 204)
BLUE: Colour = (178, 114, 0)
WHITE: Colour = (255, 255, 255)
DARK: Colour = (40, 40, 40)

# A smaller image is enlarged to this width, so that sub-pixel differences and text can be seen.
MIN_WIDTH_PX = 960
# Text of this relative size is legible on a canvas of MIN_WIDTH_PX.
TEXT_SCALE = 0.55
FONT = cv2.FONT_HERSHEY_SIMPLEX

_SHIFT = 4  # OpenCV takes coordinates in 1/16 px


@dataclass(frozen=True, slots=True)
class Canvas:
    """A picture ``scale`` times as large as the camera image it shows.

    Attributes:
        pixels: (H, W, 3) uint8 BGR.
        scale: Enlargement of the camera image.
        text_size: How many times as large text is as what is legible on a canvas of MIN_WIDTH_PX.
    """

    pixels: Image
    scale: float
    text_size: float = 1.0

    @property
    def thickness(self) -> int:
        """Line thickness [px] that looks the same in pictures of any size."""
        return max(1, round(float(self.pixels.shape[1]) / MIN_WIDTH_PX))

    def position(self, points: npt.ArrayLike) -> npt.NDArray[np.int32]:
        """Return image points (..., 2) [px] in this picture, in OpenCV's fixed-point numbers."""
        xy = (np.asarray(points, dtype=np.float64) + 0.5) * self.scale - 0.5  # pixel centres are integers
        return np.round(xy * (1 << _SHIFT)).astype(np.int32)

    @property
    def line_height(self) -> float:
        """Distance of two lines of text [px]."""
        return 44 * self._text_scale

    def pixel(self, point: npt.ArrayLike) -> tuple[float, float]:
        """Return where an image point (2,) [px] lies in this picture [px]."""
        x, y = self.position(point) / (1 << _SHIFT)
        return float(x), float(y)

    def holds(self, points: Array) -> bool:
        """Whether image points (..., 2) [px] are numbers, and not far outside."""
        limit = 4.0 * max(self.pixels.shape[:2]) / self.scale
        return bool(np.isfinite(points).all() and np.abs(points).max() < limit)

    def polyline(self, points: Array, colour: Colour, thickness: int | None = None) -> None:
        """Draw a polyline through image points (N, 2) [px], leaving out those far outside."""
        for start, end in pairwise(points):
            if self.holds(np.stack([start, end])):
                (a, b), size = self.position([start, end]).tolist(), thickness or self.thickness
                cv2.line(self.pixels, a, b, colour, size, cv2.LINE_AA, _SHIFT)

    def polygon(self, points: Array, colour: Colour) -> None:
        """Fill a convex polygon through image points (N, 2) [px]."""
        cv2.fillConvexPoly(self.pixels, self.position(points), colour, cv2.LINE_AA, _SHIFT)

    def dot(self, point: Array, radius_px: float, colour: Colour, thickness: int = -1) -> None:
        """Draw a dot, or with a positive thickness a ring."""
        radius = round(radius_px * self.thickness * (1 << _SHIFT))
        cv2.circle(self.pixels, self.position(point).tolist(), radius, colour, thickness, cv2.LINE_AA, _SHIFT)

    def specks(self, points: Array, colour: Colour) -> None:
        """Paint specks at image points (N, 2) [px]: for thousands of them, quicker than dots."""
        height, width = self.pixels.shape[:2]
        for offset in np.ndindex(3 * self.thickness, 3 * self.thickness):
            columns, rows = (self.position(points) >> _SHIFT).T + np.array(offset)[:, None]
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            self.pixels[rows[inside], columns[inside]] = colour

    def text_width(self, text: str) -> int:
        """Return how wide a text of size 1 is [px]."""
        return int(cv2.getTextSize(text, FONT, self._text_scale, self._stroke)[0][0])

    def text(self, text: str, x: float, y: float, colour: Colour = WHITE, size: float = 1.0) -> int:
        """Write on a plate, the lower left corner at (x, y) of this picture; return the width [px].

        The plate is dark, but white under blue, which is not legible on a dark one.
        """
        scale, stroke = size * self._text_scale, self._stroke
        # The fonts of OpenCV 4 and 5 differ in width; what would run out of the picture is made smaller.
        wanted = cv2.getTextSize(text, FONT, scale, stroke)[0][0]
        scale *= min(1.0, max(self.pixels.shape[1] - x, 1) / max(wanted, 1))
        (width, height), below = cv2.getTextSize(text, FONT, scale, stroke)
        left, baseline, margin = round(x), round(y), 2 * self.thickness
        rows = slice(max(baseline - height - margin, 0), max(baseline + below, 0))
        columns = slice(max(left - margin, 0), max(left + width + margin, 0))
        self.pixels[rows, columns] = WHITE if colour == BLUE else DARK
        cv2.putText(self.pixels, text, (left, baseline), FONT, scale, colour, stroke, cv2.LINE_AA)
        return int(width)

    @property
    def _text_scale(self) -> float:
        """Scale of the font for a text of size 1."""
        return self.text_size * TEXT_SCALE * float(self.pixels.shape[1]) / MIN_WIDTH_PX

    @property
    def _stroke(self) -> int:
        """Line thickness of letters [px]."""
        return max(1, round(self.thickness * self.text_size))


def dark_strip(width: int, height: float) -> Canvas:
    """Return an empty dark canvas for text."""
    return Canvas(np.full((round(height), width, 3), DARK, dtype=np.uint8), 1.0)


def to_ascii(text: str) -> str:
    """Return a text in ASCII, because OpenCV's fonts have no other characters."""
    return text.encode("ascii", "replace").decode()
