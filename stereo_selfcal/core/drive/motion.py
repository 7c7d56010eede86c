"""The motion of a car on its suspension, measured in a drive: means over ten seconds, and their scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..types import Array, Indices

# Length of a block. Suspensions ring for a second or two, and brakes are applied for some seconds. So means
# over ten seconds are hardly correlated, and the correlation that remains is measured.
BLOCK_S = 10.0
# Fewest block means for the standard error of the mean over all blocks.
_FEWEST_FOR_ERROR = 3
# Neighbours on either side of a block that outliers are compared with; a frame is compared with its block.
_NEIGHBOURS = 2
# Scale of normal deviations by their upper quartile: three quarters are within so many standard deviations.
# Up to a quarter of wrong values do not move it, and it is more efficient than the median.
_QUARTILE = 0.75
_SIGMA_OF_QUARTILE = 1.1503
# Most correlation of neighbouring blocks; above it, a shift cannot be distinguished from motion.
_MAX_CORRELATION = 0.8
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
class CarMotion:
    """Scatter of the block means, caused by the motion of the car.

    Attributes:
        sigma: (3,) long-run standard deviation of a block mean, which includes the correlation of the blocks.
            The standard deviation of the mean of n blocks is this over the root of n.
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


def measure_motion(blocks: TimeBlocks, noise: Array, per_block: float) -> CarMotion:
    """Measure the motion by the differences of blocks; a shift changes only one of them.

    Let the block means be an autoregression of first order. Then differences over two blocks have
    (1 + correlation) times the variance of those over one.

    Args:
        blocks: The block means.
        noise: (N, 3) standard deviations of the frames.
        per_block: Mean number of frames in a block.
    """
    differences = (np.abs(blocks.values[lag:] - blocks.values[:-lag]) for lag in (1, 2))
    one, two = (np.quantile(each, _QUARTILE, axis=0) / _SIGMA_OF_QUARTILE for each in differences)
    ratio = float(np.mean(two**2 / np.maximum(one**2, _NO_SCATTER**2)))
    correlation = float(np.clip(ratio - 1.0, 0.0, _MAX_CORRELATION))
    # The variance of a difference is 2 (1 - correlation) times that of a mean.
    single = one**2 / (2.0 * (1.0 - correlation))
    floor = np.median(noise, axis=0) ** 2 / per_block
    return CarMotion(np.sqrt(np.maximum(single, floor) * (1.0 + correlation) / (1.0 - correlation)))


def standard_error(stamps: Array, values: Array) -> Array | None:
    """Return the covariance (3, 3) of a mean over time, from its block means and their correlation.

    Returns:
        None where there are too few blocks.
    """
    means = without_excursions(blocks_of(stamps, values)).values
    n = len(means)
    if n < _FEWEST_FOR_ERROR:
        return None
    residual = means - means.mean(axis=0)
    variance = (residual**2).mean(axis=0)
    lagged = (residual[1:] * residual[:-1]).mean(axis=0)
    # Residuals of a mean are correlated by -1 / n even where the values are not.
    correlation = float(np.mean(lagged / np.maximum(variance, _NO_SCATTER**2))) + 1.0 / n
    correlation = float(np.clip(correlation, 0.0, _MAX_CORRELATION))
    covariance: Array = (residual.T @ residual) / (n - 1) / n * (1 + correlation) / (1 - correlation)
    return covariance
