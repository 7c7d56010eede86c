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

"""``synth``: write a synthetic stereo recording with its truth."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.errors import printable
from ..synth.bag import STORAGES, TRUTH_FILE, write_bag, write_named_bags
from ..synth.scenes import NAMED_SCENES, NamedScene, custom_scene, named_scene
from .console import EXIT_OK, OTHER_STATUSES, Parser, Progress, UsageError, run

_DESCRIPTION = f"""\
Write a synthetic stereo recording of a straight road (rosbag2) with its truth in OUT_BAG/{TRUTH_FILE}.

Topics: /stereo/left|right/image_rect (mono8) and camera_info. Same options, same bytes.
"""
_EPILOG = f"""\
exit status: 0 written; 2 bad usage, or OUT_BAG exists already (nothing is overwritten);
{OTHER_STATUSES}
"""

# Options of a scene made to order: (option, type, keyword of custom_scene, factor to its unit, help).
_DEG = math.pi / 180
_NUMBERS = (
    ("--height-m", "height_m", 1.0, "height of the middle of the baseline over the road [m]"),
    ("--pitch-deg", "pitch_rad", _DEG, "pitch [deg], > 0: nose down"),
    ("--roll-deg", "roll_rad", _DEG, "roll [deg], > 0: right side down"),
    ("--yaw-deg", "lane_yaw_rad", _DEG, "heading against the lane [deg], > 0: points left"),
    ("--offset-m", "lateral_offset_m", 1.0, "position beside the middle of the lane [m], > 0: left"),
    ("--curvature", "curvature_per_m", 1.0, "curvature of the road [1/m], > 0 bends left"),
    ("--noise", "noise_fraction", 1.0, "standard deviation of the noise as a fraction of 255, 0 ... 1"),
    ("--rate-hz", "rate_hz", 1.0, "frames per second (default 10)"),
    ("--bump-at-s", "bump_at_s", 1.0, "the mount is knocked this long after the first frame [s]"),
    ("--bump-height-m", "bump_height_m", 1.0, "change of its height by the knock [m]"),
    ("--bump-pitch-deg", "bump_pitch_rad", _DEG, "change of its pitch by the knock [deg]"),
    ("--bump-roll-deg", "bump_roll_rad", _DEG, "change of its roll by the knock [deg]"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status (`cli.console`)."""
    return run("synth", _synth, argv)


def _synth(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    if arguments.named_all is not None:
        if arguments.out_bag is not None or arguments.named is not None or _made_to_order(arguments):
            raise UsageError("--named-all stands alone: it takes no OUT_BAG and no other option; see --help")
        for path in write_named_bags(arguments.named_all):
            sys.stdout.write(f"{printable(str(path))}\n")
        return EXIT_OK
    if arguments.out_bag is None:
        raise UsageError("OUT_BAG is missing; see --help")
    scene = _scene(arguments)
    progress = Progress(scene.n_frames)
    try:
        write_bag(arguments.out_bag, scene, arguments.storage, progress.show)
    finally:
        progress.clear()
    sys.stdout.write(f"{printable(str(arguments.out_bag))}: {scene.description}; {scene.n_frames} frames\n")
    return EXIT_OK


def _scene(arguments: argparse.Namespace) -> NamedScene:
    """Return the scene the options describe."""
    given = _made_to_order(arguments)
    if arguments.named is None:
        return custom_scene(name=arguments.out_bag.name, **given)
    if given:
        raise UsageError("--named is a finished scene: it takes no option that changes it")
    return named_scene(arguments.named)


def _made_to_order(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the keywords of custom_scene that were given; the others have their defaults there."""
    given: dict[str, Any] = {}
    for option, keyword, factor, _ in _NUMBERS:
        value = getattr(arguments, keyword)
        if value is not None:
            if not math.isfinite(value):
                raise UsageError(f"{option} is {value}: a finite number is needed")
            given[keyword] = value * factor
    for keyword in ("n_frames", "seed"):
        if getattr(arguments, keyword) is not None:
            given[keyword] = getattr(arguments, keyword)
    if arguments.no_lines:
        given["no_lines"] = True
    return given


def _parser() -> Parser:
    parser = Parser(
        prog="synth",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("out_bag", metavar="OUT_BAG", type=Path, nargs="?", help="folder to make")
    for option, keyword, _, text in _NUMBERS:
        add(option, dest=keyword, metavar="X", type=float, help=text)
    add("--frames", dest="n_frames", metavar="N", type=int, help="number of frames, at 50 km/h")
    add("--seed", metavar="N", type=int, help="seed of noise and texture")
    add("--no-lines", action="store_true", help="leave out the paint")
    add("--storage", choices=STORAGES, default="mcap", help="mcap (zstd, the default) or sqlite3")
    names = ", ".join(scene.name for scene in NAMED_SCENES)
    add("--named", metavar="NAME", help=f"write one of the named scenes: {names}")
    add("--named-all", metavar="FOLDER", type=Path, help="write all named scenes into FOLDER, replacing them")
    return parser
