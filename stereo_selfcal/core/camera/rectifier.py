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

"""Rectification of the images of a stereo camera for one rig. Node and replay use the same code.

Raw images are undistorted and rectified with K, D, R and P of their CameraInfo. Rectified images are not
changed, with two exceptions. Where the cx of the right camera differs from that of the left one, the right
image is shifted. Where K is P and D is zero, but R turns a camera a little, its image is turned by R: such is
the CameraInfo of a rectified camera that has turned since (:mod:`..geometry.camera_info_repair`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import RigError
from ..types import Image
from .camera_info import EQUIDISTANT, CameraModel, InfoReason
from .camera_info_checks import check_image_size, find_unusual_values
from .pair_geometry import is_corrected, pair_geometry
from .plain_camera_info import PlainCameraInfo
from .rig import StereoRig
from .rig_checks import Finding, check_focal_length, check_possible, find_unusual_rig
from .rotations import turn_deg

Maps = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]

# The maps of both cameras, before and after a change of their CameraInfo.
_CACHED_MAPS = 4
# Parameter of cubic interpolation by convolution; with this value it is exact for parabolas (Keys 1981).
_KEYS_A = -0.5


@dataclass(frozen=True, slots=True)
class StereoRectifier:
    """Converts the images of two cameras into those of a rectified rig.

    Attributes:
        rig: The rig of the images that :meth:`apply` returns.
        doubts: Unusual values in the CameraInfo of the cameras, or in the rig.
        cameras: Left and right camera, None where the rig was given by parameters.
        raw: Whether the images are raw, so that they have to be undistorted and rectified.
        turned: Whether they are rectified images that have to be turned by R.
        shift_px: Shift of the right image to the right, for rectified images [px].
        whole: The same for images of the whole sensor, where CameraInfo says that they are cropped or binned;
            else None.
        infos: The CameraInfo of both cameras; that of the rig where it was given by parameters.
    """

    rig: StereoRig
    doubts: tuple[Finding, ...] = ()
    cameras: tuple[CameraModel, CameraModel] | None = None
    raw: bool = False
    turned: bool = False
    shift_px: float = 0.0
    whole: StereoRectifier | None = None
    infos: tuple[PlainCameraInfo, PlainCameraInfo] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of_rig(cls, rig: StereoRig) -> StereoRectifier:
        """Return that of images of this rig, which need no change.

        Raises:
            RigError: No stereo camera of a car has such a rig.
        """
        check_possible(rig)
        return cls(rig, tuple(find_unusual_rig(rig)), infos=PlainCameraInfo.of_rig(rig))

    @classmethod
    def from_camera_info(cls, left: Any, right: Any, rectified: bool = True) -> StereoRectifier:
        """Build from the CameraInfo of both cameras.

        Args:
            left: Anything with the fields of sensor_msgs/CameraInfo, ROS 2 or ROS 1.
            right: The same of the right camera.
            rectified: Whether the images are rectified; False: they are raw.

        Raises:
            CameraInfoError: A CameraInfo cannot be right; see :meth:`StereoRig.from_camera_info`. Unlike
                there, cx may differ. For raw images also: the distortion model is unknown, or R is no
                rotation.
            RigError: A value of the rig cannot be right.
        """
        cameras = CameraModel.read(left, "left", rectified), CameraModel.read(right, "right", rectified)
        infos = PlainCameraInfo.of(left), PlainCameraInfo.of(right)
        whole = None
        if cameras[0].region or cameras[1].region:
            sensors = (
                CameraModel.read(left, "left", rectified, True),
                CameraModel.read(right, "right", rectified, True),
            )
            try:
                whole = cls._of_cameras(*sensors)
            except RigError:  # then they are cropped and binned, or nothing
                whole = None
            else:
                ignored = tuple(
                    Finding(
                        InfoReason.REGION_NOT_APPLIED,
                        f"the {camera.side} images show the whole sensor, although their CameraInfo has "
                        f"{camera.region}, which is not applied: set it to 0",
                    )
                    for camera in cameras
                    if camera.region
                )
                whole = replace(whole, doubts=whole.doubts + ignored, infos=infos)
        return replace(cls._of_cameras(*cameras), whole=whole, infos=infos)

    @classmethod
    def _of_cameras(cls, left: CameraModel, right: CameraModel) -> StereoRectifier:
        pair = pair_geometry(left, right)
        rectified = left.rectified
        if not rectified:
            left.check_raw()
            right.check_raw()
        rig = StereoRig.of_camera(left, pair.baseline_m)
        check_focal_length(rig, "CameraInfo gives")
        doubts = tuple(find_unusual_values(left, right, pair.baseline_m, rectified))
        turned = rectified and is_corrected(left, right)
        return cls(rig, doubts, (left, right), not rectified, turned, pair.shift_px)

    def for_images(self, left: Image, right: Image) -> StereoRectifier:
        """Return the one for images of this size: CameraInfo may say that they are binned when they are not.

        Args:
            left: (H, W) uint8 image of the left camera.
            right: The same of the right camera.
        """
        whole = self.whole
        if whole is not None and left.shape == right.shape == (whole.rig.height, whole.rig.width):
            return whole
        return self

    def sees_as(self, other: StereoRectifier) -> bool:
        """Whether both make the same rig of the same images, so that their frames can be fused."""
        if self.cameras is None or other.cameras is None:
            return self.rig == other.rig and self.cameras is other.cameras
        mine, theirs = ([camera.used for camera in each.cameras or ()] for each in (self, other))
        return self.raw == other.raw and mine == theirs

    @property
    def turn_text(self) -> str:
        """Which rectified images R turns, and by how much; "" where it turns none."""
        if not (self.turned and self.cameras):
            return ""
        angles_deg = {
            camera.side: turn_deg(np.array(camera.r).reshape(3, 3))
            for camera in self.cameras
            if camera.is_turned
        }
        return "R turns " + " and ".join(
            f"the {side} images by {a:.3f} deg" for side, a in angles_deg.items()
        )

    def apply(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Return the images of the rectified rig.

        Images whose size differs from that in the CameraInfo are returned unchanged; the calibrator refuses
        them with the reason.

        Args:
            left: (H, W) uint8 image of the left camera.
            right: The same of the right camera.
        """
        size = (self.rig.height, self.rig.width)
        if left.shape != size or right.shape != size or self.cameras is None:
            return left, right
        if self.raw:
            # The right image gets the projection of the left one, which also corrects a different cx.
            p = self.cameras[0].p
            left, right = (
                _remap(image, rectification_maps(camera, p))
                for image, camera in zip((left, right), self.cameras, strict=True)
            )
            return left, right
        if self.turned:
            p = self.cameras[0].p
            left_camera, right_camera = self.cameras
            if left_camera.is_turned:
                left = _turned(left, rectification_maps(left_camera, p))
            if right_camera.is_turned or self.shift_px:
                right = _turned(right, rectification_maps(right_camera, p))
            return left, right
        return left, shifted(right, self.shift_px) if self.shift_px else right

    def size_faults(self, left: tuple[int, int] | None, right: tuple[int, int] | None) -> list[Finding]:
        """Compare the sizes (width, height) of images with the CameraInfo; None where a size is not known."""
        if self.cameras is None:
            return []
        if self.whole is not None and left == right == (self.whole.rig.width, self.whole.rig.height):
            return []
        sizes = zip(self.cameras, (left, right), strict=True)
        found = [check_image_size(camera, size) for camera, size in sizes if size is not None]
        return [finding for finding in found if finding is not None]


@lru_cache(maxsize=_CACHED_MAPS)
def rectification_maps(camera: CameraModel, p: tuple[float, ...]) -> Maps:
    """Return the column and the row in the raw image of every rectified pixel, (H, W) each [px].

    Args:
        camera: The camera.
        p: (12,) projection of the rectified image, row by row.
    """
    k = np.array(camera.k).reshape(3, 3)
    rectified_from_raw = np.array(camera.r).reshape(3, 3)
    projection = np.array(p).reshape(3, 4)[:, :3]
    coefficients = np.array(camera.d, dtype=np.float64)
    fisheye = camera.model == EQUIDISTANT
    make: Any = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    size = (camera.width, camera.height)
    columns, rows = make(k, coefficients, rectified_from_raw, projection, size, cv2.CV_32FC1)
    return np.asarray(columns, dtype=np.float32), np.asarray(rows, dtype=np.float32)


def shifted(image: Image, columns_px: float) -> Image:
    """Return an image shifted to the right by whole or fractional pixels; the border column is repeated.

    Args:
        image: (H, W) uint8.
        columns_px: Shift [px]; negative: to the left.
    """
    whole = int(np.floor(columns_px))
    weights = _keys_weights(columns_px - whole)
    # Output column u is the input at u - columns_px, which lies between u - whole - 1 and u - whole.
    reach = abs(whole) + len(weights)
    wide = cv2.copyMakeBorder(image, 0, 0, reach, reach, cv2.BORDER_REPLICATE)
    if columns_px != whole:
        # filter2D correlates: tap i is the pixel i - 2 to the right.
        wide = cv2.filter2D(wide, -1, weights[None, :], anchor=(2, 0), borderType=cv2.BORDER_REPLICATE)
    start = reach - whole
    return np.ascontiguousarray(wide[:, start : start + image.shape[1]], dtype=np.uint8)


def _keys_weights(fraction: float) -> npt.NDArray[np.float64]:
    """Return the weights of the pixels at -2, -1, 0, 1 for the value at ``-fraction`` (0 ... 1)."""
    distances = np.abs(np.array([-2.0, -1.0, 0.0, 1.0]) + fraction)
    near = (_KEYS_A + 2) * distances**3 - (_KEYS_A + 3) * distances**2 + 1
    far = _KEYS_A * (distances**3 - 5 * distances**2 + 8 * distances - 4)
    weights: npt.NDArray[np.float64] = np.where(distances <= 1, near, np.where(distances < 2, far, 0.0))
    return weights


def _remap(image: Image, maps: Maps) -> Image:
    # Linear, as in image_proc: of OpenCV's interpolations it alone causes no shift (cubic: 0.05 px, Lanczos:
    # 0.03 px).
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), dtype=np.uint8)


def _turned(image: Image, maps: Maps) -> Image:
    # The same for an image that is turned a little. Its border is repeated: one of black would be an edge.
    interpolation = cv2.INTER_LINEAR
    return np.asarray(cv2.remap(image, *maps, interpolation, borderMode=cv2.BORDER_REPLICATE), np.uint8)
