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

"""fleet: the command, from recordings to tables and index page, interrupted and resumed."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fleet_making import QUICK, make_bags, make_copies, quick_options

from stereo_selfcal.cli.fleet import listed, main
from stereo_selfcal.cli.replay import main as replay
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet import processes
from stereo_selfcal.fleet.store import Bag, Store
from stereo_selfcal.fleet.work import FleetSettings

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture
def nowhere():
    """Name a cluster that is not there: no work must be left for it."""
    pytest.importorskip("distributed")
    return ["--scheduler", "tcp://127.0.0.1:9"]


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    """Recordings, what replay says of them, and a fleet that has done them."""
    folder = tmp_path_factory.mktemp("fleet")
    make_bags(folder / "bags", 3)
    (folder / "bags" / "broken.mcap").write_bytes(b"no recording")
    arguments = [
        str(folder / "bags"),
        "--output",
        str(folder / "out"),
        "--workers",
        "2",
    ]
    return folder, arguments, main(arguments)


def table(folder):
    with (folder / "table.csv").open(newline="", encoding="utf-8") as file:
        return {Path(row["bag"]).name: row for row in csv.DictReader(file)}


@pytest.mark.slow
def test_a_run_with_a_broken_recording_is_complete_and_says_so(roads):
    folder, _, status = roads
    assert status == 1
    rows = table(folder / "out")
    assert {name: row["status"] for name, row in rows.items()} == {
        "broken.mcap": "failed",
        "road0": "calibrated",
        "road1": "calibrated",
        "road2": "calibrated",
    }
    assert "cannot be read as a recording" in rows["broken.mcap"]["reason"]
    assert "broken.mcap" in (folder / "out" / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_its_numbers_are_those_of_replay(roads, capsys):
    folder, _, _ = roads
    rows = table(folder / "out")
    for name in ("road0", "road1", "road2"):
        capsys.readouterr()
        assert replay([str(folder / "bags" / name), "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        (file,) = (folder / "out" / "results").glob(f"{name}-*.json")
        assert json.loads(file.read_text(encoding="utf-8"))["replay"] == said
        for key, value in said["extrinsics"].items():
            assert float(rows[name][key]) == value
        for key, value in said["std"].items():
            stem, unit = key.rsplit("_", 1)
            assert float(rows[name][f"{stem}_std_{unit}"]) == value


@pytest.mark.slow
def test_what_is_finished_is_not_done_again(roads, capsys, tmp_path, monkeypatch):
    folder, arguments, _ = roads
    before = {path: path.stat().st_mtime_ns for path in (folder / "out" / "results").glob("road*")}
    monkeypatch.setattr(processes, "_start_worker", lambda: pytest.fail("there is no work"))
    good = [str(folder / "bags" / name) for name in ("road2", "road0", "road1")]
    assert main([*good, *arguments[1:], "--table", str(tmp_path / "more.csv")]) == 0
    assert "3 recordings (3 of them before): 3 calibrated" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert list(table(folder / "out")) == ["road2", "road0", "road1"]
    assert (tmp_path / "more.csv").read_bytes() == (folder / "out" / "table.csv").read_bytes()


@pytest.mark.slow
def test_other_settings_need_a_cluster_again(roads, capsys, monkeypatch, nowhere):
    monkeypatch.setattr("stereo_selfcal.fleet.cluster._CONNECT_S", 0.5)
    folder, arguments, _ = roads
    assert main([str(folder / "bags" / "road0"), *arguments[1:3], "--seed", "1", *nowhere]) == 2
    assert "no scheduler answers" in capsys.readouterr().err
    assert table(folder / "out")["road0"]["status"] == "not_done"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: BAG"),
        (["x", "--workers", "0"], "0 is not in 1 ... "),
        (["x", "--patience", "0"], "0 is no time"),
        (["x", "--patience", "nan"], "not a time"),
        (["x", "--dashboard-port", "70000"], "no port"),
        (["x", "--dashboard-port", "-1"], "no port"),
        (
            ["x", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"],
            "--workers is of processes on this machine",
        ),
        (
            ["x", "--scheduler", "tcp://127.0.0.1:9", "--dashboard-port", "0"],
            "--dashboard-port is of processes",
        ),
        (["x", "--table", "x.xlsx"], "end the name in .csv or .parquet"),
        (["x", "--start", "3", "--end", "2"], "the first must be the smaller"),
        (["x", "--rig", "nowhere.yaml"], "cannot be read"),
        (["x", "--output", "/dev/null"], "choose a writable folder"),
        (["@nowhere"], "nowhere"),
        (["@/dev/zero"], "/dev/zero cannot be read: it is not a file"),
        (["@pipe"], "pipe cannot be read: it is not a file"),
        (["@huge"], "huge is no list of recordings: it is larger than 16777216 bytes"),
        (["@empty"], "the list names no recording"),
        (["x", "--every", "9" * 30], "is not in 1 ... 1000000000"),
        (["x", "--patience", "1e308"], "1e+308 is not a time in 0 ... 1000000000 s"),
    ],
)
def test_bad_usage(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    os.truncate(os.open("huge", os.O_CREAT | os.O_WRONLY), 2**40)
    (tmp_path / "empty").write_text("\n\n")
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err


@pytest.mark.parametrize(
    ("missing", "option"),
    [
        ("distributed", "--scheduler"),
        ("distributed", "--dashboard-port"),
        ("cryptography", "--dashboard-port"),
    ],
)
def test_what_a_cluster_needs_and_is_missing_is_named(monkeypatch, capsys, tmp_path, missing, option):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("stereo_selfcal.cli.fleet.find_spec", lambda name: None if name == missing else name)
    assert main(["x", option, "8786"]) == 2
    said = capsys.readouterr().err
    assert f"{missing} is missing" in said
    assert "pip install" in said


@pytest.mark.slow
def test_processes_of_this_machine_need_no_dask(roads, tmp_path):
    folder, _, _ = roads
    without = "import sys; sys.modules |= dict.fromkeys(['dask', 'distributed', 'cryptography']); "
    without += "from stereo_selfcal.cli.fleet import main; sys.exit(main(sys.argv[1:]))"
    script = tmp_path / "without.py"
    script.write_text(f"if __name__ == '__main__':\n    {without}\n", encoding="utf-8")
    command = [sys.executable, str(script), str(folder / "bags" / "road0"), "--output", str(tmp_path / "out")]
    command += quick_options(tmp_path)
    run = subprocess.run(command, env=environment(), text=True, capture_output=True, check=False)
    assert (run.returncode, "1 calibrated" in run.stdout) == (0, True), run.stderr


@pytest.mark.slow
def test_where_no_worker_can_start_the_command_ends_with_a_reason_and_a_status(
    roads, capsys, tmp_path, monkeypatch
):
    start = processes._start_worker

    def start_and_kill():
        worker = start()
        worker.process.kill()
        return worker

    monkeypatch.setattr(processes, "_start_worker", start_and_kill)
    folder, _, _ = roads
    assert main([str(folder / "bags" / "road0"), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        "fleet: no worker is left: 5 in a row ended as they started (the last one killed by signal 9)" in said
    )
    assert "Traceback" not in said
    assert table(tmp_path / "out")["road0"]["status"] == "not_done"


def test_what_is_in_the_way_of_a_result_is_said_before_any_work_is_done(tmp_path, capsys):
    bag = tmp_path / "road.mcap"
    bag.write_bytes(b"no recording")
    stem = Bag.of(bag, FleetSettings(CalibratorConfig())).stem
    (tmp_path / "out" / "results" / f"{stem}.json").mkdir(parents=True)
    assert main([str(bag), "--output", str(tmp_path / "out"), "--no-report"]) == 2
    assert "is in the way of a result: it is not a file; move it away" in capsys.readouterr().err


def environment(**more):
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])} | more


def wait_for_group_to_end(group):
    end_s = time.monotonic() + 30
    while time.monotonic() < end_s:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("processes are left")


@pytest.mark.slow
def test_interrupted_it_ends_cleanly_and_goes_on_where_it_was(tmp_path):
    make_copies(tmp_path / "bags", 6, n_frames=4)
    command = [sys.executable, "-m", "stereo_selfcal", "fleet", str(tmp_path / "bags")]
    command += ["--output", str(tmp_path / "out"), "--workers", "1", "--no-report", *quick_options(tmp_path)]
    # In a process group of its own, all of which gets the Ctrl-C, as in a terminal.
    run = subprocess.Popen(
        command,
        env=environment(),
        start_new_session=True,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    results = tmp_path / "out" / "results"
    end_s = time.monotonic() + 120
    while not (results.is_dir() and list(results.glob("*.json"))):
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.02)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == 130, errors
    assert "Traceback" not in errors
    assert re.search(r"\d of 6 done; the same command goes on from here", errors)
    wait_for_group_to_end(run.pid)  # no worker is left
    statuses = [row["status"] for row in table(tmp_path / "out").values()]
    finished = statuses.count("calibrated")
    assert 1 <= finished < 6
    assert statuses.count("not_done") == 6 - finished
    assert "Interrupted" in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    before = {path: path.stat().st_mtime_ns for path in results.glob("*.json")}
    again = subprocess.run(command, env=environment(), text=True, capture_output=True, check=False)
    assert again.returncode == 0, again.stderr
    assert f"6 recordings ({finished} of them before): 6 calibrated" in again.stdout
    assert f"{6 - finished} recordings to do" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.slow
def test_killed_again_and_again_it_loses_no_result_leaves_nothing_and_comes_to_an_end(tmp_path):
    bags = make_copies(tmp_path / "bags", 6)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    out = tmp_path / "out"
    command = [sys.executable, "-m", "stereo_selfcal", "fleet", str(tmp_path / "bags"), "--output", str(out)]
    command += ["--workers", "2", *quick_options(tmp_path)]
    store = Store(out, reports=True)
    settings = FleetSettings(QUICK)
    seen = set()
    for kills in range(2):
        run = subprocess.Popen(
            command,
            env=environment(TMPDIR=str(scratch)),
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end_s = time.monotonic() + 120
        while len(list((out / "results").glob("*.json"))) <= kills:
            assert run.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.01)
        acknowledged = set((out / "results").glob("*.json"))
        run.kill()
        run.wait()
        wait_for_group_to_end(run.pid)  # workers end with it
        assert seen <= acknowledged <= set((out / "results").glob("*.json"))
        finished = [bag for bag in bags if store.finished(Bag.of(bag, settings)) is not None]
        assert len(finished) >= len(acknowledged)
        seen = acknowledged
    again = subprocess.run(
        command, env=environment(TMPDIR=str(scratch)), text=True, capture_output=True, check=False
    )
    assert again.returncode == 0, again.stderr
    assert "of them before): 6 calibrated" in again.stdout
    assert not list(scratch.iterdir())
    assert {path.name for path in out.iterdir()} == {"results", "reports", "table.csv", "index.html"}
    assert not list(out.rglob(".*"))


def test_lines_of_a_list_are_paths_and_nothing_else(tmp_path, monkeypatch):
    """Not options, no lists of their own, and no text that has to be UTF-8."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list").write_bytes(b"a\n\n@list\r\n--every\nb \xff\n")
    names = [os.fsencode(path) for path in listed([Path("first"), Path("@list")])]
    assert names == [b"first", b"a", b"@list", b"--every", b"b \xff"]


@pytest.mark.slow
def test_an_output_folder_whose_name_forges_lines_is_told_printable(tmp_path, capsys):
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    folder = tmp_path / "out\nFORGED\x1b[31m"
    main([str(tmp_path / "x.mcap"), "--output", str(folder), "--workers", "1", "--no-report"])
    said = "".join(capsys.readouterr())
    assert "\x1b" not in said and "\nFORGED" not in said
