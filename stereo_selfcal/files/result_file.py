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

"""The result file: a ROS 2 parameter file, which is written whole or not at all.

Its content is a :class:`.saved_result.SavedResult`.
"""

from __future__ import annotations

import math
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .. import __version__
from ..core.camera.rig import StereoRig
from ..core.config import flatten
from ..core.drive.targets import Targets
from ..core.errors import ConfigError, OutputError, printable
from ..core.reservations import reservations_to_mapping
from ..core.results import CalibrationResult
from .atomic_file import remove_leftovers, set_aside, write_atomically
from .field_checks import PROVENANCE
from .node_settings import ALIGNMENT_PREFIX, NODE_NAME, OLD_OUTPUT_PATH, RESULT_PREFIX
from .parameter_file import ANY_NODE, PARAMETERS, UnreadableFileError, node_parameters
from .saved_evidence import evidence_to_mapping, told_travel
from .saved_result import RESULT_NAMES, SCHEMA, SavedResult, check_images, same_images, source_topics

# A result file has 2 to 6 kB, most of it the terms of the uncertainty.
_MOST_BYTES = 65_536
# Of a text that says where images came from; no name of a file or topic is longer, and it keeps the
# file below _MOST_BYTES however it has to be escaped.
_LONGEST_SOURCE = 1000

# While the yaw is not known, x points along the heading of the camera. Once it is, x points along the
# direction of travel; where the frame has its origin, only the parameters of the node say.
_EQUATION_ON_ROAD = "p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]"
_EQUATION_IN_VEHICLE = "p_vehicle = R_z(yaw) R_y(pitch) R_x(roll) p_camera + [mount.x_m, mount.y_m, height]"
_UNITS = "REP-103: x forward, y left, z up; metres, radians"


class _Quoted(str):
    """Text that is quoted in YAML: rcl reads a bare 1e5 as a number, where YAML 1.1 sees a word."""

    __slots__ = ()


class _InOneLine(list):  # type: ignore[type-arg]
    """List that is written in one line."""

    __slots__ = ()


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    """Dumper of :class:`_Quoted` and :class:`_InOneLine`."""


_Dumper.add_representer(
    _Quoted, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", str(text), style='"')
)
_Dumper.add_representer(
    _InOneLine,
    lambda dumper, items: dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=True),
)


@dataclass(frozen=True, slots=True)
class Restored:
    """The result file at the start of the node.

    Attributes:
        saved: The calibration, None when there is none that can be used.
        problem: One sentence: why what is there cannot be used, and where it is now. Empty when all is
            well or no file is there.
        kept_aside: Where a file that cannot be used was moved to, None when none was moved.
        of_others: Whether the file is good, but of other images.
        path: The file that was read, None where there is none.
    """

    saved: SavedResult | None = None
    problem: str = ""
    kept_aside: Path | None = None
    of_others: bool = False
    path: Path | None = None


def result_parameters(result: CalibrationResult) -> dict[str, float]:
    """Return the parameters of an accepted result, ``extrinsics.height_m`` and so on, in their order.

    Raises:
        OutputError: The result is a rejection, or holds NaN or infinity.
    """
    extrinsics, std = result.extrinsics, result.std
    if extrinsics is None or std is None:
        raise OutputError(f"there is no calibration to publish or write: {result.message}")
    values = (*extrinsics.as_dict().values(), *std.as_dict().values())
    parameters = {RESULT_PREFIX + name: value for name, value in zip(RESULT_NAMES, values, strict=True)}
    for name, value in parameters.items():
        if not math.isfinite(value):
            raise OutputError(
                f"{name} is {value}: a result that is not finite is neither published nor written"
            )
    return parameters


def yaw_parameters(result: CalibrationResult) -> dict[str, float]:
    """Return the yaw against the direction of travel and its standard deviation, ``extrinsics.yaw_rad``.

    While the yaw is not known, there are none.
    """
    travel = told_travel(result)
    values = {} if travel is None else travel.yaw_dict()
    return {RESULT_PREFIX + name: value for name, value in values.items()}


def alignment_parameters(result: CalibrationResult) -> dict[str, float]:
    """Return the known angles of the right camera and their standard deviations, ``alignment.pitch_rad``."""
    if result.alignment is None:
        return {}
    values = result.alignment.as_dict() | result.alignment.std_dict()
    return {ALIGNMENT_PREFIX + name: value for name, value in values.items()}


def evidence_parameters(result: CalibrationResult) -> dict[str, Any]:
    """Return how a result was reached, by the names of a result file: ``provenance.mount.duration_s``."""
    sections = {"frames": int(result.n_frames), **evidence_to_mapping(result, None)}
    return flatten({PROVENANCE: sections})


def format_result(
    result: CalibrationResult, rig: StereoRig, source: str, seed: int, targets: Targets | None = None
) -> str:
    """Return the text of a result file: same input, same bytes.

    Args:
        result: An accepted result.
        rig: The rig it holds for.
        source: Where the images came from: a bag, topics.
        seed: Seed of the calibrator.
        targets: Standard deviations that were asked for: the file has them, and whether they are reached.

    Raises:
        OutputError: The result is a rejection, or holds what :func:`load_result` would refuse.
    """
    yaw = yaw_parameters(result)
    extrinsics = {
        name.removeprefix(RESULT_PREFIX): value for name, value in (result_parameters(result) | yaw).items()
    }
    assert result.covariance is not None  # it has standard deviations
    provenance = {
        "schema": SCHEMA,
        "stamp": float(result.stamp_s),
        # A file name may hold bytes that are no UTF-8; they must not keep the result from being saved.
        "source": _Quoted(source[:_LONGEST_SOURCE].encode("utf-8", "backslashreplace").decode("utf-8")),
        "frames": int(result.n_frames),
        "seed": int(seed),
        "version": _Quoted(__version__),
        "rig": rig.to_mapping(),
        "covariance": _InOneLine(float(value) for value in result.covariance.ravel()),
    }
    provenance |= _in_lines(evidence_to_mapping(result, targets))
    if result.reservations:
        provenance["reservations"] = reservations_to_mapping(result.reservations)
    parameters: dict[str, Any] = {"extrinsics": extrinsics}
    alignment = alignment_parameters(result)
    if result.alignment is not None and alignment:
        parameters["alignment"] = {
            name.removeprefix(ALIGNMENT_PREFIX): value for name, value in alignment.items()
        }
        if np.all(result.alignment.known()):
            variances = map(float, result.alignment.covariance.ravel())
            provenance["alignment_covariance"] = _InOneLine(variances)
        if result.alignment.unexplained_rad > 0.0:
            provenance["alignment_unexplained_rad"] = float(result.alignment.unexplained_rad)
    parameters["provenance"] = provenance
    try:
        SavedResult.from_parameters(parameters)
    except ConfigError as error:
        raise OutputError(f"a result that cannot be right is not written: {error}") from error
    document = {ANY_NODE: {PARAMETERS: parameters}}
    body: str = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=math.inf)
    # PyYAML writes letters as they are that turn the text around them about; all texts are quoted.
    escaped = (printable(letter) if letter > "\x7f" else letter for letter in body)
    equation = _EQUATION_IN_VEHICLE if yaw else _EQUATION_ON_ROAD
    return f"# {equation}   ({_UNITS})\n" + "".join(escaped)


def _in_lines(value: Any) -> Any:
    """Return sections in which every list is written in one line."""
    if isinstance(value, dict):
        return {name: _in_lines(each) for name, each in value.items()}
    return _InOneLine(value) if isinstance(value, list) else value


def write_result(
    path: Path | str,
    result: CalibrationResult,
    rig: StereoRig,
    *,
    source: str,
    seed: int,
    keep_others: bool = False,
    targets: Targets | None = None,
) -> Path | None:
    """Write an accepted result as a ROS 2 parameter file, whole or not at all.

    Args:
        path: The file; its folder must exist. A link is followed.
        result: An accepted result.
        rig: The rig it holds for.
        source: Where the images came from: a bag, topics.
        seed: Seed of the calibrator.
        keep_others: Whether a file that is there and is no result file, or that of other topics, is kept
            aside (:func:`.atomic_file.set_aside`) instead of being replaced.
        targets: Standard deviations that were asked for, None where none were.

    Returns:
        Where what was there is now, None where nothing was kept aside.

    Raises:
        OutputError: There is nothing to write, or the file cannot be written, or what is there cannot
            be kept aside; what was there before is untouched.
    """
    content = format_result(result, rig, source, seed, targets).encode("utf-8")
    aside = set_aside(path) if keep_others and _is_of_others(path, source) else None
    write_atomically(path, content)
    return aside


def _is_of_others(path: Path | str, source: str) -> bool:
    """Whether a file is there that is not to be replaced by a result from ``source``."""
    if _is_missing(path) or _is_no_file(path):
        return False
    try:
        topics = load_result(path).topics
    except ConfigError:
        return True
    ours = source_topics(source)
    return topics is not None and ours is not None and not same_images(topics, ours)


def load_result(path: Path | str) -> SavedResult:
    """Read a result file and check every value in it.

    Raises:
        UnreadableFileError: The file cannot be read.
        ConfigError: It is no result file that can be used: one sentence with the file, the field, its
            value and the remedy.
    """
    if _is_no_file(path):  # opening a pipe would wait for a writer
        raise UnreadableFileError(
            f"{path} cannot be read: it is not a file; give the name of a result file of {NODE_NAME}"
        )
    parameters = node_parameters(path, _MOST_BYTES)
    try:
        return SavedResult.from_parameters(parameters)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def restore(path: Path | str, topics: tuple[str, str] | None = None) -> Restored:
    """Find the calibration of the last run, for the start of a node.

    A file that is corrupt, of something else or of a newer version is renamed
    (:func:`.atomic_file.set_aside`) and so kept from being replaced. One that cannot be read or moved, or
    that is of other images, is left where it is. Leftovers of a killed writer are removed. Whether the
    calibration holds for the cameras is for :func:`.saved_result.check_fits`, once they are known.

    Args:
        path: The result file; there may be none.
        topics: Topics of the left and right images it has to be of, None for any.
    """
    remove_leftovers(path)
    if _is_missing(path):
        return Restored()
    file = Path(path)
    try:
        saved = load_result(path)
    except UnreadableFileError as error:
        return Restored(problem=f"{error}; it stays where it is", path=file)
    except ConfigError as error:
        problem = str(error)
    else:
        return _of_images(saved, file, topics)
    try:
        aside = set_aside(path)
    except OutputError as error:
        return Restored(problem=f"{problem}; it stays where it is: {error}", path=file)
    return Restored(problem=f"{problem}; kept aside as {printable(str(aside))}", kept_aside=aside, path=file)


def restore_old_default(topics: tuple[str, str]) -> Restored:
    """Find the calibration that an earlier version wrote to the file that was the default of all nodes.

    It may be of another node: it is only read, and only taken if it says that it is of these images.

    Args:
        topics: Topics of the left and right images it has to be of.
    """
    try:
        path = Path(OLD_OUTPUT_PATH).expanduser()
    except RuntimeError:  # no home folder, so nobody wrote there
        return Restored()
    if _is_missing(path):
        return Restored()
    try:
        saved = load_result(path)
    except ConfigError:  # told by the node whose file it is now
        return Restored()
    if saved.topics is None:
        problem = (
            f"{path} is not used: it does not say of which images its calibration is; calibrate anew, or set "
            "output_path to it"
        )
        return Restored(problem=problem, of_others=True, path=path)
    return _of_images(saved, path, topics)


def _of_images(saved: SavedResult, path: Path, topics: tuple[str, str] | None) -> Restored:
    try:
        if topics is not None:
            check_images(saved, topics)
    except ConfigError as error:
        return Restored(problem=f"{path} is not used: {error}", of_others=True, path=path)
    return Restored(saved, path=path)


def _is_missing(path: Path | str) -> bool:
    try:
        Path(path).stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except (OSError, ValueError):  # told when it is read
        return False
    return False


def _is_no_file(path: Path | str) -> bool:
    """Whether it is a folder, a pipe, a device."""
    try:
        return not stat.S_ISREG(Path(path).stat().st_mode)
    except (OSError, ValueError):  # told when it is read
        return False
