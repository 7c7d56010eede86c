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

"""Medians of short lists. For 60 values, np.median spends more time on its checks than on the values."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..types import Array

# Standard deviation of normal values over the median of their absolute deviations.
SIGMA_OVER_MAD = 1.4826
# An estimate farther than this from the median of the others is an outlier. One of 15 000 normal values is.
OUTLIER_SIGMAS = 4.0
# Median and 95th percentile of the chi-squared distribution with three degrees of freedom.
MEDIAN_CHI2_3 = 2.366
UNLIKELY_CHI2_3 = 7.815


def upper_median(values: Array) -> float:
    """Return the median of values (N,); for an even N, the greater one of the two middle values."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def median(values: Array) -> float:
    """Return the median of values (N,); for an even N, the mean of the two middle values."""
    middle = len(values) // 2
    if len(values) % 2:
        return upper_median(values)
    lower, upper = np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1].tolist()
    return float(lower + upper) / 2.0


def quantile(ordered: npt.NDArray[np.integer | np.floating], part: float) -> float:
    """Return the quantile at a fraction (0 ... 1) of sorted values (N,), interpolated linearly."""
    position = (len(ordered) - 1) * part
    below = int(position)
    lower, upper = (float(ordered[i]) for i in (below, min(below + 1, len(ordered) - 1)))
    return lower + (upper - lower) * (position - below)
