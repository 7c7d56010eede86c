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

"""Names of topics, images, files and folders forge no line of what is said, and cost no output."""

import csv
import io
import json
import os
import sys
import unicodedata

import cv2
import pytest
import yaml
from bag_making import RIG, Camera, make_bag, picture
from fake_calibrator import use_fake

from stereo_selfcal.cli import console
from stereo_selfcal.cli.replay import main, pair_names
from stereo_selfcal.cli.synth import main as synth
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.fleet.outcome import BagOutcome, Status
from stereo_selfcal.fleet.table import csv_of
from stereo_selfcal.offline.csv_table import harmless

# A title for the terminal, a line to forge, one turned about, bytes that are no UTF-8, a separator of lines.
EVIL = {
    "escape": "\x1b]0;owned\x07",
    "line ends": "\r\nmount 9.9",
    "bidi": "\u202egnp",
    "no UTF-8": os.fsdecode(b"\xff\xfe"),
    "line separator": "\u2028x",
    "C1": "\x9b31m",
}


def is_clean(text):
    """Whether a terminal or a browser shows a text as it is, line by line."""
    lines = text.replace("\n", "")
    return all(unicodedata.category(letter)[0] != "C" for letter in lines) and "\u2028" not in lines


def images(tmp_path, name):
    folder = tmp_path / f"rec{name}"
    sides = (f"l{name}", f"r{name}")
    for side, of in zip(sides, ("left", "right"), strict=True):
        (folder / side).mkdir(parents=True)
        for number in (1, 2):
            _, content = cv2.imencode(".png", picture(of, number))
            (folder / side / f"{name}{number}.png").write_bytes(content.tobytes())
    (folder / "rig.yaml").write_text(yaml.safe_dump(RIG.to_mapping()))
    return folder, ["--left", sides[0], "--right", sides[1]]


@pytest.fixture
def calibrator(monkeypatch):
    return use_fake(monkeypatch)


@pytest.mark.parametrize("name", EVIL.values(), ids=EVIL)
def test_names_forge_no_line_of_any_output_and_cost_none(calibrator, capsys, tmp_path, name):
    folder, options = images(tmp_path, name)
    out = {option: tmp_path / f"out.{option}" for option in ("output", "report", "csv")}
    arguments = [str(folder), *options]
    for option, path in out.items():
        arguments += [f"--{option}", str(path)]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert said.err == "" and is_clean(said.out)
    assert len([line for line in said.out.splitlines() if line.startswith("mount")]) == 1
    said.out.encode()
    texts = {option: path.read_text("utf-8") for option, path in out.items()}
    assert all(map(is_clean, texts.values())), {option: is_clean(text) for option, text in texts.items()}
    rows = list(csv.DictReader(texts["csv"].splitlines()))
    assert [row["accepted"] for row in rows] == ["1", "1"]
    assert load_result(out["output"]).provenance["source"].startswith("rec")
    assert not [line for text in texts.values() for line in text.splitlines() if line.startswith("fused")]
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr().out
    assert said.count("\n") == 1 and is_clean(said)
    assert json.loads(said)["frames"][0]["name"] == f"{name}1.png"


@pytest.mark.parametrize("name", EVIL.values(), ids=EVIL)
def test_names_forge_no_line_of_an_error(capsys, tmp_path, name):
    assert main([str(tmp_path / f"none{name}")]) == 2
    assert main([str(tmp_path), "--config", str(tmp_path / name.replace("/", ""))]) == 2
    assert main([str(tmp_path), f"--no{name}"]) == 2
    assert synth([str(tmp_path / f"a{name}" / "b")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and is_clean(said.err) and said.err.count("\n") == 4
    said.err.encode()


def test_topics_forge_no_line(calibrator, capsys, tmp_path):
    evil = "\x1b[2J\nmount 9.9"
    sides = [
        Camera(side, f"/a{evil}/{side}/image_rect", f"/a{evil}/{side}/camera_info")
        for side in ("left", "right")
    ]
    bag = make_bag(tmp_path / "bag", sides)
    assert main([str(bag), "--report", str(tmp_path / "out.html")]) == 0
    said = capsys.readouterr().out
    assert is_clean(said) and "/a\\x1b[2J\\nmount 9.9/left/image_rect (3 images)" in said
    assert is_clean((tmp_path / "out.html").read_text("utf-8"))


def test_a_pair_has_the_name_of_a_file_whatever_its_topics_are_called():
    class Side:
        def __init__(self, base):
            self.base = base

    class Pair:
        def __init__(self, base):
            self.left, self.right = Side(f"{base}/left"), Side(f"{base}/right")

    assert pair_names([Pair("/front\n\x1b[2J"), Pair("/rear")]) == ["front___2J", "rear"]
    assert pair_names([Pair("/" + "a" * 300), Pair("/rear")]) == ["pair1", "pair2"]


@pytest.mark.parametrize(
    ("cell", "shown"),
    [
        ("=1+1", "'=1+1"),
        ("+1+1", "'+1+1"),
        ("-1+1", "'-1+1"),
        ("@SUM(1)", "'@SUM(1)"),
        ("\t=1+1", "\\t=1+1"),
        ("\r=1+1", "\\r=1+1"),
        ("\n=1+1", "\\n=1+1"),
        ("＝1+1", "'＝1+1"),
        ("a;=1+1", "a;'=1+1"),
        ("-1.png", "'-1.png"),
        ("-1.5", "-1.5"),
        ("-1e-5", "-1e-5"),
        (-1.5, -1.5),
        (-3, -3),
        ("pitch -2.2 deg; height +1 m", "pitch -2.2 deg; height +1 m"),
        (None, None),
    ],
)
def test_a_cell_is_no_formula_and_a_number_stays_what_it_is(cell, shown):
    assert harmless(cell) == shown


def test_a_table_of_frames_holds_no_formula(calibrator, capsys, tmp_path):
    folder, options = images(tmp_path, "=cmd|' !A")
    assert main([str(folder), *options, "--csv", str(tmp_path / "out.csv")]) == 0
    row = next(csv.DictReader((tmp_path / "out.csv").read_text().splitlines()))
    assert row["name"] == "'=cmd|' !A1.png"
    assert float(row["roll_rad"]) == pytest.approx(-0.02, abs=1) and not row["roll_rad"].startswith("'")


def test_what_is_said_is_said_on_a_terminal_of_few_letters(monkeypatch):
    content = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(content, encoding="ascii"))
    assert console.run("tool", lambda argv: sys.stdout.write("caf\u00e9") * 0, []) == 0
    assert content.getvalue() == b"caf\\xe9"


def test_the_table_of_a_fleet_holds_no_formula_and_no_escape():
    outcome = BagOutcome("=1+1\x1b[2J\udcff", Status.FAILED, "@x\n", "-1")
    text = csv_of([outcome])
    text.encode()
    row = next(csv.DictReader(text.splitlines()))
    assert (row["bag"], row["reason"], row["message"]) == ("'=1+1\\x1b[2J\\udcff", "'@x\\n", "-1")
