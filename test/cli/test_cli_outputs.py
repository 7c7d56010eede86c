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

"""Outputs never replace what a command reads, another output, or a file that is plainly something else."""

import shutil

import cv2
import numpy as np
import pytest
import yaml
from bag_making import RIG, cameras, make_bag
from fake_calibrator import use_fake

from stereo_selfcal.cli import fleet, limits, replay


@pytest.fixture
def calibrator(monkeypatch):
    return use_fake(monkeypatch)


@pytest.fixture
def drive(tmp_path):
    """A recording, settings and a rig file."""
    make_bag(tmp_path / "drive", cameras(), n_frames=2)
    (tmp_path / "conf.yaml").write_text("/**:\n  ros__parameters: {search: {height_max_m: 3.0}}\n")
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refusal(main, arguments, folder, capsys):
    """Return what is said of a command that is refused and changes nothing."""
    before = contents(folder)
    assert main([str(each) for each in arguments]) == 2
    assert contents(folder) == before
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("option", ["--output", "--csv", "--report"])
@pytest.mark.parametrize("target", ["drive/metadata.yaml", "drive/drive.mcap", "conf.yaml", "rig.yaml"])
def test_no_output_of_replay_overwrites_an_input_and_both_are_named(
    drive, calibrator, capsys, option, target
):
    inputs = (drive / "drive", "--config", drive / "conf.yaml", "--rig", drive / "rig.yaml")
    err = refusal(replay.main, [*inputs, option, drive / target], drive, capsys)
    assert f"replay: {option} {drive / target} is " in err
    assert "must not be overwritten: give another file" in err


@pytest.mark.parametrize("make", ["symlink_to", "hardlink_to"])
def test_an_input_under_the_name_of_a_link_is_not_overwritten(drive, calibrator, capsys, make):
    link = drive / "out.yaml"
    getattr(link, make)(drive / "conf.yaml")
    arguments = [drive / "drive", "--config", drive / "conf.yaml", "--output", link]
    err = refusal(replay.main, arguments, drive, capsys)
    assert f"--output {link} is --config {drive / 'conf.yaml'}" in err


def test_exports_are_outputs_too(drive, calibrator, capsys):
    config = drive / "out.autoware.yaml"
    shutil.copy(drive / "conf.yaml", config)
    arguments = [drive / "drive", "--config", config, "--output", drive / "out.yaml", "--export", "autoware"]
    assert f"--export {config} is --config" in refusal(replay.main, arguments, drive, capsys)
    both = ["--output", drive / "a.yaml", "--export", "autoware", "--csv", drive / "a.autoware.yaml"]
    assert "--csv and --export are both" in refusal(replay.main, [drive / "drive", *both], drive, capsys)


def test_two_outputs_are_two_files(drive, calibrator, capsys):
    (drive / "real").mkdir()
    (drive / "link").symlink_to(drive / "real")
    arguments = ["--csv", drive / "real/a.html", "--report", drive / "link/a.html"]
    err = refusal(replay.main, [drive / "drive", *arguments], drive, capsys)
    assert (
        f"--csv and --report are both {drive / 'link/a.html'} (by another name, {drive / 'real/a.html'})"
        in err
    )


def test_files_of_all_pairs_are_checked_before_the_first_is_calibrated(tmp_path, calibrator, capsys):
    sides = [camera for place in ("front", "rear") for camera in cameras_of(place)]
    make_bag(tmp_path / "drive", sides, n_frames=2)
    config = tmp_path / "out.rear.yaml"
    config.write_text("/**:\n  ros__parameters: {search: {height_max_m: 3.0}}\n")
    arguments = [tmp_path / "drive", "--all", "--config", config, "--output", tmp_path / "out.yaml"]
    assert f"--output {config} is --config" in refusal(replay.main, arguments, tmp_path, capsys)


def cameras_of(place):
    both = cameras()
    for camera in both:
        camera.image, camera.info = (
            f"/{place}/{camera.side}/image_rect",
            f"/{place}/{camera.side}/camera_info",
        )
    return both


def test_images_of_a_folder_and_its_rig_are_inputs(tmp_path, calibrator, capsys):
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        cv2.imwrite(str(tmp_path / side / "1.png"), np.zeros((RIG.height, RIG.width), np.uint8))
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    for option, name in (("--picture", "left/1.png"), ("--output", "rig.yaml")):
        err = refusal(replay.main, [tmp_path, option, tmp_path / name], tmp_path, capsys)
        assert f"{option} {tmp_path / name} is the " in err


def test_what_is_plainly_something_else_is_not_replaced(drive, calibrator, capsys):
    other = make_bag(drive / "other", cameras(), n_frames=2)
    shutil.copy(other / "other.mcap", drive / "recorded")
    (drive / "picture.yaml").write_bytes(cv2.imencode(".png", np.zeros((2, 2), np.uint8))[1].tobytes())
    cases = {
        "other/other.mcap": "would replace an MCAP recording",
        "other/metadata.yaml": "would replace the metadata.yaml of a recording",
        "recorded": "would replace an MCAP recording",
        "picture.yaml": "would replace a PNG picture",
        "drive/new.mcap": "has the name of a file of a recording",
    }
    for name, expected in cases.items():
        err = refusal(replay.main, [drive / "drive", "--output", drive / name], drive, capsys)
        assert f"--output {drive / name} {expected}: give another" in err


def test_a_second_run_replaces_its_own_files_also_beside_the_recording(drive, calibrator):
    folder = drive / "drive"
    files = [("--output", "r.yaml"), ("--csv", "r.csv"), ("--report", "r.html"), ("--picture", "r.png")]
    arguments = [str(each) for option, name in files for each in (option, folder / name)]
    for _ in range(2):
        assert replay.main([str(folder), *arguments]) == 0


def test_tables_of_a_fleet_overwrite_no_input(drive, calibrator, capsys):
    listed = drive / "list.csv"
    listed.write_text(f"{drive / 'drive'}\n")
    rest = ["--output", drive / "out"]
    err = refusal(fleet.main, [f"@{listed}", "--table", listed, *rest], drive, capsys)
    assert f"--table {listed} is the list" in err
    rig = drive / "out" / "table.csv"
    rig.parent.mkdir()
    shutil.copy(drive / "rig.yaml", rig)
    err = refusal(fleet.main, [drive / "drive", "--rig", rig, *rest], drive, capsys)
    assert f"--output {rig} is --rig" in err
    err = refusal(fleet.main, [drive / "drive", "--table", drive / "out/table.csv", *rest], drive, capsys)
    assert "--output and --table are both" in err


def test_the_chart_of_limits_does_not_overwrite_the_rig(drive, capsys):
    rig = drive / "rig.png"
    shutil.copy(drive / "rig.yaml", rig)
    err = refusal(limits.main, ["--rig", rig, "--plot", rig], drive, capsys)
    assert f"--plot {rig} is --rig {rig}, which is read" in err
