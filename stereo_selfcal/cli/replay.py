"""``replay``: calibrate from a recording, through the same calibrator as the node and without a ROS graph."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2

from ..atomic_file import write_atomically
from ..core.config import CalibratorConfig
from ..core.errors import ConfigError
from ..exports import EXPORTS, export_paths, parse_exports, write_exports
from ..offline import BagSource, FrameRow, FrameSource, Replay, Selection, calibrate_recording, look_again
from ..parameter_file import load_calibrator_config, load_frames
from ..picture import draw_overview
from ..result_file import write_result
from ..rig_file import read_rig_file
from .console import (
    EXIT_NOT_ACCEPTED,
    EXIT_OK,
    Parser,
    Progress,
    UsageError,
    check_writable,
    run,
)
from .report import as_json, table_header, table_row, table_summary

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


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status of interface.md, "Command line"."""
    return run("replay", _replay, argv)


def _replay(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    _check_outputs(arguments.output, arguments.picture, arguments.exports)
    frames = load_frames(arguments.config)
    rig = None if arguments.rig is None else read_rig_file(arguments.rig)
    config = _config(arguments.config, arguments.seed)
    selection = Selection(max_frames=arguments.max_frames)
    with BagSource(
        [arguments.bag], arguments.left, arguments.right, arguments.tolerance_s, rig, selection
    ) as source:
        replay = _run_with_output(source, config, as_json=arguments.json)
        _write_files(source, replay, arguments, frames)
    report = as_json if arguments.json else table_summary
    sys.stdout.write(report(replay.rows, replay.estimate))
    return EXIT_OK if replay.estimate.accepted else EXIT_NOT_ACCEPTED


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


def _run_with_output(source: FrameSource, config: CalibratorConfig, *, as_json: bool) -> Replay:
    """Replay with a progress bar, and with the table unless JSON is wanted."""
    progress = Progress(source.count)
    done = 0

    def on_row(row: FrameRow) -> None:
        nonlocal done
        done += 1
        progress.clear()
        if not as_json:
            sys.stdout.write(table_row(row))
            sys.stdout.flush()
        progress.show(done)

    if not as_json:
        names, counts = (source.left_name, source.right_name), source.n_images
        for side, name, count in zip(("left", "right"), names, counts, strict=True):
            sys.stdout.write(f"{side:<5} {name} ({count} images)\n")
        sys.stdout.write(table_header())
    progress.show(0)
    try:
        return calibrate_recording(source, config, on_row)
    finally:
        progress.clear()


def _write_files(
    source: FrameSource, replay: Replay, arguments: argparse.Namespace, frames: tuple[str, str]
) -> None:
    """Write what the options ask for, before anything is said: a reader of stdout may go away."""
    estimate, rig = replay.estimate, replay.rig
    if arguments.output is not None and estimate.accepted:
        # The folders above the recording are nobody's business.
        write_result(arguments.output, estimate, rig, source=source.name, seed=replay.config.seed)
        assert estimate.extrinsics is not None
        write_exports(arguments.output, arguments.exports, estimate.extrinsics, rig, *frames)
    if arguments.picture is not None:
        _write_picture(arguments.picture, source, replay)


def _write_picture(path: Path, source: FrameSource, replay: Replay) -> None:
    """Draw the fused estimate over the frame that shows it, or the refusal of that frame."""
    frame, shown = look_again(source, replay.shown, replay.config)
    if replay.estimate.accepted:
        shown = replace(replay.estimate, pattern=shown.pattern)
    picture = draw_overview(frame.left, frame.right, replay.rig, shown)
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
