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

"""synth: what it writes, and what it refuses."""

import math

import pytest
import yaml

from stereo_selfcal.bags import StereoBag
from stereo_selfcal.cli.synth import main
from stereo_selfcal.synth import scenes

OPTIONS = {
    "--height-m": "1.25", "--pitch-deg": "2", "--roll-deg": "-1", "--yaw-deg": "0.5", "--offset-m": "0.1",
    "--curvature": "0.001", "--noise": "0.02", "--frames": "2", "--seed": "9",
}  # fmt: skip


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_options_reach_the_bag_and_its_truth(tmp_path, capsys, storage):
    path = tmp_path / "bag"
    arguments = [str(path), "--storage", storage, *(word for pair in OPTIONS.items() for word in pair)]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert str(path) in out
    truth = yaml.safe_load((path / "truth.yaml").read_text())
    assert truth["height_m"] == 1.25
    assert truth["pitch_rad"] == pytest.approx(math.radians(2), abs=1e-15)
    assert truth["roll_rad"] == pytest.approx(math.radians(-1), abs=1e-15)
    assert truth["lane_yaw_rad"] == pytest.approx(math.radians(0.5), abs=1e-15)
    assert (truth["lateral_offset_m"], truth["curvature_per_m"]) == (0.1, 0.001)
    assert (truth["noise_fraction"], truth["n_frames"], truth["seed"]) == (0.02, 2, 9)
    with StereoBag(path) as bag:
        assert bag.read_rig() == scenes.PAPER_RIG
        assert len(list(bag.frames())) == 2


def test_a_bump_reaches_the_truth(tmp_path):
    path = tmp_path / "bag"
    options = ["--rate-hz", "2", "--bump-at-s", "0.5", "--bump-pitch-deg", "0.4", "--bump-roll-deg", "1"]
    assert main([str(path), "--frames", "2", "--bump-height-m", "-0.02", *options]) == 0
    truth = yaml.safe_load((path / "truth.yaml").read_text())
    assert truth["bump"]["stamp_s"] == 100.5
    assert truth["bump"]["height_m"] == pytest.approx(truth["height_m"] - 0.02)
    assert truth["bump"]["pitch_rad"] == pytest.approx(truth["pitch_rad"] + math.radians(0.4))
    assert truth["bump"]["roll_rad"] == pytest.approx(math.radians(1))
    with StereoBag(path) as bag:
        assert [frame.stamp_s for frame in bag.frames()] == [100.0, 100.5]


def test_no_lines(tmp_path):
    assert main([str(tmp_path / "bag"), "--no-lines", "--frames", "1"]) == 0
    truth = yaml.safe_load((tmp_path / "bag" / "truth.yaml").read_text())
    assert truth["line_offsets_m"] == []
    assert truth["expected"] == "no_lines_found"


def test_named(tmp_path):
    assert main([str(tmp_path / "bag"), "--named", "noisy_20"]) == 0
    assert yaml.safe_load((tmp_path / "bag" / "truth.yaml").read_text())["name"] == "noisy_20"


@pytest.mark.slow
def test_named_all(tmp_path, capsys):
    folder = tmp_path / "deep" / "bags"
    assert main(["--named-all", str(folder)]) == 0
    names = [scene.name for scene in scenes.NAMED_SCENES]
    assert capsys.readouterr().out.splitlines() == [str(folder / name) for name in names]
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert size < 9e6, "the bags are committed"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "OUT_BAG is missing"),
        (["there"], "exists already and is not overwritten"),
        (["there/file/bag"], "there is no folder"),
        (["bag", "--frames", "0"], "n_frames is 0"),
        (["bag", "--noise", "2"], "noise"),
        (["bag", "--noise", "nan"], "--noise is nan"),
        (["bag", "--height-m", "0"], "height_m is 0"),
        (["bag", "--height-m", "high"], "invalid float value"),
        (["bag", "--pitch-deg", "inf"], "--pitch-deg is inf"),
        (["bag", "--seed", "-1"], "seed is -1"),
        (["bag", "--storage", "tape"], "invalid choice"),
        (["bag", "--named", "nothing"], "there is no scene 'nothing'"),
        (["bag", "--named", "curve", "--noise", "0"], "takes no option that changes it"),
        (["bag", "--named-all", "x"], "--named-all stands alone"),
        (["--named-all", "x", "--frames", "2"], "--named-all stands alone"),
        (["--named-all", "others"], "is no synthetic bag and is not replaced"),
    ],
)
def test_bad_usage(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    for folder in ("there", "others/straight_road"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "file").write_text("of a user")
    before = sorted(tmp_path.rglob("*"))
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.startswith("synth: ")
    assert err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_interrupted_writing_leaves_nothing(tmp_path, monkeypatch, capsys):
    def interrupted(self, index):
        raise KeyboardInterrupt

    monkeypatch.setattr(scenes.NamedScene, "frame", interrupted)
    assert main([str(tmp_path / "bag")]) == 130
    assert not list(tmp_path.iterdir())
