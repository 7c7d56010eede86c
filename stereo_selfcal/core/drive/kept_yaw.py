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

"""The yaw of a calibration, where a newer one has not measured it: it holds while the camera is not moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..results import CalibrationResult

# By chance, one of 120 calibrations of the same mount differs by more in one of its three components.
_MOVED_SIGMAS = 3.0


def with_kept_yaw(new: CalibrationResult, old: CalibrationResult) -> CalibrationResult:
    """Return a calibration with the yaw of one before, where it knows it less well and nothing has moved.

    A car that stands shows no direction of travel. Height, pitch and roll say whether the camera is where it
    was. Where it is not, its yaw may have changed as well, and is not known.

    Args:
        new: An accepted calibration.
        old: The one before, of the same cameras.
    """
    before, now = old.travel, new.travel
    if before is None or not before.tells_yaw:
        return new
    if now is not None and now.std[0] <= before.std[0]:
        return new
    if _moved(new, old):
        if now is not None and now.tells_yaw:
            return new
        return replace(
            new, message=f"{new.message}; the yaw of before is not kept, as the camera was moved since"
        )
    if now is not None and now.tells_yaw:
        apart = abs(now.yaw_rad - before.yaw_rad)
        if apart > _MOVED_SIGMAS * float(np.hypot(now.std[0], before.std[0])):
            return new
    return replace(
        new, travel=before, message=f"{new.message}; {before.describe_yaw()}, kept as it was known before"
    )


def _moved(new: CalibrationResult, old: CalibrationResult) -> bool:
    """Whether one of height, pitch and roll differs by more than both uncertainties explain."""
    if new.extrinsics is None or old.extrinsics is None or new.covariance is None or old.covariance is None:
        return True
    difference = new.extrinsics.as_array() - old.extrinsics.as_array()
    std = np.sqrt(np.diag(new.covariance + old.covariance))
    return bool(np.any(np.abs(difference) > _MOVED_SIGMAS * std))
