"""Medians for short lists: np.median spends more time on its checks than on 60 values."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..types import Array

# Of normal values: standard deviation over the median of the absolute deviations.
SIGMA_OVER_MAD = 1.4826
# Of estimates of one thing: one farther than this from the median of the others is an outlier, as is one in
# 15 000 of normal ones.
OUTLIER_SIGMAS = 4.0
# Of the chi-squared distribution with three degrees of freedom: its median, and what one of twenty exceeds.
MEDIAN_CHI2_3 = 2.366
UNLIKELY_CHI2_3 = 7.815


def upper_median(values: Array) -> float:
    """Return the median of values (N,); of an even number, the greater one of the two in the middle."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def median(values: Array) -> float:
    """Return the median of values (N,); of an even number, the mean of the two in the middle."""
    middle = len(values) // 2
    if len(values) % 2:
        return upper_median(values)
    lower, upper = np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1].tolist()
    return float(lower + upper) / 2.0


def quantile(ordered: npt.NDArray[np.integer | np.floating], part: float) -> float:
    """Return the value below which a part (0 ... 1) of sorted values (N,) lies, linear between them."""
    place = (len(ordered) - 1) * part
    below = int(place)
    lower, upper = (float(ordered[i]) for i in (below, min(below + 1, len(ordered) - 1)))
    return lower + (upper - lower) * (place - below)
