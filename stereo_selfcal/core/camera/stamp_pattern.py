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

"""Why no left and right image formed a pair: told by the pattern of their stamps.

Two causes look alike at first sight. Cameras that are not triggered together have other stamps for the same
moment; a tolerance helps. Images that are lost on the way leave gaps, and where a left and a right one never
arrive of the same moment, their stamps differ by whole frames; a tolerance of that size would pair images of
different moments. What tells them apart is the camera's period, the least usual gap in the stamps of a side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..types import Array

_S_PER_NS = 1e-9
_MS_PER_S = 1e3

# Gaps up to this many times the least one are of one frame: stamps jitter by less than a quarter of a frame.
_ONE_FRAME = 1.5
# A side that lacks more of its frames than this loses images. A camera's own hiccups are fewer.
_LOST_SHARE = 0.2
# Fewer stamps of a side show no pattern.
_LEAST_STAMPS = 6
# Of fewer than that, but this many without a gap, an offset of less than this part of a frame is clear: to be
# in step, the cameras would have to lose four of five images, and always the same four.
_FEWEST_STAMPS = 3
_CLEARLY_LESS = 0.2
# Stamps of one moment differ by less than this part of a frame, where the cameras are triggered together.
_IN_PHASE = 0.1
# With gaps, the least one is the camera's period only if all others are whole multiples of it: most, to this
# part of a frame. Of images lost at random all gaps of 14 are even once in 16 000 times.
_LEAST_STAMPS_WITH_GAPS = 8
_WHOLE_FRAMES = 0.15
_WHOLE_SHARE = 0.8
# Length of the mean of the offsets as angles: 1 if left and right are always apart by one part of a frame.
_SAME_OFFSET = 0.9
# An offset of this part of the gaps may be that of cameras faster than what arrives of them, of which every
# second or third image is lost; to this accuracy.
_FASTER = (2, 3)
_FASTER_ACCURACY = 0.02

# A suggested tolerance over the least difference that was seen; stamps jitter by so much.
_SUGGESTED_MARGIN = 1.2
_SUGGESTED_STEP_S = 0.001


class NoPairCause(Enum):
    """What keeps images from forming pairs."""

    TOO_FEW = "too_few"
    QUEUE = "queue"
    LOST = "lost"
    UNEQUAL = "unequal"
    CLOCKS = "clocks"
    UNCLEAR = "unclear"


@dataclass(frozen=True, slots=True)
class StampPattern:
    """What the stamps show of images that formed no pair.

    Attributes:
        cause: Why they did not.
        nearest_s: Least difference of a left and a right stamp [s], NaN where a side has none.
        period_s: Time between two images of a camera [s], NaN where it is not seen.
        lost: Share of the frames of the left and of the right camera that are not there.
    """

    cause: NoPairCause
    nearest_s: float = math.nan
    period_s: float = math.nan
    lost: tuple[float, float] = (0.0, 0.0)

    @property
    def tolerance_s(self) -> float | None:
        """A tolerance with which they would pair, and no images of different moments; None without one."""
        if self.cause is not NoPairCause.UNEQUAL:
            return None
        return suggest_tolerance_s(self.nearest_s, self.period_s)

    @property
    def half_frame(self) -> str:
        """Half of a frame's time, in words: the limit of every tolerance."""
        return f"half a frame is {0.5 * self.period_s * _MS_PER_S:.1f} ms"

    def __str__(self) -> str:
        """Return the cause as a part of a sentence, without the remedy."""
        nearest = f"the nearest stamps differ by {self.nearest_s * _MS_PER_S:.3f} ms"
        frame = f"a frame is {self.period_s * _MS_PER_S:.1f} ms"
        missing = f"missing are {self.lost[0]:.0%} of the left and {self.lost[1]:.0%} of the right images"
        match self.cause:
            case NoPairCause.TOO_FEW:
                few = "too few images arrived on both sides to tell why"
                return few if math.isnan(self.nearest_s) else f"{nearest}; {few}"
            case NoPairCause.LOST:
                return f"images are lost on the way: {nearest}, whole frames ({frame}); {missing}"
            case NoPairCause.CLOCKS:
                return (
                    f"{nearest}, more than half a frame ({frame}): no tolerance helps, the clocks of the "
                    "cameras have to be set alike"
                )
            case NoPairCause.UNCLEAR:
                return (
                    f"{nearest}; either images are lost on the way and no two of one moment arrived, or the "
                    "stamps of the cameras differ: a tolerance might pair images of different moments"
                )
            case _:
                return nearest


def stamp_pattern(
    left_ns: Sequence[int], right_ns: Sequence[int], tolerance_s: float = 0.0, equal_before: bool = False
) -> StampPattern:
    """Find out why images formed no pair.

    Args:
        left_ns: Stamps of the left images that arrived [ns], in any order.
        right_ns: Those of the right images.
        tolerance_s: Greatest difference of a pair [s].
        equal_before: Whether left and right images with equal stamps were seen before these.
    """
    left, right = _seconds(left_ns, right_ns)
    if not left.size or not right.size:
        return StampPattern(NoPairCause.TOO_FEW)
    offsets = _offsets(left, right)
    least = float(np.abs(offsets).min())
    if least <= tolerance_s + 0.5 * _S_PER_NS:
        return StampPattern(NoPairCause.QUEUE, least)
    period = _period_s(left, right)
    if not math.isfinite(period):
        return StampPattern(NoPairCause.TOO_FEW, least)
    lost = _lost_share(left, period), _lost_share(right, period)
    return StampPattern(_cause(left, right, offsets, max(lost), period, equal_before), least, period, lost)


def suggest_tolerance_s(nearest_s: float, period_s: float) -> float | None:
    """Return a tolerance with which the images of two cameras would pair, None when there is none.

    The tolerance is between the least difference of their stamps and half a frame. With half a frame or more,
    an image would be nearer to the one before or after its partner.

    Args:
        nearest_s: Least difference of a left and a right stamp that was seen [s].
        period_s: Time between two images of the faster camera [s].

    Returns:
        Whole milliseconds [s].
    """
    half_frame_s = 0.5 * period_s
    if not nearest_s < half_frame_s:
        return None
    step_s = math.ceil(_SUGGESTED_MARGIN * nearest_s / _SUGGESTED_STEP_S) * _SUGGESTED_STEP_S
    if step_s < half_frame_s:
        return round(step_s, 3)
    # Near half a frame, there may be no whole millisecond between the two; then microseconds are used.
    fine_s = math.ceil(round(nearest_s * 1e6, 3)) / 1e6
    return fine_s if fine_s < half_frame_s else None


def _seconds(left_ns: Sequence[int], right_ns: Sequence[int]) -> tuple[Array, Array]:
    """Return both as (N,) float64 [s] since the first, sorted, each once; 64 bits hold no absolute ns."""
    first = min([*left_ns, *right_ns], default=0)
    left, right = (
        np.unique(np.array([stamp_ns - first for stamp_ns in side], float) * _S_PER_NS)
        for side in (left_ns, right_ns)
    )
    return left, right


def _offsets(left: Array, right: Array) -> Array:
    """Return how far each stamp of the shorter side is after the nearest of the other, (N,) [s]."""
    few, many = (left, right) if left.size <= right.size else (right, left)
    after = np.searchsorted(many, few).clip(1, max(many.size - 1, 1))
    below, above = few - many[after - 1], few - many[np.minimum(after, many.size - 1)]
    offsets: Array = np.where(np.abs(below) <= np.abs(above), below, above)
    return offsets


def _period_s(left: Array, right: Array) -> float:
    """Return the time between two images of the faster camera, NaN where no side has two."""
    periods = [math.nan]
    for gaps in (np.diff(left), np.diff(right)):
        if gaps.size:
            one = float(np.median(gaps[gaps <= _ONE_FRAME * gaps.min()]))
            periods.append(float(gaps.sum() / np.round(gaps / one).sum()))
    return float(np.nanmin(periods)) if len(periods) > 1 else math.nan


def _lost_share(side: Array, period: float) -> float:
    frames = max(1.0, float(np.round((side[-1] - side[0]) / period)))
    return float(np.clip(1.0 - (side.size - 1) / frames, 0.0, 1.0)) if side.size > 1 else 0.0


def _cause(
    left: Array, right: Array, offsets: Array, lost: float, period: float, equal_before: bool
) -> NoPairCause:
    least, n = float(np.abs(offsets).min()), min(left.size, right.size)
    same_moment = least < 0.5 * period
    unclear = NoPairCause.LOST if equal_before else NoPairCause.UNCLEAR
    if n < _LEAST_STAMPS:
        clear = n >= _FEWEST_STAMPS and lost <= _LOST_SHARE and least <= _CLEARLY_LESS * period
        return NoPairCause.UNEQUAL if clear and not equal_before else unclear
    if lost <= _LOST_SHARE:
        times = period / float(np.median(np.abs(offsets)))
        if any(abs(times - faster) <= _FASTER_ACCURACY * faster for faster in _FASTER):
            return unclear
        return NoPairCause.UNEQUAL if same_moment else NoPairCause.CLOCKS
    if not same_moment:
        in_phase = float(np.median(_off_whole(offsets / period))) <= _IN_PHASE
        return NoPairCause.LOST if in_phase else unclear
    of_the_period = n >= _LEAST_STAMPS_WITH_GAPS and all(
        float(np.mean(_off_whole(np.diff(side) / period) <= _WHOLE_FRAMES)) >= _WHOLE_SHARE
        for side in (left, right)
    )
    same_offset = float(np.abs(np.mean(np.exp(2j * np.pi * offsets / period)))) >= _SAME_OFFSET
    return NoPairCause.UNEQUAL if of_the_period and same_offset else unclear


def _off_whole(frames: Array) -> Array:
    """Return how far numbers are from whole ones."""
    distance: Array = np.abs(frames - np.round(frames))
    return distance
