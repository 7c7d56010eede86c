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

"""The scripts in examples/ run, and print what they say; that of the node's client is tested in test/ros."""

import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from stereo_selfcal.synth.scenes import named_scene

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"


def example(name, *arguments):
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    environment = {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def pair(tmp_path):
    """Two images of a road and their rig, as files."""
    scene = named_scene("straight_road")
    frame, rig = scene.frame(0), scene.scene.rig
    paths = tmp_path / "left.png", tmp_path / "right.png", tmp_path / "rig.yaml"
    cv2.imwrite(str(paths[0]), frame.left)
    cv2.imwrite(str(paths[1]), frame.right)
    paths[2].write_text("".join(f"{name}: {getattr(rig, name)}\n" for name in rig.__slots__))
    return paths


@pytest.mark.slow
def test_two_images_are_calibrated_with_the_causes_of_the_uncertainty(pair):
    run = example("two_images.py", *pair)
    assert run.returncode == 0, run.stderr
    height_m, height_std_m = map(float, re.search(r"height +(\S+) m +\+- (\S+)", run.stdout).groups())
    pitch_deg, pitch_std_deg = map(float, re.search(r"pitch +(\S+) deg +\+- (\S+)", run.stdout).groups())
    assert abs(height_m - 1.4) < 0.005 and 0.0 < height_std_m < 0.03
    assert abs(pitch_deg - 3.0) < 0.02
    parts = [float(value) for value in re.findall(r"(\S+) deg of pitch", run.stdout)]
    assert parts == sorted(parts, reverse=True)
    assert sum(part**2 for part in parts) ** 0.5 == pytest.approx(pitch_std_deg, abs=2e-3)


@pytest.mark.slow
def test_two_images_that_are_refused_are_told_by_a_word(pair):
    left, right, rig = pair
    run = example("two_images.py", right, left, rig)
    assert run.returncode == 1, run.stderr
    assert "reason: cameras_swapped\n" in run.stdout


@pytest.mark.slow
def test_a_drive_ends_where_it_is_good_enough():
    run = example("drive.py", ROOT / "bags" / "straight_road", "--pitch-std-deg", "0.2")
    assert run.returncode == 0, run.stderr
    stds = [float(value) for value in re.findall(r" deg \+- (\S+)", run.stdout)]
    assert len(stds) < 10 and all(std > 0.2 for std in stds[:-1]) and stds[-1] <= 0.2
    assert f"calibrated from {len(stds)} frames" in run.stdout


def test_a_drive_that_cannot_be_read_is_said_in_one_line(tmp_path):
    run = example("drive.py", tmp_path / "nowhere")
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1 and "no such file or folder" in run.stderr


def test_every_example_says_how_it_is_run_and_is_named_in_the_docs():
    scripts = sorted(EXAMPLES.glob("*.py"))
    assert len(scripts) == 3
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for script in scripts:
        assert f"examples/{script.name} " in script.read_text(encoding="utf-8") or script.stem == "call_node"
        assert f"](../examples/{script.name})" in page
        assert script.stat().st_mode & 0o111
