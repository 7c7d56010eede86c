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

"""The options of ``replay``, and those that ``fleet`` shares with it."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.drive.targets import USUAL_TARGETS
from ..core.errors import ConfigError, shortened
from ..core.geometry.pose import POSE_COMPONENTS
from ..files.exports import EXPORT_NAMES, parse_exports
from ..offline import default_jobs
from .console import OTHER_STATUSES, Parser

# Of a recording: 30 years, or three years of frames at 10 Hz. In nanoseconds it is an integer of 64 bits.
_MOST = 10**9

_DESCRIPTION = """\
Find height, pitch and roll of a stereo camera from a recording of a straight road.

BAG is a rosbag2 folder (mcap or sqlite3), a single .mcap or .db3 file, or a ROS 1 .bag, with
rectified images of both cameras (raw ones: --raw); several are one drive, in the order of time.
Or it is a folder of image pairs, left/NAME.png and right/NAME.png, with a rig file. Every frame
is calibrated; the accepted ones are fused. With --until-good, reading ends as soon as the mount is
known as well as asked.
"""
_EPILOG = f"""\
exit status: 0 calibrated, whether --until-good has reached its targets or not (the JSON has
"targets_reached"); 1 no frame was accepted; 2 bad usage, unreadable input or an output that
cannot be written, also when a recording is damaged after some frames, which are shown all the same;
{OTHER_STATUSES}
p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height], REP-103: pitch > 0 is nose down,
roll > 0 is right side down.
"""


def replay_parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser(
        prog="replay",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("bags", metavar="BAG", type=Path, nargs="+", help="the recording")
    add_camera_options(parser)
    add(
        "--camera-info",
        metavar=("LEFT", "RIGHT"),
        type=Path,
        nargs=2,
        help="CameraInfo files (YAML of camera_info_manager) of both cameras instead of the topics",
    )
    add(
        "--odometry",
        metavar="TOPIC",
        help="nav_msgs/Odometry of the car: its turn rate and speed say where the images are wrong",
    )
    add("--imu", metavar="TOPIC", help="sensor_msgs/Imu in the car's axes (z up), the same by its turn rate")
    add("--all", dest="all_pairs", action="store_true", help="calibrate every stereo pair of the recording")
    add("--output", metavar="FILE", type=Path, help="write the result as a ROS 2 parameter file (YAML)")
    add(
        "--export",
        dest="exports",
        metavar="NAME[,NAME]",
        type=_exports,
        default=(),
        help=f"write these formats beside FILE of --output: {', '.join(EXPORT_NAMES)}",
    )
    add(
        "--picture",
        metavar="FILE",
        type=Path,
        help="write an overlay of the result on the last good frame (PNG)",
    )
    add("--report", metavar="FILE", type=Path, help="write a report to look at: one HTML file, with pictures")
    add("--csv", metavar="FILE", type=Path, help="write a table, one line per frame (SI units, radians)")
    add(
        "--mcap",
        metavar="FILE",
        type=Path,
        help="write images, poses, transforms, markers and diagnostics as a new recording (MCAP)",
    )
    add("--json", action="store_true", help="print one JSON object (SI units, radians) instead of the table")
    add_selection_options(parser)
    _add_target_options(parser)
    add(
        "--jobs",
        metavar="N",
        type=positive_int,
        default=default_jobs(),
        help="processes that calibrate (default: %(default)s, the cores); the result is the same with any",
    )
    return parser


def _add_target_options(parser: Parser) -> None:
    """Add when a calibration is good enough to read no further."""
    add = parser.add_argument
    add(
        "--until-good",
        action="store_true",
        help="read until the standard deviations of the mount are those below, and no further",
    )
    for component, default in zip(POSE_COMPONENTS, USUAL_TARGETS.std.as_array(), strict=True):
        add(
            f"--target-{component.std_name.replace('_', '-')}",
            dest=f"target_{component.std_name}",
            metavar=component.si_unit.upper(),
            type=float,
            help=f"std of the {component.label} that is good enough [{component.si_unit}]; 0: any (default: "
            f"that of --config, or {default:g})",
        )
    add(
        "--min-frames",
        metavar="N",
        type=positive_int,
        help="accepted frames there must be (default: frames of --config, or 1)",
    )


def add_camera_options(parser: Parser) -> None:
    """Add what is to be known of the cameras, and how they are calibrated."""
    add = parser.add_argument
    add("--left", metavar="TOPIC", help="image topic of the left camera (default: found by type and name)")
    add("--right", metavar="TOPIC", help="image topic of the right camera; of image pairs: the folder")
    add(
        "--left-info",
        metavar="TOPIC",
        help="CameraInfo topic of the left camera (default: that of its images)",
    )
    add("--right-info", metavar="TOPIC", help="CameraInfo topic of the right camera")
    add("--rig", metavar="FILE", type=Path, help="rig file (YAML or JSON) instead of the CameraInfo topics")
    claim = parser.add_mutually_exclusive_group()
    claim.add_argument(
        "--raw",
        action="store_true",
        help="the images are raw: undistort and rectify them by their CameraInfo",
    )
    claim.add_argument(
        "--rectified",
        action="store_true",
        help="the images are rectified, whatever their topics are called (image_raw of kitti2bag)",
    )
    add("--config", metavar="FILE", type=Path, help="settings of the calibrator (YAML)")
    add("--seed", metavar="N", type=int, help="seed of the random numbers (default: that of the settings)")


def add_selection_options(parser: Parser) -> None:
    """Add which frames of a recording are used."""
    add = parser.add_argument
    add(
        "--approximate-sync-tolerance",
        dest="tolerance_s",
        metavar="S",
        type=time_s,
        default=0.0,
        help="pair images whose stamps differ by at most S seconds (default: equal stamps)",
    )
    add("--start", metavar="S", type=time_s, default=0.0, help="from S seconds after the recording starts")
    add("--end", metavar="S", type=time_s, help="to S seconds after the recording starts")
    add("--every", metavar="N", type=positive_int, default=1, help="every N-th frame")
    add("--max-frames", metavar="N", type=positive_int, help="stop after N frames")


def positive_int(text: str) -> int:
    """Return the whole number an option gives, 1 or more."""
    value = int(text)
    if not 1 <= value <= _MOST:
        raise argparse.ArgumentTypeError(f"{shortened(value)} is not in 1 ... {_MOST}")
    return value


def time_s(text: str) -> float:
    """Return the time an option gives [s], 0 or more."""
    value = float(text)
    if not 0 <= value <= _MOST:
        raise argparse.ArgumentTypeError(f"{shortened(value)} is not a time in 0 ... {_MOST} s")
    return value


def _exports(text: str) -> tuple[str, ...]:
    try:
        return parse_exports(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
