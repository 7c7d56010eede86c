"""Lists of different lengths, end to end in one array."""

from __future__ import annotations

import numpy as np

from ..types import Indices


def consecutive(starts: Indices, counts: Indices) -> Indices:
    """Return whole numbers, end to end: from each start (N,) on, as many as its count (N,)."""
    ends = np.cumsum(counts)
    numbers: Indices = np.repeat(starts - ends + counts, counts)
    numbers += np.arange(len(numbers))
    return numbers
