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

"""A camera that is turned about the vertical while the car drives: its yaw against the travel changes.

Height, pitch and roll hardly show it. The yaw of steps is averaged over times as long as what lasts in it. At
each time between these, the mean before is compared with the mean after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.travel import Travel
from ..rejection import NotFitted, fitted
from ..reservations import Reservation, ReservationKind
from ..road.priors import RIDE_MEMORY_S
from .travel import DrivenSteps, TravelStep, average_travel, estimate_travel

# Of a hundred times at which it may have happened, one in 10^5 drives without a change shows more.
_CHANGED_SIGMAS = 5.0
_LEAST_BLOCKS = 2  # on either side: one may be a lorry that passes
# What a passing lorry or a gust does is over by then; the yaw since the change is that of the camera.
_SETTLED_S = 10.0


@dataclass(frozen=True, slots=True)
class YawChange:
    """A change of the yaw.

    Attributes:
        at_s: Its time [s].
        by_rad: By how much the yaw has changed [rad].
    """

    at_s: float
    by_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class TravelOfDrive:
    """The direction of travel at the end of a drive.

    Attributes:
        travel: The camera against it; None where it is not known.
        reservations: That the camera seems to have been turned; none where it has not.
    """

    travel: Travel | None
    reservations: tuple[Reservation, ...] = ()


def find_yaw_change(driven: DrivenSteps) -> YawChange | None:
    """Return the clearest change of the yaw in a drive; None where it has not changed.

    Args:
        driven: Its steps, in the order of time.
    """
    block = np.floor((driven.middle_s - driven.middle_s[0]) / RIDE_MEMORY_S).astype(np.intp)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    if len(starts) < 2 * _LEAST_BLOCKS:
        return None
    ends = np.append(starts[1:], len(block))
    means = np.array([np.median(driven.yaw_rad[a:b]) for a, b in zip(starts, ends, strict=True)])
    noise = np.array([driven.noise[a:b, 0].mean() / (b - a) for a, b in zip(starts, ends, strict=True)])
    bends = np.array([driven.bend_std_rad[a:b].max() for a, b in zip(starts, ends, strict=True)])
    information = 1.0 / (math.pi / 2.0 * noise + bends**2 + driven.yaw_scatter_rad**2)  # of a median
    total, weighted = np.cumsum(information), np.cumsum(information * means)
    before, after = total[:-1], total[-1] - total[:-1]
    change = (weighted[-1] - weighted[:-1]) / after - weighted[:-1] / before
    sigmas = np.abs(change) / np.sqrt(1.0 / before + 1.0 / after)
    inside = slice(_LEAST_BLOCKS - 1, len(sigmas) - _LEAST_BLOCKS + 1)
    best = _LEAST_BLOCKS - 1 + int(sigmas[inside].argmax())
    # Most of the time on either side shows it; a lorry that passes moves a mean, and no median.
    by_most = float(np.median(means[best + 1 :]) - np.median(means[: best + 1]))
    if sigmas[best] <= _CHANGED_SIGMAS or abs(by_most) < 0.5 * abs(float(change[best])):
        return None
    return YawChange(float(driven.middle_s[starts[best + 1]]), float(change[best]))


def travel_at_end(steps: Sequence[TravelStep], roll: tuple[float, float], n_frames: int) -> TravelOfDrive:
    """Return the camera against the direction of travel at the end of a drive.

    Where the camera was turned long enough before, it is that since then. Else half of the change is in its
    standard deviation.

    Args:
        steps: The steps, in the order of time.
        roll: Roll of the mount over the road, and its standard deviation [rad].
        n_frames: Number of frames of the estimate that it belongs to.
    """
    driven = DrivenSteps.of(steps, roll[0])
    if isinstance(driven, NotFitted):
        return TravelOfDrive(None)
    travel = fitted(average_travel(driven, roll[1]))
    change = None if travel is None else find_yaw_change(driven)
    if travel is None or change is None:
        return TravelOfDrive(travel)
    detail = f"by {math.degrees(change.by_rad):+.2f} deg at {change.at_s:.1f} s"
    reservation = Reservation(ReservationKind.YAW_CHANGED, detail, max(1, n_frames))
    later = fitted(estimate_travel([step for step in steps if step.stamp_s >= change.at_s], roll))
    if later is not None and later.driven_s >= _SETTLED_S:
        return TravelOfDrive(later, (reservation,))
    covariance = travel.covariance + np.diag([change.by_rad**2 / 4.0, 0.0])
    return TravelOfDrive(replace(travel, covariance=covariance), (reservation,))
