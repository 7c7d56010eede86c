"""The rectified stereo rig: intrinsics shared by both cameras, and the baseline."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Protocol

from .errors import RigError

# Two rectified cameras share one projection matrix but for the baseline term. Calibration
# tools print P with about six digits, so a difference of a hundredth of a pixel is a real one.
_RECTIFIED_TOLERANCE_PX = 0.01


class CameraInfoLike(Protocol):
    """What is read of sensor_msgs/CameraInfo (ROS 1 spells ``k`` and ``p`` as ``K`` and ``P``)."""

    width: int
    height: int


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
            # numbers.Real takes NumPy's scalars as well.
            if isinstance(given, bool) or not isinstance(given, numbers.Real):
                raise RigError(f"rig.{field.name} is {given!r}, a number is needed")
            value = float(given)
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
            RigError: A camera is uncalibrated (K[0] = 0), the sizes differ, the pair is
                not rectified to one projection matrix, or the baseline is zero or negative.
        """
        projections = []
        for side, info in (("left", left), ("right", right)):
            k = _matrix(info, "k", 9, side)
            p = _matrix(info, "p", 12, side)
            if k[0] == 0.0:
                raise RigError(
                    f"{side} CameraInfo is uncalibrated (K[0] = 0): calibrate the camera "
                    "or give the rig by parameters"
                )
            if p[0] == 0.0:
                raise RigError(
                    f"{side} CameraInfo has no projection matrix (P[0] = 0): calibrate the "
                    "pair as a stereo pair or give the rig by parameters"
                )
            projections.append(p)
        size = (int(left.width), int(left.height))
        if size != (int(right.width), int(right.height)):
            raise RigError(
                f"left CameraInfo is {size[0]} x {size[1]}, right is {right.width} x "
                f"{right.height}: both cameras must have one size"
            )
        p_left, p_right = projections
        for name, i in (("fx", 0), ("cx", 2), ("fy", 5), ("cy", 6)):
            if not abs(p_left[i] - p_right[i]) <= _RECTIFIED_TOLERANCE_PX:
                raise RigError(
                    f"P of the cameras differ in {name}: {p_left[i]} left, {p_right[i]} right: "
                    "rectify both images to one projection matrix"
                )
        baseline_m = (p_left[3] - p_right[3]) / p_right[0]
        if baseline_m == 0.0:
            raise RigError(
                "CameraInfo gives a baseline of zero (P[3] is 0 in both cameras): P[3] of the "
                "right camera must be -fx * baseline, or give the rig by parameters"
            )
        if baseline_m < 0.0:
            raise RigError(
                f"CameraInfo gives a negative baseline ({baseline_m:.4f} m): left and right are swapped"
            )
        return cls(*size, p_left[0], p_left[5], p_left[2], p_left[6], baseline_m)

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
        unknown = [str(name) for name in values if name not in names]
        if missing or unknown:
            parts = [f"lacks {', '.join(missing)}"] if missing else []
            parts += [f"has unknown {', '.join(unknown)}"] if unknown else []
            raise RigError(f"rig {' and '.join(parts)}: its keys are {', '.join(names)}")
        return cls(**{name: values[name] for name in names})

    def to_mapping(self) -> dict[str, float]:
        """Return the rig as a mapping, the inverse of :meth:`from_mapping`."""
        return asdict(self)


def _matrix(info: Any, name: str, size: int, side: str) -> list[float]:
    """Return matrix ``name`` of a CameraInfo as ``size`` floats, from either spelling."""
    values = getattr(info, name, None)
    if values is None:
        values = getattr(info, name.upper(), None)
    if values is None or len(values) != size:
        raise RigError(f"{side} CameraInfo has no matrix {name.upper()} of {size} values")
    numbers = [float(value) for value in values]
    if not all(math.isfinite(number) for number in numbers):
        raise RigError(f"{side} CameraInfo has NaN or infinity in {name.upper()}")
    return numbers
