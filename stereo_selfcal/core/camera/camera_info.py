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
from .rotations import ROTATION_TOLERANCE, rotation_error, turn_deg

# Distance of a principal point from the middle of the sensor, as a fraction of its side, up to which it is
# usual: at most 0.05 for the cameras of KITTI and EuRoC. Half the resolution moves it by 0.25.
_MIDDLE = 0.15

# K is P, and R the identity, up to this: a thousandth of a pixel at a focal length of 1000 px.
SAME = 1e-6
# A right camera that has turned since it was calibrated is put right by R, if by no more than this. Drift by
# temperature and bumps is below a degree; a greater turn is that of a pair that nobody has rectified.
MOST_CORRECTED_DEG = 5.0

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
    NOT_RECTIFIED = "not_rectified"
    RECTIFIED_ALREADY = "rectified_already"
    ALTERNATING = "alternating"
    BASELINE_UNUSUAL = "baseline_unusual"
    FOCAL_LENGTHS_DISAGREE = "focal_lengths_disagree"
    FOCAL_LENGTH_IMPLAUSIBLE = "focal_length_implausible"
    FOCAL_LENGTH_UNUSUAL = "focal_length_unusual"
    PRINCIPAL_POINT = "principal_point"
    SEEMS_UNRECTIFIED = "seems_unrectified"
    REFERENCE_IS_RIGHT = "reference_is_right"
    REGION_NOT_APPLIED = "region_not_applied"
    ROTATION_NOT_APPLIED = "rotation_not_applied"

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

    Of the CameraInfo of rectified images only P is used; K may be all zeros. R is used as well where it is
    all that is left to be done (:attr:`correction`).

    Attributes:
        width: Image width [px].
        height: Image height [px].
        k: (9,) intrinsics of the raw image, row by row [px].
        p: (12,) projection of the rectified image, row by row [px, px m].
        r: (9,) rotation from the raw to the rectified camera, row by row; () where there is none.
        d: Distortion coefficients.
        model: Name of the distortion model as it was given.
        cropped: Whether the images show only a region of the sensor.
        region: Binning and region of interest in words, "" where they change nothing.
        side: "left" or "right", for messages.
        rectified: Whether the images are rectified, for messages.
    """

    width: int
    height: int
    k: tuple[float, ...]
    p: tuple[float, ...]
    r: tuple[float, ...]
    d: tuple[float, ...]
    model: str
    cropped: bool = False
    region: str = field(default="", compare=False)
    side: str = field(default="", compare=False)
    rectified: bool = field(default=True, compare=False)

    @classmethod
    def read(cls, info: Any, side: str, rectified: bool = True, whole: bool = False) -> CameraModel:
        """Read anything with the fields of sensor_msgs/CameraInfo, ROS 2 or ROS 1 (``K`` for ``k``).

        Args:
            info: The message.
            side: "left" or "right".
            rectified: Whether the images are rectified; False: they are raw, and K is needed.
            whole: Whether the images show the whole sensor, whatever region and binning say.

        Raises:
            CameraInfoError: It is uncalibrated, K or P is malformed or not finite, or its region of
                interest and binning do not go together with its size or with P.
        """
        k = _matrix(info, "k", 9, side)
        p = _matrix(info, "p", 12, side)
        otherwise = " or give the rig by parameters" if rectified else ""
        if k[0] == 0.0 and (p[0] == 0.0 or not rectified):
            raise CameraInfoError(
                InfoReason.UNCALIBRATED,
                f"{side} CameraInfo is uncalibrated (K[0] = 0{'' if p[0] else ' and P[0] = 0'}): calibrate "
                f"the camera{otherwise}",
            )
        if p[0] == 0.0:
            raise CameraInfoError(
                InfoReason.NO_PROJECTION,
                f"{side} CameraInfo has no projection matrix (P[0] = 0): calibrate the "
                f"pair as a stereo pair{otherwise}",
            )
        region = _Region.read(info, side)
        if whole:
            region = region.ignored()
        region.check_projection(p, side)
        return cls(
            *region.size,
            region.applied_to(k) if k[0] else tuple(k),
            region.applied_to(p),
            tuple(values_of(info, "r") or ()),
            tuple(values_of(info, "d") or ()),
            str(getattr(info, "distortion_model", "")),
            region.cropped,
            str(region),
            side,
            rectified,
        )

    @property
    def used(self) -> tuple[Any, ...]:
        """What is used of the parameters: cameras for which it is equal rectify and see alike."""
        size = (self.width, self.height)
        if self.rectified:
            return (*size, self.p, self.correction)
        n = next((n for n in range(len(self.d), 0, -1) if self.d[n - 1]), 0)  # trailing zeros change nothing
        return (
            *size,
            self.p,
            self.k,
            self.r,
            self.d[:n],
            self.model if n or self.model == EQUIDISTANT else "",
        )

    @property
    def is_turned(self) -> bool:
        """Whether there is a rotation R that is not the identity."""
        given = len(self.r) == 9 and any(self.r)
        return given and not np.allclose(self.r, np.eye(3).ravel(), atol=SAME)

    @property
    def k_is_p(self) -> bool:
        """Whether K is the left part of P."""
        return all(abs(self.k[3 * i + j] - self.p[4 * i + j]) <= SAME for i in range(3) for j in range(3))

    @property
    def leaves_only_r(self) -> bool:
        """Whether K is P and D is zero: images that still have to be turned by R, or not even that."""
        return self.k_is_p and not any(self.d)

    @property
    def correction(self) -> tuple[float, ...]:
        """R (9,) where K is P, D is zero and R is a small rotation; () where there is none.

        Such is the CameraInfo of rectified images of a camera that has turned since it was calibrated.
        """
        turned = self.leaves_only_r and self.is_turned
        small = turned and turn_deg(np.array(self.r).reshape(3, 3)) <= MOST_CORRECTED_DEG
        return self.r if small else ()

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
                f"{known}: calibrate with one of them, or rectify the images before and calibrate from those "
                "(rectified: true in the node, replay without --raw)",
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
        error = rotation_error(rotation)
        if not error <= ROTATION_TOLERANCE:
            raise CameraInfoError(
                InfoReason.NOT_A_ROTATION,
                f"R of the {self.side} CameraInfo is no rotation (R R^T differs from the identity by "
                f"{error:.2g}, at most {ROTATION_TOLERANCE:g} allowed): calibrate the pair again",
            )


@dataclass(frozen=True, slots=True)
class _Region:
    """The region of the sensor that an image shows, and its binning."""

    left: int
    top: int
    size: tuple[int, int]
    binning: tuple[int, int]
    sensor: tuple[int, int]

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
        return cls(left, top, (columns // binning[0], rows // binning[1]), binning, (width, height))

    @property
    def cropped(self) -> bool:
        """Whether the image shows a part of the sensor."""
        return self.size != tuple(n // each for n, each in zip(self.sensor, self.binning, strict=True))

    def __str__(self) -> str:
        parts = []
        if self.binning != (1, 1):
            parts.append(f"binning {self.binning[0]} x {self.binning[1]}")
        if self.cropped:
            parts.append(f"a region of interest at ({self.left}, {self.top})")
        return " and ".join(parts)

    def ignored(self) -> _Region:
        """Return the region of images that show the whole sensor, unbinned."""
        return _Region(0, 0, self.sensor, (1, 1), self.sensor)

    def check_projection(self, p: Sequence[float], side: str) -> None:
        """Refuse a P that is that of the image already, although K and P describe the whole sensor.

        Its principal point lies in the middle of the image as it is, and far from it once region and binning
        are applied. The focal lengths would be wrong by the binning, and nothing in the images shows it.

        Raises:
            CameraInfoError: It is.
        """
        if not str(self):
            return
        as_it_is, applied = (
            max(abs((q[i] + 0.5) / n - 0.5) for i, n in zip((2, 6), self.size, strict=True) if n)
            for q in (p, self.applied_to(p))
        )
        if as_it_is < _MIDDLE <= applied:
            sensor, size = (f"{width} x {height}" for width, height in (self.sensor, self.size))
            raise CameraInfoError(
                InfoReason.REGION,
                f"{side} CameraInfo has {self} of a {sensor} px sensor, but the principal point of P, "
                f"({p[2]:.5g}, {p[6]:.5g}), is in the middle of the {size} px image, not of the sensor: give "
                "K and P of the whole sensor, or width and height of the image, with binning and roi 0",
            )

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


def values_of(info: Any, name: str) -> list[float] | None:
    """Return an array of a CameraInfo, from the spelling of ROS 2 or ROS 1; None where there is none."""
    values = getattr(info, name, None)
    if values is None:
        values = getattr(info, name.upper(), None)
    return None if values is None else [float(value) for value in values]


def _matrix(info: Any, name: str, size: int, side: str) -> list[float]:
    """Return matrix ``name`` of a CameraInfo as ``size`` finite floats."""
    values = values_of(info, name)
    if values is None or len(values) != size:
        raise CameraInfoError(
            InfoReason.MALFORMED, f"{side} CameraInfo has no matrix {name.upper()} of {size} values"
        )
    if not all(math.isfinite(value) for value in values):
        raise _not_finite(side, name.upper())
    return values


def _not_finite(side: str, name: str) -> CameraInfoError:
    return CameraInfoError(InfoReason.NOT_FINITE, f"{side} CameraInfo has NaN or infinity in {name}")


def used_values(info: Any, rectified: bool) -> tuple[Any, ...] | None:
    """Return what is used of a CameraInfo, None where it cannot be right.

    Args:
        info: Anything with the fields of sensor_msgs/CameraInfo.
        rectified: Whether its images are rectified; False: they are raw.
    """
    try:
        return CameraModel.read(info, "", rectified).used
    except RigError:
        return None


def content_of(info: Any) -> bytes | None:
    """Return the values of a ROS 2 message without its header as bytes, None of anything else.

    Args:
        info: Anything with the fields of sensor_msgs/CameraInfo.
    """
    try:
        roi = info.roi
        numbers = (info.width, info.height, info.binning_x, info.binning_y)
        region = (roi.x_offset, roi.y_offset, roi.width, roi.height)
        arrays = (info.d, info.k, info.r, info.p)
        text = f"{numbers} {region} {info.distortion_model} ".encode(errors="surrogatepass")
        return text + b"".join(values.tobytes() for values in arrays)
    except AttributeError:
        return None


def is_uncalibrated(info: Any) -> bool:
    """Whether a CameraInfo has neither K nor P, as one of a camera that was never calibrated."""
    return not any(value and value[0] for value in (values_of(info, "k"), values_of(info, "p")))
