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

"""Matched points of one frame with what they look like, so that another frame can find them again.

Each point has a binary descriptor: bits that say which of two places of its neighbourhood is brighter (BRIEF:
Calonder et al., ECCV 2010). The neighbourhood is upright, as a car's camera hardly rolls, and grows with the
disparity, so that it shows the same part of the world from any distance. Landmarks take 20 kB a frame; the
images are not needed any more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.working_size import WorkingSize
from ..types import Floats, Image
from .matched_points import MatchedPoints

_BITS = 256
_PATTERN_SEED = 20  # any: descriptors are compared within one release only
_SPREAD = 0.5  # standard deviation of the places over the half width of the neighbourhood (BRIEF: 0.4)
# Half width of the neighbourhood: so much of the disparity, within limits in parts of the image's width. For
# a baseline of half a metre, that is a quarter of a metre of the world.
_HALF_WIDTH = 0.5
_LEAST_HALF_WIDTH, _MOST_HALF_WIDTH = 1 / 130, 1 / 50
_BLUR = 1 / 250  # side of the box over which grey values are averaged, over the width


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Points that both cameras see, with what they look like in the left image.

    Attributes:
        left: (N, 2) columns and rows in the left image [px], float32.
        right: (N, 2) columns and rows in the right image [px], float32.
        descriptors: (N, 32) bits, eight in each uint8.
        ahead: How much farther ahead the right camera seems to sit in this frame, over the baseline
            (:attr:`.RowAlignment.ahead`): that of a late image depends on the speed.
        ahead_std: Its standard deviation; infinite where the rows do not tell it.
    """

    left: Floats
    right: Floats
    descriptors: npt.NDArray[np.uint8]
    ahead: float = 0.0
    ahead_std: float = math.inf

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.left)

    def in_images(self, size: WorkingSize) -> Landmarks:
        """Return the points in images of which they were found in another size."""
        left, right = (size.in_images(each).astype(np.float32) for each in (self.left, self.right))
        return replace(self, left=left, right=right)


def _pattern() -> Floats:
    """Return the pairs of places (2, BITS, 2) over the half width of a neighbourhood."""
    rng = np.random.default_rng(_PATTERN_SEED)
    places = np.clip(_SPREAD * rng.standard_normal((2, _BITS, 2)), -1.0, 1.0)
    return places.astype(np.float32)


_PLACES = _pattern()


def describe_points(
    image: Image, points: MatchedPoints, ahead: float = 0.0, ahead_std: float = math.inf
) -> Landmarks:
    """Describe the neighbourhoods of matched points in the left image.

    Args:
        image: Left image, (H, W) uint8.
        points: Matched points.
        ahead: How much farther ahead the right camera seems to sit, over the baseline.
        ahead_std: Its standard deviation.
    """
    height, width = image.shape
    side = 2 * round(_BLUR * width / 2.0) + 1
    smooth = cv2.blur(image, (side, side))
    disparity = points.left[:, 0] - points.right[:, 0]
    half = np.clip(_HALF_WIDTH * disparity, _LEAST_HALF_WIDTH * width, _MOST_HALF_WIDTH * width)
    half = half.astype(np.float32)[:, None]
    left = points.left.astype(np.float32)
    flat = smooth.reshape(-1)
    grey = []
    for places in _PLACES:
        column = np.clip(left[:, :1] + half * places[:, 0] + np.float32(0.5), 0, width - 1).astype(np.int32)
        row = np.clip(left[:, 1:] + half * places[:, 1] + np.float32(0.5), 0, height - 1).astype(np.int32)
        grey.append(flat[row * np.int32(width) + column])
    bits = np.packbits(grey[0] < grey[1], axis=1)
    return Landmarks(left, points.right.astype(np.float32), bits, ahead, ahead_std)
