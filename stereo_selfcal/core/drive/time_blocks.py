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

"""Means over blocks of ten seconds, among which changes of the mount are looked for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..types import Array, Indices
from .frame_series import FrameSeries
from .motion import measure_motion

# Length of a block. Bodies ring for a second or two, and brakes are applied for some seconds: means over ten
# seconds are hardly correlated.
BLOCK_S = 10.0
# Blocks on either side whose median is the level of a frame, when the motion about the levels is measured: a
# level that stays for two minutes is one.
_LEVEL_BLOCKS = 12
# Neighbours on either side of a block that outliers are compared with; a frame is compared with its block.
_NEIGHBOURS = 2
# Least scatter, for estimates that are all equal: smaller than any measured value [m], [rad].
_NO_SCATTER = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class TimeBlocks:
    """Means over blocks of ten seconds that contain estimates.

    Attributes:
        number: (B,) number of each block since the first estimate.
        values: (B, 3) mean of height_m, pitch_rad, roll_rad in each block.
    """

    number: Indices
    values: Array

    def __len__(self) -> int:
        return len(self.number)


@dataclass(frozen=True, slots=True, eq=False)
class BlockScatter:
    """Scatter of the block means, caused by the motion of the car and the noise of the frames.

    Attributes:
        sigma: (3,) standard deviation of a block mean, in the mean of many blocks. That of the mean of n
            blocks is this over the root of n.
    """

    sigma: Array

    def statistic(self, shift: Array, n_before: npt.ArrayLike, n_after: npt.ArrayLike) -> Array:
        """Return a shift (..., 3) over its standard error."""
        error = np.sqrt(1.0 / np.asarray(n_before) + 1.0 / np.asarray(n_after))
        statistic: Array = np.abs(shift) / (self.sigma * error[..., None])
        return statistic


def blocks_of(stamps: Array, values: Array) -> TimeBlocks:
    """Average over blocks of time; a frame far from the median of its block is left out."""
    number = np.floor((stamps - stamps[0]) / BLOCK_S).astype(np.intp)
    bounds = np.flatnonzero(np.diff(number)) + 1
    parts = np.split(values, bounds)
    scale = SIGMA_OVER_MAD * np.median(
        np.concatenate([np.abs(part - np.median(part, axis=0)) for part in parts]), axis=0
    )
    means = []
    for part in parts:
        good = np.all(np.abs(part - np.median(part, axis=0)) <= OUTLIER_SIGMAS * scale, axis=1)
        means.append(part[good].mean(axis=0) if good.any() else np.median(part, axis=0))
    return TimeBlocks(number[np.concatenate([[0], bounds])], np.array(means))


def without_excursions(blocks: TimeBlocks) -> TimeBlocks:
    """Leave out blocks that are far from the median of their neighbours.

    The blocks at a shift stay, because they agree with their neighbours on one side.
    """
    values = blocks.values
    if len(values) <= 2 * _NEIGHBOURS:
        return blocks
    padded = np.pad(values, ((_NEIGHBOURS, _NEIGHBOURS), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1, axis=0)
    deviation = np.abs(values - np.median(windows, axis=2))
    scale = SIGMA_OVER_MAD * np.median(deviation, axis=0)
    alike = np.all(deviation <= OUTLIER_SIGMAS * np.maximum(scale, _NO_SCATTER), axis=1)
    return TimeBlocks(blocks.number[alike], values[alike])


def measure_scatter_of_blocks(series: FrameSeries, blocks: TimeBlocks) -> BlockScatter:
    """Measure the motion about the levels of a drive, whatever shifts there are between them.

    The level at a time is the median of the blocks around it. It follows a shift, and nothing that returns
    within two minutes.

    Args:
        series: The frames.
        blocks: Their block means, without excursions.
    """
    reach = min(_LEVEL_BLOCKS, (len(blocks) - 1) // 2)
    padded = np.pad(blocks.values, ((reach, reach), (0, 0)), mode="reflect")
    levels = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0), axis=2)
    number = np.floor((series.times_s - series.times_s[0]) / BLOCK_S).astype(np.intp)
    nearest = np.clip(np.searchsorted(blocks.number, number), 0, len(blocks) - 1)
    about = replace(series, values=series.values - levels[nearest])
    per_block = np.count_nonzero(series.used) / len(np.unique(number))
    noise = np.median(series.variances, axis=0) / per_block
    return BlockScatter(np.sqrt(measure_motion(about).of_block(BLOCK_S) + noise))
