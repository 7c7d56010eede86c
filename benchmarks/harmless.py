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

"""Copies of a stereo pair that show the road as well as it does: cut, smaller, mirrored, in other light."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereo_selfcal.core.types import Image

from .frames import Array
from .road_pairs import RoadPair

_WHITE = 255
_MIDDLE = _WHITE / 2.0
_NOISE_GREY = 3.0  # three times that of the recorded frames
_CUT_PX = 7
_JPEG_QUALITY = 85
_BLUR_PX = 0.5
_CONTRAST = 0.8

SAME = np.ones(3)
MIRRORED = np.array([1.0, 1.0, -1.0])  # the road rolls to the other side


def mirrored(pair: RoadPair) -> RoadPair:
    """Flip both images and swap the cameras."""
    rig = replace(pair.rig, cx=pair.rig.width - 1 - pair.rig.cx)
    left, right = (np.ascontiguousarray(image[:, ::-1]) for image in (pair.right, pair.left))
    ends = pair.low * MIRRORED, pair.high * MIRRORED
    low, high = np.minimum(*ends), np.maximum(*ends)
    return replace(pair, rig=rig, left=left, right=right, low=low, high=high)


def scaled(pair: RoadPair, scale: float) -> RoadPair:
    """Make both images smaller, pixels averaged."""
    rig = pair.rig
    size = (round(rig.width * scale), round(rig.height * scale))
    by_column, by_row = size[0] / rig.width, size[1] / rig.height
    smaller = replace(
        rig,
        width=size[0],
        height=size[1],
        fx=rig.fx * by_column,
        fy=rig.fy * by_row,
        cx=(rig.cx + 0.5) * by_column - 0.5,
        cy=(rig.cy + 0.5) * by_row - 0.5,
    )
    return _with(pair, lambda image: cv2.resize(image, size, interpolation=cv2.INTER_AREA), rig=smaller)


def cut(pair: RoadPair, left: int = 0, right: int = 0, top: int = 0, bottom: int = 0) -> RoadPair:
    """Cut columns and rows off both images."""
    rig = pair.rig
    kept = (slice(top, rig.height - bottom), slice(left, rig.width - right))
    smaller = replace(
        rig,
        width=rig.width - left - right,
        height=rig.height - top - bottom,
        cx=rig.cx - left,
        cy=rig.cy - top,
    )
    return _with(pair, lambda image: image[kept], rig=smaller)


def compressed(pair: RoadPair) -> RoadPair:
    """Compress both images as JPEG, and decode them."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]

    def there_and_back(image: Image) -> npt.NDArray[Any]:
        return np.asarray(cv2.imdecode(cv2.imencode(".jpg", image, quality)[1], cv2.IMREAD_GRAYSCALE))

    return _with(pair, there_and_back)


def noisy(pair: RoadPair) -> RoadPair:
    """Add noise, of its own to each image, the same in every run."""
    rng = np.random.default_rng(zlib.crc32(f"{pair.source} {pair.name}".encode()))
    return _with(pair, lambda image: image + rng.normal(0.0, _NOISE_GREY, image.shape))


def with_gamma(pair: RoadPair, gamma: float, right_gain: float = 1.0) -> RoadPair:
    """Make the middle tones darker (a gamma above 1) or brighter, and the right image by a gain."""
    toned = _with(pair, lambda image: _WHITE * (image / _WHITE) ** gamma)
    return replace(toned, right=_bytes(toned.right * right_gain))


def flat(pair: RoadPair) -> RoadPair:
    """Lower the contrast of both images."""
    return _with(pair, lambda image: _MIDDLE + _CONTRAST * (image - _MIDDLE))


def blurred(pair: RoadPair) -> RoadPair:
    """Blur both images a little."""
    return _with(pair, lambda image: cv2.GaussianBlur(image, (0, 0), _BLUR_PX))


@dataclass(frozen=True, slots=True)
class Copy:
    """How a copy is made.

    Attributes:
        name: What is done.
        make: Makes it.
        signs: What the pose of the original is multiplied by.
        harmless: Whether it shows the road as well as the original does.
    """

    name: str
    make: Callable[[RoadPair], RoadPair]
    signs: Array
    harmless: bool = True


COPIES = (
    Copy("7 px cut at the left", partial(cut, left=_CUT_PX), SAME),
    Copy("7 px cut at the right", partial(cut, right=_CUT_PX), SAME),
    Copy("0.8 of its size", partial(scaled, scale=0.8), SAME),
    Copy("0.9 of its size", partial(scaled, scale=0.9), SAME),
    Copy("JPEG, quality 85", compressed, SAME),
    Copy("noise of 3 grey levels", noisy, SAME),
    Copy("gamma 0.8", partial(with_gamma, gamma=0.8), SAME),
    Copy("gamma 1.25", partial(with_gamma, gamma=1.25), SAME),
    Copy("mirrored", mirrored, MIRRORED),
    Copy("contrast 0.8", flat, SAME),
    Copy("blur 0.5 px", blurred, SAME),
    # These show less of the road, or show it worse.
    Copy("0.6 of its size", partial(scaled, scale=0.6), SAME, harmless=False),
    Copy("200 columns left, 40 rows above cut", partial(cut, left=200, top=40), SAME, harmless=False),
    Copy("150 columns right, 30 rows below cut", partial(cut, right=150, bottom=30), SAME, harmless=False),
    Copy(
        "gamma 1.5, right 10 % darker", partial(with_gamma, gamma=1.5, right_gain=0.9), SAME, harmless=False
    ),
)


def _with(pair: RoadPair, change: Callable[[Image], npt.NDArray[Any]], **others: Any) -> RoadPair:
    """Return the pair with both images changed, the left one first."""
    left, right = (_bytes(change(image)) for image in (pair.left, pair.right))
    return replace(pair, left=left, right=right, **others)


def _bytes(grey: npt.NDArray[Any]) -> Image:
    """Return grey values in whole levels, as a camera delivers them."""
    return np.ascontiguousarray(np.clip(np.rint(grey), 0, _WHITE).astype(np.uint8))
