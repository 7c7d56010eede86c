"""ROS 2 parameter files and the settings in them. Reading one needs no ROS, and trusts nothing in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..core.config import CalibratorConfig, flatten
from ..core.errors import ConfigError
from .node_settings import NODE_NAME, NODE_SETTINGS, is_calibrator_setting

ANY_NODE = "/**"
PARAMETERS = "ros__parameters"
_WILDCARDS = (ANY_NODE, "*", "**", "/*")
# A file may hold the parameters of a whole vehicle; those of Nav2, a big one, are 20 kB. PyYAML was
# measured to read 1 MB in 1.2 s.
_MOST_BYTES = 1_000_000
_GREATEST_INTEGER = 2**63  # an integer parameter has 64 bits


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Loader that refuses what rcl does not know either.

    A few lines of aliases can stand for gigabytes, and Python refuses to print an integer of 5 000 digits.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, "aliases (*name) are not allowed", mark)
        return super().compose_node(parent, index)

    def construct_yaml_int(self, node: Any) -> int:
        value = int(super().construct_yaml_int(node))
        if not -_GREATEST_INTEGER <= value < _GREATEST_INTEGER:
            problem = "a whole number has more than 64 bits"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


class UnreadableFileError(ConfigError):
    """A file cannot be read at all, so nothing is known of what is in it."""


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
        raise ConfigError(f"{path}: {error}") from error


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


def load_frames(path: Path | str | None) -> tuple[str, str]:
    """Return the names of the road and the camera frame: those of a parameter file, or the node's defaults.

    Raises:
        ConfigError: The file cannot be read, is no parameter file, or a name is no text.
    """
    names = ("road_frame", "camera_frame")
    values = {setting.name: setting.default for setting in NODE_SETTINGS if setting.name in names}
    given = {} if path is None else node_parameters(path)
    road, camera = (given.get(name, values[name]) for name in names)
    for name, value in zip(names, (road, camera), strict=True):
        if not isinstance(value, str) or not value.strip():
            raise ConfigError(f"{path}: {name} is {value!r}: the name of a frame is needed")
    return str(road), str(camera)


def node_parameters(path: Path | str, most_bytes: int = _MOST_BYTES) -> dict[str, Any]:
    """Return the parameters a file has for this node, nested as they are written.

    Args:
        path: The file.
        most_bytes: A larger file is refused unread.

    Raises:
        UnreadableFileError: The file cannot be read.
        ConfigError: It is no parameter file.
    """
    document = _parsed(path, _text(path, most_bytes))
    nodes = {str(name): value for name, value in document.items()} if isinstance(document, Mapping) else {}
    ours = [name for name in nodes if name in _WILDCARDS]
    ours += [name for name in nodes if name.rpartition("/")[2] == NODE_NAME]
    if not ours:
        raise ConfigError(
            f"{path} is no parameter file: '{ANY_NODE}:' or '{NODE_NAME}:' with '{PARAMETERS}:' is needed"
        )
    merged: dict[str, Any] = {}
    for name in ours:
        section = nodes[name]
        parameters = section.get(PARAMETERS) if isinstance(section, Mapping) else None
        if not isinstance(parameters, Mapping):
            raise ConfigError(f"{path}: '{name}:' has no '{PARAMETERS}:' with parameters in it")
        merged = _merged(merged, parameters)
    return merged


def _text(path: Path | str, most_bytes: int) -> str:
    try:
        with Path(path).open("rb") as file:
            content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        detail = getattr(error, "strerror", None) or str(error)
        raise UnreadableFileError(f"{path} cannot be read: {detail.lower()}") from error
    if not content:
        raise ConfigError(f"{path} is empty: '{ANY_NODE}:' with '{PARAMETERS}:' is needed")
    if len(content) > most_bytes:
        raise ConfigError(
            f"{path} is no parameter file: it is larger than {most_bytes} bytes, which is the most allowed"
        )
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} cannot be read: it is not a text file") from error


def _parsed(path: Path | str, text: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        detail = getattr(error, "problem", None) or " ".join(str(error).split())
        raise ConfigError(f"{path} is not YAML{where}: {detail}") from error
    except Exception as error:
        detail = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigError(f"{path} is not YAML that can be read: {detail}") from error


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the values of ``over``, level by level."""
    merged = dict(base)
    for name, value in over.items():
        below = merged.get(str(name))
        nested = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[str(name)] = _merged(below, value) if nested else value  # type: ignore[arg-type]
    return merged
