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

"""replay --until-good: what is asked, where it ends, and who is told."""

import json
from pathlib import Path

import pytest
import yaml
from bag_making import Camera, cameras, make_bag
from fake_calibrator import use_fake

from stereo_selfcal.cli.replay import main
from stereo_selfcal.files.result_file import load_result

USUAL = "the asked std of 10 mm, 0.12, 0.25 deg"
ANY = ["--target-height-std-m", "0", "--target-pitch-std-rad", "0", "--target-roll-std-rad", "0"]


@pytest.fixture
def calibrator(monkeypatch):
    """Frames with a standard deviation of 1 mm and 1e-4 rad, which do not get better with more of them."""
    return use_fake(monkeypatch)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return make_bag(tmp_path_factory.mktemp("replay") / "bag", cameras(), n_frames=4)


def as_json(capsys, *arguments):
    status = main([*map(str, arguments), "--json"])
    return status, json.loads(capsys.readouterr().out)


def test_it_ends_when_it_is_good_and_says_so(bag, calibrator, capsys):
    assert main([str(bag), "--until-good"]) == 0
    out = capsys.readouterr().out
    assert "1 of 1 frames accepted" in out
    assert (
        "the asked std of 10 mm, 0.12, 0.25 deg is reached after 1 frame, 0.0 s; nothing more was read" in out
    )


def test_number_of_frames_counts_accepted_ones(bag, calibrator, monkeypatch, capsys):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: index != 1))
    status, content = as_json(capsys, bag, "--until-good", "--min-frames", "2")
    assert (status, len(content["frames"]), content["targets_reached"]) == (0, 3, True)
    assert content["targets"] == {
        "reached": True,
        "height_std_m": 0.01,
        "pitch_std_rad": 0.0021,
        "roll_std_rad": 0.00436,
        "min_frames": 2,
        "frames": 3,
        "duration_s": pytest.approx(0.2),
        "message": f"{USUAL} is reached after 3 frames, 0.2 s; nothing more was read",
    }


def test_targets_that_are_not_reached_are_told_and_the_calibration_is_written(
    bag, calibrator, tmp_path, capsys
):
    output = tmp_path / "out.yaml"
    arguments = [bag, "--until-good", "--target-height-std-m", "0.0001", "--output", output]
    status, content = as_json(capsys, *arguments)
    assert (status, len(content["frames"]), content["targets_reached"]) == (0, 4, False)
    assert content["targets"]["message"].startswith(
        "the asked std of 0.1 mm, 0.12, 0.25 deg is not reached in 4 frames, 0.3 s: the height has a std of"
    )
    targets = yaml.safe_load(output.read_text())["/**"]["ros__parameters"]["provenance"]["targets"]
    assert (targets["height_std_m"], targets["reached"]) == (0.0001, False)
    assert load_result(output).n_frames == 4
    assert main(list(map(str, arguments))) == 0
    assert "is not reached in 4 frames, 0.3 s: the height has a std of 1 mm" in capsys.readouterr().out


def test_without_the_option_nothing_is_asked(bag, calibrator, tmp_path, capsys):
    output = tmp_path / "out.yaml"
    status, content = as_json(capsys, bag, "--output", output)
    assert (status, len(content["frames"])) == (0, 4)
    assert content["targets_reached"] is content["targets"] is None
    assert "targets:" not in output.read_text()


def test_nothing_accepted_is_status_1(bag, calibrator, monkeypatch, capsys):
    monkeypatch.setattr(calibrator, "accept", staticmethod(lambda index: False))
    status, content = as_json(capsys, bag, "--until-good", *ANY)
    assert (status, content["targets_reached"]) == (1, False)
    assert content["message"] in content["targets"]["message"]


def test_settings_of_a_file_are_those_of_the_node(bag, calibrator, tmp_path, capsys):
    config = tmp_path / "config.yaml"
    config.write_text("/**: {ros__parameters: {target_height_std_m: 0.0001, frames: 3}}")
    status, content = as_json(capsys, bag, "--until-good", "--config", config)
    assert (content["targets_reached"], content["targets"]["min_frames"]) == (False, 3)
    options = ["--target-height-std-m", "0.02", "--min-frames", "2"]
    status, content = as_json(capsys, bag, "--until-good", "--config", config, *options)
    assert (status, content["targets_reached"], len(content["frames"])) == (0, True, 2)


def test_every_pair_ends_by_itself(calibrator, capsys, tmp_path):
    sides = [
        Camera(side, f"/{where}/{side}/image_rect", f"/{where}/{side}/camera_info")
        for where in ("front", "rear")
        for side in ("left", "right")
    ]
    bag = make_bag(tmp_path / "two", sides, n_frames=4)
    status, content = as_json(capsys, bag, "--all", "--until-good", "--min-frames", "2")
    assert status == 0
    assert [(len(pair["frames"]), pair["targets_reached"]) for pair in content["pairs"]] == [(2, True)] * 2


WRONG = {
    "target without the option": (["--target-height-std-m", "0.1"], "of --until-good only; give it as well"),
    "frames without the option": (["--min-frames", "2"], "--min-frames: of --until-good only"),
    "below zero": (["--until-good", "--target-pitch-std-rad", "-0.1"], "target_pitch_std_rad is -0.1: it"),
    "no number": (["--until-good", "--target-roll-std-rad", "nan"], "target_roll_std_rad is nan: it must"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_bad_usage(bag, calibrator, capsys, wrong):
    options, words = WRONG[wrong]
    assert main([str(bag), *options]) == 2
    assert words in capsys.readouterr().err
    assert calibrator.made == []


@pytest.mark.parametrize(
    ("value", "words"),
    [("target_height_std_m: abc", "is 'abc': a number"), ("frames: 1.5", "frames is 1.5: a whole number")],
)
def test_bad_settings(bag, calibrator, tmp_path, capsys, value, words):
    config = tmp_path / "config.yaml"
    config.write_text(f"/**: {{ros__parameters: {{{value}}}}}")
    assert main([str(bag), "--until-good", "--config", str(config)]) == 2
    err = capsys.readouterr().err
    assert Path(config).name in err and words in err
