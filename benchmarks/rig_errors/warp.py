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

"""A right camera that is turned after the picture was taken, by the exact homography of the turn."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereo_selfcal import StereoRig
from stereo_selfcal.core.types import Image

from .angles import Angles, Array, rotation_of

# Optical axes (x right, y down, z forward) of the axes of the body (x forward, y left, z up), written here
# anew: a wrong sign in the estimator's own matrix would cancel.
OPTICAL_FROM_BODY: Array = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
# OpenCV's remapping rounds places to 1/32 px, which is a yaw of 0.0025 deg at 720 px. This one does not.
# Lagrange's polynomial through 6 x 6 pixels keeps places to a thousandth of a pixel. Lanczos' kernel of
# the same size does not keep a straight slope, and moves smooth edges by about 0.01 px.
_TAPS = 6
_WHITE = 255

Floats = npt.NDArray[np.float32]


def old_from_new(rig: StereoRig, turn: Angles) -> Array:
    """Return the homography (3, 3) to pixels of the picture from pixels of the one with a turned camera.

    Args:
        rig: The rig.
        turn: The turned body in the body as it was, as in :class:`.Angles`.
    """
    matrix = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    # A ray that the turned camera has, in the axes of the camera as it was.
    ray = OPTICAL_FROM_BODY @ rotation_of(turn) @ OPTICAL_FROM_BODY.T
    homography: Array = matrix @ ray @ np.linalg.inv(matrix)
    return homography


def turned(image: Image, rig: StereoRig, turn: Angles) -> Image:
    """Return the picture that a camera would have taken had it been turned.

    Places beyond the border have the grey of the border next to them (some pixels: 2.5 of 0.2 deg of yaw in
    the rig of KITTI).

    Args:
        image: (H, W) uint8 picture.
        rig: The rig.
        turn: As in :func:`old_from_new`.
    """
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    homography = old_from_new(rig, turn)
    x, y, w = (homography[i, 0] * columns + homography[i, 1] * rows + homography[i, 2] for i in range(3))
    return _sampled(image, x / w, y / w)


def _sampled(image: Image, x: Array, y: Array) -> Image:
    """Return the grey levels at places between pixels."""
    height, width = image.shape
    columns, column_weights = _taps(x)
    rows, row_weights = _taps(y)
    grey = image.astype(np.float32).ravel()
    total = np.zeros(x.shape, np.float32)
    inside = [np.clip(columns + i, 0, width - 1) for i in range(_TAPS)]
    for j in range(_TAPS):
        start = np.clip(rows + j, 0, height - 1) * width
        line = np.zeros(x.shape, np.float32)
        for i in range(_TAPS):
            line += column_weights[i] * grey[start + inside[i]]
        total += row_weights[j] * line
    return np.clip(np.rint(total), 0, _WHITE).astype(np.uint8)


def _taps(places: Array) -> tuple[npt.NDArray[np.intp], list[Floats]]:
    """Return the first of the pixels that are weighted, and the weights of all; they sum to one."""
    before = np.floor(places)
    ahead = _TAPS // 2 - 1
    offset = places - before + ahead
    weights = []
    for node in range(_TAPS):
        weight = np.ones_like(places)
        for other in range(_TAPS):
            if other != node:
                weight *= (offset - other) / (node - other)
        weights.append(weight.astype(np.float32))
    return before.astype(np.intp) - ahead, weights
