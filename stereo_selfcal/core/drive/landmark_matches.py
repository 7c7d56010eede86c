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

"""Landmarks of one frame found again in another frame, by their descriptors."""

from __future__ import annotations

import numpy as np

from ..estimators.landmarks import Landmarks
from ..types import Array, Floats, Indices, Mask

# A descriptor of something else differs in half of 256 bits, with a standard deviation of 8 (Calonder et al.,
# 2010). Within 64 bits, one in 10^15 pairs of unlike neighbourhoods is.
_MOST_BITS = 64
_MOST_BITS_NEAR = 80  # where the place is known, few others are compared
_RATIO = 0.8  # of the best distance to that of the second best one (Lowe, IJCV 2004)


def different_bits(before: Landmarks, after: Landmarks) -> Floats:
    """Return the numbers of bits (N, M) in which the descriptors of two frames differ."""
    first, second = (
        2.0 * np.unpackbits(each.descriptors, axis=1).astype(np.float32) - 1.0 for each in (before, after)
    )
    different: Floats = (np.float32(first.shape[1]) - first @ second.T) * np.float32(0.5)
    return different


def match_anywhere(bits: Floats) -> tuple[Indices, Indices]:
    """Return the indices of landmarks of two frames that look alike, and like no other one.

    Args:
        bits: (N, M) numbers of bits in which they differ.
    """
    pairs = _mutual(bits, _MOST_BITS)
    unlike = _unlike_others(bits, pairs) & _unlike_others(bits.T, pairs[::-1])
    return pairs[0][unlike], pairs[1][unlike]


def match_near(bits: Floats, expected: Array, found: Array, radius_px: float) -> tuple[Indices, Indices]:
    """Return the indices of landmarks that look most alike near places where they are expected.

    Args:
        bits: (N, M) numbers of bits in which they differ.
        expected: (N, 3) columns, rows and disparities that the first ones should have [px]; NaN is nowhere.
        found: (M, 3) those that the second ones have [px].
        radius_px: How far apart they may be, the differences of the three numbers together [px].
    """
    apart = np.zeros_like(bits)
    for first, second in zip(expected.astype(np.float32).T, found.astype(np.float32).T, strict=True):
        apart += np.abs(first[:, None] - second)
    return _mutual(np.where(apart <= radius_px, bits, np.float32(np.inf)), _MOST_BITS_NEAR)


def _mutual(bits: Floats, most: float) -> tuple[Indices, Indices]:
    """Return pairs each of which is the best match of the other."""
    rows = np.arange(len(bits))
    if not bits.size:
        return rows[:0], rows[:0]
    columns = bits.argmin(axis=1)
    good = (bits.argmin(axis=0)[columns] == rows) & (bits[rows, columns] <= most)
    return rows[good], columns[good]


def _unlike_others(bits: Floats, pairs: tuple[Indices, Indices]) -> Mask:
    """Return which pairs are much closer than the second best match of the first one."""
    rows, columns = pairs
    others = bits[rows]
    best = others[np.arange(len(rows)), columns].copy()
    others[np.arange(len(rows)), columns] = np.inf
    unlike: Mask = best < _RATIO * others.min(axis=1, initial=np.inf)
    return unlike
