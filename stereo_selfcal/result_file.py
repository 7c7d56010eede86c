"""Files: the result as a ROS 2 parameter file, and the calibrator's settings from one. No ROS needed."""

from __future__ import annotations

import math
import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from . import __version__
from .core.config import CalibratorConfig, flatten
from .core.errors import ConfigError, OutputError
from .core.extrinsics import Extrinsics
from .core.results import CalibrationResult
from .core.rig import StereoRig
from .node_settings import RESULT_PREFIX, is_calibrator_setting

SCHEMA = 1
NODE_NAME = "stereo_selfcal"
RESULT_NAMES = ("height_m", "pitch_rad", "roll_rad", "height_std_m", "pitch_std_rad", "roll_std_rad")

_EQUATION = (
    "# p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]"
    "   (REP-103: x forward, y left, z up; metres, radians)\n"
)
_ANY_NODE = "/**"
_WILDCARDS = (_ANY_NODE, "*", "**", "/*")
_PARAMETERS = "ros__parameters"


class _Quoted(str):
    """Text that is quoted in YAML: rcl reads a bare 1e5 as a number, where YAML 1.1 sees a word."""

    __slots__ = ()


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    """Dumper that quotes :class:`_Quoted`."""


_Dumper.add_representer(
    _Quoted, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", str(text), style='"')
)


@dataclass(frozen=True, slots=True)
class SavedResult:
    """What a result file holds.

    Attributes:
        extrinsics: The calibration.
        std: Standard deviations of the same quantities.
        rig: The rig it holds for.
        provenance: stamp [s], source, frames, seed, version, schema.
    """

    extrinsics: Extrinsics
    std: Extrinsics
    rig: StereoRig
    provenance: dict[str, Any]


def result_parameters(result: CalibrationResult) -> dict[str, float]:
    """Return the parameters of an accepted result, ``extrinsics.height_m`` and so on, in their order.

    Raises:
        OutputError: The result is a rejection, or holds NaN or infinity.
    """
    extrinsics, std = result.extrinsics, result.std
    if extrinsics is None or std is None:
        raise OutputError(f"there is no calibration to publish or write: {result.message}")
    values = (
        extrinsics.height_m, extrinsics.pitch_rad, extrinsics.roll_rad,
        std.height_m, std.pitch_rad, std.roll_rad,
    )  # fmt: skip
    parameters = {
        RESULT_PREFIX + name: float(value) for name, value in zip(RESULT_NAMES, values, strict=True)
    }
    for name, value in parameters.items():
        if not math.isfinite(value):
            raise OutputError(
                f"{name} is {value}: a result that is not finite is neither published nor written"
            )
    return parameters


def format_result(result: CalibrationResult, rig: StereoRig, source: str, seed: int) -> str:
    """Return the text of a result file: same input, same bytes.

    Args:
        result: An accepted result.
        rig: The rig it holds for.
        source: Where the images came from: a bag, topics.
        seed: Seed of the calibrator.

    Raises:
        OutputError: The result is a rejection, or holds NaN or infinity.
    """
    extrinsics = {
        name.removeprefix(RESULT_PREFIX): value for name, value in result_parameters(result).items()
    }
    provenance = {
        "schema": SCHEMA,
        "stamp": float(result.stamp_s),
        # A file name may hold bytes that are no UTF-8; they must not keep the result from being saved.
        "source": _Quoted(source.encode("utf-8", "backslashreplace").decode("utf-8")),
        "frames": int(result.n_frames),
        "seed": int(seed),
        "version": _Quoted(__version__),
        "rig": rig.to_mapping(),
    }
    document = {_ANY_NODE: {_PARAMETERS: {"extrinsics": extrinsics, "provenance": provenance}}}
    body: str = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=math.inf)
    return _EQUATION + body


def write_result(
    path: Path | str, result: CalibrationResult, rig: StereoRig, *, source: str, seed: int
) -> None:
    """Write an accepted result as a ROS 2 parameter file, whole or not at all.

    Args:
        path: The file; its folder must exist. A link is followed.
        result: An accepted result.
        rig: The rig it holds for.
        source: Where the images came from: a bag, topics.
        seed: Seed of the calibrator.

    Raises:
        OutputError: There is nothing to write, or the file cannot be written; what was there before
            is untouched.
    """
    write_atomically(path, format_result(result, rig, source, seed).encode("utf-8"))


def write_atomically(path: Path | str, content: bytes) -> None:
    """Replace a file in one step: whoever reads it, at whatever moment, finds the old or the new one.

    Raises:
        OutputError: It cannot be written; the old file is untouched and nothing is left beside it.
    """
    try:
        target = Path(os.path.realpath(path))
        # A rename would put a file in the place of a device such as /dev/null.
        if os.path.lexists(target) and not target.is_file():
            raise OutputError(f"{path} cannot be written: it is not a file; give the name of a file")
        _replace(target, content)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        detail = (getattr(error, "strerror", None) or str(error)).lower()
        raise OutputError(
            f"{path} cannot be written: {detail}; choose a writable folder that exists"
        ) from error


def _replace(target: Path, content: bytes) -> None:
    # In the same folder, as a rename is atomic only within one file system.
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    """Make the rename itself survive a power cut, where the file system and its rights allow."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def load_result(path: Path | str) -> SavedResult:
    """Read a result file and check every value in it.

    Raises:
        ConfigError: The file cannot be read, or is no result file of this schema.
        RigError: The rig in it cannot be right.
    """
    parameters = _node_parameters(path)
    try:
        extrinsics, provenance = dict(parameters["extrinsics"]), dict(parameters["provenance"])
        rig = dict(provenance.pop("rig"))
        values = [float(extrinsics[name]) for name in RESULT_NAMES]
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} is no result file of stereo_selfcal: {error!r}") from error
    if provenance.get("schema") != SCHEMA:
        raise ConfigError(
            f"{path} has schema {provenance.get('schema')!r}, this version reads {SCHEMA}: calibrate anew"
        )
    if not all(math.isfinite(value) for value in values) or min(values[0], *values[3:]) < 0:
        raise ConfigError(f"{path} holds impossible values {values}: calibrate anew")
    return SavedResult(
        Extrinsics(*values[:3]), Extrinsics(*values[3:]), StereoRig.from_mapping(rig), provenance
    )


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
        name: value for name, value in flatten(_node_parameters(path)).items() if is_calibrator_setting(name)
    }
    try:
        return CalibratorConfig.from_mapping(settings)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _node_parameters(path: Path | str) -> dict[str, Any]:
    """Return the parameters a file has for this node."""
    try:
        document = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: not UTF-8
        detail = getattr(error, "strerror", None) or "it is not a text file"
        raise ConfigError(f"{path} cannot be read: {detail.lower()}") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise ConfigError(f"{path} is not YAML{where}: {getattr(error, 'problem', None) or error}") from error
    nodes = {str(name): value for name, value in document.items()} if isinstance(document, Mapping) else {}
    ours = [name for name in nodes if name in _WILDCARDS]
    ours += [name for name in nodes if name.rpartition("/")[2] == NODE_NAME]
    if not ours:
        raise ConfigError(
            f"{path} is no parameter file: '{_ANY_NODE}:' or '{NODE_NAME}:' with '{_PARAMETERS}:' is needed"
        )
    merged: dict[str, Any] = {}
    for name in ours:
        section = nodes[name]
        parameters = section.get(_PARAMETERS) if isinstance(section, Mapping) else None
        if not isinstance(parameters, Mapping):
            raise ConfigError(f"{path}: '{name}:' has no '{_PARAMETERS}:' with parameters in it")
        merged = _merged(merged, parameters)
    return merged


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the values of ``over``, level by level."""
    merged = dict(base)
    for name, value in over.items():
        below = merged.get(str(name))
        nested = isinstance(value, Mapping) and isinstance(below, Mapping)
        merged[str(name)] = _merged(below, value) if nested else value  # type: ignore[arg-type]
    return merged
