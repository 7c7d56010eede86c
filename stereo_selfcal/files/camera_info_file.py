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

"""Files with the CameraInfo of one camera, as camera_info_manager and camera_calibration have them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..core.camera.plain_camera_info import PlainCameraInfo, RegionOfInterest
from ..core.errors import ConfigError, RigError, printable, shortened
from ..core.types import Array
from .safe_yaml import parse_yaml, read_text

# Begins every file that is written here: what does not begin so is somebody else's.
OURS = "# CameraInfo written by stereo_selfcal\n"

# Of a file of camera_calibration there is less than 1 kB.
_MOST_BYTES = 65_536
# Key, attribute and shape of each matrix; None: any length.
_MATRICES: tuple[tuple[str, str, tuple[int, int | None]], ...] = (
    ("camera_matrix", "k", (3, 3)),
    ("distortion_coefficients", "d", (1, None)),
    ("rectification_matrix", "r", (3, 3)),
    ("projection_matrix", "p", (3, 4)),
)
# Coefficients of the longest model of OpenCV.
_MOST_COEFFICIENTS = 14
_GREATEST_PIXELS = 100_000
_ROI = "x_offset", "y_offset", "height", "width"


def format_camera_info(info: PlainCameraInfo, camera_name: str, comment: str) -> str:
    """Return the text of a file.

    Args:
        info: The CameraInfo. Its binning and region of interest, which camera_info_manager takes from the
            driver, are written where there are any.
        camera_name: Name of the camera. camera_info_manager warns where it is not that of its driver.
        comment: Lines that say what it is.
    """
    document: dict[str, Any] = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": camera_name,
        "distortion_model": info.distortion_model,
    }
    for key, name, (rows, columns) in _MATRICES:
        data = [float(value) for value in getattr(info, name)]
        if name == "r" and not data:
            data = info.rotation.ravel().tolist()
        document[key] = {"rows": rows, "cols": len(data) if columns is None else columns, "data": data}
    if info.binning_x or info.binning_y:
        document |= {"binning_x": info.binning_x, "binning_y": info.binning_y}
    if info.roi != RegionOfInterest():
        document["roi"] = {name: getattr(info.roi, name) for name in _ROI}
    body: str = yaml.safe_dump(
        document, sort_keys=False, allow_unicode=True, default_flow_style=None, width=math.inf
    )
    lines = "".join(f"# {printable(line)}\n" for line in comment.splitlines())
    return OURS + lines + body


def is_ours(path: Path) -> bool:
    """Whether a file may be replaced: it was written here, or there is none."""
    try:
        with path.open("rb") as file:
            return file.read(len(OURS)) == OURS.encode()
    except FileNotFoundError:
        return True
    except OSError:  # whoever writes it says what is wrong with it
        return True


def read_camera_info_file(path: Path) -> PlainCameraInfo:
    """Read a file.

    Raises:
        RigError: It cannot be read, or does not describe a camera. What is wrong with the camera itself is
            found by whoever uses it.
    """
    shown = printable(str(path))
    try:
        values = parse_yaml(path, read_text(path, _MOST_BYTES, "CameraInfo file"))
    except ConfigError as error:
        detail = str(error).removeprefix(f"{shown} ")
        raise RigError(f"CameraInfo file {shown}: {detail}") from error
    try:
        return _from_mapping(values)
    except RigError as error:
        raise RigError(f"CameraInfo file {shown}: {error}") from error


def _from_mapping(values: Any) -> PlainCameraInfo:
    if not isinstance(values, Mapping):
        raise RigError(
            "it holds no keys; image_width, camera_matrix and so on of camera_info_manager are needed"
        )
    width, height = (_whole(values, name, least=1) for name in ("image_width", "image_height"))
    model = values.get("distortion_model", "")
    if not isinstance(model, str):
        raise RigError(f"distortion_model is {shortened(model)}, a name is needed")
    matrices = {name: _matrix(values, key, *shape) for key, name, shape in _MATRICES}
    roi = values.get("roi", {})
    if not isinstance(roi, Mapping):
        raise RigError(f"roi is {shortened(roi)}, its keys are {', '.join(_ROI)}")
    return PlainCameraInfo(
        width,
        height,
        model,
        d=matrices["d"],
        k=matrices["k"],
        r=matrices["r"],
        p=matrices["p"],
        binning_x=_whole(values, "binning_x"),
        binning_y=_whole(values, "binning_y"),
        roi=RegionOfInterest(*(_whole(roi, name) for name in _ROI)),
    )


def _whole(values: Mapping[Any, Any], name: str, least: int = 0) -> int:
    value = values.get(name, 0)
    if type(value) is not int or not least <= value <= _GREATEST_PIXELS:
        raise RigError(f"{name} is {shortened(value)}, a whole number from {least} on is needed")
    return value


def _matrix(values: Mapping[Any, Any], key: str, rows: int, columns: int | None) -> Array:
    entry = values.get(key)
    data = entry.get("data") if isinstance(entry, Mapping) else None
    if not isinstance(data, Sequence) or isinstance(data, str):
        raise RigError(f"it has no {key} with rows, cols and data")
    if columns is not None and len(data) != rows * columns:
        raise RigError(f"{key} has {len(data)} values, {rows * columns} are needed")
    if len(data) > max(rows * (columns or 0), _MOST_COEFFICIENTS):
        raise RigError(f"{key} has {len(data)} values, at most {_MOST_COEFFICIENTS} are possible")
    for value in data:
        if type(value) not in (int, float):
            raise RigError(f"{key} holds {shortened(value)}, numbers are needed")
    return np.array(data, dtype=np.float64)
