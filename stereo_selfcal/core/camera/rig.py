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

"""The rectified stereo rig: intrinsics shared by both cameras, and the baseline."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..errors import RigError, printable, shortened
from .camera_info import CameraInfoError, CameraModel, InfoReason
from .pair_geometry import is_corrected, pair_geometry, projections_differ

_LONGEST_KEY = 40  # letters that are shown of an unknown one


@dataclass(frozen=True, slots=True)
class StereoRig:
    """Rectified stereo pair of two identical pinhole cameras (paper section 2.1, Table I).

    Pixel centres lie at integer coordinates (OpenCV's convention): the
    centre of the top left pixel is (0, 0). A point at depth ``Z`` metres has the disparity
    ``fx * baseline_m / Z``.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        fx: Horizontal focal length [px].
        fy: Vertical focal length [px].
        cx: Column of the principal point [px], the same in both cameras.
        cy: Row of the principal point [px].
        baseline_m: Distance between the camera centres [m].

    Raises:
        RigError: A value is not finite, not positive, or the principal point is outside the image.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline_m: float

    def __post_init__(self) -> None:
        for field in fields(self):
            given = getattr(self, field.name)
            # numbers.Real includes the scalars of NumPy.
            if isinstance(given, bool) or not isinstance(given, numbers.Real):
                raise RigError(f"rig.{field.name} is {shortened(given)}, a number is needed")
            try:
                value = float(given)
            except OverflowError:  # a whole number of more than 308 digits
                value = math.inf
            if not math.isfinite(value):
                raise RigError(f"rig.{field.name} is {value}, a finite number is needed")
            whole = field.name in ("width", "height")
            if whole and not value.is_integer():
                raise RigError(f"rig.{field.name} is {value}, whole pixels are needed")
            object.__setattr__(self, field.name, int(value) if whole else value)
        for name in ("width", "height", "fx", "fy", "baseline_m"):
            if getattr(self, name) <= 0:
                raise RigError(
                    f"rig.{name} is {getattr(self, name)}, it must be greater than zero: "
                    "check the calibration of the camera pair"
                )
        if not (0 <= self.cx <= self.width and 0 <= self.cy <= self.height):
            raise RigError(
                f"principal point ({self.cx}, {self.cy}) lies outside the "
                f"{self.width} x {self.height} image: check cx and cy"
            )

    @classmethod
    def from_camera_info(cls, left: Any, right: Any) -> StereoRig:
        """Build the rig from the CameraInfo of both cameras.

        The projection matrix ``P`` is used, as it describes the rectified
        image; the baseline is ``-P_right[0, 3] / P_right[0, 0]``.

        Args:
            left: Anything with the fields of sensor_msgs/CameraInfo, ROS 2 or ROS 1.
            right: The same of the right camera.

        Raises:
            CameraInfoError: A camera is uncalibrated (P[0] = 0), the sizes differ, the pair is
                not rectified to one projection matrix, or the baseline is zero, negative or impossible for a
                vehicle. Where only cx differs, or R still turns the images, use
                :class:`~stereo_selfcal.core.camera.rectifier.StereoRectifier`.
        """
        cameras = CameraModel.read(left, "left"), CameraModel.read(right, "right")
        pair = pair_geometry(*cameras)
        if pair.shift_px:
            raise projections_differ(*cameras, "cx", 2)
        if is_corrected(*cameras):
            raise CameraInfoError(
                InfoReason.ROTATION_NOT_APPLIED,
                "R of the CameraInfo turns the images of a camera that has turned since it was calibrated: "
                "use StereoRectifier.from_camera_info, whose apply() turns them",
            )
        return cls.of_camera(cameras[0], pair.baseline_m)

    @classmethod
    def of_camera(cls, camera: CameraModel, baseline_m: float) -> StereoRig:
        """Build the rig of two cameras that share the projection matrix of this one.

        Args:
            camera: The left camera.
            baseline_m: Distance of the cameras [m].

        Raises:
            RigError: A value cannot be right.
        """
        p = camera.p
        return cls(camera.width, camera.height, p[0], p[5], p[2], p[6], baseline_m)

    @classmethod
    def from_sensor(
        cls,
        width: int,
        height: int,
        focal_mm: float,
        ccd_width_mm: float,
        baseline_m: float,
        ccd_height_mm: float | None = None,
    ) -> StereoRig:
        """Build the rig from the data sheet, as the paper's Table I gives it.

        Args:
            width: Image width [px].
            height: Image height [px].
            focal_mm: Focal length [mm].
            ccd_width_mm: Width of the light-sensitive area [mm].
            baseline_m: Distance between the camera centres [m].
            ccd_height_mm: Height of the light-sensitive area [mm]; None means square pixels.

        Returns:
            A rig with the principal point in the middle of the image.
        """
        lengths = (("focal_mm", focal_mm), ("ccd_width_mm", ccd_width_mm), ("ccd_height_mm", ccd_height_mm))
        for name, value in lengths:
            if value is not None and not value > 0:
                raise RigError(f"{name} is {value}, it must be greater than zero")
        fx = focal_mm / ccd_width_mm * width
        fy = fx if ccd_height_mm is None else focal_mm / ccd_height_mm * height
        return cls(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2, baseline_m)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> StereoRig:
        """Build the rig from a mapping with exactly the attribute names (a rig file).

        Raises:
            RigError: A key is missing or unknown, or a value cannot be right.
        """
        names = [field.name for field in fields(cls)]
        missing = [name for name in names if name not in values]
        unknown = [printable(str(name)[:_LONGEST_KEY]) for name in values if name not in names]
        if missing or unknown:
            parts = [f"lacks {', '.join(missing)}"] if missing else []
            parts += [f"has unknown {', '.join(unknown)}"] if unknown else []
            raise RigError(f"rig {' and '.join(parts)}: its keys are {', '.join(names)}")
        return cls(**{name: values[name] for name in names})

    def to_mapping(self) -> dict[str, float]:
        """Return the rig as a mapping, the inverse of :meth:`from_mapping`."""
        return asdict(self)
