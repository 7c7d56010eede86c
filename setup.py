"""The ament_python description of the package; `colcon build` reads it."""

import re
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
        (f"share/{NAME}/bags/straight_road", _files("bags/straight_road", "*")),  # what the demo plays
    ],
    python_requires=">=3.10",
    install_requires=["setuptools"],
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
    description="Finds height, pitch and roll of a vehicle's stereo camera from painted lane lines.",
    license="Apache-2.0",
    entry_points={
        # Not the modules of the commands: Ctrl-C is seen to before they are imported.
        "console_scripts": [
            f"{command} = {NAME}.__main__:{command}"
            for command in ("node", "replay", "fleet", "synth", "limits", "demo")
        ],
    },
)
