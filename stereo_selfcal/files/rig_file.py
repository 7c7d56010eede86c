"""Rig files: the intrinsics and the baseline of a rectified pair, as text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import yaml

from ..core.camera.rig import StereoRig
from ..core.errors import RigError


def read_rig_file(path: Path) -> StereoRig:
    """Read a rig file, YAML or JSON: ``width, height, fx, fy, cx, cy, baseline_m``.

    Raises:
        RigError: It cannot be read, or does not describe a rig.
    """
    try:
        text = path.read_text(encoding="utf-8")
        # PyYAML reads most of JSON, but takes the 1e3 of JSON for a word.
        values = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        detail = error.strerror if isinstance(error, OSError) else error
        raise RigError(f"rig file {path}: cannot be read ({detail})") from error
    if not isinstance(values, Mapping):
        raise RigError(f"rig file {path}: holds no keys; it needs {', '.join(StereoRig.__slots__)}")
    try:
        return StereoRig.from_mapping(values)
    except RigError as error:
        raise RigError(f"rig file {path}: {error}") from error
