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

"""Delay of the right images against the left ones, from a drive whose speed varies.

A right image that is taken later shows the street from farther ahead: by the speed times the delay. A right
camera that sits farther ahead than the rig has it does the same at any speed. Both come apart where the speed
varies; at constant speed only their sum is known, and the prior of the rig decides how much of it is a delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.travel import RightDelay
from ..numerics.linear import invert, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..numerics.statistics import SIGMA_OVER_MAD, upper_median
from ..rejection import Bound, NotFitted
from ..results import CalibrationResult
from ..road.priors import BASELINE_DIRECTION_STD_RAD
from ..types import Array
from .travel import TravelStep

_REWEIGHTING = Reweighting(rounds=4, absolute_rounds=2)
_LEAST_FRAMES = 3
# Prior of the delay: that of a frame at 10 Hz, and so none where anything is measured.
_DELAY_STD_S = 0.1
# Rows that are off by a tenth of a pixel move the road by a centimetre or two along the way.
_OFFSET_STD_M = 0.02
# Speeds by the steps around are right to so much in rendered drives: steps have errors of their own, and a
# car changes its acceleration.
_SPEED_PART = 0.03
# Within this time, the speed changes linearly: a car brakes by 3 m/s^2, and by other than that hardly sooner.
_NEAR_S = 0.75
_STEPS_OF_LINE = 4
_LEAST_SPEED_SCATTER_MPS = 0.05
_OF_SPEEDS = Reweighting(rounds=2, absolute_rounds=3)
_OF_LINE = "numbers of the speed that the steps determine"
_DETERMINED = "numbers of the delay that the frames determine"


@dataclass(frozen=True, slots=True)
class SeenAhead:
    """How far ahead the right camera seems to sit in a frame.

    Attributes:
        stamp_s: Time stamp of the frame [s].
        ahead_m: How much farther ahead than the rig has it [m].
        std_m: Its standard deviation [m].
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
    """

    stamp_s: float
    ahead_m: float
    std_m: float
    stamp_difference_s: float = 0.0


def seen_ahead(result: CalibrationResult, rig: StereoRig) -> SeenAhead | None:
    """Return how far ahead the right camera seems to sit in a frame, accepted or refused.

    The rows of points all over the images tell it; where they do not, the road as seen from above.

    Args:
        result: Result of the frame.
        rig: The rig.

    Returns:
        The way; None where nothing tells it.
    """
    seen, late = result.landmarks, result.lateness
    if seen is not None and math.isfinite(seen.ahead_std):
        ahead_m, std_m = rig.baseline_m * seen.ahead, rig.baseline_m * seen.ahead_std
    elif late is not None:
        # A right image that is taken earlier is one of a camera that sits farther back.
        ahead_m, std_m = -late.way_m, late.std_m
    else:
        return None
    return SeenAhead(result.stamp_s, ahead_m, std_m, result.stamp_difference_s)


def estimate_delay(
    seen: Sequence[SeenAhead], steps: Sequence[TravelStep], rig: StereoRig
) -> RightDelay | NotFitted:
    """Estimate the delay of the right images of a drive, against what their stamps say.

    Args:
        seen: How far ahead the right camera seems to sit in each frame.
        steps: Steps of the drive, in the order of time: they tell the speed.
        rig: The rig that all come from.

    Returns:
        The delay, or why it is not known.
    """
    speeds_mps = speeds_at([each.stamp_s for each in seen], steps)
    by_stamps_m = speeds_mps * np.array([each.stamp_difference_s for each in seen])
    ahead_m = np.array([each.ahead_m for each in seen]) - by_stamps_m
    delay = fit_delay(ahead_m, [each.std_m for each in seen], speeds_mps, rig)
    if isinstance(delay, NotFitted):
        return delay
    # Speeds that are all too large make the delay too small.
    of_speed = np.diag([(_SPEED_PART * delay.delay_s) ** 2, 0.0])
    return replace(delay, covariance=delay.covariance + of_speed)


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
    used = found.weights > 0.0
    speeds = float(speed[used].min()), float(speed[used].max())
    return RightDelay(float(delay_s), float(offset_m), covariance, int(np.count_nonzero(used)), speeds)


def speeds_at(stamps_s: Sequence[float], steps: Sequence[TravelStep]) -> Array:
    """Return the speed of the car (N,) at some times [m/s], by the steps around each.

    A car does not change its speed by much within a second. So the speed is that of a line through the steps
    before and after, without outliers.

    Args:
        stamps_s: Time stamps [s].
        steps: Steps of the drive.

    Returns:
        The speeds; NaN where no steps are near, or all lie on one side.
    """
    middle = np.array([step.middle_s for step in steps])
    speed = np.array([step.speed_mps for step in steps])
    return np.array([_speed_at(stamp, middle, speed) for stamp in stamps_s], np.float64)


def _speed_at(stamp_s: float, middle_s: Array, speed_mps: Array) -> float:
    apart = middle_s - stamp_s
    near = np.abs(apart) <= _NEAR_S
    time, speed = apart[near], speed_mps[near]
    if not (np.any(time <= 0.0) and np.any(time >= 0.0)):
        return math.nan
    # With few steps, their mean is all they tell.
    degree = 1 if len(time) >= _STEPS_OF_LINE and float(np.ptp(time)) > 0.0 else 0
    design = np.vander(time, degree + 1, increasing=True)

    def fit(weights: Array, _: float | Array) -> tuple[Array, Array] | NotFitted:
        weighted = design.T * weights
        line = solve_linear(weighted @ design, weighted @ speed, _OF_LINE)
        return line if isinstance(line, NotFitted) else (line, speed - design @ line)

    found = fit_reweighted(fit, len(time), _OF_SPEEDS, scale_by_median(_LEAST_SPEED_SCATTER_MPS))
    return math.nan if isinstance(found, NotFitted) else float(found.solution[0])
