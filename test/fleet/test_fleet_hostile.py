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

"""Folders and names that are meant to do harm: links in circles, pipes, devices, names that are no text."""

import csv
import json
import os
import socket
import subprocess
import time
from pathlib import Path

import pytest
from fleet_making import make_bags, run_fleet

from stereo_selfcal.cli.fleet import main
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet.bags import files_of, find_bags
from stereo_selfcal.fleet.outcome import Status
from stereo_selfcal.fleet.processes import ProcessWorkers
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings

SETTINGS = FleetSettings(CalibratorConfig())
HANGS_S = 8.0
AT_ONCE_S = 20.0  # takes milliseconds; without an end it would be hours


def test_links_that_lead_in_circles_end(tmp_path):
    """With n links to the folder above there are n to the power of forty ways through them."""
    (tmp_path / "drives" / "bag").mkdir(parents=True)
    (tmp_path / "drives" / "bag" / "metadata.yaml").touch()
    (tmp_path / "drives" / "itself").symlink_to("itself")
    for index in range(5):
        (tmp_path / "drives" / f"up{index}").symlink_to("..")
    begin_s = time.monotonic()
    assert find_bags([tmp_path]) == [tmp_path / "drives" / "bag"]
    bag = tmp_path / "drives" / "bag"
    for index in range(5):
        (bag / f"up{index}").symlink_to(tmp_path)
    assert {path.name for path, _ in files_of(bag)} == {"metadata.yaml"}
    assert time.monotonic() - begin_s < AT_ONCE_S


def test_a_folder_deeper_than_python_calls_ends(tmp_path):
    folder = os.open(tmp_path, os.O_RDONLY)
    for _ in range(1500):
        os.mkdir("d", dir_fd=folder)
        below = os.open("d", os.O_RDONLY, dir_fd=folder)
        os.close(folder)
        folder = below
    os.close(folder)
    try:
        # From where a path is too long for the system it cannot be looked at: the next run says so.
        (found,) = find_bags([tmp_path])
        assert found.is_relative_to(tmp_path)
    finally:
        subprocess.run(["rm", "-r", str(tmp_path / "d")], check=True)  # too deep for Python's own


def test_images_behind_a_link_are_part_of_a_recording(tmp_path):
    """Else a result would stay though they have changed."""
    (tmp_path / "camera").mkdir()
    (tmp_path / "camera" / "1.png").write_bytes(b"1")
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "left").symlink_to(tmp_path / "camera")
    before = Bag.of(tmp_path / "drive", SETTINGS).key
    (tmp_path / "camera" / "1.png").write_bytes(b"12")
    assert Bag.of(tmp_path / "drive", SETTINGS).key != before


@pytest.mark.slow
def test_what_is_no_file_ends_within_the_patience_and_is_a_row(tmp_path, monkeypatch):
    make_bags(tmp_path, 1)
    os.mkfifo(tmp_path / "pipe.mcap")
    os.mkfifo(tmp_path / "pipe.bag")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "folder" / "metadata.yaml")
    (tmp_path / "zeros.mcap").symlink_to("/dev/zero")
    (tmp_path / "circle.mcap").symlink_to("circle.mcap")
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as end:
        end.bind("socket.db3")
        paths = find_bags([tmp_path])
        names = {"pipe.mcap", "pipe.bag", "folder", "zeros.mcap", "circle.mcap", "socket.db3", "road0"}
        assert {path.name for path in paths} == names
        with ProcessWorkers(2, HANGS_S) as workers:
            done = run_fleet(workers, paths, SETTINGS)
    assert done.pop("road0").outcome.status is Status.CALIBRATED
    assert {item.outcome.status for item in done.values()} == {Status.FAILED}
    assert all(item.outcome.reason for item in done.values())


STRANGE = [
    "bytes\udcff.mcap",
    "escape\x1b[2J.mcap",
    "line\nfleet: all is well.mcap",
    "=1+1.mcap",
    "tab\t.mcap",
]


@pytest.mark.slow
def test_names_that_are_no_text_cost_no_row_no_page_and_no_line(tmp_path, capsys):
    (road,) = make_bags(tmp_path / "made", 1)
    bags = tmp_path / "bags"
    bags.mkdir()
    for name in STRANGE:
        (bags / name).write_bytes(b"no recording")
    road.rename(bags / "road\udcfe\x1b[31m")
    assert main([str(bags), "--output", str(tmp_path / "out"), "--workers", "1"]) == 1
    said = "".join(capsys.readouterr())
    assert "\x1b" not in said
    assert not any(line.startswith("fleet: all is well") for line in said.splitlines())
    table = (tmp_path / "out" / "table.csv").read_text(encoding="utf-8")
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "\x1b" not in table + page
    rows = list(csv.DictReader(table.splitlines()))
    assert len(rows) == len(STRANGE) + 1
    (good,) = [row for row in rows if row["status"] == "calibrated"]
    assert good["bag"].endswith(r"road\udcfe\x1b[31m")
    assert (tmp_path / "out" / good["report"]).is_file()
    assert good["report"].isascii()
    files = list((tmp_path / "out" / "results").iterdir())
    assert len(files) == len(rows)
    assert {json.loads(file.read_text(encoding="utf-8"))["outcome"]["bag"] for file in files} == {
        row["bag"] for row in rows
    }
    # The same again: what is calibrated is known by its strange name.
    assert main([str(bags), "--output", str(tmp_path / "out"), "--workers", "1"]) == 1
    assert "(1 of them before)" in capsys.readouterr().out


def test_a_name_with_a_nul_is_a_recording_that_cannot_be_read():
    path = Path("a\0b")
    assert find_bags([path]) == [path]
    assert Bag.of(path, SETTINGS).name == r"a\x00b"


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every folder")
def test_a_folder_that_cannot_be_read_is_a_row(tmp_path):
    (tmp_path / "closed").mkdir(mode=0)
    (tmp_path / "open.mcap").touch()
    assert find_bags([tmp_path]) == [tmp_path / "closed", tmp_path / "open.mcap"]
