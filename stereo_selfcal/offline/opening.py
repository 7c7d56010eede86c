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

"""Opens a recording by its path: bags, or a folder of image pairs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..bags import BagError, Selection
from ..core.camera.rig import StereoRig
from ..files.rig_file import read_rig_file
from .bag import BagSource
from .camera_files import cameras_of_files
from .folder import FolderSource, is_image_folder
from .recording import FrameSource

# Looked for in a folder of image pairs when no rig is given.
RIG_FILES = ("rig.yaml", "rig.json")


def open_source(
    paths: Sequence[Path],
    left: str | None = None,
    right: str | None = None,
    tolerance_s: float = 0.0,
    rig: StereoRig | None = None,
    selection: Selection | None = None,
    raw: bool = False,
    left_info: str | None = None,
    right_info: str | None = None,
    rectified: bool = False,
    camera_info: tuple[Path, Path] | None = None,
    odometry: str | None = None,
    imu: str | None = None,
) -> FrameSource:
    """Open a recording.

    Args:
        paths: Bags, which are one recording in the order of time; or one folder of image pairs.
        left: Image topic (in a folder of images: folder) of the left camera, None to find it.
        right: The same of the right camera.
        tolerance_s: Greatest difference of the header stamps of a pair [s]; 0 means equal stamps.
        rig: The rig; None for that of the CameraInfo topics, or of a rig file beside the image folders.
        selection: Which frames are used, None for all.
        raw: Whether the images of bags are raw: they are undistorted and rectified with their CameraInfo.
        left_info: CameraInfo topic of the left camera in bags, None to find it.
        right_info: The same of the right camera.
        rectified: Whether the images of bags are rectified whatever their topics are called.
        camera_info: CameraInfo files of the left and of the right camera, in place of the rig.
        odometry: Topic of nav_msgs/Odometry in bags that says how the car turns, None for none.
        imu: The same of sensor_msgs/Imu.

    Raises:
        SelfcalError: It cannot be read, or has no unambiguous stereo pair or no rig.
    """
    folders = [path for path in paths if is_image_folder(path, left, right)]
    if not folders:
        return BagSource(
            paths,
            left,
            right,
            tolerance_s,
            rig,
            selection,
            raw,
            left_info,
            right_info,
            rectified,
            camera_info,
            odometry,
            imu,
        )
    if raw and camera_info is None:
        raise BagError(
            f"{folders[0]}: raw images need CameraInfo, which a folder of images has not: rectify them, or "
            "give --camera-info"
        )
    if not (rig is None or camera_info is None):
        raise BagError("the rig is given by --rig and by --camera-info: leave one of them")
    if not (left_info is None and right_info is None):
        raise BagError(
            f"{folders[0]}: a folder of images has no CameraInfo topics: leave out --left-info and "
            "--right-info"
        )
    if not (odometry is None and imu is None):
        raise BagError(f"{folders[0]}: a folder of images has no topics: leave out --odometry and --imu")
    if len(paths) > 1:
        raise BagError(f"{folders[0]}: a folder of images is a recording by itself: give it alone")
    if camera_info is not None:
        cameras = cameras_of_files(camera_info, raw)
        return FolderSource(folders[0], cameras.rig, left, right, selection, cameras)
    return FolderSource(folders[0], rig or _rig_in(folders[0]), left, right, selection)


def _rig_in(folder: Path) -> StereoRig:
    for name in RIG_FILES:
        if (folder / name).exists():
            return read_rig_file(folder / name)
    raise BagError(f"{folder}: images carry no rig: give --rig, or put {' or '.join(RIG_FILES)} beside them")
