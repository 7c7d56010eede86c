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

"""ROS 2 parameter files and the settings in them. Reading one needs no ROS, and trusts nothing in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..core.config import CalibratorConfig, flatten
from ..core.drive.targets import Targets
from ..core.errors import ConfigError, printable, shortened
from ..core.geometry.vehicle import PlaceInVehicle
from .frames import FRAME_NAMES, PLACE_NAMES, FrameNames
from .node_settings import (
    NODE_NAME,
    NODE_SETTINGS,
    TARGET_NAMES,
    NodeSetting,
    check_text,
    is_calibrator_setting,
)
from .safe_yaml import UnreadableFileError, parse_yaml, read_text

__all__ = ["UnreadableFileError"]

ANY_NODE = "/**"
PARAMETERS = "ros__parameters"
_ANY_NODE = (ANY_NODE, "/*")  # other patterns may match this node or not, by its namespace
# A file may hold the parameters of a whole vehicle; those of Nav2, a big one, are 20 kB. PyYAML was
# measured to read 1 MB in 1.2 s.
_MOST_BYTES = 1_000_000
_MOST_SHOWN = 5  # names of nodes in an error


def load_calibrator_config(path: Path | str) -> CalibratorConfig:
    """Read the calibrator's settings from a ROS 2 parameter file, the one the node takes.

    Parameters of the node itself are passed over; a name that neither knows is an error. Entries for
    this node win over those for any node.

    Args:
        path: A file with ``/**:`` or ``stereo_selfcal:`` (in whatever namespace) and ``ros__parameters:``.

    Raises:
        ConfigError: The file cannot be read, is no parameter file, or a setting is wrong.
    """
    settings = {
        name: value for name, value in flatten(node_parameters(path)).items() if is_calibrator_setting(name)
    }
    try:
        return CalibratorConfig.from_mapping(settings)
    except ConfigError as error:
        raise ConfigError(f"{printable(str(path))}: {error}") from error


def chosen_config(path: Path | None, seed: int | None) -> CalibratorConfig:
    """Return the settings of a file, or the defaults without one, with a seed of their own or that given.

    Raises:
        ConfigError: The file cannot be read, or holds something else.
    """
    config = CalibratorConfig() if path is None else load_calibrator_config(path)
    if seed is None:
        return config
    settings = {name: value for name, value, _ in config.settings()}
    return CalibratorConfig.from_mapping(settings | {"seed": seed})


def load_frames(path: Path | str | None) -> FrameNames:
    """Return the frames of the vehicle, the road and the camera: of a parameter file, or the node's defaults.

    Raises:
        ConfigError: The file cannot be read, is no parameter file, or a name or a number is wrong.
    """
    if path is None:
        return FrameNames()
    shown, given = f"{printable(str(path))}: ", flatten(node_parameters(path))
    settings = {setting.name: setting for setting in NODE_SETTINGS}
    values = {name: given.get(name, settings[name].default) for name in FRAME_NAMES}
    for name, value in values.items():
        if not isinstance(value, str):
            raise ConfigError(f"{shown}{name} is {shortened(value)}: the name of a frame is needed")
    x_m, y_m = (
        _checked(settings[name], given.get(name, settings[name].default), shown) for name in PLACE_NAMES
    )
    frames = FrameNames(**values, place=PlaceInVehicle(float(x_m), float(y_m)))
    try:
        for name, value in values.items():
            check_text(name, value)
        frames.check()
    except ConfigError as error:
        raise ConfigError(f"{shown}{error}") from error
    return frames


def load_targets(path: Path | str | None, given: Mapping[str, Any] | None = None) -> Targets:
    """Return the standard deviations that are good enough, and the fewest frames.

    Args:
        path: A parameter file, None for the node's defaults.
        given: Values by name that take the place of those of the file.

    Raises:
        ConfigError: The file cannot be read, is no parameter file, or a value is wrong.
    """
    in_file = {} if path is None else node_parameters(path)
    settings = {setting.name: setting for setting in NODE_SETTINGS}
    values = {}
    for name in (*TARGET_NAMES, "frames"):
        shown = f"{printable(str(path))}: " if name in in_file else ""
        values[name] = _checked(settings[name], in_file.get(name, settings[name].default), shown)
        if given is not None and name in given:
            values[name] = _checked(settings[name], given[name])
    height_m, pitch_rad, roll_rad = (float(values[name]) for name in TARGET_NAMES)
    return Targets(height_m, pitch_rad, roll_rad, int(values["frames"]))


def _checked(setting: NodeSetting, value: Any, shown: str = "") -> int | float:
    """Return a number for a parameter of the node, checked by its kind and its range."""
    whole = isinstance(setting.default, int)
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        kind = "a whole number" if whole else "a number"
        raise ConfigError(f"{shown}{setting.name} is {shortened(value)}: {kind} is needed")
    if setting.low is None or setting.high is None or not setting.low <= value <= setting.high:
        raise ConfigError(f"{shown}{setting.name} is {shortened(value)}: it must lie in {setting.range_text}")
    return value


def node_parameters(path: Path | str, most_bytes: int = _MOST_BYTES) -> dict[str, Any]:
    """Return the parameters a file has for this node, nested as they are written.

    As in ROS, those under the name of the node win over those for any node, wherever they stand.

    Args:
        path: The file.
        most_bytes: A larger file is refused unread.

    Raises:
        UnreadableFileError: The file cannot be read.
        ConfigError: It is no parameter file, or has the parameters of several such nodes.
    """
    text = read_text(path, most_bytes, "parameter file")
    shown = printable(str(path))
    if not text:
        raise ConfigError(f"{shown} is empty: '{ANY_NODE}:' with '{PARAMETERS}:' is needed")
    nodes = dict(_nodes(parse_yaml(path, text)))
    for_any = [name for name in nodes if name in _ANY_NODE]
    named = [name for name in nodes if name.rpartition("/")[2] == NODE_NAME]
    patterns = [name for name in nodes if "*" in name and name not in (*for_any, *named)]
    if len(named) > 1 or len(for_any) > 1 or patterns:
        several = [*for_any, *named, *patterns] if patterns or len(for_any) > 1 else named
        raise ConfigError(
            f"{shown} has several names that can be those of this node ({_listed(several)}): give a file "
            f"with one of them, besides '{ANY_NODE}:'"
        )
    if not for_any and not named:
        others = f", and it has {_listed(nodes)}" if nodes else ""
        raise ConfigError(
            f"{shown} is no parameter file: '{ANY_NODE}:' or '{NODE_NAME}:' with '{PARAMETERS}:' is needed"
            f"{others}"
        )
    merged: dict[str, Any] = {}
    for name in (*for_any, *named):
        parameters = nodes[name]
        if not isinstance(parameters, Mapping):
            raise ConfigError(f"{shown}: '{printable(name)}:' has no '{PARAMETERS}:' with parameters in it")
        _check_once(shown, parameters)
        merged = _merged(merged, parameters)
    return merged


def _nodes(document: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names of nodes with their parameters; as in ROS, namespaces may be levels of their own."""
    if not isinstance(document, Mapping):
        return
    for key, section in document.items():
        name = f"{above}/{str(key).lstrip('/')}" if above or str(key).startswith("/") else str(key)
        if isinstance(section, Mapping) and PARAMETERS not in section:
            below = list(_nodes(section, name))
            if below:
                yield from below
                continue
        if isinstance(section, Mapping) and PARAMETERS in section:
            yield name, section[PARAMETERS]
        elif not above:
            yield name, None


def _check_once(shown: str, parameters: Mapping[str, Any]) -> None:
    """Refuse a parameter that is written with dots and in levels at once: the last one would win."""
    seen: set[str] = set()
    for name in _dotted(parameters):
        if name in seen:
            raise ConfigError(
                f"{shown}: {shortened(name)} is there twice, with dots and in levels: give it once"
            )
        seen.add(name)


def _dotted(parameters: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{above}{name}.")
        else:
            yield f"{above}{name}"


def _listed(names: Iterable[str]) -> str:
    shown = [printable(name) for name in names]
    more = f" and {len(shown) - _MOST_SHOWN} more" if len(shown) > _MOST_SHOWN else ""
    return ", ".join(shown[:_MOST_SHOWN]) + more


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the values of ``over``, level by level."""
    merged = dict(base)
    for name, value in over.items():
        below = merged.get(str(name))
        nested = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[str(name)] = _merged(below, value) if nested else value  # type: ignore[arg-type]
    return merged
