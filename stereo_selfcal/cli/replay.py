"""``replay``: calibrate from a recording, through the same calibrator as the node and without a ROS graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Protocol

import cv2
import yaml

from ..atomic_file import write_atomically
from ..bags import StereoBag, StereoFrame
from ..core.calibrator import Calibrator
from ..core.config import CalibratorConfig
from ..core.errors import ConfigError, RigError
from ..core.images import Image
from ..core.results import CalibrationResult
from ..core.rig import StereoRig
from ..exports import EXPORTS, export_paths, parse_exports, write_exports
from ..parameter_file import load_calibrator_config, load_frames
from ..picture import draw_overview
from ..result_file import write_result
from .console import (
    EXIT_NOT_ACCEPTED,
    EXIT_OK,
    Parser,
    Progress,
    UsageError,
    check_writable,
    run,
)
from .report import FrameRow, as_json, table_header, table_row, table_summary

_DESCRIPTION = """\
Find height, pitch and roll of a stereo camera from a recording of a straight road.

BAG is a rosbag2 folder (mcap or sqlite3), a single .mcap or .db3 file, or a ROS 1 .bag, with
rectified images of both cameras. Every frame is calibrated; the accepted ones are fused.
"""
_EPILOG = """\
exit status: 0 calibrated; 1 no frame was accepted; 2 bad usage or unreadable input.
p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height], REP-103: pitch > 0 is nose down,
roll > 0 is right side down.
"""


class FrameCalibrator(Protocol):
    """What replay needs of a :class:`~stereo_selfcal.core.calibrator.Calibrator`."""

    def add(self, left: Image, right: Image, stamp_s: float = 0.0) -> CalibrationResult:
        """Calibrate one frame and remember it when it is accepted."""

    @property
    def estimate(self) -> CalibrationResult:
        """The accepted frames so far, fused."""


@dataclass(frozen=True, slots=True)
class Replay:
    """Outcome of a recording.

    Attributes:
        rows: One row per frame.
        estimate: The accepted frames, fused.
        frame: The frame for the picture: the last accepted one, or the last one when none was.
        result: The result of that frame.
    """

    rows: list[FrameRow]
    estimate: CalibrationResult
    frame: StereoFrame
    result: CalibrationResult


def run_replay(
    frames: Iterable[StereoFrame],
    calibrator: FrameCalibrator,
    on_row: Callable[[FrameRow], None] = lambda row: None,
) -> Replay:
    """Put every frame through the calibrator; at most two frames are in memory at a time.

    Args:
        frames: Stereo frames, at least one, read as they are needed.
        calibrator: Calibrator of the rig.
        on_row: Called after every frame.
    """
    rows: list[FrameRow] = []
    shown: tuple[StereoFrame, CalibrationResult] | None = None
    for frame in frames:
        result = calibrator.add(frame.left, frame.right, frame.stamp_s)
        rows.append(FrameRow.from_result(result, frame.stamp_s))
        if result.accepted or shown is None or not shown[1].accepted:
            shown = frame, result
        on_row(rows[-1])
    if shown is None:
        raise ValueError("a recording of no frames cannot be replayed")
    return Replay(rows, calibrator.estimate, *shown)


def read_rig_file(path: Path) -> StereoRig:
    """Read a rig file, YAML or JSON: ``width, height, fx, fy, cx, cy, baseline_m``.

    Raises:
        UsageError: It cannot be read, or does not describe a rig.
    """
    try:
        text = path.read_text(encoding="utf-8")
        # PyYAML reads most of JSON, but takes the 1e3 of JSON for a word.
        values = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        detail = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"--rig {path}: cannot be read ({detail})") from error
    if not isinstance(values, Mapping):
        raise UsageError(f"--rig {path}: holds no keys; it needs {', '.join(StereoRig.__slots__)}")
    try:
        return StereoRig.from_mapping(values)
    except RigError as error:
        raise UsageError(f"--rig {path}: {error}") from error


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status of interface.md, "Command line"."""
    return run("replay", _replay, argv)


def _replay(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    _check_outputs(arguments.output, arguments.picture, arguments.exports)
    frames = load_frames(arguments.config)
    rig = None if arguments.rig is None else read_rig_file(arguments.rig)
    config = _config(arguments.config, arguments.seed)
    with StereoBag(arguments.bag, arguments.left, arguments.right, arguments.tolerance_s) as bag:
        rig = bag.read_rig() if rig is None else rig
        replay = _run_with_output(bag, Calibrator(rig, config), arguments)
    estimate = replay.estimate
    # Files first: a reader of stdout that goes away must not cost the result.
    if arguments.output is not None and estimate.accepted:
        source = arguments.bag.resolve().name  # the folders above it are nobody's business
        write_result(arguments.output, estimate, rig, source=source, seed=config.seed)
        assert estimate.extrinsics is not None
        write_exports(arguments.output, arguments.exports, estimate.extrinsics, rig, *frames)
    if arguments.picture is not None:
        _write_picture(arguments.picture, replay, rig)
    report = as_json if arguments.json else table_summary
    sys.stdout.write(report(replay.rows, estimate))
    return EXIT_OK if estimate.accepted else EXIT_NOT_ACCEPTED


def _check_outputs(output: Path | None, picture: Path | None, exports: tuple[str, ...]) -> None:
    """Refuse files that cannot be written, before any work is done for them."""
    if output is not None:
        check_writable(output, "--output")
        for path in export_paths(output, exports):
            check_writable(path, "--export")
    elif exports:
        raise UsageError("--export writes beside the file of --output: give --output")
    if picture is not None:
        check_writable(picture, "--picture")
        if picture.suffix.lower() != ".png":
            raise UsageError(f"--picture {picture}: pictures are written as PNG; end the name in .png")
        if output is not None and os.path.realpath(output) == os.path.realpath(picture):
            raise UsageError(f"--output and --picture are both {output}: give two files")


def _config(path: Path | None, seed: int | None) -> CalibratorConfig:
    """Return the settings of the file, or the defaults, with the seed of the command line."""
    config = CalibratorConfig() if path is None else load_calibrator_config(path)
    if seed is None:
        return config
    settings = {name: value for name, value, _ in config.settings()}
    return CalibratorConfig.from_mapping(settings | {"seed": seed})


def _run_with_output(bag: StereoBag, calibrator: Calibrator, arguments: argparse.Namespace) -> Replay:
    """Replay with a progress bar, and with the table unless JSON is wanted."""
    total = bag.n_frames if arguments.max_frames is None else min(bag.n_frames, arguments.max_frames)
    progress = Progress(total)
    done = 0

    def on_row(row: FrameRow) -> None:
        nonlocal done
        done += 1
        progress.clear()
        if not arguments.json:
            sys.stdout.write(table_row(row))
            sys.stdout.flush()
        progress.show(done)

    if not arguments.json:
        for side, topic in (("left", bag.topics.left), ("right", bag.topics.right)):
            sys.stdout.write(f"{side:<5} {topic.name} ({topic.count} images)\n")
        sys.stdout.write(table_header())
    progress.show(0)
    try:
        return run_replay(islice(bag.frames(), arguments.max_frames), calibrator, on_row)
    finally:
        progress.clear()


def _write_picture(path: Path, replay: Replay, rig: StereoRig) -> None:
    """Draw the fused estimate over the frame that shows it, or the refusal of that frame."""
    shown = replay.result
    if replay.estimate.accepted:
        shown = replace(replay.estimate, pattern=replay.result.pattern)
    picture = draw_overview(replay.frame.left, replay.frame.right, rig, shown)
    _, content = cv2.imencode(".png", picture)
    write_atomically(path, content.tobytes())


def _positive_int(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is less than 1")
    return value


def _tolerance_s(text: str) -> float:
    value = float(text)
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a time of 0 s or more")
    return value


def _exports(text: str) -> tuple[str, ...]:
    try:
        return parse_exports(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _parser() -> Parser:
    parser = Parser(
        prog="replay",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("bag", metavar="BAG", type=Path, help="the recording")
    add("--left", metavar="TOPIC", help="image topic of the left camera (default: found by type and name)")
    add("--right", metavar="TOPIC", help="image topic of the right camera")
    add("--rig", metavar="FILE", type=Path, help="rig file (YAML or JSON) instead of the CameraInfo topics")
    add("--config", metavar="FILE", type=Path, help="settings of the calibrator (YAML)")
    add("--seed", metavar="N", type=int, help="seed of the random numbers (default: that of the settings)")
    add("--output", metavar="FILE", type=Path, help="write the result as a ROS 2 parameter file (YAML)")
    add(
        "--export",
        dest="exports",
        metavar="NAME[,NAME]",
        type=_exports,
        default=(),
        help=f"write these formats beside FILE of --output: {', '.join(EXPORTS)}",
    )
    add(
        "--picture",
        metavar="FILE",
        type=Path,
        help="write an overlay of the result on the last good frame (PNG)",
    )
    add("--json", action="store_true", help="print one JSON object (SI units, radians) instead of the table")
    add(
        "--approximate-sync-tolerance",
        dest="tolerance_s",
        metavar="S",
        type=_tolerance_s,
        default=0.0,
        help="pair images whose stamps differ by at most S seconds (default: equal stamps)",
    )
    add("--max-frames", metavar="N", type=_positive_int, help="stop after N frames")
    return parser
