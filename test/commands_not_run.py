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

"""Commands in README.md and docs/ that no test runs as they stand: why, and what is tested instead.

Blocks marked ``test`` and blocks below ``<!-- output: ... -->`` are run. All others have to match a line.
"""

import re

_NAMES = "test_docs.py compares its names"
_MACHINES = "needs other machines; test/fleet starts a cluster on this one"
_CLI = "needs ros2cli"

# Pattern of the beginning of a command -> why it is not run.
WHY = {
    r"make (demo|demo-lines|\.venv)": "needs ROS 2 and an environment; test/ros/test_demo.py runs the demo",
    r"make (test|test-floor|lint|docs)\b": "runs these tests, or is run beside them by .ci/run",
    r"make (bench|figures|bags)\b": "takes minutes to hours; test_docs.py compares the figures",
    r"make$": "lists the targets of the Makefile",
    r"\.ci/run": "runs these tests",
    r"python -m benchmarks": "takes minutes to hours; test_docs.py compares the figures it makes",
    r"rosdep ": f"needs rosdep and its rules; test_package.py holds the keys against a page; {_NAMES}",
    r"colcon ": "needs colcon; test_wheel.py installs as it does",
    r"(source|\.) (install|\.venv)/": "of a shell, in a workspace or an environment",
    r"sudo apt ": "changes the system",
    r"pip install": "needs a package registry; test_wheel.py installs the wheel",
    r"python3 -m venv": "of Python itself",
    r"stereo_selfcal (replay|--version)": "of an installed wheel; test_wheel.py runs it",
    r"ros2 (run|launch) stereo_selfcal": f"{_CLI}; test/ros runs the node as a process; {_NAMES}",
    r"ros2 (param|service|topic|bag|launch|run)\b": f"{_CLI}; test/ros calls the same over DDS; {_NAMES}",
    r"rviz2 ": "needs RViz; test_layouts.py holds its topics and types against the recording",
    r"dask (scheduler|worker) ": _MACHINES,
    r"python -m stereo_selfcal fleet .*--scheduler": _MACHINES,
    r"python -m stereo_selfcal replay (BAG|drive)": f"needs a recording of the reader's; {_NAMES}",
    r"python -m stereo_selfcal( COMMAND| --version| replay)?$": "a form, no line; test_main.py runs it",
    r"git tag ": "of whoever makes a release",
}


def why_not_run(command: str) -> str | None:
    """Return the reason that a command is not run; None where there is none."""
    return next((why for pattern, why in WHY.items() if re.match(pattern, command)), None)
