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

"""What a fleet keeps: outcomes, result files, tables, the index page, and which recordings are meant."""

import csv
import io
import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleet_making import make_bags
from result_making import TRAVEL

from stereo_selfcal.cli.fleet import _Outcomes
from stereo_selfcal.core.alignment_verdict import report_alignment
from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.errors import ConfigError, OutputError
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.fleet.bags import find_bags
from stereo_selfcal.fleet.index import index_page
from stereo_selfcal.fleet.outcome import COLUMNS, BagOutcome, Status
from stereo_selfcal.fleet.scheduling import Done
from stereo_selfcal.fleet.store import Bag, Store
from stereo_selfcal.fleet.table import check_table, csv_of, write_table
from stereo_selfcal.fleet.work import (
    FleetSettings,
    Stretches,
    calibrate_bag,
    calibrate_stretch,
    join,
    stretches_of,
)
from stereo_selfcal.offline import BagSource, Selection, calibrate_recording
from stereo_selfcal.report.page import render_report

ROOT = Path(__file__).resolve().parent.parent.parent
SETTINGS = FleetSettings(CalibratorConfig())
GOOD = BagOutcome(
    "a, b",
    Status.CALIBRATED,
    message="calibrated",
    frames=3,
    accepted=2,
    extrinsics=Extrinsics(1.4000000000000001, 0.1 + 0.2, -0.0),
    std=Extrinsics(1e-3, 1e-5, 1e-4),
    report="reports/a.html",
)
BAD = BagOutcome("<b>", Status.FAILED, "no such file", "no such file")


@pytest.fixture(scope="module")
def road(tmp_path_factory):
    return make_bags(tmp_path_factory.mktemp("fleet"), 1, n_frames=3)[0]


def touch(path):
    state = path.stat()
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns + 1))


def test_a_finished_recording_is_not_done_again(road, tmp_path):
    store = Store(tmp_path)
    bag = Bag.of(road, SETTINGS)
    assert store.finished(bag) is None
    store.save(bag, replace(GOOD, report=""), {"accepted": True})
    assert store.finished(bag) == replace(GOOD, bag=str(road), report="")


def test_it_is_done_again_when_files_or_settings_change(road, tmp_path):
    store = Store(tmp_path)
    store.save(Bag.of(road, SETTINGS), replace(GOOD, report=""), None)
    others = [
        FleetSettings(CalibratorConfig(seed=1)),
        replace(SETTINGS, tolerance_s=0.01),
        replace(SETTINGS, left="/left"),
        replace(SETTINGS, rig=StereoRig(64, 48, 50.0, 50.0, 31.5, 23.5, 0.15)),
        replace(SETTINGS, selection=Selection(max_frames=1)),
        replace(SETTINGS, raw=True),
    ]
    keys = {Bag.of(road, settings).key for settings in others}
    assert len(keys) == len(others)
    assert all(store.finished(Bag.of(road, settings)) is None for settings in others)
    assert store.finished(Bag.of(road, SETTINGS)) is not None
    touch(next(road.glob("*.mcap")))
    assert store.finished(Bag.of(road, SETTINGS)) is None


@pytest.mark.parametrize("status", [Status.FAILED, Status.NOT_DONE])
def test_what_failed_is_tried_again(road, tmp_path, status):
    store = Store(tmp_path)
    store.save(Bag.of(road, SETTINGS), replace(BAD, status=status), None)
    assert store.finished(Bag.of(road, SETTINGS)) is None


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"{}",
        b'{"key": 1}',
        b"\xff",
        b'{"key": "KEY", "outcome": {"bag": "x"}}',
        b'{"key": "KEY", "outcome": {"bag": "x"}, "replay": null, "check": "x"}',
        b'{"key": "KEY", "outcome": [], "replay": NaN, "check": []}',
        b"[" * 100_000,
        b"9" * 100_000,
    ],
)
def test_a_result_file_that_is_none_is_made_anew(road, tmp_path, content):
    store = Store(tmp_path)
    bag = Bag.of(road, SETTINGS)
    store.save(bag, replace(GOOD, report=""), None)
    (file,) = (tmp_path / "results").iterdir()
    file.write_bytes(content.replace(b"KEY", bag.key.encode()))
    assert store.finished(bag) is None


def test_a_result_with_a_number_that_is_none_is_a_failed_row_and_no_end_of_the_others(road, tmp_path):
    bag = Bag.of(road, SETTINGS)
    outcomes = _Outcomes([bag], Store(tmp_path), None)
    assert outcomes.take(Done(bag, replace(GOOD, lane_yaw_rad=float("nan")))).status is Status.FAILED
    outcomes.write()
    assert "internal error: ValueError" in outcomes.summary()


def test_a_number_that_was_changed_in_a_result_file_is_not_believed(road, tmp_path):
    store = Store(tmp_path)
    bag = Bag.of(road, SETTINGS)
    store.save(bag, replace(GOOD, report=""), None)
    (file,) = (tmp_path / "results").iterdir()
    content = file.read_text(encoding="utf-8")
    file.write_text(content.replace("1.4000000000000001", "1.5"), encoding="utf-8")
    assert file.read_text(encoding="utf-8") != content
    assert store.finished(bag) is None


def test_a_pipe_or_a_device_in_the_place_of_a_result_is_not_read(road, tmp_path):
    store = Store(tmp_path)
    bag = Bag.of(road, SETTINGS)
    path = tmp_path / "results" / f"{bag.stem}.json"
    path.symlink_to("/dev/zero")
    assert store.finished(bag) is None
    path.unlink()
    os.mkfifo(path)
    assert store.finished(bag) is None
    with pytest.raises(OutputError, match="is in the way of a result"):
        store.check(bag)


def test_a_report_elsewhere_is_none_of_a_recording(road, tmp_path):
    """Its name in a result file becomes a link in the index."""
    store = Store(tmp_path)
    bag = Bag.of(road, SETTINGS)
    (tmp_path / "other.html").touch()
    for name in ("other.html", "javascript:alert(1)", "../other.html"):
        store.save(bag, replace(GOOD, report=name), None)
        assert store.finished(bag).report == ""


def test_a_recording_whose_report_is_gone_is_done_again(road, tmp_path):
    store = Store(tmp_path, reports=True)
    bag = Bag.of(road, SETTINGS)
    name = store.save_report(bag, b"<p>")
    store.save(bag, replace(GOOD, report=name), None)
    assert store.finished(bag).report == name
    (tmp_path / name).unlink()
    assert store.finished(bag) is None
    assert Store(tmp_path).finished(bag).report == ""


def test_recordings_of_one_name_in_two_folders_have_files_of_their_own(tmp_path):
    stems = {Bag.of(tmp_path / folder / "drive", SETTINGS).stem for folder in "ab"}
    assert len(stems) == 2
    assert all(stem.startswith("drive-") for stem in stems)


def test_names_of_files_are_plain(tmp_path):
    assert Bag.of(tmp_path / ("ü b/".strip("/") + "x" * 300), SETTINGS).stem.isascii()


def test_table_keeps_every_digit():
    rows = list(csv.DictReader(io.StringIO(csv_of([GOOD, BAD]))))
    assert tuple(rows[0]) == COLUMNS
    assert [row["bag"] for row in rows] == ["a, b", "<b>"]
    assert float(rows[0]["pitch_rad"]) == GOOD.extrinsics.pitch_rad
    assert rows[1]["height_m"] == ""
    assert rows[1]["reason"] == "no such file"


def test_no_cell_of_the_table_is_a_formula():
    names = {"bag": "=1+1", "message": "@SUM(A1)", "left": "+1", "right": "-x"}
    (row,) = csv.DictReader(io.StringIO(csv_of([replace(GOOD, **names)])))
    assert [row["bag"], row["message"], row["right"]] == ["'=1+1", "'@SUM(A1)", "'-x"]
    assert float(row["roll_rad"]) == 0.0


def test_parquet_has_the_types_of_the_columns(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_table(tmp_path / "x.parquet", [GOOD, BAD])
    table = parquet.read_table(tmp_path / "x.parquet")
    assert tuple(table.column_names) == COLUMNS
    assert table.to_pylist() == [GOOD.to_mapping(), BAD.to_mapping()]
    assert str(table.schema.field("height_m").type) == "double"
    assert str(table.schema.field("frames").type) == "int64"


def test_parquet_without_pyarrow_is_refused_with_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setattr("stereo_selfcal.fleet.table.find_spec", lambda name: None)
    with pytest.raises(OutputError, match="pip install pyarrow"):
        check_table(tmp_path / "x.parquet")
    with pytest.raises(OutputError, match=r"\.csv or \.parquet"):
        check_table(tmp_path / "x.xlsx")


@pytest.mark.parametrize(
    "change",
    [
        {"height_m": float("nan")},
        {"height_m": "1"},
        {"height_m": None},
        {"height_m": 10**400},
        {"height_m": True},
        {"status": "fine"},
        {"status": ["calibrated"]},
        {"more": 1},
        {"bag": None},
        {"message": 1},
        {"frames": -1},
        {"frames": 2.0},
        {"frames": True},
        {"moves": 2**63},
        {"with_reservations": 1},
        dict.fromkeys(["height_m", "pitch_rad", "roll_rad"]),
    ],
)
def test_a_row_is_checked_when_it_is_read(change):
    assert BagOutcome.from_mapping(GOOD.to_mapping()) == GOOD
    with pytest.raises(ConfigError):
        BagOutcome.from_mapping(GOOD.to_mapping() | change)


def test_index_links_every_report_and_escapes_names():
    page = index_page([GOOD, BAD, replace(BAD, status=Status.NOT_DONE)], "made by <us>")
    assert '<a href="reports/a.html">a, b</a>' in page
    assert "&lt;b&gt;" in page
    assert "<b>" not in page.replace("<b class", "")
    assert "Interrupted: 1 recordings are not done yet." in page
    assert "http" not in page
    assert "1 calibrated, 1 failed, 1 not done" in page


def test_index_has_causes_progress_alignment_and_what_was_said_below_each_row():
    facts = {"uncertainty": "71 % motion", "progress": "after 1 frame 9 mm", "alignment": "not_seen"}
    angles = {"alignment_pitch_rad": math.radians(0.1), "alignment_pitch_std_rad": math.radians(0.02)}
    good = replace(GOOD, message="fine; not checked", **facts, **angles)
    page = index_page([good, BAD], "")
    assert page.count("<tbody>") == 2
    for label, text in (
        ("Uncertainty", "71 % motion"),
        ("Progress", "after 1 frame 9 mm"),
        ("Right camera turned by", "pitch +0.100 ± 0.02°"),
    ):
        assert page.count(f'<b class="k">{label}:</b> {text}') == 1
    assert page.count('data-label="alignment">not seen</td>') == 1
    assert page.count("What was said:") == 2
    assert '<b class="k">What was said:</b> not checked<' in page


def test_recordings_are_found_below_folders_once_each(tmp_path):
    for name in ("b/metadata.yaml", "a/metadata.yaml", "split/x_0.mcap", "split/x_1.mcap", "loose/x.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "loose" / "y_0.mcap").touch()
    (tmp_path / "old.bag").touch()
    (tmp_path / "notes.txt").touch()
    names = ["a", "b", "loose/x.mcap", "loose/y_0.mcap", "old.bag", "split"]
    assert find_bags([tmp_path]) == [tmp_path / name for name in names]
    (tmp_path / "link").symlink_to("a")
    given = [tmp_path / "b", tmp_path / "b", tmp_path / "a", tmp_path / "link", tmp_path / "nowhere"]
    assert find_bags(given) == [tmp_path / "b", tmp_path / "a", tmp_path / "nowhere"]


def test_a_row_is_made_of_what_replay_found(road):
    with BagSource([road]) as source:
        replay = calibrate_recording(source)
    outcome = BagOutcome.from_replay("road", replay, ("l", "r"))
    assert outcome.status is Status.CALIBRATED
    assert (outcome.frames, outcome.accepted, outcome.left) == (3, 3, "l")
    assert outcome.extrinsics == replay.estimate.extrinsics
    assert outcome.std == replay.estimate.std
    assert outcome.to_mapping()["height_m"] == replay.estimate.extrinsics.height_m
    assert outcome.to_mapping()["roll_std_rad"] == replay.estimate.std.roll_rad
    assert outcome.message == replay.estimate.message
    assert json.loads(json.dumps(outcome.to_mapping()))["status"] == "calibrated"


def test_a_row_has_how_the_right_camera_is_turned_as_far_as_it_is_known(road):
    with BagSource([road]) as source:
        replay = calibrate_recording(source)
    alignment = Alignment(1e-4, -2e-4, 0.0, np.diag([1e-10, 4e-10, np.inf]))
    estimate = replace(replay.estimate, alignment=alignment)
    replay = replace(replay, drive=replace(replay.drive, estimate=estimate))
    row = BagOutcome.from_replay("road", replay, ("l", "r")).to_mapping()
    names = [name for name in row if name.startswith("alignment")]
    assert [row[name] for name in names] == [
        str(report_alignment(alignment, replay.rig).verdict),
        *(1e-4, -2e-4, None),
        *(pytest.approx(1e-5), pytest.approx(2e-5), None),
    ]
    assert BagOutcome.from_mapping(json.loads(json.dumps(row))).to_mapping() == row


@pytest.mark.parametrize(("travel", "yaw"), [(TRAVEL, (-1 / 30, 0.002)), (None, (None, None))])
def test_a_row_has_the_yaw_against_the_direction_of_travel_where_it_is_known(road, travel, yaw):
    with BagSource([road]) as source:
        replay = calibrate_recording(source)
    replay = replace(replay, drive=replace(replay.drive, estimate=replace(replay.estimate, travel=travel)))
    outcome = BagOutcome.from_replay("road", replay, ("l", "r"))
    row = outcome.to_mapping()
    assert (row["yaw_rad"], row["yaw_std_rad"]) == yaw
    assert BagOutcome.from_mapping(json.loads(json.dumps(row))) == outcome
    (cells,) = csv.DictReader(io.StringIO(csv_of([outcome])))
    assert cells["yaw_rad"] == ("" if travel is None else repr(-1 / 30))
    page = index_page([outcome], "")
    assert "<th>yaw [deg]</th>" in page
    assert (">-1.910 &plusmn; 0.11<" in page) is (travel is not None)


def test_a_yaw_that_is_not_known_better_than_that_of_any_mount_has_no_number(road):
    with BagSource([road]) as source:
        replay = calibrate_recording(source)
    unsure = replace(TRAVEL, covariance=np.diag([math.radians(1.2) ** 2, 9e-6]))
    replay = replace(replay, drive=replace(replay.drive, estimate=replace(replay.estimate, travel=unsure)))
    assert BagOutcome.from_replay("road", replay, ("l", "r")).yaw_rad is None


@pytest.mark.parametrize("bag", ["straight_road", "noisy_20"])
def test_what_the_report_calls_with_reservations_is_so_in_the_row(bag):
    with BagSource([ROOT / "bags" / bag]) as source:
        replay = calibrate_recording(source)
        page = render_report(source, replay)
    outcome = BagOutcome.from_replay("road", replay, ("l", "r"))
    assert outcome.status is Status.CALIBRATED
    assert outcome.with_reservations == ("Calibrated, with reservations" in page)


def test_a_row_with_reservations_is_one_in_table_page_and_json():
    doubtful = replace(GOOD, with_reservations=True)
    rows = list(csv.DictReader(io.StringIO(csv_of([GOOD, doubtful]))))
    assert [row["with_reservations"] for row in rows] == ["0", "1"]
    assert BagOutcome.from_mapping(json.loads(json.dumps(doubtful.to_mapping()))) == doubtful
    assert "with reservations" not in index_page([GOOD], "")
    page = index_page([GOOD, doubtful], "")
    assert "2 calibrated; 1 with reservations" in page
    assert page.count("calibrated, with reservations</b>") == 1
    assert '<b class="status reserved">' in page


def test_stretches_hold_every_frame_once(road):
    with BagSource([road]) as source:
        stretches = stretches_of(source, SETTINGS, 0.1)
        expected = [frame.recorded_ns for frame in source.frames()]
    assert isinstance(stretches, Stretches)
    parts = [calibrate_stretch(str(road), SETTINGS, selection) for selection in stretches.selections]
    assert [head.recorded_ns for part in parts for head, _ in part.frames] == expected


def test_images_without_a_partner_are_remarked_on_in_stretches_too(road):
    with BagSource([road]) as source:
        stretches = stretches_of(source, SETTINGS, 0.1)
    parts = [calibrate_stretch(str(road), SETTINGS, selection) for selection in stretches.selections]
    assert join(parts, SETTINGS).replay.remarks == ()
    short = [replace(part, n_images=(4, 3)) for part in parts]
    assert join(short, SETTINGS).replay.remarks == (
        "1 left and 0 right images have no partner of the same time",
    )
    assert join(short, replace(SETTINGS, selection=Selection(start_s=0.01))).replay.remarks == ()


@pytest.mark.parametrize(
    "change",
    [
        {"tolerance_s": 0.01},
        {"selection": Selection(every=2)},
        {"selection": Selection(max_frames=2)},
    ],
)
def test_where_frames_depend_on_those_before_there_are_no_stretches(road, change):
    with BagSource([road]) as source:
        assert stretches_of(source, replace(SETTINGS, **change), 0.05) is None


def test_selected_time_is_divided(road):
    with BagSource([road]) as source:
        stretches = stretches_of(source, replace(SETTINGS, selection=Selection(0.05, 0.15)), 0.05)
    borders = [(each.start_s, each.end_s) for each in stretches.selections]
    np.testing.assert_allclose(borders, [(0.05, 0.1), (0.1, 0.15)])


def test_a_fault_of_ours_is_a_reason_as_well(road, monkeypatch):
    def fail(*arguments, **more):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(sys.modules["stereo_selfcal.fleet.work"], "calibrate_recording", fail)
    assert "internal error: ZeroDivisionError: by zero" in calibrate_bag(str(road), SETTINGS).reason
