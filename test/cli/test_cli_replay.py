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

"""replay: exit statuses, one-line errors, and what goes where."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bag_making import RIG, Camera, cameras, make_bag
from fake_calibrator import use_fake

from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.files.rig_file import read_rig_file

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture
def calibrator(monkeypatch):
    return use_fake(monkeypatch)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return make_bag(tmp_path_factory.mktemp("replay") / "bag", cameras(), n_frames=4)


def test_table(bag, calibrator, monkeypatch, capsys):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: index != 1))
    assert main([str(bag)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0] == "left  /stereo/left/image_rect (4 images)"
    assert len({len(line) for line in lines[2:8]}) == 1, "columns are aligned"
    assert lines[4].split() == ["100.000000", "accepted", "1.4000", "+2.865", "-0.573"]
    assert lines[5].split() == ["100.100000", "no_lines_found", "-", "-", "-"]
    text = "\n".join(lines[8:])
    assert "3 of 4 frames accepted" in text
    assert "1 x no_lines_found" in text
    assert "mean of the frames                               1.4100" in text
    assert "scatter of the frames                           0.01000       0.0000      0.0000" in text
    assert "mount                                            1.4100" in text
    assert text.endswith("roll -0.5730 deg (std 0.0057)")


def test_json_is_one_object_with_all_digits(bag, calibrator, monkeypatch, capsys):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: index != 1))
    assert main([str(bag), "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.count("\n") == 1
    content = json.loads(out)
    contract = ["accepted", "reason", "message", "extrinsics", "std", "lane_yaw_rad", "frames"]
    assert list(content) == [
        *contract,
        "segments",
        "changes",
        "uncertainty",
        "alignment",
        "travel",
        "delay",
        "with_reservations",
        "reservations",
        "mount",
        "targets_reached",
        "targets",
    ]
    assert content["mount"] is content["targets_reached"] is content["targets"] is None
    assert content["alignment"] is content["travel"] is None
    assert content["changes"] == []
    assert [segment["frames"] for segment in content["segments"]] == [3]
    estimate = calibrator.made[0].estimate
    assert content["accepted"] is True
    assert content["reason"] is None
    assert content["extrinsics"]["height_m"] == estimate.extrinsics.height_m
    assert content["std"]["height_m"] == math.sqrt(1e-6)
    assert content["lane_yaw_rad"] == 0.1
    assert content["frames"][1] == {
        "stamp_s": pytest.approx(100.1),
        "accepted": False,
        "reason": "no_lines_found",
        "height_m": None,
        "pitch_rad": None,
        "roll_rad": None,
        "std": None,
        "known_start": False,
        "stood": False,
        "reservations": [],
        "alignment": None,
        "attempts": [],
    }
    assert content["frames"][0]["pitch_rad"] == 0.05
    assert content["frames"][0]["std"] == pytest.approx(
        {"height_m": 1e-3, "pitch_rad": 1e-4, "roll_rad": 1e-4}
    )


def test_json_has_the_reservations_of_the_estimate_and_of_each_frame(capsys):
    assert main([str(ROOT / "bags" / "straight_road"), "--max-frames", "2", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    said = "not checked against the texture of the road surface: too little texture between the lines"
    fused = {"kind": "not_checked_by_texture", "frames": 2, "message": f"{said} (2 of 2 frames)"}
    assert content["with_reservations"] is True
    assert content["reservations"] == content["segments"][0]["reservations"] == [fused]
    assert content["frames"][0]["reservations"] == [fused | {"frames": 1, "message": said}]
    assert content["message"].endswith(f"; {said} (2 of 2 frames)")


def test_files(bag, calibrator, tmp_path, capsys):
    output, picture = tmp_path / "result.yaml", tmp_path / "overview.png"
    output.write_text("an older result")
    assert main([str(bag), "--output", str(output), "--picture", str(picture), "--seed", "7"]) == 0
    first = capsys.readouterr().out, output.read_bytes(), picture.read_bytes()
    parameters = yaml.safe_load(output.read_text())["/**"]["ros__parameters"]
    assert parameters["extrinsics"]["height_m"] == calibrator.made[0].estimate.extrinsics.height_m
    assert parameters["provenance"]["source"] == "bag"
    assert parameters["provenance"]["seed"] == calibrator.made[0].config.seed == 7
    assert cv2.imread(str(picture)).shape[2] == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["overview.png", "result.yaml"]
    assert main([str(bag), "--output", str(output), "--picture", str(picture), "--seed", "7"]) == 0
    assert first == (capsys.readouterr().out, output.read_bytes(), picture.read_bytes()), "deterministic"


def test_exports_are_written_beside_the_result(bag, calibrator, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("/**: {ros__parameters: {road_frame: asphalt}}")
    arguments = [str(bag), "--output", str(tmp_path / "out.yaml"), "--export", "autoware,urdf"]
    assert main([*arguments, "--config", str(config)]) == 0
    names = {"config.yaml", "out.yaml", "out.autoware.yaml", "out.urdf.xml"}
    assert {path.name for path in tmp_path.iterdir()} == names
    pose = yaml.safe_load((tmp_path / "out.autoware.yaml").read_text())["asphalt"]["stereo_camera"]
    saved = load_result(tmp_path / "out.yaml").extrinsics
    expected = (saved.height_m, saved.pitch_rad, saved.roll_rad)
    assert (pose["z"], pose["pitch"], pose["roll"]) == pytest.approx(expected, rel=1e-12)


def test_exports_name_the_left_camera_as_the_recording_does(bag, calibrator, tmp_path, capsys):
    config = tmp_path / "config.yaml"
    config.write_text("/**: {ros__parameters: {camera_frame: from_camera_info}}")
    arguments = [str(bag), "--output", str(tmp_path / "out.yaml"), "--export", "autoware"]
    assert main([*arguments, "--config", str(config)]) == 0
    pose = yaml.safe_load((tmp_path / "out.autoware.yaml").read_text())["road"]["left"]
    assert pose["y"] > 0.0 and pose["yaw"] == pytest.approx(
        -np.pi / 2, abs=0.1
    )  # x of an optical frame: right
    config.write_text("/**: {ros__parameters: {camera_frame: right}}")
    assert main([*arguments, "--config", str(config)]) == 2
    assert "which is the right camera by its CameraInfo" in capsys.readouterr().err
    assert (tmp_path / "out.yaml").is_file()


def test_export_without_a_result_file_has_no_place(bag, calibrator, capsys):
    assert main([str(bag), "--export", "urdf"]) == 2
    assert "give --output" in capsys.readouterr().err
    assert calibrator.made == []


def test_export_that_cannot_be_written_costs_no_work(bag, calibrator, tmp_path, capsys):
    (tmp_path / "out.urdf.xml").mkdir()
    assert main([str(bag), "--output", str(tmp_path / "out.yaml"), "--export", "urdf"]) == 2
    assert "--export" in capsys.readouterr().err
    assert calibrator.made == []


@pytest.mark.parametrize("as_json", [False, True])
def test_nothing_accepted(bag, calibrator, monkeypatch, tmp_path, capsys, as_json):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: False))
    output = tmp_path / "result.yaml"
    output.write_text("an older result")
    arguments = [str(bag), "--output", str(output), "--picture", str(tmp_path / "p.png")]
    assert main(arguments + ["--json"] * as_json) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert output.read_text() == "an older result", "the last good calibration stays"
    assert (tmp_path / "p.png").exists(), "the picture shows why"
    if as_json:
        content = json.loads(out)
        assert (content["accepted"], content["reason"]) == (False, "no_lines_found")
        assert content["extrinsics"] is content["std"] is content["lane_yaw_rad"] is None
    else:
        assert "0 of 4 frames accepted" in out
        assert "at least 2 needed; paint some" in out


def test_max_frames(bag, calibrator, capsys):
    assert main([str(bag), "--json", "--max-frames", "2"]) == 0
    assert len(json.loads(capsys.readouterr().out)["frames"]) == 2


def test_settings_and_seed_reach_the_calibrator(bag, calibrator, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("stereo_selfcal: {ros__parameters: {seed: 3, genetic: {population: 50}}}")
    assert main([str(bag), "--config", str(config)]) == 0
    assert main([str(bag), "--config", str(config), "--seed", "4"]) == 0
    assert main([str(bag)]) == 0
    assert [made.config.seed for made in calibrator.made] == [3, 4, CalibratorConfig().seed]
    assert [made.config.genetic.population for made in calibrator.made[:2]] == [50, 50]


def test_rig_file_replaces_camera_info(tmp_path, calibrator):
    path = make_bag(tmp_path / "bag", cameras(info=""))
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(RIG.to_mapping()))
    assert main([str(path), "--rig", str(rig)]) == 0
    assert calibrator.made[0].rig == RIG
    as_json = tmp_path / "rig.json"
    as_json.write_text(json.dumps(RIG.to_mapping() | {"fx": 5e1}).replace("50.0", "5e1"))
    assert read_rig_file(as_json) == RIG


def test_ros_arguments_are_passed_over(bag, calibrator):
    assert main(["--ros-args", "-r", "__node:=x", "--", str(bag)]) == 0
    assert main([str(bag), "--ros-args", "--params-file", "nowhere"]) == 0


def test_approximate_stamps(tmp_path, calibrator, capsys):
    path = make_bag(tmp_path / "bag", [Camera("left"), Camera("right", stamp_shift_ns=2_000_000)])
    assert main([str(path)]) == 2
    said = capsys.readouterr().err
    assert "the nearest stamps differ by 2.000 ms: give --approximate-sync-tolerance 0.003 (half a " in said
    assert main([str(path), "--approximate-sync-tolerance", "0.01"]) == 0


P_WITHOUT_BASELINE = np.array([50.0, 0, 31.5, 0, 0, 50, 23.5, 0, 0, 0, 1, 0])


def truncated(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(), kind="mcap")
    os.truncate(path / "bag.mcap", 5000)
    return [path]


def recording(sides, *extra):
    return lambda tmp_path: [make_bag(tmp_path / "bag", sides), *extra]


def text(tmp_path):
    (tmp_path / "notes.mcap").write_text("not a bag")
    return [tmp_path / "notes.mcap"]


def rig_file(content):
    def make(tmp_path):
        (tmp_path / "rig.yaml").write_text(content)
        return [make_bag(tmp_path / "bag", cameras()), "--rig", tmp_path / "rig.yaml"]

    return make


def config_file(content):
    def make(tmp_path):
        (tmp_path / "config.yaml").write_text(content)
        return [make_bag(tmp_path / "bag", cameras()), "--config", tmp_path / "config.yaml"]

    return make


def output_in(*parts):
    def make(tmp_path):
        (tmp_path / "file").touch()
        (tmp_path / "folder").mkdir()
        return [make_bag(tmp_path / "bag", cameras()), "--output", tmp_path.joinpath(*parts)]

    return make


BAD_INPUT = {
    "missing path": (lambda p: [p / "nowhere"], "nowhere: no such file or folder"),
    "not a bag": (text, "cannot be read as a recording"),
    "truncated mcap": (truncated, "cannot be read as a recording"),
    "no images": (recording(cameras(image="")), "no images"),
    "only one camera": (recording([Camera("left")]), "only one camera (left)"),
    "no CameraInfo": (recording(cameras(info="")), "give the rig with --rig"),
    "K[0] = 0": (recording(cameras(info_changes={"k": np.zeros(9), "p": np.zeros(12)})), "K[0] = 0"),
    "zero baseline": (recording(cameras(info_changes={"p": P_WITHOUT_BASELINE})), "baseline of zero"),
    "unknown encoding": (recording(cameras(encoding="yuv422")), "'yuv422' is not supported"),
    "step too small": (recording(cameras(step_too_small=True)), "step is 63 bytes"),
    "output without folder": (output_in("nowhere", "x.yaml"), "choose a writable folder"),
    "output is a folder": (output_in("folder"), "is not a file"),
    "output below a file": (output_in("file", "x.yaml"), "choose a writable folder"),
    "ambiguous topics": (
        recording(
            [Camera(s, f"/{where}/{s}/image", "") for where in ("front", "rear") for s in ("left", "right")]
        ),
        "choose with --left and --right",
    ),
    "unknown topic": (recording(cameras(), "--left", "/x"), "--left /x: no such image topic"),
    "no arguments": (lambda p: [], "BAG"),
    "unknown option": (recording(cameras(), "--wrong"), "--wrong"),
    "seed no number": (recording(cameras(), "--seed", "x"), "invalid int value"),
    "seed out of range": (recording(cameras(), "--seed", "-1"), "seed is -1"),
    "no frames wanted": (recording(cameras(), "--max-frames", "0"), "0 is not in 1 ... "),
    "bad tolerance": (recording(cameras(), "--approximate-sync-tolerance", "nan"), "is not a time"),
    "rig file missing": (recording(cameras(), "--rig", "/nowhere/rig.yaml"), "No such file"),
    "rig file no YAML": (rig_file("a: ["), "cannot be read"),
    "rig file no mapping": (rig_file("5"), "holds no keys"),
    "rig file lacks keys": (rig_file("{width: 64, height: 48}"), "lacks fx"),
    "rig file wrong value": (
        rig_file(yaml.safe_dump(RIG.to_mapping() | {"baseline_m": 0.0})),
        "baseline_m is 0.0",
    ),
    "config file missing": (recording(cameras(), "--config", "/nowhere/x.yaml"), "cannot be read"),
    "unknown setting": (
        config_file("stereo_selfcal: {ros__parameters: {genetic: {size: 5}}}"),
        "genetic.size",
    ),
    "unknown export": (recording(cameras(), "--output", "x.yaml", "--export", "tf"), "they are urdf, "),
    "picture no PNG": (recording(cameras(), "--picture", "x.pdf"), "end the name in .png"),
    "one file for both": (
        recording(cameras(), "--picture", "x.png", "--output", "./x.png"),
        "give two files",
    ),
}


@pytest.mark.parametrize("name", BAD_INPUT)
def test_bad_input_is_one_line_and_exit_status_2(name, tmp_path, calibrator, capsys, monkeypatch):
    make, message = BAD_INPUT[name]
    arguments = [str(argument) for argument in make(tmp_path)]
    result = tmp_path / "result.yaml"
    result.write_text("an older result")
    if "--output" not in arguments:
        arguments += ["--output", str(result)]
    monkeypatch.chdir(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert message in err
    assert err.startswith("replay: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def run(*arguments, **options):
    command = [sys.executable, "-m", "stereo_selfcal", "replay", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, **options)


@pytest.mark.slow
def test_bad_input_as_a_process(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(encoding="yuv422"))
    os.truncate(path / "bag.mcap", 5000)
    for arguments in ([tmp_path / "nowhere"], [path], []):
        done = run(*arguments)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr


def test_help_as_a_process():
    done = run("--help")
    assert done.returncode == 0
    assert "exit status" in done.stdout


def test_unwritable_folder(bag, tmp_path, calibrator, monkeypatch, capsys):
    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)  # root may write anywhere
    assert main([str(bag), "--output", str(tmp_path / "x.yaml")]) == 2
    assert "cannot be written: permission denied" in capsys.readouterr().err
    assert not calibrator.made, "found before the work"
