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

"""How far the road in the right image is shifted along the road: by images that were not taken at one time.

Both images are drawn as seen from above, each with its own camera over the same road. What is on the road
lies at the same place in both, unless the car has moved between the images. The shift is found by the
correlation of phases (Kuglin and Hines, 1975), in which a faint pattern counts as much as a clear line.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import SIDES, Side, image_from_road
from ..geometry.pose import Extrinsics
from ..types import Array, Image

# The part of the road that is compared [m]: ahead, and to either side.
_NEAR_M, _FAR_M, _HALF_WIDTH_M = 4.0, 20.0, 4.0
_CELL_M = 0.0625
_SMOOTH_CELLS = 1.0


@dataclass(frozen=True, slots=True)
class RoadShift:
    """Where the road in the right image lies against that in the left one.

    Attributes:
        ahead_m: How much farther ahead a mark of the road lies in the right image [m]: the right image was
            taken that much earlier on the way.
        sigmas: Height of this peak of the correlation over its scatter.
        sigmas_at_zero: The same without a shift.
    """

    ahead_m: float
    sigmas: float
    sigmas_at_zero: float


def find_road_shift(
    images: tuple[Image, Image],
    rig: StereoRig,
    pose: Extrinsics,
    yaw_rad: float = 0.0,
    turned: Array | None = None,
) -> RoadShift:
    """Find how far the road in the right image is shifted along the road.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        pose: Pose over the road.
        yaw_rad: Yaw of the camera against the lane [rad].
        turned: Homography (3, 3) to the right image from one of a camera that is not turned; None where it
            is that.
    """
    straight = np.eye(3)
    left, right = (
        _from_above(image, image_of_camera @ _image_from_cell(rig, pose, yaw_rad, side))
        for image, side, image_of_camera in zip(
            images, SIDES, (straight, straight if turned is None else turned), strict=True
        )
    )
    spectra = [np.fft.rfft2(each) for each in (left, right)]
    product = spectra[1] * np.conj(spectra[0])
    product /= np.maximum(np.abs(product), np.finfo(np.float64).tiny)
    shifted = np.fft.fftshift(np.fft.irfft2(product, left.shape))
    # A blur, as the peak lies between cells.
    correlation = np.asarray(cv2.GaussianBlur(shifted, (0, 0), _SMOOTH_CELLS), np.float64)
    middle = left.shape[0] // 2, left.shape[1] // 2
    scatter = max(float(correlation.std()), float(np.finfo(np.float64).tiny))  # of flat images it is zero
    # Along the road only: the lines have told how the images lie to each other across it.
    along = correlation[:, middle[1] - 1 : middle[1] + 2].max(axis=1)
    best = int(along[1:-1].argmax()) + 1
    before, peak, after = (float(each) for each in along[best - 1 : best + 2])
    part = 0.5 * (before - after) / min(before - 2.0 * peak + after, -np.finfo(np.float32).eps)
    zero = float(along[middle[0] - 1 : middle[0] + 2].max())
    return RoadShift((best + part - middle[0]) * _CELL_M, peak / scatter, zero / scatter)


def _image_from_cell(rig: StereoRig, pose: Extrinsics, yaw_rad: float, side: Side) -> Array:
    """Return the homography (3, 3) from cells of the road, rows along it, to an image."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    # Axes of the road along the lane: the camera points left of the lane by its yaw.
    camera_from_lane = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    lane_from_cell = np.array([[0.0, _CELL_M, _NEAR_M], [_CELL_M, 0.0, -_HALF_WIDTH_M], [0.0, 0.0, 1.0]])
    image_from_cell: Array = image_from_road(rig, pose, side) @ camera_from_lane @ lane_from_cell
    return image_from_cell


def _from_above(image: Image, image_from_cell: Array) -> Array:
    """Return the road as seen from above, without its mean and tapered to the borders."""
    rows, columns = round((_FAR_M - _NEAR_M) / _CELL_M), round(2.0 * _HALF_WIDTH_M / _CELL_M)
    above = cv2.warpPerspective(
        image, image_from_cell, (columns, rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    ).astype(np.float64)
    above -= above.mean()
    window: Array = above * np.outer(np.hanning(rows), np.hanning(columns))
    return window
