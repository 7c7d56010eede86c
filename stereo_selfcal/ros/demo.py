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

"""``demo``: starts the real node, plays a drive to it, calls ``~/calibrate``, compares with the truth.

Then it writes a report of the drive.
"""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import rclpy
import yaml
from rclpy.node import Node
from std_srvs.srv import Trigger

from ..bags import StereoBag, StereoFrame
from ..closed_streams import let_go, open_closed_streams, tell_error
from ..core.calibrator import Calibrator
from ..core.config import CalibratorConfig
from ..core.drive.targets import USUAL_TARGETS, Targets
from ..core.errors import OutputError, SelfcalError, printable
from ..core.geometry.pose import POSE_COMPONENTS, Extrinsics
from ..files.atomic_file import write_atomically
from ..files.node_settings import NODE_NAME
from ..files.result_file import load_result
from ..files.saved_result import SavedResult
from ..interrupts import raised_by_ctrl_c
from ..pictures.overview import draw_overview
from ..unforeseen import unforeseen
from .arguments import RosParser
from .player import BagPlayer

DRIVE_NAME, LINES_NAME = "drive", "straight_road"
TRUTH_FILE = "truth.yaml"
RESULT_FILE = "extrinsics.yaml"
PICTURE_FILE = "overview.png"
REPORT_FILE = "report.html"

_EXIT_NOT_ACCEPTED = 1
_EXIT_BAD_INPUT = 2
_START_TIMEOUT_S = 60.0
_CALL_TIMEOUT_S = 60.0  # how long the node collects frames at most
# What is asked of a drive: what twenty seconds of that of the package tell. 0.19 and 0.25 deg.
_OF_A_DRIVE = Targets(0.010, 0.0033, 0.0044)
# What is asked of a shorter recording: about what estimates of one road may differ by. 0.3 and 0.8 deg.
_OF_A_MOMENT = Targets(0.03, 0.0052, 0.014)
_LEAST_DRIVE_S = 20.0
_LISTENS_TIMEOUT_S = 10.0  # until it plays, whether the node is known to listen or not
_KNOWN_S = 1.0  # a subscription is known to the player before the player is known to it
_ANSWER_TIMEOUT_S = 120.0
_END_TIMEOUT_S = 20.0
# The lines of replay's output that say how many frames were accepted, and for what others were refused.
_COUNTS = re.compile(r"\d+ of \d+ frames? accepted|  +\d+ x ")
# Domains up to 101 collide with no port that Linux hands out to others.
_HIGHEST_DOMAIN = 101


class DemoError(SelfcalError):
    """The demo cannot continue; the message names the step."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of the service."""

    success: bool
    message: str


def run_demo(bag: Path, output_dir: Path) -> int:
    """Calibrate from a recording through the real node and report.

    Args:
        bag: A rosbag2 recording, its truth beside it when it is a synthetic one.
        output_dir: Where the result file, the picture and the report go; made if missing.

    Returns:
        Exit status: 0 calibrated, 1 refused.

    Raises:
        SelfcalError: The recording, the folder or the node failed.
    """
    result_path = output_dir / RESULT_FILE
    try:
        output_dir.mkdir(parents=True, exist_ok=True)
        for name in (RESULT_FILE, PICTURE_FILE, REPORT_FILE):
            (output_dir / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{printable(str(output_dir))} cannot be written: {error.strerror}; choose --output-dir"
        ) from error
    answer = _calibrate_live(bag, result_path)
    _say(f"answer   {answer.message}" if answer.success else f"refused  {answer.message}")
    if not answer.success:
        return _EXIT_NOT_ACCEPTED
    saved = load_result(result_path)
    _say(_table(saved, *_read_truth(bag)))
    frame = _frame_at(bag, float(saved.provenance["stamp"]))
    if frame is not None:
        _say(_write_picture(frame, saved, output_dir / PICTURE_FILE))
    _say(f"result   {printable(str(result_path))}")
    _say(_write_report(bag, output_dir / REPORT_FILE))
    return 0


def packaged_bag(name: str = DRIVE_NAME) -> Path:
    """Return a recording that comes with the package: in the present folder, a checkout, or installed.

    Args:
        name: Its name.

    Raises:
        DemoError: It is not there.
    """
    checkout = Path(__file__).resolve().parents[2]
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    places = [
        Path("bags"),
        checkout / "bags",
        *(Path(prefix, "share", NODE_NAME, "bags") for prefix in prefixes),
    ]
    for place in places:
        if (place / name / "metadata.yaml").is_file():
            return place / name
    raise DemoError(
        f"the recording {name} is not installed with the package: make one (ros2 run {NODE_NAME} synth "
        f"--named {LINES_NAME} {LINES_NAME}) and give --bag {LINES_NAME}"
    )


def _calibrate_live(bag: Path, result_path: Path) -> Answer:
    """Start the node, play the recording, call the service, end everything."""
    # By default nothing leaves this machine, and no other node on it is disturbed.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % _HIGHEST_DOMAIN))
    targets = _targets_of(bag)
    rclpy.init(args=[])
    try:
        node = Node(f"{NODE_NAME}_demo")
        player = BagPlayer(node, bag)
        with _node_process(player, result_path, targets) as process:
            try:
                _say(f"playing  {printable(str(bag))} over DDS to the node (process {process.pid})")
                _say(
                    f"asking   {targets.describe()} at most, within {_CALL_TIMEOUT_S:.0f} s "
                    f"(by default {USUAL_TARGETS.describe()})"
                )
                return _call(node, process, player)
            finally:
                player.stop()
    finally:
        rclpy.try_shutdown()


def _targets_of(bag: Path) -> Targets:
    """Return what is asked of a recording, by how long it lasts."""
    with StereoBag(bag) as recording:
        lasts_s = 1e-9 * (recording.end_ns - recording.start_ns)
    return _OF_A_DRIVE if lasts_s >= _LEAST_DRIVE_S else _OF_A_MOMENT


@contextmanager
def _node_process(
    player: BagPlayer, result_path: Path, targets: Targets
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the node as its own process, connected to the recorded topics; end it as Ctrl-C would."""
    left, right = player.topics.left, player.topics.right
    compressed = left.name != left.base
    remappings = {
        "left/image_rect": left.base,
        "right/image_rect": right.base,
        "left/camera_info": left.camera_info,
        "right/camera_info": right.camera_info,
    }
    parameters = {
        # Values of -p are YAML: a quoted value stays text.
        "output_path": "'" + str(result_path.absolute()).replace("'", "''") + "'",
        "image_transport": "compressed" if compressed else "raw",
        "timeout_s": str(_CALL_TIMEOUT_S),
        **{f"target_{component.std_name}": str(component.of(targets.std)) for component in POSE_COMPONENTS},
    }
    arguments = [sys.executable, "-m", "stereo_selfcal", "node", "--ros-args", "--log-level", "warn"]
    for name, topic in remappings.items():
        arguments += ["-r", f"{name}:={topic}"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={value}"]
    # A session of its own: Ctrl-C here ends the demo, and the demo ends the node.
    process = subprocess.Popen(arguments, env=_environment(), start_new_session=True)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _call(node: Node, process: subprocess.Popen[bytes], player: BagPlayer) -> Answer:
    """Call the service; play as soon as the node listens, so that it sees the whole drive."""
    client = node.create_client(Trigger, f"/{NODE_NAME}/calibrate")
    waited_s, step_s = 0.0, 0.5
    while not client.wait_for_service(step_s):
        waited_s += step_s
        if process.poll() is not None:
            raise DemoError(f"the node ended at its start with exit status {process.returncode}; see above")
        if waited_s >= _START_TIMEOUT_S:
            raise DemoError(f"the node did not offer ~/calibrate within {_START_TIMEOUT_S:.0f} s")
    future = client.call_async(Trigger.Request())
    for _ in range(round(_LISTENS_TIMEOUT_S / step_s)):
        if player.is_heard:
            break
        rclpy.spin_until_future_complete(node, future, timeout_sec=step_s)
    rclpy.spin_until_future_complete(node, future, timeout_sec=_KNOWN_S)
    player.start()
    rclpy.spin_until_future_complete(node, future, timeout_sec=_ANSWER_TIMEOUT_S)
    if not future.done():
        raise DemoError(f"the node did not answer within {_ANSWER_TIMEOUT_S:.0f} s")
    response = future.result()
    return Answer(bool(response.success), str(response.message))


def _read_truth(bag: Path) -> tuple[Extrinsics | None, float | None]:
    """Return the truth of a synthetic recording and its yaw [rad]; None where it is not told."""
    path = bag / TRUTH_FILE
    if not path.is_file():
        return None, None
    try:
        truth: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        yaw = truth.get("yaw_rad")
        return Extrinsics.from_mapping(truth), None if yaw is None else float(yaw)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, yaml.YAMLError) as error:
        raise DemoError(f"{path} is no truth file: {error}") from error


def _table(saved: SavedResult, truth: Extrinsics | None, true_yaw_rad: float | None) -> str:
    """Return the answer beside the truth, metres and degrees."""
    lines = [f"{'':16}{'found':>10}{'std':>10}" + (f"{'truth':>10}{'error':>10}" if truth else "")]
    for component in POSE_COMPONENTS:
        scale = component.unit.per_si
        found, std = (component.of(pose) * scale for pose in (saved.extrinsics, saved.std))
        true = None if truth is None else component.of(truth) * scale
        lines.append(_row(component.heading, found, std, true))
    travel = saved.evidence.travel
    if travel is not None and travel.tells_yaw:
        found, std = math.degrees(travel.yaw_rad), math.degrees(math.sqrt(travel.covariance[0, 0]))
        lines.append(
            _row("yaw [deg]", found, std, None if true_yaw_rad is None else math.degrees(true_yaw_rad))
        )
    return "\n".join(lines)


def _row(heading: str, found: float, std: float, true: float | None) -> str:
    """Return a row of the table."""
    beside = "" if true is None else f"{true:>+10.4f}{found - true:>+10.4f}"
    return f"{heading:16}{found:>+10.4f}{std:>10.4f}{beside}"


def _frame_at(bag: Path, stamp_s: float) -> StereoFrame | None:
    with StereoBag(bag) as recording:
        return next((frame for frame in recording.frames() if frame.stamp_s == stamp_s), None)


def _write_picture(frame: StereoFrame, saved: SavedResult, path: Path) -> str:
    """Draw the last frame the node used, calibrated once more in this process; say whether that agrees."""
    config = CalibratorConfig.from_mapping({"seed": saved.provenance["seed"]})
    calibrator = Calibrator(saved.rig, config)
    result = calibrator.add(frame.left, frame.right, frame.stamp_s)
    # Lines and gates are those of the frame; the calibration is that of the mount, as the node has answered.
    of_mount = replace(
        result,
        extrinsics=saved.extrinsics,
        covariance=saved.covariance,
        uncertainty=(),
        travel=saved.evidence.travel,
    )
    picture = draw_overview(frame.left, frame.right, saved.rig, of_mount if result.accepted else result)
    encoded, png = cv2.imencode(path.suffix, picture)
    if not encoded:
        raise OutputError(f"{path} cannot be written: the picture cannot be encoded")
    write_atomically(path, png.tobytes())
    picture_of = f"picture  {printable(str(path))}"
    if saved.n_frames > 1:
        return f"{picture_of}, of the last of {saved.n_frames} frames"
    verdict = "the same numbers" if calibrator.estimate.extrinsics == saved.extrinsics else "OTHER numbers"
    return f"the Python API gives {verdict} for this frame\n{picture_of}"


def _write_report(bag: Path, path: Path) -> str:
    """Replay the recording into a report, and say which frames were refused; open it on a display."""
    command = [sys.executable, "-m", "stereo_selfcal", "replay", str(bag), "--report", str(path)]
    run = subprocess.run(command, env=_environment(), capture_output=True, text=True, check=False)
    if not path.is_file():
        return f"report   none: replay ended with exit status {run.returncode}\n{run.stderr.strip()}"
    counts = [line for line in run.stdout.splitlines() if _COUNTS.match(line)]
    shown = _has_display() and webbrowser.open(path.absolute().as_uri())
    where = f"report   {printable(str(path))}" + (", opened" if shown else ": open it in a browser")
    return "\n".join((f"replay   {counts[0]}" if counts else "replay", *counts[1:], where))


def _has_display() -> bool:
    """Whether somebody sees what is opened."""
    displays = os.environ.get("DISPLAY"), os.environ.get("WAYLAND_DISPLAY")
    return sys.stdout.isatty() and any(displays)


def _environment() -> dict[str, str]:
    """Return the environment of programs of this package.

    Python puts the present folder first on its path with -m: no module there is to take the place of ours.
    """
    package_parent = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (package_parent, os.environ.get("PYTHONPATH"))))
    return {**os.environ, "PYTHONPATH": path, "PYTHONSAFEPATH": "1"}


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo.

    Args:
        argv: Arguments without the program name, None for those of the process.

    Returns:
        Exit status: 0 calibrated; 1 refused; 2 bad usage, unreadable input or a node that failed; 3 what was
        not foreseen.
    """
    open_closed_streams()
    parser = RosParser(
        prog="demo",
        description=__doc__.replace("``", ""),
        epilog="exit status: 0 calibrated; 1 refused; 2 bad usage, unreadable input or a node that failed; "
        "3 something unforeseen, with a traceback",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--bag", type=Path, help=f"rosbag2 folder (default: {DRIVE_NAME}, half a minute, of the package)"
    )
    which.add_argument(
        "--lines", action="store_true", help=f"play {LINES_NAME} of the package: a second of a bare road"
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("demo"),
        help="for the result, the picture and the report (default: %(default)s)",
    )
    try:
        arguments = parser.parse_args(argv)
        with raised_by_ctrl_c():
            packaged = LINES_NAME if arguments.lines else DRIVE_NAME
            return run_demo(arguments.bag or packaged_bag(packaged), arguments.output_dir)
    except SelfcalError as error:
        tell_error(f"demo: {printable(str(error))}\n")
        return _EXIT_BAD_INPUT
    except BrokenPipeError:  # whoever read the output has ended
        let_go(sys.stdout)
        return 128 + signal.SIGPIPE
    except KeyboardInterrupt:
        tell_error("demo: interrupted\n")
        return 128 + signal.SIGINT
    except Exception as error:  # noqa: BLE001 - whatever it is, it is told with its traceback and a status
        return unforeseen("demo", error)


if __name__ == "__main__":
    sys.exit(main())
