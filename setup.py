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

"""The description of the package: `colcon build` reads it (ament_python), and `pip install .`."""

import re
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "stereo_selfcal"

# Read, not imported: importing the package needs numpy and OpenCV.
_INIT = Path(NAME, "__init__.py").read_text(encoding="utf-8")
_VERSION = re.search(r'^__version__ = "(.+)"$', _INIT, re.MULTILINE)
assert _VERSION, f"{NAME}/__init__.py has no __version__"


def _files(folder: str, pattern: str) -> list[str]:
    """List the files of a folder, relative to this one: setuptools takes no absolute paths here."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


def _programs() -> list[str]:
    """Return the entry points of whoever installs.

    colcon and Debian packages run `install` or `develop` and put one for each command into
    lib/stereo_selfcal, where `ros2 run` looks (setup.cfg says so). pip makes a wheel and puts them into bin,
    where a program called `node` would shadow Node.js: there is one for all.
    """
    if {"install", "develop"}.isdisjoint(sys.argv):
        return [f"{NAME} = {NAME}.__main__:program"]
    # Not the modules of the commands: Ctrl-C is seen to before they are imported.
    return [
        f"{command} = {NAME}.__main__:{command}"
        for command in ("node", "replay", "fleet", "history", "synth", "limits", "demo")
    ]


setup(
    name=NAME,
    version=_VERSION[1],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.report": ["templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", _files("config", "*")),
        (f"share/{NAME}/launch", _files("launch", "*.launch.py")),
        (f"share/{NAME}/bags/drive", _files("bags/drive", "*")),  # what the demo plays
        (f"share/{NAME}/bags/straight_road", _files("bags/straight_road", "*")),
    ],
    python_requires=">=3.10",
    # What the package needs without ROS, for pip: colcon installs nothing, rosdep what package.xml names.
    # The least versions are those of requirements/floor.txt.
    install_requires=[
        "Jinja2>=3.1",
        "numpy>=1.26",
        "opencv-python-headless>=4.6",
        "PyYAML>=6.0",
        "rosbags>=0.11.9",
    ],
    extras_require={
        "fleet": ["distributed>=2024.8", "cryptography"],
        "parquet": ["pyarrow"],
        "test": ["pytest", "hypothesis"],
    },
    zip_safe=True,
    author="Seed 64efc911 maintainers",
    author_email="maintainers@users.noreply.h-seed-64efc911.example",
    maintainer="Seed 64efc911 maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-64efc911.example",
    description="Finds height, pitch and roll of a vehicle's stereo camera from the road itself.",
    license="Apache-2.0",
    entry_points={"console_scripts": _programs()},
)
