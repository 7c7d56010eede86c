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

"""Values of a usable CameraInfo that are unusual, or that contradict what the images are said to be."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from .camera_info import EQUIDISTANT, MOST_CORRECTED_DEG, CameraInfoError, CameraModel, InfoReason
from .pair_geometry import is_corrected, shifts_text
from .rig_checks import (
    Finding,
    find_principal_point_at_border,
    find_unusual_baseline,
    find_unusual_focal_length,
)
from .topic_names import says_rectified

# Most zoom of a rectification. It is 0.73 for the cameras of KITTI and 0.95 for those of EuRoC. A factor of
# two occurs where the K of a CameraInfo was scaled to another resolution and its P was not. The images of
# wide lenses are zoomed more.
_MOST_ZOOM = 2.0
_MOST_ZOOM_FISHEYE = 4.0

# A rectification that moves no pixel by more than this changes nothing: lines are located to about a tenth
# of a pixel, which is 0.01 degrees of pitch at a focal length of 500 px.
_UNMOVED_PX = 0.1
# Points in each direction at which the move is measured; lenses distort most at the corners.
_GRID = 9


def find_unusual_values(
    left: CameraModel, right: CameraModel, baseline_m: float, rectified: bool
) -> list[Finding]:
    """Return the unusual values of two usable cameras.

    A D that is not zero is no finding, because the CameraInfo of a rectified image is that of the raw camera.

    Args:
        left: The left camera.
        right: The right camera.
        baseline_m: Distance of the cameras [m].
        rectified: Whether the images are supposed to be rectified.
    """
    found = find_unusual_baseline(baseline_m, "P[3]")
    if left.p[3] > 0.0 <= right.p[3]:
        text = (
            f"{shifts_text(left, right)}, usual is 0 and {right.p[3] - left.p[3]:.6g}: if the lines of the "
            "images match only the other way round, left and right are in order and the sign of P[3] is wrong"
        )
        found.append(Finding(InfoReason.REFERENCE_IS_RIGHT, text))
    found += find_unusual_focal_length(left.p[0], left.p[5], (left.width, left.height), "P")
    for camera in (left, right):
        found += _unusual_values_of(camera, rectified)
    return found + (_ignored_rotations(left, right) if rectified else [])


def _ignored_rotations(left: CameraModel, right: CameraModel) -> list[Finding]:
    """Return the corrections of rectified images that are not made, with the reason."""
    if is_corrected(left, right):
        return []
    found = []
    for camera, other in ((left, right), (right, left)):
        if not (camera.k[0] and camera.leaves_only_r and camera.is_turned):
            continue
        why = (
            f"K is P and D is zero in the {camera.side} one alone; give the {other.side} one of the same pair"
            if camera.correction and not other.leaves_only_r
            else f"at most {MOST_CORRECTED_DEG:g} deg are a correction of rectified images; if these images "
            "are not rectified, set rectified: false"
        )
        text = f"R of the {camera.side} CameraInfo turns the camera and is not applied: {why}"
        found.append(Finding(InfoReason.ROTATION_NOT_APPLIED, text))
    return found


def check_claim(
    cameras: tuple[CameraModel, CameraModel], topics: tuple[str, str], rectified: bool, remedy: str
) -> None:
    """Compare what the images are said to be with the names of their topics and with their CameraInfo.

    Images of a topic that is not called rectified are raw by the conventions of ROS. They can be taken as
    rectified only where rectification would change nothing. Raw images that are taken for rectified ones
    give a pose that is off by the rotation of the camera, with a small standard deviation.

    A pair whose K is P and whose D is zero, and of which R turns one camera a little, is used alike for raw
    and for rectified images: that camera is turned by R. So there is nothing to compare. Where R turns both,
    it may be that of raw cameras.

    Args:
        cameras: Left and right camera.
        topics: Names of the image topics.
        rectified: Whether the images are said to be rectified; False: to be raw.
        remedy: What to do if they are not.

    Raises:
        CameraInfoError: They are not.
    """
    if is_corrected(*cameras) and not all(camera.is_turned for camera in cameras):
        return
    for camera, topic in zip(cameras, topics, strict=True):
        called_rectified, called_raw = says_rectified(topic)
        believed = called_rectified if rectified else (called_raw or not called_rectified)
        moved_px = 0.0 if believed else rectification_moves_px(camera)
        if moved_px <= _UNMOVED_PX:
            continue
        how = f"by up to {moved_px:.1f} px" if math.isfinite(moved_px) else "by an unknown amount"
        if rectified:
            raise CameraInfoError(
                InfoReason.NOT_RECTIFIED,
                f"{topic} is not called rectified, and by its CameraInfo ({_why_raw(camera)}) rectification "
                f"moves pixels {how}, at most {_UNMOVED_PX:g} px allowed: the images are raw; {remedy}",
            )
        raise CameraInfoError(
            InfoReason.RECTIFIED_ALREADY,
            f"{topic} is called rectified, and its CameraInfo would rectify the images a second time, which "
            f"moves pixels {how}, at most {_UNMOVED_PX:g} px allowed: {remedy}",
        )


def rectification_moves_px(camera: CameraModel) -> float:
    """Return how far a pixel of the raw image lies from its place in the rectified one, at most [px].

    A CameraInfo with P alone says nothing about the raw image: 0. Where it cannot be computed (an unknown
    distortion model, D or R without K, impossible numbers), it is infinite.

    Args:
        camera: The camera.
    """
    if not camera.k[0]:
        return math.inf if any(camera.d) or camera.is_turned else 0.0
    d = np.array(camera.d)
    if not all(map(math.isfinite, (*camera.d, *camera.r))):
        return math.inf
    k, p = np.array(camera.k).reshape(3, 3), np.array(camera.p).reshape(3, 4)[:, :3]
    r = np.array(camera.r).reshape(3, 3) if len(camera.r) == 9 and any(camera.r) else np.eye(3)
    columns, rows = np.meshgrid(
        np.linspace(0, camera.width - 1, _GRID), np.linspace(0, camera.height - 1, _GRID)
    )
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(_GRID**2)])
    with np.errstate(all="ignore"):
        try:
            rays = (r.T @ np.linalg.solve(p, pixels)).T
            if not (rays[:, 2] > 0).all():
                return math.inf
            raw = _project(camera.model, np.ascontiguousarray(rays / rays[:, 2:]), k, d)
        except (cv2.error, np.linalg.LinAlgError):
            return math.inf
        moved = np.abs(raw - pixels[:2].T).max()
    return float(moved) if np.isfinite(moved) else math.inf


def _project(model: str, rays: Any, k: Any, d: Any) -> Any:
    """Return the raw pixels (N, 2) of rays (N, 3)."""
    if model == EQUIDISTANT:
        return cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), k, d)[0][:, 0]
    coefficients = d if d.any() else np.zeros(4)
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), k, coefficients)[0][:, 0]


def _why_raw(camera: CameraModel) -> str:
    """Return which matrices say that an image has still to be rectified."""
    why = ["D is not zero"] if any(camera.d) else []
    if camera.is_turned:
        why.append("R is not the identity")
    if camera.k[0] and not camera.k_is_p:
        why.append("K is not P")
    return ", ".join(why)


def check_image_size(model: CameraModel, size: tuple[int, int]) -> Finding | None:
    """Compare the size of an image with the size in its CameraInfo.

    Args:
        model: The camera.
        size: Width and height of an image of this camera [px].

    Returns:
        The finding, None where the sizes agree.
    """
    if size == (model.width, model.height):
        return None
    return Finding(
        InfoReason.IMAGE_SIZE,
        f"the {model.side} image is {size[0]} x {size[1]}, its CameraInfo is for {model.width} x "
        f"{model.height} (region of interest and binning applied): publish the CameraInfo of these images",
    )


def _unusual_values_of(camera: CameraModel, rectified: bool) -> list[Finding]:
    found = []
    side, k, p = camera.side, camera.k, camera.p
    most = _MOST_ZOOM_FISHEYE if camera.model == EQUIDISTANT else _MOST_ZOOM
    for name, raw, projected in (("fx", k[0], p[0]), ("fy", k[4], p[5])):
        if raw > 0 and projected > 0 and not 1 / most < projected / raw < most:
            text = (
                f"{name} of the {side} CameraInfo is {raw:.5g} in K and {projected:.5g} in P, usual is a "
                f"ratio of at most {most:g}: they may belong to different resolutions"
            )
            found.append(Finding(InfoReason.FOCAL_LENGTHS_DISAGREE, text))
            break
    for name, column, row in (("K", k[2], k[5]), ("P", p[2], p[6])):
        if not camera.cropped and (name == "P" or k[0]):
            size = (camera.width, camera.height)
            at_border = find_principal_point_at_border(column, row, size, f"{name} of the {side} CameraInfo")
            if at_border:
                found += at_border
                break
    unturned = len(camera.r) == 9 and not camera.is_turned and any(camera.r)
    if rectified and camera.k_is_p and unturned and any(camera.d):
        text = (
            f"the {side} CameraInfo is that of a single camera, not of a rectified pair (P is K, R is the "
            "identity, D is not zero): if the images are not rectified, set rectified: false or calibrate "
            "them as a pair"
        )
        found.append(Finding(InfoReason.SEEMS_UNRECTIFIED, text))
    return found
