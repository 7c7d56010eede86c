"""CameraInfo: the parameters of a camera, and which of its values cannot be right.

A fault that would prevent a calibration, or make it wrong, raises a :class:`CameraInfoError`. A value that is
unusual but possible is reported by :mod:`.camera_info_checks`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from ..errors import RigError, shortened

# Two rectified cameras share one projection matrix, except for the baseline term. Calibration tools print P
# with about six digits, so a difference of a hundredth of a pixel is no rounding.
_RECTIFIED_TOLERANCE_PX = 0.01

# No vehicle has a baseline outside this range. P[3] in pixel millimetres gives 30 m and more. P[3] =
# -baseline without fx gives less than 4 mm (2 m over 500 px). The height is then wrong by the same factor,
# and the images do not show it.
_POSSIBLE_BASELINE_M = (0.005, 10.0)

# R is written with six digits or more, so a rotation is orthogonal to about 1e-6.
_ROTATION_TOLERANCE = 1e-3

NO_DISTORTION = ""
PLUMB_BOB, RATIONAL, EQUIDISTANT = "plumb_bob", "rational_polynomial", "equidistant"
# Possible numbers of coefficients of each model. For the rational one, OpenCV writes more than ROS defines.
_COEFFICIENTS = {PLUMB_BOB: (0, 4, 5), RATIONAL: (0, 5, 8, 12, 14), EQUIDISTANT: (4,), NO_DISTORTION: (0,)}


class InfoReason(Enum):
    """What is wrong with a CameraInfo; ``str(reason)`` is a stable snake_case word."""

    MALFORMED = "malformed"
    NOT_FINITE = "not_finite"
    UNCALIBRATED = "uncalibrated"
    NO_PROJECTION = "no_projection"
    REGION = "region"
    SIZES_DIFFER = "sizes_differ"
    PROJECTIONS_DIFFER = "projections_differ"
    BASELINE_ZERO = "baseline_zero"
    BASELINE_IMPLAUSIBLE = "baseline_implausible"
    CAMERAS_SWAPPED = "cameras_swapped"
    UNKNOWN_MODEL = "unknown_model"
    NOT_A_ROTATION = "not_a_rotation"
    IMAGE_SIZE = "image_size"
    BASELINE_UNUSUAL = "baseline_unusual"
    FOCAL_LENGTHS_DISAGREE = "focal_lengths_disagree"
    PRINCIPAL_POINT = "principal_point"
    SEEMS_UNRECTIFIED = "seems_unrectified"

    def __str__(self) -> str:
        return self.value


class CameraInfoError(RigError):
    """A CameraInfo that cannot be right.

    Attributes:
        reason: Kind of the fault.
    """

    def __init__(self, reason: InfoReason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Parameters of a camera from its CameraInfo, for its images: region of interest and binning are applied.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        k: (9,) intrinsics of the raw image, row by row [px].
        p: (12,) projection of the rectified image, row by row [px, px m].
        r: (9,) rotation from the raw to the rectified camera, row by row; () where there is none.
        d: Distortion coefficients.
        model: Name of the distortion model as it was given.
        cropped: Whether the images show only a region of the sensor.
        side: "left" or "right", for messages.
    """

    width: int
    height: int
    k: tuple[float, ...]
    p: tuple[float, ...]
    r: tuple[float, ...]
    d: tuple[float, ...]
    model: str
    cropped: bool = False
    side: str = field(default="", compare=False)

    @classmethod
    def read(cls, info: Any, side: str) -> CameraModel:
        """Read anything with the fields of sensor_msgs/CameraInfo, ROS 2 or ROS 1 (``K`` for ``k``).

        Args:
            info: The message.
            side: "left" or "right".

        Raises:
            CameraInfoError: It is uncalibrated, K or P is malformed or not finite, or its region of
                interest does not lie in the image.
        """
        k = _matrix(info, "k", 9, side)
        p = _matrix(info, "p", 12, side)
        if k[0] == 0.0:
            raise CameraInfoError(
                InfoReason.UNCALIBRATED,
                f"{side} CameraInfo is uncalibrated (K[0] = 0): calibrate the camera "
                "or give the rig by parameters",
            )
        if p[0] == 0.0:
            raise CameraInfoError(
                InfoReason.NO_PROJECTION,
                f"{side} CameraInfo has no projection matrix (P[0] = 0): calibrate the "
                "pair as a stereo pair or give the rig by parameters",
            )
        region = _Region.read(info, side)
        return cls(
            *region.size,
            region.applied_to(k),
            region.applied_to(p),
            tuple(_values(info, "r") or ()),
            tuple(_values(info, "d") or ()),
            str(getattr(info, "distortion_model", "")),
            region.cropped,
            side,
        )

    def check_raw(self) -> None:
        """Check the parameters that raw images are undistorted and rectified with.

        Raises:
            CameraInfoError: The distortion model is unknown, D or R is malformed or not finite, or R is no
                rotation. An R of zeros is refused too. It may stand for aligned cameras, which could be used,
                or for a pair that was never calibrated, which could not.
        """
        if self.model not in _COEFFICIENTS:
            known = ", ".join(sorted(name for name in _COEFFICIENTS if name))
            raise CameraInfoError(
                InfoReason.UNKNOWN_MODEL,
                f"{self.side} CameraInfo has the distortion model {shortened(self.model)}, known are "
                f"{known}: calibrate with one of them, or rectify the images before and set rectified: true",
            )
        if len(self.d) not in _COEFFICIENTS[self.model]:
            counts = " or ".join(str(n) for n in _COEFFICIENTS[self.model])
            raise CameraInfoError(
                InfoReason.MALFORMED,
                f"{self.side} CameraInfo has {len(self.d)} distortion coefficients, "
                f"{self.model or 'no model'} has {counts}: check the calibration file",
            )
        for name, values in (("D", self.d), ("R", self.r)):
            if not all(math.isfinite(value) for value in values):
                raise _not_finite(self.side, name)
        if len(self.r) != 9 or not any(self.r):
            raise CameraInfoError(
                InfoReason.NOT_A_ROTATION,
                f"{self.side} CameraInfo has no rotation (R is {'zero' if self.r else 'missing'}): calibrate "
                "the pair as a stereo pair, or write the identity if the cameras are aligned",
            )
        rotation = np.array(self.r).reshape(3, 3)
        with np.errstate(over="ignore", invalid="ignore"):  # impossible values may give infinity or NaN
            error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if not error <= _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise CameraInfoError(
                InfoReason.NOT_A_ROTATION,
                f"R of the {self.side} CameraInfo is no rotation (R R^T differs from the identity by "
                f"{error:.2g}, at most {_ROTATION_TOLERANCE:g} allowed): calibrate the pair again",
            )


@dataclass(frozen=True, slots=True)
class PairGeometry:
    """Geometry of a camera pair, from the projection matrices of both cameras.

    Attributes:
        baseline_m: Distance of the cameras [m].
        shift_px: Shift of the right image to the right that gives it the cx of the left image [px].
    """

    baseline_m: float
    shift_px: float


def pair_geometry(left: CameraModel, right: CameraModel) -> PairGeometry:
    """Compare the projection matrices of both cameras.

    Raises:
        CameraInfoError: The sizes differ, the matrices differ in more than cx, or the baseline is impossible.
    """
    size = (left.width, left.height)
    if size != (right.width, right.height):
        raise CameraInfoError(
            InfoReason.SIZES_DIFFER,
            f"left CameraInfo is {size[0]} x {size[1]}, right is {right.width} x "
            f"{right.height}: both cameras must have one size",
        )
    for name, i in (("fx", 0), ("fy", 5), ("cy", 6)):
        if not abs(left.p[i] - right.p[i]) <= _RECTIFIED_TOLERANCE_PX:
            raise projections_differ(left, right, name, i)
    baseline_m = (left.p[3] - right.p[3]) / right.p[0]
    if baseline_m == 0.0:
        raise CameraInfoError(
            InfoReason.BASELINE_ZERO,
            "CameraInfo gives a baseline of zero (P[3] is 0 in both cameras): P[3] of the "
            "right camera must be -fx * baseline, or give the rig by parameters",
        )
    if baseline_m < 0.0:
        raise CameraInfoError(
            InfoReason.CAMERAS_SWAPPED,
            f"CameraInfo gives a negative baseline ({baseline_m:.4f} m): left and right are swapped",
        )
    least_m, most_m = _POSSIBLE_BASELINE_M
    if not least_m <= baseline_m <= most_m:
        raise CameraInfoError(
            InfoReason.BASELINE_IMPLAUSIBLE,
            f"CameraInfo gives a baseline of {baseline_m:.4g} m, at least {least_m:g} m and at most "
            f"{most_m:g} m are possible: "
            "P[3] of the right camera must be -fx * baseline in pixels times metres (not millimetres), or "
            "give the rig by parameters",
        )
    shift_px = left.p[2] - right.p[2]
    if abs(shift_px) > left.width:  # the shifted image would have no column in common with the other
        raise projections_differ(left, right, "cx", 2, left.width)
    return PairGeometry(baseline_m, shift_px if abs(shift_px) > _RECTIFIED_TOLERANCE_PX else 0.0)


def projections_differ(
    left: CameraModel, right: CameraModel, name: str, i: int, most_px: float = _RECTIFIED_TOLERANCE_PX
) -> CameraInfoError:
    """Return the error of two projection matrices that differ in one element.

    Args:
        left: The left camera.
        right: The right camera.
        name: Name of the element.
        i: Index of the element in P, row by row.
        most_px: Most difference that is allowed [px].
    """
    return CameraInfoError(
        InfoReason.PROJECTIONS_DIFFER,
        f"P of the cameras differ in {name}: {left.p[i]} left, {right.p[i]} right, at most "
        f"{most_px:g} px apart allowed: rectify both images to one projection matrix",
    )


@dataclass(frozen=True, slots=True)
class _Region:
    """The region of the sensor that an image shows, and its binning."""

    left: int
    top: int
    size: tuple[int, int]
    binning: tuple[int, int]
    cropped: bool

    @classmethod
    def read(cls, info: Any, side: str) -> _Region:
        width, height = int(info.width), int(info.height)
        roi = getattr(info, "roi", None)
        left, top, columns, rows = (
            int(getattr(roi, name, 0)) for name in ("x_offset", "y_offset", "width", "height")
        )
        whole = not (columns or rows or left or top)
        if not whole and not (columns and rows and left + columns <= width and top + rows <= height):
            raise CameraInfoError(
                InfoReason.REGION,
                f"{side} CameraInfo has a region of interest of {columns} x {rows} px at ({left}, {top}), "
                f"which does not lie in {width} x {height}: correct roi, or leave it zero for all",
            )
        if whole:
            columns, rows = width, height
        # A binning of zero means one.
        binning = (max(int(getattr(info, "binning_x", 0)), 1), max(int(getattr(info, "binning_y", 0)), 1))
        cropped = (columns, rows) != (width, height)
        return cls(left, top, (columns // binning[0], rows // binning[1]), binning, cropped)

    def applied_to(self, matrix: Sequence[float]) -> tuple[float, ...]:
        """Return K or P [3 x n, row by row] of the image from that of the whole sensor."""
        if (self.left, self.top, *self.binning) == (0, 0, 1, 1):
            return tuple(matrix)
        n = len(matrix) // 3
        values = np.array(matrix).reshape(3, n)
        for i, offset in enumerate((self.left, self.top)):
            # A binned pixel covers n sensor pixels, so its centre is the mean of their centres.
            values[i, 2] = (values[i, 2] - offset + 0.5) / self.binning[i] - 0.5
            for j in {0, 1, n - 1} - {2}:
                values[i, j] /= self.binning[i]
        return tuple(float(value) for value in values.ravel())


def _values(info: Any, name: str) -> list[float] | None:
    """Return an array of a CameraInfo, from the spelling of ROS 2 or ROS 1."""
    values = getattr(info, name, None)
    if values is None:
        values = getattr(info, name.upper(), None)
    return None if values is None else [float(value) for value in values]


def _matrix(info: Any, name: str, size: int, side: str) -> list[float]:
    """Return matrix ``name`` of a CameraInfo as ``size`` finite floats."""
    values = _values(info, name)
    if values is None or len(values) != size:
        raise CameraInfoError(
            InfoReason.MALFORMED, f"{side} CameraInfo has no matrix {name.upper()} of {size} values"
        )
    if not all(math.isfinite(value) for value in values):
        raise _not_finite(side, name.upper())
    return values


def _not_finite(side: str, name: str) -> CameraInfoError:
    return CameraInfoError(InfoReason.NOT_FINITE, f"{side} CameraInfo has NaN or infinity in {name}")
