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

"""Rig files: the intrinsics and the baseline of a rectified pair, as text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..core.camera.rig import StereoRig
from ..core.camera.rig_checks import check_possible
from ..core.errors import ConfigError, RigError, printable
from .safe_yaml import parse_json, parse_yaml, read_text

# Seven numbers, and whatever is said of them.
_MOST_BYTES = 65_536


def read_rig_file(path: Path) -> StereoRig:
    """Read a rig file, YAML or JSON: ``width, height, fx, fy, cx, cy, baseline_m``.

    Raises:
        RigError: It cannot be read, or does not describe a rig.
    """
    shown = printable(str(path))
    try:
        text = read_text(path, _MOST_BYTES, "rig file")
        values = (parse_json if path.suffix.lower() == ".json" else parse_yaml)(path, text)
    except ConfigError as error:
        cause = error.__cause__
        detail = cause.strerror if isinstance(cause, OSError) else str(error).removeprefix(f"{shown} ")
        raise RigError(f"rig file {shown}: cannot be read ({detail})") from error
    if not isinstance(values, Mapping):
        raise RigError(f"rig file {shown}: holds no keys; it needs {', '.join(StereoRig.__slots__)}")
    try:
        rig = StereoRig.from_mapping(values)
        check_possible(rig)
    except RigError as error:
        raise RigError(f"rig file {shown}: {error}") from error
    return rig
