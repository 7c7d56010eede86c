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

"""Geometry of a pair of cameras, from the projection matrices in their CameraInfo."""

from __future__ import annotations

from dataclasses import dataclass

from .camera_info import CameraInfoError, CameraModel, InfoReason

# Two rectified cameras share one projection matrix, except for the baseline term. Calibration tools print P
# with about six digits, so a difference of a hundredth of a pixel is no rounding.
_RECTIFIED_TOLERANCE_PX = 0.01

# No vehicle has a baseline outside this range. P[3] in pixel millimetres gives 30 m and more. P[3] =
# -baseline without fx gives less than 4 mm (2 m over 500 px). The height is then wrong by the same factor,
# and the images do not show it.
POSSIBLE_BASELINE_M = (0.005, 10.0)


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
        raise _no_baseline(left, right)
    if baseline_m < 0.0:
        raise _negative_baseline(left, right, baseline_m)
    least_m, most_m = POSSIBLE_BASELINE_M
    if not least_m <= baseline_m <= most_m:
        raise CameraInfoError(
            InfoReason.BASELINE_IMPLAUSIBLE,
            f"CameraInfo gives a baseline of {baseline_m:.4g} m ({shifts_text(left, right)}), at least "
            f"{least_m:g} m and at most {most_m:g} m are possible: "
            "P[3] of the right camera must be -fx * baseline in pixels times metres (not millimetres)"
            f"{_or_rig(left)}",
        )
    shift_px = left.p[2] - right.p[2]
    if abs(shift_px) > left.width:  # the shifted image would have no column in common with the other
        raise projections_differ(left, right, "cx", 2, left.width)
    return PairGeometry(baseline_m, shift_px if abs(shift_px) > _RECTIFIED_TOLERANCE_PX else 0.0)


def is_corrected(left: CameraModel, right: CameraModel) -> bool:
    """Whether a pair is that of rectified images of which a camera has turned, so that R turns it back.

    Both cameras have K = P and D = 0, and R is a small rotation of one of them at least. Where a CameraInfo
    of rectified images is that of the raw camera, as image_proc sends it along, K is not P or D is not zero.
    """
    turned = [camera for camera in (left, right) if camera.is_turned]
    alone = left.leaves_only_r and right.leaves_only_r
    return bool(turned) and alone and all(camera.correction for camera in turned)


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


def shifts_text(left: CameraModel, right: CameraModel) -> str:
    """Return what P[3] is in both cameras, for a message."""
    return f"P[3] is {left.p[3]:.6g} in the left camera and {right.p[3]:.6g} in the right one"


def _no_baseline(left: CameraModel, right: CameraModel) -> CameraInfoError:
    """Return the error of a P[3] that is the same in both cameras."""
    p3 = left.p[3]
    if p3 != 0.0:
        why = (
            f"P[3] is {p3:.6g} in both cameras, so both have the CameraInfo of one of them: publish that of "
            "each camera with its own images"
        )
    elif left.p[7] != right.p[7]:
        why = (
            f"P[3] is 0 in both cameras, P[7] is {left.p[7]:.6g} in the left one and {right.p[7]:.6g} in the "
            "right one: these cameras stand one above the other, a pair side by side is needed"
        )
    else:
        why = (
            "P[3] is 0 in both cameras, as after a calibration of each camera alone: calibrate them as a "
            f"stereo pair, which makes P[3] of the right camera -fx * baseline{_or_rig(left)}"
        )
    return CameraInfoError(InfoReason.BASELINE_ZERO, f"CameraInfo gives a baseline of zero ({why})")


def _negative_baseline(left: CameraModel, right: CameraModel, baseline_m: float) -> CameraInfoError:
    """Return the error of a P[3] that is greater in the right camera."""
    text = f"CameraInfo gives a negative baseline ({baseline_m:.4f} m): {shifts_text(left, right)}"
    if left.p[3] < 0.0 and right.p[3] == 0.0:
        # Only the right camera of a pair has a negative P[3], so this is its CameraInfo.
        remedy = (
            "the CameraInfo of left and right are swapped; if the images are as well, exchange all topics, "
            "otherwise those of CameraInfo alone"
        )
    else:
        fx_b = abs(left.p[3] - right.p[3])
        remedy = (
            f"0 and {-fx_b:.6g} (-fx * baseline) are needed; if the left images are those of the left "
            "camera, the sign of P[3] is wrong: correct it in the calibration; if they are those of the "
            "right one, left and right are swapped: exchange the topics"
        )
    return CameraInfoError(InfoReason.CAMERAS_SWAPPED, f"{text}: {remedy}")


def _or_rig(camera: CameraModel) -> str:
    return ", or give the rig by parameters" if camera.rectified else ""
