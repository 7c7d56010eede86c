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

"""replay with the real calibrator: the synthetic bags, and a real car's recording where it is at hand."""

import csv
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from stereo_selfcal.cli.replay import main
from stereo_selfcal.synth.bag import write_named_bags
from stereo_selfcal.synth.scenes import NAMED_SCENES

ROOT = Path(__file__).resolve().parent.parent.parent
KITTI = ROOT.parent / "shared" / "data" / "kitti_odometry02"
KITTI_PLANE = KITTI.parent / "kitti_odometry02_stereo_plane.csv"

# Issue 2: the greatest difference from the stereo plane, for most frames.
KITTI_HEIGHT_M = 0.060
KITTI_PITCH_RAD = math.radians(0.5)

# A truth outside of this many standard deviations would make the stated uncertainty a lie; with 9
# numbers drawn, 4 sigma are exceeded once in 1700 runs.
SIGMAS = 4.0


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Return a folder with the named bags: those beside the project, which test_synth_bag.py makes anew."""
    if all((ROOT / "bags" / scene.name).exists() for scene in NAMED_SCENES):
        return ROOT / "bags"
    folder = tmp_path_factory.mktemp("bags")
    list(write_named_bags(folder))
    return folder


def replay(capsys, *arguments):
    status = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    assert err == ""
    return status, json.loads(out)


@pytest.mark.slow
@pytest.mark.parametrize("scene", NAMED_SCENES, ids=lambda scene: scene.name)
def test_named_scene_gives_what_its_truth_says(bags, capsys, scene):
    truth = yaml.safe_load((bags / scene.name / "truth.yaml").read_text())
    status, content = replay(capsys, bags / scene.name)
    assert len(content["frames"]) == scene.n_frames
    if truth["expected"] != "calibrated":
        assert (status, content["accepted"]) == (1, False)
        assert {frame["reason"] for frame in content["frames"]} == {truth["expected"]}
        assert content["reason"] == truth["expected"]
        return
    assert status == 0
    for name, value in content["extrinsics"].items():
        assert abs(value - truth[name]) < SIGMAS * content["std"][name], name


@pytest.mark.slow
def test_result_file_and_json_hold_the_same_digits(bags, capsys, tmp_path):
    output = tmp_path / "result.yaml"
    _, content = replay(capsys, bags / "straight_road", "--output", output, "--max-frames", "3")
    saved = yaml.safe_load(output.read_text())["/**"]["ros__parameters"]["extrinsics"]
    assert {name: saved[name] for name in content["extrinsics"]} == content["extrinsics"]
    assert saved["height_std_m"] == content["std"]["height_m"]


@pytest.mark.slow
def test_two_processes_say_the_same(bags):
    command = [sys.executable, "-m", "stereo_selfcal", "replay", str(bags / "noisy_10"), "--json"]
    command += ["--max-frames", "3"]
    runs = [subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout for _ in range(2)]
    assert runs[0] == runs[1]


@pytest.mark.slow
@pytest.mark.skipif(not KITTI.exists(), reason=f"no recording of a real car at {KITTI}")
def test_real_recording_agrees_with_the_stereo_plane(capsys, tmp_path):
    picture = tmp_path / "overview.png"
    status, content = replay(capsys, KITTI, "--picture", picture)
    assert status == 0
    assert picture.stat().st_size > 100_000
    with KITTI_PLANE.open(encoding="utf-8") as file:
        reference = list(csv.DictReader(file))
    near = [
        frame["accepted"]
        and abs(frame["height_m"] - float(row["sgbm_height_m"])) < KITTI_HEIGHT_M
        and abs(frame["pitch_rad"] - math.radians(float(row["sgbm_pitch_deg"]))) < KITTI_PITCH_RAD
        for frame, row in zip(content["frames"], reference, strict=True)
    ]
    assert sum(near) > len(near) / 2, near
