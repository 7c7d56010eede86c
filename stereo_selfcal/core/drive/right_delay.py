"""Delay of the right images against the left ones, from a drive whose speed varies.

A right image that is taken later shows the street from farther ahead: by the speed times the delay. A right
camera that sits farther ahead than the rig has it does the same at any speed. Both come apart where the speed
varies; at constant speed only their sum is known, and the prior of the rig decides how much of it is a delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.travel import RightDelay
from ..numerics.linear import invert, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted
from ..numerics.statistics import SIGMA_OVER_MAD, upper_median
from ..rejection import Bound, NotFitted
from ..road.priors import BASELINE_DIRECTION_STD_RAD
from ..types import Array
from .travel import TravelStep

_REWEIGHTING = Reweighting(rounds=4, absolute_rounds=2)
_LEAST_FRAMES = 3
# Prior of the delay: that of a frame at 10 Hz, and so none where anything is measured.
_DELAY_STD_S = 0.1
# Rows that are off by a tenth of a pixel move the road by a centimetre or two along the way.
_OFFSET_STD_M = 0.02
_DETERMINED = "numbers of the delay that the frames determine"


def fit_delay(
    ahead_m: npt.ArrayLike, std_m: npt.ArrayLike, speed_mps: npt.ArrayLike, rig: StereoRig
) -> RightDelay | NotFitted:
    """Fit a delay of the right images and an offset of the right camera to how far ahead it seems to sit.

    Args:
        ahead_m: (N,) how far ahead the right camera seems to sit in each frame [m]:
            :attr:`.RowAlignment.ahead` times the baseline.
        std_m: (N,) standard deviations [m].
        speed_mps: (N,) speed of the car at these times [m/s].
        rig: Intrinsics and baseline.

    Returns:
        Both, or why they are not known: there are too few frames.
    """
    ahead, std, speed = (np.asarray(each, np.float64) for each in (ahead_m, std_m, speed_mps))
    known = np.isfinite(ahead) & np.isfinite(std) & (std > 0.0) & np.isfinite(speed)
    ahead, std, speed = ahead[known], std[known], speed[known]
    if len(ahead) < _LEAST_FRAMES:
        return NotFitted("frames whose speed is known", len(ahead), Bound.LEAST, _LEAST_FRAMES)
    design = np.column_stack([speed, np.ones(len(speed))])
    offset_std_m = math.hypot(BASELINE_DIRECTION_STD_RAD * rig.baseline_m, _OFFSET_STD_M)
    prior = np.diag([_DELAY_STD_S**-2.0, offset_std_m**-2.0])
    scaled = design / std[:, None]

    def fit(weights: Array, _: float | Array) -> tuple[Array, Array] | NotFitted:
        weighted = scaled.T * weights
        solution = solve_linear(weighted @ scaled + prior, weighted @ (ahead / std), _DETERMINED)
        if isinstance(solution, NotFitted):
            return solution
        return solution, (ahead - design @ solution) / std

    # Frames that scatter more than they say are all taken as less certain; none as more certain.
    found = fit_reweighted(
        fit, len(ahead), _REWEIGHTING, lambda left: max(1.0, SIGMA_OVER_MAD * upper_median(np.abs(left)))
    )
    if isinstance(found, NotFitted):
        return found
    information = (scaled.T * (found.weights / float(found.scale) ** 2)) @ scaled
    covariance = invert(information + prior, _DETERMINED)
    if isinstance(covariance, NotFitted):
        return covariance
    delay_s, offset_m = found.solution
    return RightDelay(float(delay_s), float(offset_m), covariance, int(np.count_nonzero(found.weights)))


def speeds_at(stamps_s: Sequence[float], steps: Sequence[TravelStep]) -> Array:
    """Return the speed of the car (N,) at some times [m/s], between the steps that were measured.

    Args:
        stamps_s: Time stamps [s].
        steps: Steps of the drive, in the order of time.

    Returns:
        The speeds; NaN before the middle of the first step, after that of the last one, and where no step is
        near.
    """
    stamps = np.asarray(stamps_s, np.float64)
    if not steps:
        return np.full(len(stamps), math.nan)
    middle = np.array([step.middle_s for step in steps])
    speed = np.array([step.speed_mps for step in steps])
    found = np.interp(stamps, middle, speed, left=math.nan, right=math.nan)
    # Within a step or next to it.
    begin = np.array([step.stamp_s for step in steps])
    length = np.array([step.duration_s for step in steps])
    apart = np.abs(stamps[:, None] - (begin + length / 2.0)) <= 1.01 * length
    return np.where(apart.any(axis=1), found, math.nan)
