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

"""The history of a camera: what is marked when it was turned, and that noise is not."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from fleet_making import quick_options
from result_making import RIG, a_mount, write

from stereo_selfcal import Extrinsics
from stereo_selfcal.cli.fleet import main as fleet
from stereo_selfcal.cli.history import main
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.pose import POSE_NAMES
from stereo_selfcal.files.result_file import write_result
from stereo_selfcal.fleet.history import FALSE_MARKS, QUANTITIES, DriveResult, Known, history_of, least_marked
from stereo_selfcal.fleet.history_input import of_one_camera, read_sources
from stereo_selfcal.fleet.history_page import history_page
from stereo_selfcal.fleet.outcome import rig_of_text, rig_text
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene

# What a drive of some minutes leaves, in the order of QUANTITIES [m, rad].
STD = dict(zip((each.name for each in QUANTITIES), (9e-3, 3e-3, 5e-3, 2e-3, 5e-5, 6e-5, 3e-4), strict=True))
DAY_S = 86400.0


def drives(rng, n=10, turn=None, at=5, shared=0.0):
    """Return results as honest drives give them: their errors are as large as they say.

    Args:
        rng: Noise.
        n: Number of drives.
        turn: By how much numbers change, by name.
        at: Index of the drive from which on they do.
        shared: Part of each variance that all drives have in common.
    """
    common = {name: rng.normal(0.0, std * math.sqrt(shared)) for name, std in STD.items()}
    found = []
    for index in range(n):
        own = {name: rng.normal(0.0, std * math.sqrt(1.0 - shared)) for name, std in STD.items()}
        change = turn if turn and index >= at else {}
        known = {name: Known(common[name] + own[name] + change.get(name, 0.0), STD[name]) for name in STD}
        found.append(DriveResult(f"drive {index}", 1.7e9 + index * DAY_S, known))
    return found


def exact(values, name="pitch_rad", std=1.0):
    return [DriveResult(f"{index}", None, {name: Known(value, std)}) for index, value in enumerate(values)]


def told(history):
    return [(each.quantity.name, each.later, each.earlier) for each in history.changes]


@pytest.mark.parametrize("shared", [0.0, 0.5])
def test_a_camera_that_does_not_change_is_rarely_marked(shared):
    rng, n = np.random.default_rng(1), 600
    wrong = sum(bool(history_of(drives(rng, shared=shared)).changes) for _ in range(n)) / n
    assert wrong <= FALSE_MARKS + 3.0 * math.sqrt(FALSE_MARKS / n)
    assert (wrong > 0.01) == (shared == 0.0)  # what all drives share cancels in their differences


@pytest.mark.parametrize("name", STD)
def test_a_turn_is_marked_at_its_drive_and_nowhere_else(name):
    rng, n = np.random.default_rng(2), 60
    turn = {name: 7.0 * math.sqrt(2.0) * STD[name]}
    histories = [history_of(drives(rng, turn=turn)) for _ in range(n)]
    found = [(name, 5, 4) in told(history) for history in histories]
    assert sum(found) >= 0.95 * n
    others = [set(told(history)) - {(name, 5, 4)} for history in histories]
    assert sum(map(bool, others)) <= 0.15 * n
    assert all((index, name) not in history.marks for history in histories[:10] for index in (1, 2))


def test_a_change_as_large_as_the_page_says_would_be_marked():
    rng = np.random.default_rng(3)
    still = history_of(drives(rng))
    pitch = next(each for each in QUANTITIES if each.name == "pitch_rad")
    least = least_marked(still, pitch)
    for factor, marked in ((1.01, [("pitch_rad", 1, 0)]), (0.99, [])):
        pair = [DriveResult("a", None, drive.known) for drive in still.drives]
        first = {name: Known(0.0, std) for name, std in STD.items()}
        pair = [DriveResult("", None, first) for _ in range(10)]
        pair[1:] = [DriveResult("", None, first | {"pitch_rad": Known(factor * least, STD["pitch_rad"])})] * 9
        assert [each for each in told(history_of(pair)) if each[1] == 1] == marked


def test_noise_within_its_std_is_not_marked_and_the_same_values_known_better_are():
    values = [0.0, 1.0, -1.0, 0.5]
    assert told(history_of(exact(values))) == []
    assert told(history_of(exact(values, std=0.2)))


def test_a_slow_drift_is_told_against_the_first_drive_once():
    history = history_of(exact([0.0, 1.5, 3.0, 4.5, 6.0]))
    assert told(history) == [("pitch_rad", 3, 0)]
    assert history.changes[0].sentence.startswith("the camera is turned")
    assert (4, "pitch_rad") in history.marks


def test_a_drive_that_does_not_know_a_number_is_passed_over():
    results = exact([0.0, 0.0, 0.0, 9.0])
    results[2] = DriveResult("refused", None, {}, "refused")
    assert told(history_of(results)) == [("pitch_rad", 3, 1)]


def test_drives_are_in_order_of_time_where_all_have_one():
    rng = np.random.default_rng(4)
    results = drives(rng, 4)[::-1]
    assert [each.name for each in history_of(results).drives] == [f"drive {index}" for index in range(4)]
    without = [replace(results[0], stamp_s=None), *results[1:]]
    assert history_of(without).drives[0].name == "drive 3"


def test_page_marks_the_change_in_plot_table_and_words():
    rng = np.random.default_rng(5)
    results = drives(rng, turn={"alignment_yaw_rad": 0.01})
    results[7] = DriveResult("<b>", results[7].stamp_s, {}, "refused: <i>")
    results[8] = replace(results[8], moves=1, report="fleet/reports/a%20b.html")
    history = history_of(results)
    page = history_page(history, ["x.yaml: of <others>"], "made by <us>")
    assert "10 drives of one camera: 1 significant change<" in page
    assert (
        "Between drives 5 and 6 (2023-11-19 22:13): the right camera against the left one is turned" in page
    )
    charts = page.split("<svg")[1:]
    assert len(charts) == len(STD)
    assert ['class="moved"' in chart for chart in charts] == [False] * 6 + [True]
    (dots,) = (chart.split('class="changed" d="')[1].split('"')[0] for chart in charts if "changed" in chart)
    assert dots.count("M") == 4  # drives 6, 7, 9 and 10
    assert page.count('<span class="marked">') == 4
    assert "moved during drive 9" in page
    assert '<a href="fleet/reports/a%20b.html">drive 8</a>' in page
    for forged in ("<b>", "<i>", "<others>", "<us>"):
        assert forged not in page
    assert "http" not in page
    still = history_page(history_of(drives(np.random.default_rng(5))), [], "")
    assert "no significant change" in still
    assert 'class="changed"' not in still
    assert '<span class="marked">' not in still


def a_turned(angle_rad, **changes):
    """Return a result at some pitch."""
    pose = Extrinsics(1.4, 0.05 + angle_rad, 0.01)
    return a_mount(extrinsics=pose, covariance=a_mount().covariance, **changes)


def test_result_files_of_other_cameras_and_of_one_moment_are_left_out(tmp_path):
    alignment = Alignment(1e-4, -2e-4, 0.0, np.diag([1e-10, 4e-10, np.inf]))
    topics = "/left/image_rect /right/image_rect"
    write(tmp_path / "a.yaml", a_turned(0.0, stamp_s=1.7e9, alignment=alignment), topics)
    write(tmp_path / "b.yaml", a_turned(0.0, stamp_s=1.6e9, alignment=alignment), topics)
    write(tmp_path / "other_images.yaml", a_turned(0.1), "/rear/left /rear/right")
    write_result(
        tmp_path / "other_rig.yaml", a_turned(0.1), replace(RIG, fx=500.0, fy=500.0), source=topics, seed=7
    )
    write(tmp_path / "one_moment.yaml", a_turned(0.1, mount=None), topics)
    sources, unusable = read_sources(sorted(tmp_path.glob("*.yaml")), tmp_path)
    results, others = of_one_camera(sources)
    assert [each.name.rpartition("/")[2] for each in results] == ["b.yaml", "a.yaml"]
    assert set(results[0].known) == {*POSE_NAMES, "alignment_pitch_rad", "alignment_roll_rad"}
    assert results[1].known["alignment_roll_rad"] == Known(-2e-4, pytest.approx(2e-5))
    (problem,) = unusable
    assert problem.startswith(f"{tmp_path}/one_moment.yaml: ")
    assert len(others) == 2
    assert any("of the images of /rear/left and /rear/right" in problem for problem in others)
    assert any("rig.fx was 516.6, now it is 500" in problem for problem in others)


def test_of_several_cameras_the_one_with_the_most_results_is_taken(tmp_path):
    other = replace(RIG, fx=500.0, fy=500.0)
    write_result(tmp_path / "a.yaml", a_turned(0.0, stamp_s=1.6e9), other, source="x", seed=7)
    for name, stamp_s in (("b", 1.8e9), ("c", 1.7e9)):
        write(tmp_path / f"{name}.yaml", a_turned(0.0, stamp_s=stamp_s))
    results, others = of_one_camera(read_sources(sorted(tmp_path.glob("*.yaml")), tmp_path)[0])
    assert [each.name.rpartition("/")[2] for each in results] == ["c.yaml", "b.yaml"]
    assert others == [
        f"{tmp_path}/a.yaml: the calibration is of other cameras: rig.fx was 516.6, now it is 500 "
        "(a difference of at most 0.01 is allowed)"
    ]


@pytest.mark.parametrize(
    "text", ["", "640x480", rig_text(RIG).replace("fx=", "fz="), f"{rig_text(RIG)} more=1"]
)
def test_a_rig_is_read_as_it_was_written_or_not_at_all(text):
    assert rig_of_text(rig_text(RIG)) == RIG
    with pytest.raises(ValueError, match="rig"):
        rig_of_text(text)


@pytest.fixture(scope="module")
def fleets(tmp_path_factory):
    """Two fleets of one camera: it was turned by 3 deg before the second one."""
    folder = tmp_path_factory.mktemp("history")
    options = quick_options(folder)
    for name, pitches in (("before", (3.0, 3.0)), ("after", (6.0,))):
        for index, pitch_deg in enumerate(pitches):
            bag = folder / name / f"road{index}"
            bag.parent.mkdir(exist_ok=True)
            scene = custom_scene(name=name, n_frames=1, pitch_rad=math.radians(pitch_deg), seed=index)
            write_bag(bag, scene)
        assert (
            fleet([str(folder / name), "--output", str(folder / f"{name}_out"), "--workers", "1", *options])
            == 0
        )
    return folder


def test_two_fleets_show_the_turn_between_them(fleets, capsys):
    page = fleets / "history.html"
    both = [str(fleets / "before_out"), str(fleets / "after_out")]
    assert main([*both, "--output", str(page)]) == 1
    said = capsys.readouterr().out
    assert "3 drives, 3 with a calibration" in said
    assert "Between drives 2 and 3 (no date): the camera is turned" in said
    assert "nose down" in said
    text = page.read_text(encoding="utf-8")
    (link,) = {part.split('"')[0] for part in text.split('href="')[1:] if "after_out" in part}
    assert (fleets / link).is_file()
    assert main([both[0], "--output", str(page)]) == 0
    assert "No significant change." in capsys.readouterr().out


def test_json_has_every_comparison(fleets, capsys):
    both = [str(fleets / "before_out"), str(fleets / "after_out")]
    assert main([*both, "--output", str(fleets / "json.html"), "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert [len(drive["values"]) >= 3 for drive in content["drives"]] == [True] * 3
    marked = {each["quantity"]: each for each in content["comparisons"] if each["significant"]}
    assert math.degrees(marked["pitch_rad"]["difference"]) == pytest.approx(3.0, abs=0.3)


def test_a_damaged_result_is_left_out_and_said(fleets, capsys, tmp_path):
    results = tmp_path / "fleet" / "results"
    results.mkdir(parents=True)
    for file in (fleets / "before_out" / "results").iterdir():
        (results / file.name).write_bytes(file.read_bytes())
    file = sorted(results.iterdir())[0]
    file.write_text(
        file.read_text(encoding="utf-8").replace('"accepted": 1', '"accepted": 2'), encoding="utf-8"
    )
    arguments = [str(tmp_path / "fleet"), str(fleets / "after_out"), "--output", str(tmp_path / "x.html")]
    assert main(arguments) == 1
    assert f"left out: {file}: it is damaged; run the fleet again" in capsys.readouterr().err
    assert "it is damaged" in (tmp_path / "x.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["nothing"], "nothing"),
        (["empty"], "has no results of a fleet"),
        (["one.yaml"], "calibrations of one camera: 1, at least 2 are needed"),
        (["one.yaml", "two.yaml", "--output", "two.yaml"], "is the result two.yaml, which is read"),
    ],
)
def test_bad_usage(names, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for name in ("one.yaml", "two.yaml"):
        write(tmp_path / name, a_turned(0.0))
    assert main(names) == 2
    error = capsys.readouterr().err
    assert message in error
    assert not (tmp_path / "history.html").exists()
