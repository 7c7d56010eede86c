"""The tasks of a fleet: workers that die, recordings that fail, stretches of long ones."""

import json
import logging
import time
from pathlib import Path

import pytest

pytest.importorskip("distributed")

from fleet_making import deadly, make_bags, report_of

from stereo_selfcal.cli.report import as_json
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.fleet import cluster as cluster_module
from stereo_selfcal.fleet.cluster import ClusterError, existing_cluster, local_cluster
from stereo_selfcal.fleet.outcome import Status
from stereo_selfcal.fleet.scheduling import FleetRun
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.offline import BagSource, calibrate_recording

# A cluster of workers, which the tests share.
pytestmark = pytest.mark.slow

PATIENCE_S = 180.0
SETTINGS = FleetSettings(CalibratorConfig())


@pytest.fixture(scope="module")
def cluster():
    with local_cluster(workers=2, dashboard_port=0, allowed_failures=1) as client:
        yield client


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    return make_bags(tmp_path_factory.mktemp("fleet"), 3)


def run(client, paths, settings=SETTINGS, **options):
    done = {}

    def on_done(item):
        assert item.bag.path.name not in done
        done[item.bag.path.name] = item

    end_s = time.monotonic() + PATIENCE_S

    def on_wait():
        assert time.monotonic() < end_s, "nothing comes in: is a worker left?"

    FleetRun(client, settings, **options).run([Bag.of(path, settings) for path in paths], on_done, on_wait)
    return done


def replayed(path):
    with BagSource([path]) as source:
        return calibrate_recording(source)


def test_workers_log_nothing(cluster):
    """A heartbeat that meets the end of the run would be an error with a traceback."""
    levels = cluster.run(lambda: logging.getLogger("distributed.worker").getEffectiveLevel())
    assert set(levels.values()) == {logging.CRITICAL}


@pytest.mark.parametrize("stretch_s", [None, 0.25], ids=["whole", "in stretches"])
def test_numbers_are_those_of_replay_to_the_last_digit(cluster, tmp_path, stretch_s):
    (path,) = make_bags(tmp_path, 1, n_frames=7)
    expected = replayed(path)
    found = run(cluster, [path], stretch_s=stretch_s)[path.name].calibrated.replay
    assert as_json(found) == as_json(expected)
    assert found.estimate.covariance.tolist() == expected.estimate.covariance.tolist()
    assert [row.recorded_ns for row in found.rows] == [row.recorded_ns for row in expected.rows]


def test_a_worker_that_is_killed_is_replaced_and_its_recording_done_again(cluster, roads, tmp_path):
    marker = tmp_path / "road1.died"
    done = run(cluster, roads, deadly(once=marker))
    assert marker.exists()
    assert {name: item.outcome.status for name, item in done.items()} == dict.fromkeys(
        ["road0", "road1", "road2"], Status.CALIBRATED
    )


def test_a_recording_that_kills_every_worker_is_a_row_and_the_others_are_done(cluster, roads):
    done = run(cluster, roads, deadly(always=["road1"]))
    assert done["road1"].outcome.status is Status.FAILED
    assert "died" in done["road1"].outcome.reason
    assert {done[name].outcome.status for name in ("road0", "road2")} == {Status.CALIBRATED}


def test_a_recording_that_cannot_be_read_is_a_row_with_its_reason(cluster, roads, tmp_path):
    (tmp_path / "broken.mcap").write_bytes(b"no recording")
    done = run(cluster, [tmp_path / "broken.mcap", tmp_path / "nowhere", roads[0]])
    assert done["broken.mcap"].outcome.status is done["nowhere"].outcome.status is Status.FAILED
    assert "cannot be read as a recording" in done["broken.mcap"].outcome.reason
    assert "no such file" in done["nowhere"].outcome.reason
    assert done["road0"].outcome.status is Status.CALIBRATED


def test_a_damaged_recording_in_stretches_ends_where_it_ends_as_a_whole(cluster, tmp_path):
    (path,) = make_bags(tmp_path, 1, n_frames=8)
    (file,) = path.glob("*.mcap")
    content = bytearray(file.read_bytes())
    middle = len(content) * 6 // 10
    content[middle : middle + 4096] = bytes(4096)
    file.write_bytes(content)
    expected = replayed(path)
    assert expected.damage is not None
    done = run(cluster, [path], stretch_s=0.3)[path.name]
    found = done.calibrated.replay
    assert found.damage == expected.damage
    assert done.outcome.status is Status.DAMAGED
    assert done.outcome.reason == expected.damage
    assert as_json(found) == as_json(expected)


def test_reports_are_made_by_workers_and_one_that_fails_costs_nothing_else(cluster, roads):
    done = run(cluster, roads, make_report=report_of)
    assert done["road0"].report.decode().startswith("<p>calibrated from 2 frames")
    assert done["road1"].report is None
    assert done["road1"].problem == "no report today"
    assert done["road1"].outcome.status is Status.CALIBRATED


def test_nothing_is_left_in_the_cluster_when_the_caller_stops(cluster, roads):
    class StopError(Exception):
        pass

    def on_done(item):
        raise StopError

    with pytest.raises(StopError):
        FleetRun(cluster, SETTINGS).run([Bag.of(path, SETTINGS) for path in roads], on_done)
    assert not cluster.futures or all(state.status != "pending" for state in cluster.futures.values())


def test_no_task_has_the_name_of_one_of_another_run(cluster):
    """Runs one after the other are often at one address; what is cancelled of the first was the second's."""

    class Names:
        def __init__(self):
            self.keys = []

        def submit(self, *_, key, **__):
            self.keys.append(key)
            raise ClusterError("enough")

        def cancel(self, *_, **__):
            pass

    assert cluster.status == "running"  # results are waited for with the client there is
    names = Names()
    for _ in range(20):
        with pytest.raises(ClusterError, match="enough"):
            FleetRun(names, SETTINGS).run([Bag("road", Path("road"), "road", "1")], lambda _: None)
    assert len(set(names.keys)) == 20


def test_an_existing_cluster_is_used_by_its_address(cluster, roads):
    with existing_cluster(cluster.scheduler.address) as client:
        done = run(client, roads[:1])
    assert done["road0"].outcome.status is Status.CALIBRATED
    assert json.dumps(done["road0"].outcome.to_mapping())


def test_a_scheduler_that_says_two_things_at_once_is_asked_again(cluster, monkeypatch):
    """A client that expects one message fails; one that fails every time is told."""
    connect, failures = cluster_module.Client, [AssertionError, AssertionError]

    def flaky(*arguments, **settings):
        if failures:
            raise failures.pop()
        return connect(*arguments, **settings)

    monkeypatch.setattr(cluster_module, "Client", flaky)
    with existing_cluster(cluster.scheduler.address) as client:
        assert client.status == "running"
    assert not failures
    failures += [AssertionError] * 5
    with pytest.raises(AssertionError), existing_cluster(cluster.scheduler.address):
        pass
    assert not failures


def test_no_cluster_at_an_address(monkeypatch):
    monkeypatch.setattr("stereo_selfcal.fleet.cluster._CONNECT_S", 0.5)
    with (
        pytest.raises(ClusterError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"),
        existing_cluster("tcp://127.0.0.1:9"),
    ):
        pass


def test_workers_of_other_versions_are_refused(cluster, monkeypatch):
    monkeypatch.setattr("numpy.__version__", "0.1")  # of this process, not of the workers
    with (
        pytest.raises(ClusterError, match=r"worker .* has .*, this process .* numpy 0\.1,"),
        existing_cluster(cluster.scheduler.address),
    ):
        pass
