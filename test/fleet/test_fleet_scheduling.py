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

"""The tasks of a fleet: workers that die, recordings that fail, stretches of long ones."""

import bag_making
import pytest
from fleet_making import QUICK, deadly, make_bags, make_copies, report_of, run_fleet

from stereo_selfcal.cli.report import as_json
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet.outcome import Status
from stereo_selfcal.fleet.processes import ProcessWorkers
from stereo_selfcal.fleet.scheduling import FleetRun
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.offline import BagSource, calibrate_recording

# Workers, which the tests share.
pytestmark = pytest.mark.slow

SETTINGS, QUICKLY = FleetSettings(CalibratorConfig()), FleetSettings(QUICK)


@pytest.fixture(scope="module")
def workers():
    with ProcessWorkers(2, 60.0) as workers:
        yield workers


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    return make_copies(tmp_path_factory.mktemp("fleet"), 3)


def replayed(path):
    with BagSource([path]) as source:
        return calibrate_recording(source)


@pytest.mark.parametrize("stretch_s", [None, 0.25], ids=["whole", "in stretches"])
def test_numbers_are_those_of_replay_to_the_last_digit(workers, tmp_path, stretch_s):
    (path,) = make_bags(tmp_path, 1, n_frames=7)
    expected = replayed(path)
    found = run_fleet(workers, [path], SETTINGS, stretch_s=stretch_s)[path.name].calibrated.replay
    assert as_json(found) == as_json(expected)
    assert found.estimate.covariance.tolist() == expected.estimate.covariance.tolist()
    assert [row.recorded_ns for row in found.rows] == [row.recorded_ns for row in expected.rows]


def test_a_worker_that_is_killed_is_replaced_and_its_recording_done_again(workers, roads, tmp_path):
    marker = tmp_path / "road1.died"
    done = run_fleet(workers, roads, deadly(once=marker))
    assert marker.exists()
    assert {name: item.outcome.status for name, item in done.items()} == dict.fromkeys(
        ["road0", "road1", "road2"], Status.CALIBRATED
    )


def test_a_recording_that_kills_every_worker_is_a_row_and_the_others_are_done(workers, roads):
    done = run_fleet(workers, roads, deadly(always=["road1"]))
    assert done["road1"].outcome.status is Status.FAILED
    assert "died" in done["road1"].outcome.reason
    assert {done[name].outcome.status for name in ("road0", "road2")} == {Status.CALIBRATED}


def test_a_recording_that_cannot_be_read_is_a_row_with_its_reason(workers, roads, tmp_path):
    (tmp_path / "broken.mcap").write_bytes(b"no recording")
    done = run_fleet(workers, [tmp_path / "broken.mcap", tmp_path / "nowhere", roads[0]], QUICKLY)
    assert done["broken.mcap"].outcome.status is done["nowhere"].outcome.status is Status.FAILED
    # The row names the recording beside it.
    assert done["broken.mcap"].outcome.reason.startswith("cannot be read as a recording")
    assert done["nowhere"].outcome.reason.startswith("no such file or folder")
    assert done["road0"].outcome.status is Status.CALIBRATED


def test_a_damaged_recording_in_stretches_ends_where_it_ends_as_a_whole(workers, tmp_path):
    (path,) = make_bags(tmp_path, 1, n_frames=8)
    (file,) = path.glob("*.mcap")
    content = bytearray(file.read_bytes())
    middle = len(content) * 6 // 10
    content[middle : middle + 4096] = bytes(4096)
    file.write_bytes(content)
    expected = replayed(path)
    assert expected.damage is not None
    done = run_fleet(workers, [path], SETTINGS, stretch_s=0.3)[path.name]
    found = done.calibrated.replay
    assert found.damage == expected.damage
    assert done.outcome.status is Status.DAMAGED
    assert done.outcome.reason == expected.damage
    assert as_json(found) == as_json(expected)


def test_repeated_images_in_stretches_are_those_of_the_whole(workers, tmp_path, monkeypatch):
    """The frame before a stretch is read as well, and how many came twice is counted over the whole."""
    shown = bag_making.picture
    monkeypatch.setattr(
        bag_making,
        "picture",
        lambda side, i, rig: shown(side, min(i, 2) if side == "right" else i, rig),
    )
    twice = [*bag_making.cameras(), *bag_making.cameras()]
    for name, cameras in (("frozen", bag_making.cameras()), ("twice", twice)):
        path = bag_making.make_bag(tmp_path / name, cameras, n_frames=8)
        expected = replayed(path)
        assert [row.reason for row in expected.rows].count("image_frozen") == 5
        assert any("came twice" in remark for remark in expected.remarks) == (name == "twice")
        found = run_fleet(workers, [path], SETTINGS, stretch_s=0.25)[name].calibrated.replay
        assert as_json(found) == as_json(expected)
        assert found.remarks == expected.remarks


def test_reports_are_made_by_workers_and_one_that_fails_costs_nothing_else(workers, roads):
    done = run_fleet(workers, roads, QUICKLY, make_report=report_of)
    assert done["road0"].report.decode().startswith("<p>calibrated from 2 frames")
    assert done["road1"].report is None
    assert done["road1"].problem == "no report today"
    assert done["road1"].outcome.status is Status.CALIBRATED


def test_nothing_is_left_to_do_when_the_caller_stops(workers, roads):
    class StopError(Exception):
        pass

    def on_done(item):
        raise StopError

    with pytest.raises(StopError):
        FleetRun(workers, QUICKLY).run([Bag.of(path, QUICKLY) for path in roads], on_done)
    assert workers.result(0.5) is None
    assert set(run_fleet(workers, roads[:1], QUICKLY)) == {"road0"}
