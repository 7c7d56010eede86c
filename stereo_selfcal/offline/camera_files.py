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

"""The cameras of a recording by two CameraInfo files, in place of what is recorded."""

from __future__ import annotations

from pathlib import Path

from ..bags import BagError
from ..core.camera.camera_info_checks import check_claim
from ..core.camera.rectifier import StereoRectifier
from ..core.errors import RigError, printable
from ..files.camera_info_file import read_camera_info_file


def cameras_of_files(files: tuple[Path, Path], raw: bool) -> StereoRectifier:
    """Return the cameras of two CameraInfo files, of the left and of the right one.

    Args:
        files: The files, as camera_info_manager has them.
        raw: Whether the images are raw.

    Raises:
        RigError: A file cannot be read, or the CameraInfo cannot be right.
    """
    left, right = (read_camera_info_file(file) for file in files)
    try:
        return StereoRectifier.from_camera_info(left, right, rectified=not raw)
    except RigError as error:
        raise BagError(f"{error} (CameraInfo of {_named(files)})") from error


def check_topics(
    cameras: StereoRectifier, files: tuple[Path, Path], topics: tuple[str, str], raw: bool, declared: bool
) -> None:
    """Compare what the images are said to be with the names of their topics.

    Args:
        cameras: The cameras of the files.
        files: The files.
        topics: The image topics.
        raw: Whether the images are said to be raw.
        declared: Whether the user says that they are rectified, whatever their topics are called.

    Raises:
        BagError: They are not.
    """
    if declared or cameras.cameras is None:
        return
    remedy = "leave out --raw" if raw else "give --raw, or --rectified if they are rectified after all"
    try:
        check_claim(cameras.cameras, topics, not raw, remedy)
    except RigError as error:
        raise BagError(f"{error} (CameraInfo of {_named(files)})") from error


def turn_note(cameras: StereoRectifier) -> tuple[str, ...]:
    """Return a sentence about the turn of rectified images by their CameraInfo, none where there is none."""
    return (f"the CameraInfo is a corrected one: {cameras.turn_text}",) if cameras.turned else ()


def _named(files: tuple[Path, Path]) -> str:
    return " and ".join(printable(str(file)) for file in files)
