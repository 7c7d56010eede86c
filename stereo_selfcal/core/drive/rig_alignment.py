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

"""The alignment of the right camera over a drive: by its frames, the direction of travel and the parallax."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.row_alignment import LEAST_SMOOTH_PX, turn_by_smooth_rows
from ..evidence.told_alignment import told_variances, with_untold
from ..geometry.alignment import Alignment
from ..geometry.travel import RightDelay
from ..rejection import NotFitted, fitted
from ..results import CalibrationResult
from ..road.priors import ROW_YAW_STD_RAD
from ..types import Array
from .mean_over_time import MeanOverTime, mean_over_time
from .right_delay import SeenAhead, estimate_delay
from .travel import TravelStep
from .travel_vergence import vergence_of_parallax, vergence_of_travel

# Half of the variance of a frame's angle is noise of its own. The other half lasts: what things beside the
# road, lens and paint do to rows and lines is the same in frames that see the same.
_LASTING_PART = 0.5
_MEMORY_S = 10.0
# And some of it is the same in all frames of a rig. At least this part of a variance is not.
_OWN_PART = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SeenAlignment:
    """The alignment of a frame, without its result.

    Attributes:
        stamp_s: Time stamp [s].
        alignment: How the right camera is turned.
        ahead: How far ahead it seems to sit; None where nothing tells it.
    """

    stamp_s: float
    alignment: Alignment
    ahead: SeenAhead | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DriveOfRig:
    """What the motion between the frames of a drive tells.

    Attributes:
        alignment: How the right camera is turned; None where no frame tells it.
        delay: When right images are taken, against the left ones; None where too few frames tell it.
    """

    alignment: Alignment | None
    delay: RightDelay | None


def drive_of_rig(
    frames: Sequence[CalibrationResult],
    seen: Sequence[SeenAlignment],
    steps: Sequence[TravelStep],
    rig: StereoRig,
) -> DriveOfRig:
    """Return what a drive tells of the rig.

    Args:
        frames: Accepted frames, in the order of time.
        seen: Alignments of all frames, refused ones among them: rows do not ask for a road.
        steps: Steps between frames of the same drive, in the order of time.
        rig: The rig that all come from.
    """
    return DriveOfRig(
        _alignment(frames, seen, steps, rig),
        fitted(estimate_delay([each.ahead for each in seen if each.ahead is not None], steps, rig)),
    )


def _alignment(
    frames: Sequence[CalibrationResult],
    seen: Sequence[SeenAlignment],
    steps: Sequence[TravelStep],
    rig: StereoRig,
) -> Alignment | None:
    """Return the robust mean of what frames tell of the alignment; the yaw by travel and parallax, too."""
    if not seen:
        return None
    # A longer gap has nothing in common with what was before, and a gap of hours no more than that.
    gaps_s = np.diff(np.sort([each.stamp_s for each in seen]))
    duration_s = float(np.minimum(gaps_s, 2.0 * _MEMORY_S).sum())
    values = np.array([each.alignment.as_array() for each in seen])
    variances = np.array([told_variances(each.alignment) for each in seen])
    permanent = _permanent_variances(variances, rig)
    over = MeanOverTime(duration_s, _MEMORY_S)
    means, of_means = np.zeros(3), np.full(3, np.inf)
    for index in range(3):
        told = np.isfinite(variances[:, index])
        if not np.any(told):
            continue
        own = variances[told, index] - permanent[told, index]
        lasting = _LASTING_PART * own
        mean = mean_over_time(values[told, index], own - lasting, over, common=lasting)
        if isinstance(mean, NotFitted):
            return seen[-1].alignment
        remains = np.average(np.sqrt(permanent[told, index]), weights=mean.weights / own)
        means[index], of_means[index] = mean.value, mean.variance + remains**2
    of_means = with_untold(of_means)
    by_drive = [
        each
        for each in (
            vergence_of_travel(steps, [each for each in frames if each.confirmed_by_texture], rig),
            vergence_of_parallax(steps, rig),
        )
        if not isinstance(each, NotFitted)
    ]
    yaws = np.array([means[2], *(each.yaw_rad for each in by_drive)])
    information = np.array([of_means[2], *(each.std_rad**2 for each in by_drive)]) ** -1.0
    yaw = float(yaws @ information / information.sum())
    # Where they contradict each other, the scatter tells how much either is to be believed (Birge, 1932).
    chi2 = float(information @ (yaws - yaw) ** 2) / max(1, len(yaws) - 1)
    variance = max(1.0, chi2) / float(information.sum())
    covariance = np.diag([of_means[0], of_means[1], variance])
    return Alignment(
        float(means[0]),
        float(means[1]),
        yaw,
        covariance,
        unexplained_rad=float(np.median([each.alignment.unexplained_rad for each in seen])),
        yaw_corrected_rad=float(np.mean([each.alignment.yaw_corrected_rad for each in seen])),
    )


def _permanent_variances(variances: Array, rig: StereoRig) -> Array:
    """Return the parts (N, 3) of the variances of the angles that are the same in all frames of a rig.

    Rows of matched points are drawn to whole pixels in all frames alike. The yaw that they tell is off by
    what is not known of the lenses, and counts in the mean of all that tells it as its information does.

    Args:
        variances: (N, 3) of what frames tell; infinite where they tell nothing.
        rig: Intrinsics.
    """
    by_pixels_rad = turn_by_smooth_rows(LEAST_SMOOTH_PX, rig)
    most = (1.0 - _OWN_PART) * variances
    permanent = np.empty_like(variances)
    permanent[:, :2] = np.minimum(by_pixels_rad**2, most[:, :2])
    permanent[:, 2] = np.minimum((variances[:, 2] / ROW_YAW_STD_RAD) ** 2, most[:, 2])
    return permanent
