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

"""Noise that is fixed to the world, filtered for the size of a pixel on the surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from .cameras import Array32

SIZE = 1024  # texels of a tile along either axis
_SEED = 7_301  # of the tiles; worlds differ by place, scale and mixture
_PAD = 1  # texels around each level, so that it repeats without a seam
_COLUMNS = 2048  # of the arrays given to OpenCV, which takes no longer ones than 32767


@cache
def tile(name: str) -> Array32:
    """Return a tile that repeats, of mean 0 and standard deviation 1, shape (SIZE, SIZE).

    Args:
        name: "grain" (stones in bitumen), "cloud" (all sizes alike), "leaf" (spots of a few texels),
            "crack" (0 where there is none, 1 inside).
    """
    rng = np.random.default_rng([_SEED, sum(name.encode())])
    if name == "grain":
        fine = _filtered(rng, 0.6, 40.0) + 0.5 * _filtered(rng, 1.2, 60.0)
        stones = np.clip(_filtered(rng, 0.0, 130.0) - 1.2, 0, None)
        return _standard(fine + 1.2 * stones)
    if name == "cloud":
        return _standard(_filtered(rng, 1.25, 200.0))
    if name == "leaf":
        return _standard(_filtered(rng, 0.5, 90.0) + 0.7 * _filtered(rng, 1.5, 90.0))
    if name == "crack":
        return _cracks(rng)
    raise ValueError(f"there is no tile {name!r}")


def _filtered(rng: np.random.Generator, fall: float, highest: float) -> Array32:
    """Return noise of which the amplitude falls with the frequency to the power ``fall``.

    Args:
        rng: Source of the noise.
        fall: The power.
        highest: Waves a tile at which a soft cut begins, times about four.
    """
    y = np.fft.fftfreq(SIZE)[:, None] * SIZE
    x = np.fft.rfftfreq(SIZE)[None] * SIZE
    radius = np.hypot(x, y)
    gain = np.where(radius > 0, 1 / np.maximum(radius, 1) ** fall, 0) * np.exp(
        -((radius / (4 * highest)) ** 2)
    )
    waves = np.fft.rfft2(rng.standard_normal((SIZE, SIZE))) * gain
    return _standard(np.fft.irfft2(waves, s=(SIZE, SIZE)))


def _standard(values: npt.NDArray[np.floating[Any]]) -> Array32:
    standard: Array32 = ((values - values.mean()) / values.std()).astype(np.float32)
    return standard


def _cracks(rng: np.random.Generator) -> Array32:
    image = np.zeros((SIZE, SIZE), np.uint8)
    for _ in range(26):
        heading = rng.uniform(0, 2 * np.pi)
        turns = np.cumsum(rng.normal(0, 0.25, 60)) + heading
        steps = 5.0 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        path = np.cumsum(steps, axis=0) + rng.uniform(0, SIZE, 2)
        for dx in (-SIZE, 0, SIZE):
            for dy in (-SIZE, 0, SIZE):
                points = np.round((path + np.array([dx, dy])) * 16).astype(np.int32)
                cv2.polylines(image, [points], False, 255, int(rng.integers(1, 3)), cv2.LINE_AA, 4)
    share: Array32 = image.astype(np.float32) / np.float32(255)
    return share


@dataclass(frozen=True)
class Stack:
    """A tile at several sizes of texels, in one picture.

    Attributes:
        atlas: All levels, one below the other.
        top: First row of each level.
        rows: Texels of each level along the view.
        cols: Texels of each level across it.
        first: Number of the first level, below 0 where nearer ones are finer along the view only.
    """

    atlas: Array32
    top: Array32
    rows: Array32
    cols: Array32
    first: int

    def sample(self, along: Array32, across: Array32, level: Array32) -> Array32:
        """Return the texture at places given in tiles.

        Args:
            along: Place along the view.
            across: Place across it.
            level: Level of the texels; between two levels both are mixed.
        """
        if not len(along):
            return np.zeros(0, np.float32)
        along = along - np.floor(along)
        across = across - np.floor(across)
        level = np.clip(level - np.float32(self.first), 0, len(self.top) - 1.001)
        lower = level.astype(np.int32)
        share = level - lower
        first = self._tap(along, across, lower)
        second = self._tap(along, across, lower + 1)
        result: Array32 = first + share * (second - first)
        return result

    def _tap(self, along: Array32, across: Array32, level: npt.NDArray[np.int32]) -> Array32:
        col = across * self.cols[level] + np.float32(_PAD - 0.5)
        row = along * self.rows[level] + self.top[level]
        return _remap(self.atlas, col, row)


def _remap(image: Array32, col: Array32, row: Array32) -> Array32:
    """Return an image at scattered places, by bilinear interpolation."""
    count = len(col)
    lines = -(-count // _COLUMNS)
    padded = np.zeros((2, lines * _COLUMNS), np.float32)
    padded[0, :count], padded[1, :count] = col, row
    maps = padded.reshape(2, lines, _COLUMNS)
    result: Array32 = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR).ravel()[:count].astype(np.float32)
    return result


@cache
def stack(name: str, slope: int, offset: int) -> Stack:
    """Return the levels of a tile: texels double across from one to the next.

    Args:
        name: Name of the tile.
        slope: Doublings along the view for each across: 2 for a floor, of which a pixel sees a length
            that grows with the square of the distance; 1 for a wall.
        offset: Doublings along the view at level 0. Levels below have as many texels across, and more along.
    """
    base = tile(name)
    levels: list[Array32] = []
    first = -max(0, -(-offset // slope))
    for level in range(first, SIZE.bit_length() - 2):
        rows = max(SIZE >> max(0, slope * level + offset), 4)
        cols = max(SIZE >> max(0, level), 4)
        smaller = (
            base
            if (rows, cols) == base.shape
            else cv2.resize(base, (cols, rows), interpolation=cv2.INTER_AREA)
        )
        levels.append(np.pad(smaller, _PAD, mode="wrap").astype(np.float32))
    heights = [len(level) for level in levels]
    atlas = np.zeros((sum(heights), SIZE + 2 * _PAD), np.float32)
    top = np.concatenate([[0], np.cumsum(heights)[:-1]])
    for start, level_image in zip(top, levels, strict=True):
        atlas[start : start + level_image.shape[0], : level_image.shape[1]] = level_image
    return Stack(
        atlas,
        (top + _PAD - 0.5).astype(np.float32),
        np.array([height - 2 * _PAD for height in heights], np.float32),
        np.array([level.shape[1] - 2 * _PAD for level in levels], np.float32),
        first,
    )
