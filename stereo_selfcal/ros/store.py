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

"""Saves the active calibration to the result file, restores it in the next run, and keeps it aside."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from ..core.drive.targets import Targets
from ..core.errors import OutputError, printable
from ..files.atomic_file import cannot_be_written, set_aside
from ..files.exports import CAMERA_INFO, write_exports
from ..files.frames import PlacedCamera
from ..files.node_settings import ros_home
from ..files.result_file import restore, restore_old_default, write_result
from ..files.saved_result import SavedResult
from ..files.writable import check_writable
from .calibration_keeper import ActiveCalibration
from .config import NodeConfig

# A greater age means that the stamp is of another clock (a simulation, a recording): the age is unknown then.
_LONGEST_AGE_S = 50 * 365.25 * 86400.0
# What writing a file may raise: whatever the system says of it, the calibration stays in effect.
_FAILURES = (OutputError, OSError, ValueError)


def restored_calibration(saved: SavedResult, path: Path, now_s: float) -> ActiveCalibration:
    """Return a calibration of an earlier run as an active one.

    Args:
        saved: The calibration.
        path: Where it comes from.
        now_s: Time of the clock that stamps images [s].
    """
    age_s = now_s - saved.stamp_s
    if not 0.0 <= age_s <= _LONGEST_AGE_S:
        age_s = 0.0
    return ActiveCalibration(
        saved.as_result(), saved.rig, time.monotonic() - age_s, f"restored from {printable(str(path))}"
    )


def save(
    active: ActiveCalibration,
    config: NodeConfig,
    source: str,
    placed: PlacedCamera | None,
    targets: Targets | None = None,
) -> tuple[str, bool]:
    """Save a calibration, and export it to the formats of ``exports``.

    Args:
        active: The calibration.
        config: Parameters of the node.
        source: Where the images came from.
        placed: The camera in the vehicle; None where CameraInfo has not told which frame is meant.
        targets: Standard deviations that were asked for, None where none were.

    Returns:
        Where it was saved or why not, in words; and whether saving or exporting failed.
    """
    path = config.output_path
    if path is None:
        return "not saved, as output_path is empty", False
    try:
        _make_folder(path.parent)
        aside = write_result(
            path,
            active.result,
            active.rig,
            source=source,
            seed=config.calibrator.seed,
            keep_others=True,
            targets=targets,
        )
    except _FAILURES as error:
        return f"in effect, but not saved: {_reason(error, path)}", True
    kept = f"; what was there, not of these images, is kept as {printable(str(aside))}" if aside else ""
    shown = printable(str(path))
    if not config.exports:
        return f"saved to {shown}{kept}", False
    try:
        if placed is None:
            raise OutputError("no CameraInfo has told which frame camera_frame is: call ~/calibrate again")
        pairs = active.repaired_pairs if CAMERA_INFO in config.exports else ()
        write_exports(path, config.exports, placed, active.rig, pairs, config.frame_names.pair_name)
    except _FAILURES as error:
        return f"saved to {shown}, but not exported: {_reason(error, path)}{kept}", True
    return f"saved to {shown} and exported as {', '.join(config.exports)}{kept}", False


def keep_aside(paths: Iterable[Path], topics: tuple[str, str], *, old_default: bool) -> tuple[str, bool]:
    """Keep result files aside that the next start would restore.

    Files of other images stay, as they are not restored, and so do exports.

    Args:
        paths: Where they may be.
        topics: Topics of the left and right images of the node.
        old_default: Whether the next start may take the file that earlier versions wrote for all nodes.

    Returns:
        Where they are now or why not, in words, "" where there was none; and whether that failed.
    """
    found = [restore(path, topics) for path in dict.fromkeys(paths)]
    if old_default:
        found.append(restore_old_default(topics))
    told, failed = [], False
    for each in found:
        if each.saved is None or each.path is None:
            continue
        try:
            told.append(f"its file is kept as {printable(str(set_aside(each.path)))}")
        except OutputError as error:
            told.append(f"the next start will restore it: {error}")
            failed = True
    return "; ".join(told), failed


def check_output(path: Path) -> None:
    """Make sure that a result can be written, before there is one.

    Raises:
        OutputError: It cannot: one sentence with the path, the cause and the remedy.
    """
    check_writable(path, _ros_home())


def _make_folder(folder: Path) -> None:
    """Make a folder in that of ROS. Other folders are up to the user."""
    home = _ros_home()
    if home is None or not folder.is_relative_to(home):
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{printable(str(folder))} cannot be made: {error.strerror}; set output_path"
        ) from error


def _ros_home() -> Path | None:
    """Return the folder of ROS; None where there is no home folder to have it in."""
    try:
        return Path(ros_home()).expanduser().absolute()
    except RuntimeError:
        return None


def _reason(error: Exception, path: Path) -> str:
    """Return the sentence of an error; those of the system do not say what could not be done."""
    return str(error if isinstance(error, OutputError) else cannot_be_written(path, error))
