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

"""The CameraInfo of a pair, corrected by a measured alignment.

The turn is put on the right camera alone. The images show only how one camera is turned against the other,
and nobody can tell which of them has moved. With the right one corrected, the left camera, P and the baseline
stay as they are, and so does everything that was calibrated against them: the pose of the mount, the
transforms of the vehicle.

An angle is corrected where it is three standard deviations off or more; the others keep their value, as a
correction by noise would only add noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.camera_info import CameraModel
from ..camera.pair_geometry import is_corrected
from ..camera.plain_camera_info import PlainCameraInfo
from ..camera.rectifier import StereoRectifier
from ..errors import RigError
from .alignment import Alignment, optical_rotation

# An angle that is off by fewer standard deviations may well be none: of 100 good angles, 0.3 are.
LEAST_STD = 3.0
_ANGLES = ("pitch", "roll", "yaw")


@dataclass(frozen=True, slots=True, eq=False)
class RepairedPair:
    """The CameraInfo of both cameras, corrected where they are surely off.

    Attributes:
        left: That of the left camera.
        right: That of the right camera.
        originals: Both as they were.
        corrected: Angles of the right camera that were corrected: of "pitch", "roll" and "yaw"; none: both
            are as they were.
        alignment: How the right camera was found to be turned; None where it was not measured.
        rectified: Whether it is that of rectified images.
    """

    left: PlainCameraInfo
    right: PlainCameraInfo
    originals: tuple[PlainCameraInfo, PlainCameraInfo]
    corrected: tuple[str, ...]
    alignment: Alignment | None
    rectified: bool

    def describe(self) -> str:
        """Return what was corrected, and why nothing else: one sentence."""
        if self.alignment is None:
            return "as it was: the alignment of the cameras was not measured"
        found = self.alignment.describe()
        if not self.corrected:
            return f"as it was: no angle is {LEAST_STD:g} standard deviations off ({found})"
        return f"the right camera is turned back in {', '.join(self.corrected)} ({found})"


def repair_camera_info(
    left: PlainCameraInfo, right: PlainCameraInfo, alignment: Alignment | None, rectified: bool = True
) -> RepairedPair:
    """Correct the CameraInfo of a pair by how its right camera is turned.

    Args:
        left: That of the left camera, with which the alignment was measured.
        right: That of the right camera.
        alignment: How the right camera is turned against where this CameraInfo has it; None: not measured.
        rectified: Whether the images are rectified. They get K = P and D = 0, and R turns the right one. Raw
            images keep K and D, and R is turned on.

    Returns:
        The pair; as it was where no angle is surely off.

    Raises:
        CameraInfoError: A CameraInfo cannot be right.
    """
    originals = left, right
    angles = () if alignment is None else surely_off(alignment)
    if alignment is None or not angles:
        return RepairedPair(left, right, originals, (), alignment, rectified)
    values = zip(_ANGLES, alignment.as_array(), strict=True)
    turn = optical_rotation(*(float(value) if name in angles else 0.0 for name, value in values))
    if not rectified:
        return RepairedPair(left, right.turned(turn), originals, angles, alignment, rectified)
    cameras = CameraModel.read(left, "left"), CameraModel.read(right, "right")
    # What was turned by such a CameraInfo already is turned further.
    before = (left.rotation, right.rotation) if is_corrected(*cameras) else (np.eye(3), np.eye(3))
    pair = left.rectified(before[0]), right.rectified(turn @ before[1])
    return RepairedPair(*pair, originals, angles, alignment, rectified)


def repaired_pairs(cameras: StereoRectifier, alignment: Alignment | None) -> tuple[RepairedPair, ...]:
    """Return the corrected CameraInfo of cameras: for their images, and for the driver of raw ones.

    The CameraInfo beside rectified images may be that of the raw cameras, of which image_proc made them. For
    the images as they are, K, D and R are past. The driver needs those of the raw cameras, turned further.

    Args:
        cameras: The cameras of the images from which the alignment was measured.
        alignment: How the right camera is turned against where they have it; None: not measured.

    Returns:
        One pair, or a second one where it is corrected and the CameraInfo is that of raw cameras.
    """
    infos = cameras.infos or PlainCameraInfo.of_rig(cameras.rig)
    pair = repair_camera_info(*infos, alignment, rectified=not cameras.raw)
    if cameras.raw or cameras.turned or not pair.corrected or not _are_raw(cameras):
        return (pair,)
    return pair, repair_camera_info(*infos, alignment, rectified=False)


def _are_raw(cameras: StereoRectifier) -> bool:
    """Whether the CameraInfo of both says how raw images are rectified."""
    models = cameras.cameras or ()
    try:
        for camera in models:
            camera.check_raw()
    except RigError:
        return False
    return all(camera.k[0] for camera in models) and any(
        camera.is_turned or not camera.leaves_only_r for camera in models
    )


def surely_off(alignment: Alignment) -> tuple[str, ...]:
    """Return the angles that are at least three of their standard deviations away from zero."""
    values, std = alignment.as_array(), alignment.std
    off = np.isfinite(values) & np.isfinite(std) & (values != 0.0) & (np.abs(values) >= LEAST_STD * std)
    return tuple(name for name, each in zip(_ANGLES, off, strict=True) if each)
