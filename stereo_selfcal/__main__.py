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

"""``python -m stereo_selfcal COMMAND``: the same programs as ``ros2 run stereo_selfcal COMMAND``.

Where pip has installed the package, ``stereo_selfcal COMMAND`` is the same.
"""

from __future__ import annotations

from .interrupts import end_at_once_by_ctrl_c

if __name__ == "__main__":
    end_at_once_by_ctrl_c()

# After that, as a signal may come while they are imported.
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

from . import __version__
from .closed_streams import open_closed_streams, tell_error
from .unforeseen import unforeseen

# Command -> (module with main(argv) -> exit status, what it does). Imported when needed: only the
# node and the demo need ROS.
COMMANDS = {
    "node": ("stereo_selfcal.ros.node", "calibrate a running stereo camera (needs ROS 2)"),
    "replay": ("stereo_selfcal.cli.replay", "calibrate from a recording, without ROS"),
    "fleet": (
        "stereo_selfcal.cli.fleet",
        "calibrate many recordings on many processes, without ROS",
    ),
    "history": (
        "stereo_selfcal.cli.history",
        "compare results of one camera from several drives, without ROS",
    ),
    "synth": ("stereo_selfcal.cli.synth", "write a synthetic recording with its truth, without ROS"),
    "limits": (
        "stereo_selfcal.cli.limits",
        "how accurate a rig can be at all, to choose a baseline and a mounting",
    ),
    "demo": ("stereo_selfcal.ros.demo", "play a synthetic recording to the node and call it (needs ROS 2)"),
}

_EXIT_BAD_USAGE = 2

_PROGRAM = "stereo_selfcal"  # as pip installs it
# rosdep cannot install it on Ubuntu 24.04, where pip may not touch the system unless told.
_HOW_TO_INSTALL = {
    "rosbags": "pip install rosbags (of the system's Python: pip install --break-system-packages rosbags)"
}
_USUAL_WAY = "source ROS 2 or see docs/install.md"


def usage() -> str:
    """Return the help text."""
    program = _PROGRAM if Path(sys.argv[0]).name == _PROGRAM else f"python -m {_PROGRAM}"
    lines = [f"  {name:<8}{text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(
        [
            f"usage: {program} COMMAND ... | --version",
            "",
            "Height, pitch and roll of a vehicle's stereo camera over the road, from the road itself.",
            "",
            *lines,
            "",
            f"Each command explains itself: {program} replay --help",
            "Exit status: 0 and 1 as the command says; 2 bad usage or unreadable input; 3 something",
            "unforeseen, with a traceback; 128 and its number for a signal that ends it (130: Ctrl-C).",
            "",
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command named by the first argument and return its exit status."""
    open_closed_streams()
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] in (["-h"], ["--help"]):
        sys.stdout.write(usage())
        return 0
    if arguments == ["--version"]:
        sys.stdout.write(f"{_PROGRAM} {__version__}\n")
        return 0
    if not arguments or arguments[0] not in COMMANDS:
        given = f"unknown command {arguments[0]!r}" if arguments else "no command given"
        tell_error(f"stereo_selfcal: {given}; the commands are {', '.join(COMMANDS)}, see --help\n")
        return _EXIT_BAD_USAGE
    try:
        program = import_module(COMMANDS[arguments[0]][0])
    except ModuleNotFoundError as error:
        way = _HOW_TO_INSTALL.get((error.name or "").partition(".")[0], _USUAL_WAY)
        tell_error(
            f"stereo_selfcal: {arguments[0]} needs the Python module {error.name}, which is not installed; "
            f"{way}\n"
        )
        return _EXIT_BAD_USAGE
    except Exception as error:  # noqa: BLE001 - a module that cannot be imported is told as all else is
        return unforeseen(f"stereo_selfcal {arguments[0]}", error)
    status: int = program.main(arguments[1:])
    return status


def _script(command: str) -> int:
    """Run a command as a program of its own: what ``ros2 run stereo_selfcal COMMAND`` starts."""
    end_at_once_by_ctrl_c()
    return main([command, *sys.argv[1:]])


# The entry points of setup.py: this module is imported in no time, those of the commands are not.
node, replay, fleet, history, synth, limits, demo = (partial(_script, command) for command in COMMANDS)


def program() -> int:
    """Run the program that pip installs: ``stereo_selfcal COMMAND``."""
    end_at_once_by_ctrl_c()
    return main()


if __name__ == "__main__":
    sys.exit(main())
