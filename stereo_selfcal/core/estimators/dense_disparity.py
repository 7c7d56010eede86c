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

"""Dense disparities at low resolution, by semi-global matching (Hirschmueller, PAMI 2008; OpenCV's SGBM)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..types import Array, Floats, Image

# Width of the small images [px]. A third of KITTI's images, in which a trial found 68 of 85 roads.
_WIDTH_PX = 400
_MOST_PIXELS = 120_000  # of a small image, however high it is
# Settings of SGBM as OpenCV's documentation recommends them for one channel: 8 and 32 times the block's area.
_BLOCK = 5
_P1, _P2 = 8 * _BLOCK**2, 32 * _BLOCK**2
_UNIQUENESS_PERCENT, _SPECKLE_AREA, _SPECKLE_RANGE, _LEFT_RIGHT_PX = 10, 50, 2, 1
_BM_BLOCK = 9  # side of a block that is matched alone [px of the small images]
_FRACTION = 16.0  # OpenCV counts disparities in 1/16 px


@dataclass(frozen=True, slots=True, eq=False)
class SmallImages:
    """Both images, made small.

    Attributes:
        images: Left and right image, (h, w) uint8.
        scale: Pixels of the images for one pixel of the small images.
    """

    images: tuple[Image, Image]
    scale: int

    @classmethod
    def of(cls, images: tuple[Image, Image]) -> SmallImages:
        """Make a left and a right image, (H, W) uint8, small."""
        height, width = images[0].shape
        scale = max(1, round(width / _WIDTH_PX), math.ceil(math.sqrt(width * height / _MOST_PIXELS)))
        size = width // scale, height // scale
        left, right = (
            np.asarray(
                cv2.resize(image[: size[1] * scale, : size[0] * scale], size, interpolation=cv2.INTER_AREA),
                np.uint8,
            )
            for image in images
        )
        return cls((left, right), scale)

    def match(self, number: int) -> DenseDisparities:
        """Return the disparities of the small left image.

        Args:
            number: How many disparities are searched, a multiple of 16.
        """
        return self._by(
            cv2.StereoSGBM.create(
                minDisparity=0,
                numDisparities=number,
                blockSize=_BLOCK,
                P1=_P1,
                P2=_P2,
                disp12MaxDiff=_LEFT_RIGHT_PX,
                uniquenessRatio=_UNIQUENESS_PERCENT,
                speckleWindowSize=_SPECKLE_AREA,
                speckleRange=_SPECKLE_RANGE,
                mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            ),
            number,
        )

    def match_blocks(self, number: int) -> DenseDisparities:
        """Return the disparities where blocks have texture: less, and in a third of the time.

        Args:
            number: As of :meth:`match`.
        """
        matcher = cv2.StereoBM.create(number, _BM_BLOCK)
        matcher.setUniquenessRatio(_UNIQUENESS_PERCENT)
        return self._by(matcher, number)

    def _by(self, matcher: cv2.StereoMatcher, number: int) -> DenseDisparities:
        # The first columns are left out, as many as there are disparities.
        padded = [cv2.copyMakeBorder(each, 0, 0, number, 0, cv2.BORDER_REPLICATE) for each in self.images]
        found = np.asarray(matcher.compute(padded[0], padded[1]), np.float32)[:, number:]
        found = found / np.float32(_FRACTION)
        columns = np.arange(found.shape[1], dtype=np.float32)
        return DenseDisparities(np.where(found <= columns, found, np.float32(-1.0)), self.scale, number)


@dataclass(frozen=True, slots=True, eq=False)
class DenseDisparities:
    """Disparities of the small left image.

    Attributes:
        values: (h, w) disparities [px of the small image]; not positive where they are unknown.
        scale: Pixels of the images for one pixel of the small image.
        number: How many disparities were searched.
    """

    values: Floats
    scale: int
    number: int

    def at(self, points: Floats) -> Floats:
        """Return the disparities (N,) [px of the images] at points of the left image; not positive: unknown.

        Args:
            points: (N, 2) columns and rows [px].
        """
        height, width = self.values.shape
        column, row = (points[:, :2] / np.float32(self.scale)).astype(np.intp).T
        found = self.values[np.minimum(row, height - 1), np.minimum(column, width - 1)]
        disparities: Floats = found * np.float32(self.scale)
        return disparities


def in_images(small: npt.ArrayLike, scale: int) -> Array:
    """Return the columns or rows in the images for those of images that are smaller by a factor."""
    full: Array = (np.asarray(small, np.float64) + 0.5) * scale - 0.5
    return full
