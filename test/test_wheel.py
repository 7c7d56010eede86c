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

"""The package as pip installs it, and as colcon does: made, put into an empty folder, and run from there."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import cv2
import pytest

from stereo_selfcal.__main__ import COMMANDS
from stereo_selfcal.synth.scenes import named_scene

ROOT = Path(__file__).resolve().parent.parent
INSTALLED = ("stereo_selfcal", "bags/drive", "bags/straight_road", "config", "launch", "resource")
FILES = ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "LICENSE")

pytestmark = pytest.mark.slow


def run(*command, cwd, **variables):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return a copy of what is installed: setuptools writes into the folder it works in."""
    pytest.importorskip("setuptools")
    folder = tmp_path_factory.mktemp("source")
    for name in INSTALLED:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, folder / name)
    return folder


def modules_in(prefix):
    return sysconfig.get_path("purelib", "posix_prefix", {"base": str(prefix)})


def test_a_wheel_installs_one_program_which_calibrates_a_folder_of_pairs(source, tmp_path):
    pytest.importorskip("pip")
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    run(*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, source, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    prefix = tmp_path / "prefix"
    run(
        *pip,
        "install",
        "--no-deps",
        "--no-index",
        "--ignore-installed",
        "--prefix",
        prefix,
        wheel,
        cwd=tmp_path,
    )
    program = prefix / "bin" / "stereo_selfcal"
    assert [path.name for path in program.parent.iterdir()] == [program.name]

    scene = named_scene("straight_road")
    frame, rig = scene.frame(0), scene.scene.rig
    for side, image in (("left", frame.left), ("right", frame.right)):
        (tmp_path / "pairs" / side).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "pairs" / side / "0.png"), image)
    text = "".join(f"{name}: {getattr(rig, name)}\n" for name in rig.__slots__)
    (tmp_path / "pairs" / "rig.yaml").write_text(text)
    installed = {"PYTHONPATH": modules_in(prefix), "OPENBLAS_NUM_THREADS": "1"}
    said = run(program, "replay", "pairs", "--report", "out.html", cwd=tmp_path, **installed)
    assert "calibrated from 1 frame: height 1.4" in said
    assert (tmp_path / "out.html").is_file()  # its template is installed, too
    where = run(
        sys.executable,
        "-c",
        "import stereo_selfcal; print(stereo_selfcal.__file__)",
        cwd=tmp_path,
        **installed,
    )
    assert where.startswith(str(prefix))


def test_colcon_puts_each_command_where_ros2_run_looks(source, tmp_path):
    prefix = tmp_path / "prefix"
    run(
        *(sys.executable, "setup.py", "-q", "egg_info", "--egg-base", tmp_path),
        *("build", "--build-base", tmp_path / "build"),
        *("install", "--prefix", prefix, "--record", tmp_path / "install.log"),
        *("--install-scripts", "$base/lib/stereo_selfcal", "--single-version-externally-managed"),
        cwd=source,
        PYTHONWARNINGS="ignore",
    )
    programs = prefix / "lib" / "stereo_selfcal"
    assert {path.name for path in programs.iterdir()} == set(COMMANDS)
    assert all(path.stat().st_mode & 0o111 for path in programs.iterdir())
    share = prefix / "share" / "stereo_selfcal"
    assert (share / "bags" / "straight_road" / "metadata.yaml").is_file()
    said = run(programs / "limits", "--help", cwd=tmp_path, PYTHONPATH=modules_in(prefix))
    assert said.startswith("usage: limits")
