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

"""Whether both images were taken at the same time, as the road shows it.

A car that moves between the images moves the road in them: by much along the way, and by a little across it.
What is across makes the baseline seem longer or shorter, and the height with it. What is along is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.landmarks import Landmarks
from ..estimators.road_shift import find_road_shift
from ..geometry.pose import Extrinsics
from ..rejection import Bound, Rejection, RejectReason
from ..road.priors import BASELINE_DIRECTION_STD_RAD, SIDEWAYS_MPS, SIDEWAYS_PART, USUAL_SPEED_MPS
from ..tolerances import EXCLUDED_SIGMAS, WRONG
from ..types import Array, Image

# Least height of the peak of the correlation over its scatter; chance makes 5 of the 33 000 cells.
_LEAST_SIGMAS = 10.0
# Where the correlation without a shift is that much of the greatest one, the road does not exclude it. Under
# a plane that is not the road, such as that of a kerb and a line, the greatest one lies beside zero.
_MOST_AT_ZERO = 0.5
# Standard deviation of the way. In recorded pairs of cameras that are triggered together, it is 1.6 cm, as
# rows that are off by a tenth of a pixel move the road by a centimetre 10 m ahead.
_WAY_STD_M = 0.02
_REMEDY = "trigger both cameras together, and check that the driver pairs images of the same moment"


@dataclass(frozen=True, slots=True)
class Lateness:
    """The way of the car between the right image and the left one.

    Attributes:
        way_m: The way [m], > 0: the right image was taken earlier.
        std_m: Its standard deviation.
        clear: Whether the road tells that the way is not zero, either.
    """

    way_m: float
    std_m: float
    clear: bool

    def limit_m(self, pose: Extrinsics, rig: StereoRig) -> float:
        """Return the way that makes a height wrong by its part across [m]."""
        wrong_m = float(WRONG[0]) * rig.baseline_m / (pose.height_m * SIDEWAYS_PART)
        return max(EXCLUDED_SIGMAS * self.std_m, wrong_m)

    @property
    def surely(self) -> bool:
        """Whether the images were surely not taken at the same time."""
        return self.clear and abs(self.way_m) > EXCLUDED_SIGMAS * self.std_m

    @property
    def what(self) -> str:
        """The finding in words, with a place for the value."""
        late = "left" if self.way_m > 0.0 else "right"
        delay_ms = 1e3 * abs(self.way_m) / USUAL_SPEED_MPS
        return (
            f"the {late} image was taken {{value}} of the way later than the other one, which is "
            f"{delay_ms:.0f} ms at 50 km/h"
        )

    def refusal(self) -> Rejection:
        """Return the refusal of a pair that was surely not taken at the same time."""
        numbers = abs(self.way_m), Bound.MOST, EXCLUDED_SIGMAS * self.std_m, "m"
        return Rejection(RejectReason.IMAGES_NOT_SYNCHRONISED, self.what, *numbers, _REMEDY)

    def covariance(self, pose: Extrinsics, rig: StereoRig) -> Array:
        """Return the covariance (3, 3) of a pose by what the car moved sideways between the images.

        Args:
            pose: The pose.
            rig: The rig: the height is proportional to its baseline.
        """
        return _by_way_across(SIDEWAYS_PART * float(np.hypot(self.way_m, self.std_m)), pose, rig)


def measure_lateness(
    images: tuple[Image, Image],
    rig: StereoRig,
    pose: Extrinsics,
    yaw_rad: float | None,
    turned: Array | None = None,
) -> Lateness | None:
    """Measure the way of the car between both images.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        pose: Pose over the road.
        yaw_rad: Yaw of the camera against the lane, None where it is not known.
        turned: As of :func:`.find_road_shift`.

    Returns:
        The way; None where the road shows nothing that tells it.
    """
    shift = find_road_shift(images, rig, pose, yaw_rad or 0.0, turned)
    if shift.sigmas < _LEAST_SIGMAS:
        return None
    return Lateness(shift.ahead_m, _WAY_STD_M, shift.sigmas_at_zero < _MOST_AT_ZERO * shift.sigmas)


def lateness_of_rows(landmarks: Landmarks | None, rig: StereoRig) -> Lateness | None:
    """Return the way of the car between both images, as the rows of points all over them tell it.

    Args:
        landmarks: The points, and how far ahead the right camera seems to sit.
        rig: The rig.

    Returns:
        The way; None where the rows do not tell it.
    """
    if landmarks is None or not np.isfinite(landmarks.ahead_std):
        return None
    std_m = rig.baseline_m * float(np.hypot(landmarks.ahead_std, BASELINE_DIRECTION_STD_RAD))
    return Lateness(-rig.baseline_m * landmarks.ahead, float(np.hypot(std_m, _WAY_STD_M)), clear=True)


def synchronisation_covariance(
    late: Lateness | None, stamp_difference_s: float, pose: Extrinsics, rig: StereoRig
) -> Array:
    """Return the covariance (3, 3) of a pose by images that are not of one moment.

    Args:
        late: The way of the car between both images; None where the road does not tell it. Then the car
            moves as far across as cars do in that time.
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
        pose: The pose.
        rig: The rig.
    """
    if late is not None:
        return late.covariance(pose, rig)
    return _by_way_across(SIDEWAYS_MPS * abs(stamp_difference_s), pose, rig)


def _by_way_across(across_m: float, pose: Extrinsics, rig: StereoRig) -> Array:
    """Return the covariance of a pose by a way across, which lengthens or shortens the baseline."""
    covariance = np.zeros((3, 3))
    covariance[0, 0] = (pose.height_m * across_m / rig.baseline_m) ** 2
    return covariance
