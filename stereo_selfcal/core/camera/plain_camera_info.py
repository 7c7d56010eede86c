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

"""CameraInfo as a value of its own: the fields of sensor_msgs/CameraInfo without ROS."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..types import Array
from .camera_info import PLUMB_BOB, values_of
from .rig import StereoRig

_NO_DISTORTION = 5  # zeros, as ROS writes plumb_bob


@dataclass(frozen=True, slots=True)
class RegionOfInterest:
    """Region of interest, with the fields of sensor_msgs/RegionOfInterest; all zero: the whole sensor."""

    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class PlainCameraInfo:
    """CameraInfo of one camera. It has the fields of sensor_msgs/CameraInfo, and can stand in its place.

    Attributes:
        width: Width of the sensor [px].
        height: Height of the sensor [px].
        distortion_model: Name of the distortion model.
        d: Distortion coefficients.
        k: (9,) intrinsics of the raw image, row by row [px].
        r: (9,) rotation from the raw to the rectified camera, row by row.
        p: (12,) projection of the rectified image, row by row [px, px m].
        binning_x: Sensor columns in a column of the image; 0 means 1.
        binning_y: Sensor rows in a row of the image; 0 means 1.
        roi: The part of the sensor that the images show.
        frame_id: Frame of the camera, "" where it is not known.
    """

    width: int
    height: int
    distortion_model: str
    d: Array
    k: Array
    r: Array
    p: Array
    binning_x: int = 0
    binning_y: int = 0
    roi: RegionOfInterest = field(default_factory=RegionOfInterest)
    frame_id: str = ""

    @classmethod
    def of(cls, info: Any) -> PlainCameraInfo:
        """Copy anything with the fields of sensor_msgs/CameraInfo, ROS 2 or ROS 1."""
        roi = getattr(info, "roi", None)
        d, k, r, p = (np.array(values_of(info, name) or (), dtype=np.float64) for name in "dkrp")
        return cls(
            int(info.width),
            int(info.height),
            str(getattr(info, "distortion_model", "")),
            d,
            k,
            r,
            p,
            int(getattr(info, "binning_x", 0)),
            int(getattr(info, "binning_y", 0)),
            RegionOfInterest(
                *(int(getattr(roi, name, 0)) for name in ("x_offset", "y_offset", "height", "width")),
            ),
            str(getattr(getattr(info, "header", None), "frame_id", getattr(info, "frame_id", ""))),
        )

    @classmethod
    def of_rig(cls, rig: StereoRig) -> tuple[PlainCameraInfo, PlainCameraInfo]:
        """Return the CameraInfo of both cameras of a rectified rig."""
        k = np.array([rig.fx, 0.0, rig.cx, 0.0, rig.fy, rig.cy, 0.0, 0.0, 1.0])
        left, right = (
            np.array([rig.fx, 0.0, rig.cx, shift, 0.0, rig.fy, rig.cy, 0.0, 0.0, 0.0, 1.0, 0.0])
            for shift in (0.0, -rig.fx * rig.baseline_m)
        )
        common = rig.width, rig.height, PLUMB_BOB, np.zeros(_NO_DISTORTION), k, np.eye(3).ravel()
        return cls(*common, left), cls(*common, right)

    @property
    def rotation(self) -> Array:
        """R (3, 3); the identity where it is missing or zero."""
        return self.r.reshape(3, 3) if len(self.r) == 9 and self.r.any() else np.eye(3)

    def turned(self, rotation: Array) -> PlainCameraInfo:
        """Return that of a camera whose rectified image is turned further.

        Args:
            rotation: (3, 3) from the rectified camera as it was to the one that is wanted.
        """
        return replace(self, r=(rotation @ self.rotation).ravel())

    def rectified(self, rotation: Array) -> PlainCameraInfo:
        """Return that of rectified images that only have to be turned: K = P, D = 0.

        Args:
            rotation: (3, 3) from the camera of these images to the one that is wanted.
        """
        k = self.p.reshape(3, 4)[:, :3].ravel()
        nothing = np.zeros(_NO_DISTORTION)
        return replace(self, distortion_model=PLUMB_BOB, d=nothing, k=k, r=rotation.ravel().copy())
