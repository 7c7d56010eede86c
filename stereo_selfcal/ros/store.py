"""Saves the active calibration to the result file, and restores it in the next run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ..core.errors import OutputError
from ..files.exports import write_exports
from ..files.node_settings import NODE_SETTINGS
from ..files.result_file import write_result
from ..files.saved_result import SavedResult
from .calibration_keeper import ActiveCalibration
from .config import NodeConfig

# A greater age means that the stamp is of another clock (a simulation, a recording): the age is unknown then.
_LONGEST_AGE_S = 50 * 365.25 * 86400.0


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
    return ActiveCalibration(saved.as_result(), saved.rig, time.monotonic() - age_s, f"restored from {path}")


def save(active: ActiveCalibration, config: NodeConfig, source: str) -> tuple[str, bool]:
    """Save a calibration, and export it to the formats of ``exports``.

    Args:
        active: The calibration.
        config: Parameters of the node.
        source: Where the images came from.

    Returns:
        Where it was saved or why not, in words; and whether saving or exporting failed.
    """
    path = config.output_path
    if path is None:
        return "not saved, as output_path is empty", False

    def write() -> None:
        if path == _default_output_path():
            _make_folder(path.parent)
        write_result(
            path, active.result, active.rig, source=source, seed=config.calibrator.seed, keep_others=True
        )

    problem = _tried(write)
    if problem:
        return f"in effect, but not saved: {problem}", True
    if not config.exports:
        return f"saved to {path}", False
    extrinsics = active.result.extrinsics
    assert extrinsics is not None  # it was written
    frames = config.road_frame, config.camera_frame
    problem = _tried(lambda: write_exports(path, config.exports, extrinsics, active.rig, *frames))
    if problem:
        return f"saved to {path}, but not exported: {problem}", True
    return f"saved to {path} and exported as {', '.join(config.exports)}", False


def _tried(write: Callable[[], object]) -> str:
    try:
        write()
    except OutputError as error:
        return str(error)
    return ""


def _make_folder(folder: Path) -> None:
    """Make the folder of ROS if ROS has not made it yet. Other folders are up to the user."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made: {error.strerror}; set output_path") from error


def _default_output_path() -> Path:
    default = next(setting.default for setting in NODE_SETTINGS if setting.name == "output_path")
    return Path(str(default)).expanduser()
