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

"""When the mount was moved: level shifts in the estimates of a drive, separated from the car's own motion.

A car pitches when it brakes, rolls when it turns, and sinks under its load. After each such motion its camera
returns. A mount that was knocked does not return. So the estimates are averaged over blocks of ten seconds,
and a deviation that returns within two minutes is motion. A shift must be significant against the motion that
the same drive shows. The threshold is exceeded by chance in one drive in a hundred.

Shifts are searched in seeded intervals, the most significant first (S. Kovacs et al., "Seeded binary
segmentation", Biometrika 110, 2023). Unlike plain binary segmentation, this finds a shift and its opposite. A
shift that is not significant against the minutes around it is dropped, so that a slow drift is not divided
into steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..tolerances import LEAST_SHIFT
from ..types import Array
from .frame_series import FrameSeries
from .motion import mark_outliers
from .time_blocks import (
    BLOCK_S,
    BlockScatter,
    TimeBlocks,
    blocks_of,
    measure_scatter_of_blocks,
    without_excursions,
)

# Least duration of a level on either side of a shift: two minutes. A level that returns within them is that
# of a car that braked twice, stood on a slope or towed.
_STAYS_BLOCKS = 12
_FEWEST_BLOCKS = 2 * _STAYS_BLOCKS
# A shift is compared with the estimates within this time on either side. Over hours, fuel, load and warmth
# move a camera as well.
_AROUND_S = 300.0
# Least statistic of a shift, in standard errors. The statistic is the greatest over all intervals, parameters
# and splits. It exceeds the threshold in at most 1 % of simulated drives of minutes to an hour without a
# shift, whether motion lasts for half a second or for five.
_THRESHOLD = 5.5

# Growth of the lengths of the seeded intervals, which overlap by half.
_GROWTH = 2**0.5
# Half width of the 95 % interval of a change point, in units of sigma^2 / shift^2: J. Bai, "Estimation of a
# change point in multiple regression models", Rev. Econ. Stat. 79, 1997.
_BAI_95 = 11.0


@dataclass(frozen=True, slots=True, eq=False)
class MountSegment:
    """A part of a drive in which the mount did not move.

    Attributes:
        first: Index of its first estimate.
        end: Index after its last estimate.
        start_s: Stamp of the first estimate [s].
        end_s: Stamp of the last estimate [s].
        mean: (3,) mean of height_m, pitch_rad, roll_rad without outliers.
        spread: (3,) standard deviation of the estimates over time: the car's motion and the noise of a frame.
    """

    first: int
    end: int
    start_s: float
    end_s: float
    mean: Array
    spread: Array


@dataclass(frozen=True, slots=True, eq=False)
class LevelShift:
    """A move of the mount.

    Attributes:
        index: Index of the first estimate after the move.
        at_s: Time of the move [s]: the middle between the last estimate before and the first one after it.
        within_s: Half width of the interval that contains the move with a probability of 95 % [s].
        shift: (3,) change of height_m, pitch_rad, roll_rad.
        sigmas: (3,) the change over its standard error.
    """

    index: int
    at_s: float
    within_s: float
    shift: Array
    sigmas: Array


@dataclass(frozen=True, slots=True, eq=False)
class MountHistory:
    """Segments of a drive, and the moves of the mount between them.

    Attributes:
        segments: Parts in which the mount did not move, in order; at least one.
        changes: Moves between the segments.
        judged: Whether the drive is long enough to distinguish a move from motion.
    """

    segments: tuple[MountSegment, ...]
    changes: tuple[LevelShift, ...]
    judged: bool


def find_changes(series: FrameSeries) -> MountHistory:
    """Find the moves of the mount, and its pose between them.

    Args:
        series: The accepted frames of a drive, at least one.

    Returns:
        One segment where the mount was not moved, or where the drive is too short to find a move.

    Raises:
        ValueError: There is no frame.
    """
    if not len(series):
        raise ValueError("a drive of no frames has no mount")
    stamps, values = series.times_s, series.values
    blocks = blocks_of(stamps, values)
    if len(blocks) < _FEWEST_BLOCKS:
        return MountHistory((_segment(stamps, values, 0, len(stamps)),), (), False)
    kept = without_excursions(blocks)
    if len(kept) < _FEWEST_BLOCKS:
        kept = blocks
    scatter = measure_scatter_of_blocks(replace(series, used=mark_outliers(series)), kept)
    splits = _verify_splits(_refit_splits(_candidates(kept, scatter), kept, scatter), kept, scatter)
    cuts = [_locate(split, splits, kept, stamps, values, scatter) for split in splits]
    bounds = [0, *cuts, len(stamps)]
    segments = tuple(_segment(stamps, values, a, b) for a, b in pairwise(bounds))
    changes = tuple(
        _change(cut, split, splits, kept, stamps, scatter) for cut, split in zip(cuts, splits, strict=True)
    )
    return MountHistory(segments, changes, True)


def _seeded(n: int) -> list[tuple[int, int]]:
    """Return intervals of n blocks: all lengths from the shortest to n, each shifted by half its length."""
    intervals = []
    length = float(2 * _STAYS_BLOCKS)
    while True:
        whole = min(round(length), n)
        n_starts = -(-(n - whole) // max(whole // 2, 1)) + 1
        starts = np.unique(np.round(np.linspace(0, n - whole, n_starts)).astype(int))
        intervals += [(int(start), int(start) + whole) for start in starts]
        if whole == n:
            return intervals
        length *= _GROWTH


def _candidates(blocks: TimeBlocks, scatter: BlockScatter) -> list[int]:
    """Return the splits at which the level shifts significantly, as indices of blocks, in order."""
    total = np.vstack([np.zeros(3), np.cumsum(blocks.values, axis=0)])
    found: list[tuple[float, int, int, int]] = []
    for start, end in _seeded(len(blocks)):
        split = np.arange(start + _STAYS_BLOCKS, end - _STAYS_BLOCKS + 1)
        before = (total[split] - total[start]) / (split - start)[:, None]
        after = (total[end] - total[split]) / (end - split)[:, None]
        statistic = scatter.statistic(after - before, split - start, end - split)
        large = np.where(np.abs(after - before) >= LEAST_SHIFT, statistic, 0.0).max(axis=1)
        best = int(np.argmax(large))
        if large[best] > _THRESHOLD:
            found.append((-float(large[best]), start, end, int(split[best])))
    splits: list[int] = []
    for _, start, end, split_at in sorted(found):
        if not any(start < other < end for other in splits):
            splits.append(split_at)
    return sorted(splits)


def _around(split: int, splits: list[int], blocks: TimeBlocks) -> tuple[slice, slice]:
    """Return the blocks before and after a split, up to the next splits, and at most ``_AROUND_S`` away."""
    reach = round(_AROUND_S / BLOCK_S)
    before = max([other for other in splits if other < split], default=0)
    after = min([other for other in splits if other > split], default=len(blocks))
    return slice(max(before, split - reach), split), slice(split, min(after, split + reach))


def _reach(split: int, splits: list[int], blocks: TimeBlocks) -> tuple[int, int]:
    """Return the range of blocks a split may move in: half way to its neighbours, which may move as well."""
    before, after = _around(split, splits, blocks)
    inset = _STAYS_BLOCKS // 2
    low = (before.start + split) // 2 + inset if before.start in splits else before.start
    high = (split + after.stop) // 2 - inset if after.stop in splits else after.stop
    return min(low, split), max(high, split)


def _refit_splits(splits: list[int], blocks: TimeBlocks, scatter: BlockScatter) -> list[int]:
    """Move each split to its best position, judged by all blocks around it instead of its interval alone."""
    moved = []
    for split in splits:
        before, after = _around(split, splits, blocks)
        values = blocks.values[before.start : after.stop] / scatter.sigma
        low, high = _reach(split, splits, blocks)
        n = np.arange(low, high + 1) - before.start
        n = n[(n >= _STAYS_BLOCKS) & (n <= len(values) - _STAYS_BLOCKS)]
        if not len(n):
            moved.append(split)
            continue
        total = np.cumsum(values, axis=0)
        before_sum, after_sum = total[n - 1], total[-1] - total[n - 1]
        explained = np.sum(before_sum**2 / n[:, None] + after_sum**2 / (len(values) - n)[:, None], axis=1)
        moved.append(before.start + int(n[np.argmax(explained)]))
    return moved


def _shift(split: int, splits: list[int], blocks: TimeBlocks, scatter: BlockScatter) -> tuple[Array, Array]:
    """Return the shift (3,) at a split and its statistic (3,), from the blocks around it."""
    before, after = (blocks.values[part] for part in _around(split, splits, blocks))
    shift = np.median(after, axis=0) - np.median(before, axis=0)
    return shift, scatter.statistic(shift, len(before), len(after))


def _verify_splits(splits: list[int], blocks: TimeBlocks, scatter: BlockScatter) -> list[int]:
    """Drop the splits that are not significant, the weakest first, and pairs of splits that return."""
    splits = list(splits)
    while splits:
        strength = []
        for split in splits:
            shift, statistic = _shift(split, splits, blocks, scatter)
            strength.append(float(np.where(np.abs(shift) >= LEAST_SHIFT, statistic, 0.0).max()))
        weakest = int(np.argmin(strength))
        if strength[weakest] > _THRESHOLD:
            returning = _first_return(splits, blocks, scatter)
            if returning is None:
                break
            del splits[returning : returning + 2]
            continue
        del splits[weakest]
    return splits


def _first_return(splits: list[int], blocks: TimeBlocks, scatter: BlockScatter) -> int | None:
    """Return the index of the first two neighbouring splits between which the camera moved only briefly."""
    for i, (away, back) in enumerate(pairwise(splits)):
        if back - away > _STAYS_BLOCKS:
            continue
        others = [split for split in splits if split not in (away, back)]
        before, _ = _around(away, others, blocks)
        _, after = _around(back, others, blocks)
        shift = np.median(blocks.values[after], axis=0) - np.median(blocks.values[before], axis=0)
        statistic = scatter.statistic(shift, before.stop - before.start, after.stop - after.start)
        if not np.any((np.abs(shift) >= LEAST_SHIFT) & (statistic > _THRESHOLD)):
            return i
    return None


def _locate(
    split: int, splits: list[int], blocks: TimeBlocks, stamps: Array, values: Array, scatter: BlockScatter
) -> int:
    """Return the index of the first frame after a shift, by least squares around it."""
    before, after = _around(split, splits, blocks)
    levels = [np.median(blocks.values[part], axis=0) for part in (before, after)]
    low, high = _reach(split, splits, blocks)
    starts_s = stamps[0] + BLOCK_S * np.append(blocks.number, blocks.number[-1] + 1)
    first, end = (int(i) for i in np.searchsorted(stamps, starts_s[[low, high]]))
    first, end = max(first, 1), min(end, len(stamps) - 1)
    costs = [np.sum(((values[first:end] - level) / scatter.sigma) ** 2, axis=1) for level in levels]
    # A frame that is off by more than the shift is an outlier. Its contribution is limited to that of the
    # shift.
    most = float(np.sum(((levels[1] - levels[0]) / scatter.sigma) ** 2))
    gain = np.clip(costs[1] - costs[0], -most, most)  # > 0: nearer to the level before the shift
    return first + int(np.argmax(np.concatenate([[0.0], np.cumsum(gain)])))


def _change(
    cut: int, split: int, splits: list[int], blocks: TimeBlocks, stamps: Array, scatter: BlockScatter
) -> LevelShift:
    shift, statistic = _shift(split, splits, blocks, scatter)
    gap_s = float(stamps[cut] - stamps[cut - 1])
    strength = float(np.sum((shift / scatter.sigma) ** 2))
    within_s = gap_s / 2.0 + _BAI_95 * BLOCK_S / strength
    return LevelShift(cut, float(stamps[cut] + stamps[cut - 1]) / 2.0, within_s, shift, statistic)


def _segment(stamps: Array, values: Array, first: int, end: int) -> MountSegment:
    part = values[first:end]
    deviation = np.abs(part - np.median(part, axis=0))
    scale = SIGMA_OVER_MAD * np.median(deviation, axis=0)
    good = np.all(deviation <= OUTLIER_SIGMAS * scale, axis=1)
    part = part[good] if good.any() else part
    spread = part.std(axis=0, ddof=1) if len(part) > 1 else np.zeros(3)
    return MountSegment(
        first,
        end,
        float(stamps[first]),
        float(stamps[end - 1]),
        part.mean(axis=0),
        spread,
    )
