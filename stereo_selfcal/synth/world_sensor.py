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

"""From the light on a sensor to the picture that is delivered: noise, colour mosaic, compression."""

from __future__ import annotations

import cv2
import numpy as np

from .ingredients import Camera, Sensor
from .renderer import Frame, Picture, quantise

# Weights of red, green and blue in a grey picture: ITU-R BT.601, as OpenCV has them.
GREY_WEIGHTS = (0.299, 0.587, 0.114)

# Bilinear interpolation of the colours that a pixel does not see, from its eight neighbours:
# red and blue have one pixel of four, green has every other.
SPARSE: Picture = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32) / np.float32(4)
DENSE: Picture = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]], np.float32) / np.float32(4)


def capture(picture: Picture, camera: Camera, rng: np.random.Generator) -> Frame:
    """Return what a camera makes of the light on its sensor, (H, W) uint8.

    The bytes of a compressed picture depend on the release of OpenCV.
    """
    sensor = camera.sensor
    if sensor.mosaic:
        raw = quantise(picture * _filters(picture.shape, sensor), camera.photometry, rng)
        frame = demosaic(raw, sensor)
    else:
        frame = quantise(picture, camera.photometry, rng)
    if sensor.jpeg_quality is None:
        return frame
    _, data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def demosaic(raw: Frame, sensor: Sensor) -> Frame:
    """Return the grey picture of a mosaic of colours, white-balanced and interpolated, (H, W) uint8."""
    error = sensor.white_balance_error
    gains = ((1 + error) / sensor.red, 1.0, 1 / (sensor.blue * (1 + error)))
    grey = np.zeros(raw.shape, np.float32)
    for colour, (weight, gain) in enumerate(zip(GREY_WEIGHTS, gains, strict=True)):
        seen = np.where(_colours(raw.shape) == colour, raw, 0).astype(np.float32)
        full = _filtered(seen, DENSE if colour == 1 else SPARSE) * np.float32(gain)
        grey += np.float32(weight) * np.minimum(full, 255)
    return np.rint(np.clip(grey, 0, 255)).astype(np.uint8)


def _colours(shape: tuple[int, ...]) -> Frame:
    """Return the colour of every pixel: 0 red, 1 green, 2 blue."""
    colours = np.ones(shape, np.uint8)
    colours[::2, ::2], colours[1::2, 1::2] = 0, 2
    return colours


def _filters(shape: tuple[int, ...], sensor: Sensor) -> Picture:
    """Return the share of the light that every pixel of a mosaic gets."""
    shares: Picture = np.array([sensor.red, 1.0, sensor.blue], np.float32)[_colours(shape)]
    return shares


def _filtered(picture: Picture, kernel: Picture) -> Picture:
    """Return the sums of the neighbours; mirrored at the border, where the colours stay in step."""
    padded = np.pad(picture, 1, mode="reflect")
    height, width = picture.shape
    total = np.zeros_like(picture)
    for (row, column), weight in np.ndenumerate(kernel):
        total += weight * padded[row : row + height, column : column + width]
    return total
