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

pytest.importorskip("distributed")

from fleet_making import make_bags

from stereo_selfcal.cli.fleet import main
from stereo_selfcal.cli.replay import main as replay

ROOT = Path(__file__).resolve().parent.parent.parent
NOWHERE = ["--scheduler", "tcp://127.0.0.1:9"]  # no work must be left for it


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
        "--dashboard-port",
        "0",
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
def test_what_is_finished_is_not_done_again(roads, capsys, tmp_path):
    folder, arguments, _ = roads
    before = {path: path.stat().st_mtime_ns for path in (folder / "out" / "results").glob("road*")}
    good = [str(folder / "bags" / name) for name in ("road2", "road0", "road1")]
    more = ["--table", str(tmp_path / "more.csv"), *NOWHERE]
    assert main([*good, *arguments[1:], *more]) == 0
    assert "3 recordings (3 of them before): 3 calibrated" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert list(table(folder / "out")) == ["road2", "road0", "road1"]
    assert (tmp_path / "more.csv").read_bytes() == (folder / "out" / "table.csv").read_bytes()


@pytest.mark.slow
def test_other_settings_need_a_cluster_again(roads, capsys, monkeypatch):
    monkeypatch.setattr("stereo_selfcal.fleet.cluster._CONNECT_S", 0.5)
    folder, arguments, _ = roads
    assert main([str(folder / "bags" / "road0"), *arguments[1:3], "--seed", "1", *NOWHERE]) == 2
    assert "no scheduler answers" in capsys.readouterr().err
    assert table(folder / "out")["road0"]["status"] == "not_done"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: BAG"),
        (["x", "--workers", "0"], "0 is less than 1"),
        (["x", "--table", "x.xlsx"], "end the name in .csv or .parquet"),
        (["x", "--start", "3", "--end", "2"], "the first must be the smaller"),
        (["x", "--rig", "nowhere.yaml"], "cannot be read"),
        (["x", "--output", "/dev/null"], "choose a writable folder"),
        (["@nowhere"], "nowhere"),
    ],
)
def test_bad_usage(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err


def test_dask_that_is_missing_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["x"]) == 2
    assert "pip install" in capsys.readouterr().err


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
    make_bags(tmp_path / "bags", 6, n_frames=4)
    command = [sys.executable, "-m", "stereo_selfcal", "fleet", str(tmp_path / "bags")]
    command += ["--output", str(tmp_path / "out"), "--workers", "1", "--dashboard-port", "0"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
    # In a process group of its own, all of which gets the Ctrl-C, as in a terminal.
    run = subprocess.Popen(
        command,
        env=environment,
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
    again = subprocess.run(command, env=environment, text=True, capture_output=True, check=False)
    assert again.returncode == 0, again.stderr
    assert f"6 recordings ({finished} of them before): 6 calibrated" in again.stdout
    assert f"{6 - finished} recordings to do" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before
