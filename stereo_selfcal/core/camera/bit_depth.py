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

"""Grey images of 16 bits as images of 8 bits, by the number of bits that the camera really uses.

A camera of 10 or 12 bits sends its values in 16 bits, mostly at the low end. With the high byte alone, such
an image would be nearly black. One scaling is used for both cameras, so that what they see looks alike, and
for all frames of a stream, so that the brightness does not jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..types import Image

# Depths of cameras. A dark image of a 12-bit camera uses fewer bits; in these steps, one that is not very
# dark is still known as what it is.
_DEPTHS = (8, 10, 12, 14, 16)
_SHOWN_BITS = 8
# Pixels that may have any value: broken ones are white, and so are those that a driver marks as invalid.
_STRAY = 1e-5

Pixels = npt.NDArray[Any]  # (H, W) uint8 or uint16


class BitDepth:
    """The depth of the images of one stream, and their conversion to 8 bits.

    It is the smallest usual depth in which the values fit: of the images ``look_ahead`` returns, and of those
    converted so far where ``lasting``. A pair with greater values is converted with a greater depth.

    Args:
        look_ahead: Returns images of the stream, called at most once, when the first one of 16 bits comes.
        lasting: Whether a greater depth holds for all later images too. A recording whose frames are read
            again in another order needs False: then a frame always gives the same image.
    """

    def __init__(self, look_ahead: Callable[[], Iterable[Pixels]] = tuple, lasting: bool = True) -> None:
        self._look_ahead = look_ahead
        self._lasting = lasting
        self._bits: int | None = None
        self._greatest = 0

    @property
    def remark(self) -> str:
        """What was assumed, "" where nothing was."""
        if self._bits is None or self._greatest > _DEPTHS[-2]:
            return ""
        return (
            f"the images have 16 bits for each pixel, but no value above {2**self._greatest - 1}: "
            f"they are taken as images of {self._greatest} bits"
        )

    def to_8_bits(self, left: Pixels, right: Pixels) -> tuple[Image, Image]:
        """Return both images with 8 bits; those that have them already as they are.

        Args:
            left: (H, W) uint8 or uint16 image of the left camera.
            right: The same of the right camera.
        """
        if np.uint16 not in (left.dtype, right.dtype):
            return left, right
        if self._bits is None:
            self._bits = max((depth_of(image) for image in self._look_ahead()), default=_DEPTHS[0])
        bits = max(self._bits, depth_of(left), depth_of(right))
        self._greatest = max(self._greatest, bits)
        if self._lasting:
            self._bits = bits
        return _scaled(left, bits), _scaled(right, bits)


def depth_of(image: Pixels) -> int:
    """Return the smallest usual depth in which the values of an image fit, but for a few stray pixels."""
    if image.dtype != np.uint16:
        return _DEPTHS[0]
    allowed = int(_STRAY * image.size)
    return next(bits for bits in _DEPTHS if bits == 16 or np.count_nonzero(image >> bits) <= allowed)


def _scaled(image: Pixels, bits: int) -> Image:
    if image.dtype != np.uint16:
        return image
    # Only stray pixels have more bits; they become white.
    return np.asarray(np.minimum(image >> (bits - _SHOWN_BITS), 255), dtype=np.uint8)
