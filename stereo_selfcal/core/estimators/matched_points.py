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

"""Points of texture all over both images, matched to a part of a pixel along the row and across it.

Corners (Shi and Tomasi, CVPR 1994) are followed from the left image into the right one (Lucas and Kanade,
IJCAI 1981; OpenCV's pyramidal tracker), from the dense disparities on. A match counts where the way back
leads to the same point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..types import Floats, Image, Mask
from .dense_disparity import DenseDisparities, in_images

# Twice as many points and a larger window repeat the turn of a camera no better, and take twice the time.
_MOST_POINTS = 400
_WINDOW_PX, _BLOCK_PX = 11, 5
# Least strengths of a corner over that of the strongest one: paint is the strongest. Most images show enough
# of the stronger ones, which are then the same that are chosen among all.
_QUALITIES = (1e-2, 1e-4)
# Least squared contrast along the direction of least contrast, over that along the other one. In recorded
# frames, one point of 70 has less. On rendered paint without texture, every second one has.
_LEAST_CORNER = 0.05
# Corners are looked for in images of at most this width, and of at most so many pixels where these are made
# smaller at all. They are followed in images of at most twice the other width.
_WIDTH_PX, _MOST_PIXELS = 1300, 800_000
_FOLLOWED_WIDTH_PX = 1200
_DISTANCE = 1 / 150  # between two corners, over the width of the image
_LEVELS = 1  # halvings of the image: dense disparities are good to a pixel or two
_ITERATIONS, _STEP_PX = 10, 0.01
_WAY_BACK_PX = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPoints:
    """Points that both cameras see, the clearest ones first.

    Attributes:
        left: (N, 2) columns and rows in the left image [px].
        right: (N, 2) columns and rows in the right image [px].
    """

    left: Floats
    right: Floats

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.left)

    def chosen(self, which: Mask) -> MatchedPoints:
        """Return the points of a mask (N,)."""
        return MatchedPoints(self.left[which], self.right[which])


def match_points(images: tuple[Image, Image], disparities: DenseDisparities) -> MatchedPoints:
    """Match points of texture all over both images.

    Args:
        images: Left and right image, (H, W) uint8.
        disparities: Dense disparities of the left image: where they are unknown, no point is matched.

    Returns:
        The points; none where the images show no texture.
    """
    corners = _corners(images[0], disparities)
    if not len(corners):
        return MatchedPoints(corners, corners)
    scale = max(1, images[0].shape[1] // _FOLLOWED_WIDTH_PX)
    left, right = (_smaller(image, scale) for image in images)
    points = _in_smaller(corners, scale)
    start = points.copy()
    start[:, 0] -= disparities.at(corners) / np.float32(scale)
    found, seen = _follow(left, right, points, start)
    back, seen_back = _follow(right, left, found, points.copy())
    good = seen & seen_back & (np.linalg.norm(back - points, axis=1) < _WAY_BACK_PX)
    good &= ~_on_edge(left, points)
    return MatchedPoints(corners[good], in_images(found[good], scale).astype(np.float32))


def _smaller(image: Image, scale: int) -> Image:
    """Return an image that is smaller by a factor."""
    if scale == 1:
        return image
    size = image.shape[1] // scale, image.shape[0] // scale
    used = image[: size[1] * scale, : size[0] * scale]
    return np.asarray(cv2.resize(used, size, interpolation=cv2.INTER_AREA), np.uint8)


def _in_smaller(points: Floats, scale: int) -> Floats:
    """Return columns and rows in an image that is smaller by a factor."""
    half = np.float32(0.5)
    smaller: Floats = (points + half) / np.float32(scale) - half if scale > 1 else points
    return smaller


def _corners(image: Image, disparities: DenseDisparities) -> Floats:
    """Return the strongest corners (N, 2) of an image [px], where it has disparities."""
    scale = max(1, math.ceil(image.shape[1] / _WIDTH_PX))
    if scale > 1:
        scale = max(scale, math.ceil(math.sqrt(image.size / _MOST_PIXELS)))
    smaller = _smaller(image, scale)
    known = (disparities.values > 0.0).astype(np.uint8)
    mask = cv2.resize(known, (smaller.shape[1], smaller.shape[0]), interpolation=cv2.INTER_NEAREST)
    distance = max(2.0, _DISTANCE * smaller.shape[1])
    for quality in _QUALITIES:
        found = cv2.goodFeaturesToTrack(
            smaller, _MOST_POINTS, quality, distance, mask=mask, blockSize=_BLOCK_PX
        )
        if found is not None and len(found) == _MOST_POINTS:
            break
    if found is None:  # what OpenCV returns for an image without corners
        return np.zeros((0, 2), np.float32)
    return in_images(found.reshape(-1, 2), scale).astype(np.float32)


def _on_edge(image: Image, points: Floats) -> Mask:
    """Return which points (N, 2) lie on a straight edge: nothing tells where they are along it."""
    half = _WINDOW_PX // 2 + 1
    reach = np.arange(-half, half + 1)
    column, row = np.rint(points).astype(np.intp).T
    columns = np.clip(column[:, None] + reach, 0, image.shape[1] - 1)
    rows = np.clip(row[:, None] + reach, 0, image.shape[0] - 1)
    windows = image[rows[:, :, None], columns[:, None, :]].astype(np.float32)
    across = windows[:, 1:-1, 2:] - windows[:, 1:-1, :-2]
    down = windows[:, 2:, 1:-1] - windows[:, :-2, 1:-1]
    xx, yy, xy = (np.einsum("nij,nij->n", *pair) for pair in ((across, across), (down, down), (across, down)))
    middle, half_way = (xx + yy) / 2.0, np.hypot((xx - yy) / 2.0, xy)
    edge: Mask = middle - half_way < _LEAST_CORNER * (middle + half_way)
    return edge


def _follow(fixed: Image, moving: Image, points: Floats, start: Floats) -> tuple[Floats, Mask]:
    """Return where points (N, 2) of one image lie in another one, and which of them were found, (N,)."""
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        fixed,
        moving,
        points,
        start,
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_LEVELS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, _ITERATIONS, _STEP_PX),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(found, np.float32).reshape(-1, 2), np.asarray(status).ravel() > 0
