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

"""Values of a rig that are possible but unusual, and those that no stereo camera of a car has.

The same holds for a rig from CameraInfo, from a file and from parameters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import RigError
from .camera_info import CameraInfoError, InfoReason
from .pair_geometry import POSSIBLE_BASELINE_M
from .rig import StereoRig

# Baselines of the stereo cameras of cars. The baseline of a lorry or of a toy may be outside this range.
_USUAL_BASELINE_M = (0.03, 2.0)
# Field of view of a rectified image along its longer side. A telephoto lens sees too little road, and beyond
# the upper limit a pixel in the middle is as wide as 15 at the border. A focal length in millimetres, or of a
# far smaller image, is beyond what is possible.
_USUAL_VIEW_DEG = (8.0, 150.0)
_MOST_VIEW_DEG = 170.0
# Most quotient of fx and fy that is usual: pixels are square, or 2 : 1 where rows or columns are binned.
_MOST_ASPECT = 2.1
# Least distance of the principal point from the border, as a fraction of the image's side. A nearer one
# belongs to another resolution, or to a crop.
_BORDER = 0.15
_MM_PER_M = 1e3


@dataclass(frozen=True, slots=True)
class Finding:
    """One unusual value of a rig or of a CameraInfo.

    Attributes:
        reason: Kind of the finding.
        message: Sentence with the value, the usual range and the remedy.
    """

    reason: InfoReason
    message: str

    def __str__(self) -> str:
        return f"{self.reason}: {self.message}"


def check_possible(rig: StereoRig) -> None:
    """Refuse a rig from a file or from parameters that no stereo camera of a car has.

    Raises:
        RigError: A value is impossible; the message has it with its unit.
    """
    least_m, most_m = POSSIBLE_BASELINE_M
    if not least_m <= rig.baseline_m <= most_m:
        in_mm = rig.baseline_m / _MM_PER_M
        hint = f" (in millimetres it would be {in_mm:.4g} m)" if least_m <= in_mm <= most_m else ""
        raise RigError(
            f"rig.baseline_m is {rig.baseline_m:.6g} m, at least {least_m:g} m and at most {most_m:g} m are "
            f"possible: give the distance of the cameras in metres{hint}"
        )
    for name in ("cx", "cy"):
        if getattr(rig, name) == 0.0:
            raise RigError(
                f"rig.{name} is 0 px, the border of the {rig.width} x {rig.height} image: give the principal "
                "point of the rectified images, usually near their middle"
            )
    check_focal_length(rig, "the rig has")


def check_focal_length(rig: StereoRig, whose: str) -> None:
    """Refuse a focal length that would see nearly half of the world.

    Args:
        rig: The rig.
        whose: Beginning of the message: "the rig has".

    Raises:
        CameraInfoError: It is impossible.
    """
    view_deg = _view_deg(rig.fx, rig.fy, (rig.width, rig.height))
    if view_deg > _MOST_VIEW_DEG:
        raise CameraInfoError(
            InfoReason.FOCAL_LENGTH_IMPLAUSIBLE,
            f"{whose} a focal length of {rig.fx:.4g} x {rig.fy:.4g} px, with which an image of "
            f"{rig.width} x {rig.height} sees {view_deg:.1f} degrees, at most {_MOST_VIEW_DEG:g} degrees are "
            "possible: give fx and fy in pixels of these images (not in millimetres)",
        )


def find_unusual_rig(rig: StereoRig) -> list[Finding]:
    """Return the unusual values of a rig from a file or from parameters."""
    size = (rig.width, rig.height)
    return [
        *find_unusual_baseline(rig.baseline_m, "rig.baseline_m"),
        *find_unusual_focal_length(rig.fx, rig.fy, size, "the rig"),
        *find_principal_point_at_border(rig.cx, rig.cy, size, "the rig"),
    ]


def find_unusual_baseline(baseline_m: float, where: str) -> list[Finding]:
    """Return what is unusual about a baseline.

    Args:
        baseline_m: The baseline [m].
        where: What to check.
    """
    least_m, most_m = _USUAL_BASELINE_M
    if least_m <= baseline_m <= most_m:
        return []
    text = (
        f"the baseline is {baseline_m:.4g} m, usual is at least {least_m:g} m and at most {most_m:g} m: "
        f"check {where}"
    )
    return [Finding(InfoReason.BASELINE_UNUSUAL, text)]


def find_unusual_focal_length(fx: float, fy: float, size: tuple[int, int], where: str) -> list[Finding]:
    """Return what is unusual about the focal length of rectified images.

    Args:
        fx: Horizontal focal length [px].
        fy: Vertical focal length [px].
        size: Width and height of the images [px].
        where: What has it.
    """
    view_deg = _view_deg(fx, fy, size)
    least_deg, most_deg = _USUAL_VIEW_DEG
    has = f"the focal length of {where} is {fx:.5g} x {fy:.5g} px"
    found = []
    if not least_deg <= view_deg <= most_deg:
        text = (
            f"{has}, with which an image of {size[0]} x {size[1]} sees {view_deg:.3g} degrees, usual are at "
            f"least {least_deg:g} and at most {most_deg:g} degrees: it may belong to another resolution"
        )
        found.append(Finding(InfoReason.FOCAL_LENGTH_UNUSUAL, text))
    if not 1 / _MOST_ASPECT <= fx / fy <= _MOST_ASPECT:
        text = f"{has}, usual is a ratio of at most {_MOST_ASPECT:g}: check fx and fy"
        found.append(Finding(InfoReason.FOCAL_LENGTH_UNUSUAL, text))
    return found


def find_principal_point_at_border(
    column: float, row: float, size: tuple[int, int], where: str
) -> list[Finding]:
    """Return what is unusual about a principal point.

    Args:
        column: Its column [px].
        row: Its row [px].
        size: Width and height of the images [px].
        where: What has it.
    """
    off = max(abs((column + 0.5) / size[0] - 0.5), abs((row + 0.5) / size[1] - 0.5))
    if off <= 0.5 - _BORDER:
        return []
    text = (
        f"principal point ({column:.5g}, {row:.5g}) of {where} lies at the border of the "
        f"{size[0]} x {size[1]} image: it may belong to another resolution"
    )
    return [Finding(InfoReason.PRINCIPAL_POINT, text)]


def _view_deg(fx: float, fy: float, size: tuple[int, int]) -> float:
    """Return the field of view of an image along its wider side, its principal point in the middle [deg]."""
    return math.degrees(2 * math.atan(max(size[0] / fx, size[1] / fy) / 2))
