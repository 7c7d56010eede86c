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

"""``replay``: calibrate from a recording, through the same calibrator as the node and without a ROS graph."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2

from ..bags import StereoTopics, stereo_pairs
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.drive.targets import Targets
from ..core.errors import ConfigError, SelfcalError, one_line, printable
from ..core.geometry.camera_info_repair import RepairedPair, repaired_pairs
from ..files.atomic_file import write_atomically
from ..files.exports import CAMERA_INFO, export_paths, write_exports
from ..files.frames import FrameNames, InfoFrames, PlacedCamera, place_camera
from ..files.node_settings import TARGET_NAMES
from ..files.parameter_file import chosen_config, load_frames, load_targets
from ..files.result_file import write_result
from ..files.rig_file import read_rig_file
from ..offline import (
    FrameRow,
    FrameSource,
    Replay,
    Selection,
    as_csv,
    calibrate_recording,
    look_again,
    open_source,
)
from ..pictures.overview import draw_overview
from ..recording import SUFFIX
from .console import (
    EXIT_BAD_INPUT,
    EXIT_NOT_ACCEPTED,
    EXIT_OK,
    Progress,
    UsageError,
    run,
)
from .outputs import File, check_outputs, recording_files
from .replay_options import replay_parser
from .report import as_dict, as_json, table_header, table_row, table_summary

# What the name of a topic may hold in a recording, and that of a file should not.
_NO_FILE_NAME = re.compile(r"[^\w.-]", re.ASCII)
_LONGEST_NAME = 100  # of the 255 bytes that file systems allow, with the name and the ending of the output

# Outputs of which --all writes one for every pair.
_FILES = ("output", "picture", "csv", "report", "mcap")


@dataclass(frozen=True, slots=True)
class _Settings:
    """The checked values of the options."""

    config: CalibratorConfig
    rig: StereoRig | None
    frames: FrameNames
    selection: Selection
    targets: Targets | None


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status that its help explains."""
    return run("replay", _replay, argv)


def _replay(argv: list[str]) -> int:
    arguments = replay_parser().parse_args(argv)
    of_one_pair = (
        arguments.left,
        arguments.right,
        arguments.left_info,
        arguments.right_info,
        arguments.camera_info,
    )
    if arguments.all_pairs and any(topic is not None for topic in of_one_pair):
        raise UsageError(
            "--all takes every pair: it does not go with --left, --right, --left-info, --right-info and "
            "--camera-info"
        )
    _check_outputs(arguments)
    settings = _Settings(
        frames=load_frames(arguments.config),
        rig=None if arguments.rig is None else read_rig_file(arguments.rig),
        config=chosen_config(arguments.config, arguments.seed),
        selection=Selection(arguments.start, arguments.end, arguments.every, arguments.max_frames),
        targets=_targets(arguments),
    )
    if arguments.all_pairs:
        return _replay_all(arguments, settings)
    replay, unwritten = _replay_one(arguments, settings)
    sys.stdout.write(as_json(replay) if arguments.json else _summary(replay, arguments))
    return _status(replay, unwritten)


def _targets(arguments: argparse.Namespace) -> Targets | None:
    """Return what is asked of the recording; None where all of it is read.

    Raises:
        UsageError: A target is given that is of no use, or is none.
        ConfigError: The settings of the file are wrong.
    """
    names = (*TARGET_NAMES, "min_frames")
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    options = [f"--{name.replace('_', '-')}" for name in given]
    if not arguments.until_good:
        if options:
            raise UsageError(f"{' and '.join(options)}: of --until-good only; give it as well")
        return None
    settings = {"frames" if name == "min_frames" else name: value for name, value in given.items()}
    try:
        return load_targets(arguments.config, settings)
    except ConfigError as error:
        raise UsageError(str(error)) from error


def _replay_one(arguments: argparse.Namespace, settings: _Settings) -> tuple[Replay, list[str]]:
    """Calibrate one pair, and write its files before the end of its table: a reader of that may go away.

    Returns:
        The outcome, and why files of it could not be written: a sentence each.
    """
    a = arguments
    with open_source(
        a.bags,
        a.left,
        a.right,
        a.tolerance_s,
        settings.rig,
        settings.selection,
        a.raw,
        a.left_info,
        a.right_info,
        a.rectified,
        None if a.camera_info is None else tuple(a.camera_info),
        a.odometry,
        a.imu,
    ) as source:
        replay = _run_with_output(source, settings, arguments)
        unwritten = _write_files(source, replay, arguments, settings.frames)
    return replay, unwritten


def _replay_all(arguments: argparse.Namespace, settings: _Settings) -> int:
    """Calibrate every pair of the recording, one after the other; one that fails does not end the run."""
    outcomes: list[dict[str, Any]] = []
    status = EXIT_OK
    pairs = stereo_pairs(arguments.bags, arguments.raw)
    names = pair_names(pairs)
    of_pairs = [_of_one_pair(arguments, name, pair) for name, pair in zip(names, pairs, strict=True)]
    check_outputs([file for each in of_pairs for file in _outputs(each)], _inputs(arguments))
    for name, pair, of_pair in zip(names, pairs, of_pairs, strict=True):
        topics = {"left": pair.left.name, "right": pair.right.name}
        try:
            replay, unwritten = _replay_one(of_pair, settings)
        except (SelfcalError, OSError) as error:
            outcomes.append({"name": name, **topics, "accepted": False, "error": one_line(error)})
            sys.stderr.write(f"replay: {name}: {one_line(error)}\n")
            status = EXIT_BAD_INPUT
            continue
        outcomes.append({"name": name, **topics, **as_dict(replay)})
        if not arguments.json:
            sys.stdout.write(f"{_summary(replay, of_pair)}\n")
        status = max(status, _status(replay, unwritten))
    if arguments.json:
        sys.stdout.write(json.dumps({"pairs": outcomes}, allow_nan=False) + "\n")
    return status


def _summary(replay: Replay, arguments: argparse.Namespace) -> str:
    """Return what stands below the table, with what was corrected of an exported CameraInfo."""
    summary = table_summary(replay)
    pairs = _repaired_pairs(replay, arguments.exports)
    if pairs:
        summary += f"CameraInfo: {pairs[0].describe()}\n"
    return summary


def _is_written(replay: Replay) -> bool:
    """Whether there is a result to be written: none that rests on a part of a damaged recording."""
    return replay.estimate.accepted and replay.damage is None


def _repaired_pairs(replay: Replay, exports: Sequence[str]) -> tuple[RepairedPair, ...]:
    """Return the CameraInfo to be exported; none where it is not asked for, or nothing new can be told.

    A right camera that has turned far lets no frame be accepted before its CameraInfo is put right. So a
    recording without an accepted frame has the corrected CameraInfo, but none that is as it was.
    """
    if CAMERA_INFO not in exports or replay.damage is not None:
        return ()
    cameras = replay.cameras or StereoRectifier.of_rig(replay.rig)
    pairs = repaired_pairs(cameras, replay.estimate.alignment)
    return pairs if replay.estimate.accepted or pairs[0].corrected else ()


def _of_one_pair(arguments: argparse.Namespace, name: str, pair: StereoTopics) -> argparse.Namespace:
    """Return the options with the files and the topics of one pair."""
    files = {option: _of_pair(getattr(arguments, option), name) for option in _FILES}
    topics = {"left": pair.left.name, "right": pair.right.name}
    return argparse.Namespace(**vars(arguments) | files | topics)


def pair_names(pairs: Sequence[StereoTopics]) -> list[str]:
    """Return a name for every pair, for files: what its topics have in common, or its number."""
    names = []
    for pair in pairs:
        both = zip(pair.left.base.split("/")[:-1], pair.right.base.split("/")[:-1], strict=False)
        common = "_".join(left for left, right in both if left and left == right)
        names.append(_NO_FILE_NAME.sub("_", common))
    usable = len(set(names)) == len(names) and all(0 < len(name) <= _LONGEST_NAME for name in names)
    return names if usable else [f"pair{number}" for number in range(1, len(pairs) + 1)]


def _of_pair(path: Path | None, name: str) -> Path | None:
    """Return ``out.yaml`` as ``out.NAME.yaml``."""
    return path and path.with_name(f"{path.stem}.{name}{path.suffix}")


def _status(replay: Replay, unwritten: Sequence[str]) -> int:
    problems = list(unwritten) if replay.damage is None else [replay.damage, *unwritten]
    if problems:
        sys.stdout.flush()
        sys.stderr.write("".join(f"replay: {printable(problem)}\n" for problem in problems))
        return EXIT_BAD_INPUT
    return EXIT_OK if replay.estimate.accepted else EXIT_NOT_ACCEPTED


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse files that cannot be written, before any work is done for them."""
    check_outputs(_outputs(arguments), _inputs(arguments))
    if arguments.output is None and arguments.exports:
        raise UsageError("--export writes beside the file of --output: give --output")
    if arguments.report is not None and find_spec("jinja2") is None:
        raise UsageError("--report needs the Python module jinja2 (python3-jinja2), which is not installed")
    if arguments.mcap is not None and arguments.mcap.suffix != SUFFIX:
        raise UsageError(f"--mcap {arguments.mcap}: recordings are written as MCAP; end the name in {SUFFIX}")
    _check_beside(arguments.mcap, arguments.bags)
    picture = arguments.picture
    if picture is not None and picture.suffix.lower() != ".png":
        raise UsageError(f"--picture {picture}: pictures are written as PNG; end the name in .png")


def _check_beside(mcap: Path | None, bags: Sequence[Path]) -> None:
    """Refuse a recording in the folder of one that is read, whose part it would be from then on."""
    folders = {os.path.realpath(bag) for bag in bags}
    if mcap is not None and os.path.realpath(mcap.parent) in folders:
        raise UsageError(f"--mcap {mcap}: it would be a part of the recording; choose another folder")


def _outputs(arguments: argparse.Namespace) -> list[File]:
    """Return the files that are going to be written."""
    given = ((option, getattr(arguments, option)) for option in _FILES)
    files = [File(f"--{option}", path, option == "mcap") for option, path in given if path is not None]
    if arguments.output is not None:
        exports = export_paths(arguments.output, arguments.exports)
        files += [File("--export", path) for path in exports]
    return files


def _inputs(arguments: argparse.Namespace) -> list[File]:
    """Return the files that are going to be read."""
    given = (("--config", arguments.config), ("--rig", arguments.rig))
    files = [File(option, path) for option, path in given if path is not None]
    files += [File("--camera-info", path) for path in arguments.camera_info or ()]
    return [*files, *recording_files(arguments.bags, arguments.left, arguments.right)]


def _run_with_output(source: FrameSource, settings: _Settings, arguments: argparse.Namespace) -> Replay:
    """Replay with a progress bar, and with the table unless JSON is wanted."""
    progress = Progress(source.count)
    done = 0

    def on_row(row: FrameRow) -> None:
        nonlocal done
        done += 1
        progress.clear()
        if not arguments.json:
            sys.stdout.write(table_row(row, source.counted))
            sys.stdout.flush()
        progress.show(done)

    if not arguments.json:
        names, counts = (source.left_name, source.right_name), source.n_images
        for side, name, count in zip(("left", "right"), names, counts, strict=True):
            sys.stdout.write(f"{side:<5} {printable(name)} ({count} images)\n")
        sys.stdout.write("".join(f"{printable(note)}\n" for note in source.notes))
        sys.stdout.write(table_header(source.counted))
    progress.show(0)
    try:
        return calibrate_recording(source, settings.config, on_row, arguments.jobs, settings.targets)
    finally:
        progress.clear()


def _write_files(
    source: FrameSource, replay: Replay, arguments: argparse.Namespace, frames: FrameNames
) -> list[str]:
    """Write what the options ask for; no result that rests on a part of a damaged recording.

    Returns:
        Why files could not be written, a sentence each: one of them costs neither the others nor the numbers.
    """
    writers: dict[str, Callable[[Path], None]] = {
        "output": lambda path: _write_result(path, source, replay, arguments.exports, frames),
        "csv": lambda path: write_atomically(path, as_csv(replay.rows).encode()),
        "picture": lambda path: _write_picture(path, source, replay),
        "report": lambda path: _write_report(path, source, replay),
        "mcap": lambda path: _write_recording(path, source, replay, frames),
    }
    problems = []
    for option, write in writers.items():
        path = getattr(arguments, option)
        if path is not None:
            try:
                write(path)
            except (SelfcalError, OSError) as error:
                problems.append(str(error))
    return problems


def _write_result(
    path: Path, source: FrameSource, replay: Replay, exports: Sequence[str], frames: FrameNames
) -> None:
    estimate, rig = replay.estimate, replay.rig
    pairs = _repaired_pairs(replay, exports)
    if estimate.extrinsics is not None and _is_written(replay):
        # The folders above the recording are nobody's business.
        asked = None if replay.goal is None else replay.goal.targets
        write_result(path, estimate, rig, source=source.name, seed=replay.config.seed, targets=asked)
        write_exports(path, exports, _placed(replay, frames), rig, pairs, frames.pair_name)
    elif pairs:
        write_exports(path, exports, None, rig, pairs, frames.pair_name)


def _placed(replay: Replay, frames: FrameNames) -> PlacedCamera:
    """Return the camera in the vehicle; what CameraInfo calls it, the recording tells."""
    infos = InfoFrames(of_rig=True) if replay.cameras is None else InfoFrames.of(replay.cameras)
    return place_camera(replay.estimate, replay.rig, frames, infos)


def _write_recording(path: Path, source: FrameSource, replay: Replay, frames: FrameNames) -> None:
    from ..recording.content import write_recording  # noqa: PLC0415 - its message types take 0.2 s to load

    write_recording(path, source, replay, frames)


def _write_report(path: Path, source: FrameSource, replay: Replay) -> None:
    from ..report.page import render_report  # noqa: PLC0415 - jinja2 is for who asks for a report

    write_atomically(path, render_report(source, replay).encode())


def _write_picture(path: Path, source: FrameSource, replay: Replay) -> None:
    """Draw the fused estimate over the frame that shows it, or the refusal of that frame."""
    frame, shown = look_again(source, replay.shown, replay.config)
    if frame.problem:
        raise UsageError(f"--picture {path}: no frame can be shown ({frame.problem})")
    if replay.estimate.accepted:
        shown = replay.estimate.drawn_as(shown)
    picture = draw_overview(frame.left, frame.right, replay.rig, shown)
    _, content = cv2.imencode(".png", picture)
    write_atomically(path, content.tobytes())
