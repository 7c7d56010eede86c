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

"""Workers of a Dask cluster: of this machine with TLS, existing ones, clusters without workers."""

import logging
import time
from contextlib import contextmanager

import pytest

pytest.importorskip("distributed")

import dask
from distributed.security import Security
from fleet_making import NANNY_HEARS_S, QUICK, deadly, make_copies, report_of, run_fleet

from stereo_selfcal.fleet import cluster as cluster_module
from stereo_selfcal.fleet.cluster import DaskWorkers, existing_cluster, local_cluster
from stereo_selfcal.fleet.outcome import Status
from stereo_selfcal.fleet.scheduling import FleetRun
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.fleet.workers import WorkersError

# A cluster of workers, which the tests share.
pytestmark = pytest.mark.slow

SETTINGS = FleetSettings(QUICK)
PATIENCE_S = 60.0
HANGS_S = 8.0  # far longer than these recordings are silent, also on a busy machine
CALIBRATED = dict.fromkeys(["road0", "road1", "road2"], Status.CALIBRATED)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    pytest.importorskip("cryptography", reason="certificates of the processes here are made by cryptography")
    folder = tmp_path_factory.mktemp("cluster")
    with local_cluster(workers=2, dashboard_port=0, folder=folder, allowed_failures=1) as client:
        yield client
    assert not list(folder.iterdir())


@pytest.fixture
def workers(cluster):
    return DaskWorkers(cluster, PATIENCE_S)


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    return make_copies(tmp_path_factory.mktemp("fleet"), 3)


@contextmanager
def trusted(cluster):
    """Have the certificates of a cluster in the settings of Dask, where a user has those of another one."""
    security = cluster.security
    client = {"cert": security.tls_client_cert, "key": security.tls_client_key}
    settings = {"ca-file": security.tls_ca_file, "client": client}
    with dask.config.set({f"distributed.comm.tls.{name}": value for name, value in settings.items()}):
        yield cluster.scheduler.address


def statuses(done):
    return {name: item.outcome.status for name, item in done.items()}


def test_workers_log_nothing(cluster):
    """A heartbeat that meets the end of the run would be an error with a traceback."""
    levels = cluster.run(lambda: logging.getLogger("distributed.worker").getEffectiveLevel())
    assert set(levels.values()) == {logging.CRITICAL}


def test_what_is_said_on_a_cluster_of_this_machine_is_encrypted(cluster):
    addresses = [cluster.scheduler.address, *cluster.run(lambda: None)]
    assert len(addresses) == 3
    assert all(address.startswith("tls://127.0.0.1:") for address in addresses)


def test_whoever_has_no_certificate_of_it_is_kept_out(cluster, monkeypatch):
    monkeypatch.setattr("stereo_selfcal.fleet.cluster._CONNECT_S", 2.0)
    address = cluster.scheduler.address
    with pytest.raises(WorkersError, match=r"no certificate .*TLS__CA_FILE"), existing_cluster(address):
        pass
    plain = address.replace("tls:", "tcp:")
    with pytest.raises(WorkersError, match="no scheduler answers"), existing_cluster(plain):
        pass
    other = Security.temporary()  # a certificate that another cluster has made
    client = {"cert": other.tls_client_cert, "key": other.tls_client_key}
    with (
        dask.config.set({"distributed.comm.tls.ca-file": other.tls_ca_file}),
        dask.config.set({"distributed.comm.tls.client": client}),
        pytest.raises(WorkersError, match="no scheduler answers"),
        existing_cluster(address),
    ):
        pass


def test_a_cluster_makes_reports_and_the_numbers_of_replay(workers, roads):
    done = run_fleet(workers, roads, SETTINGS, make_report=report_of)
    assert statuses(done) == CALIBRATED
    assert done["road0"].report.decode().startswith("<p>calibrated from 2 frames")
    assert done["road1"].problem == "no report today"


def test_a_worker_that_is_killed_is_replaced_and_its_recording_done_again(workers, roads, tmp_path):
    marker = tmp_path / "road1.died"
    done = run_fleet(workers, roads, deadly(once=marker, after_s=NANNY_HEARS_S))
    assert marker.exists()
    assert statuses(done) == CALIBRATED


def test_a_recording_that_kills_every_worker_is_a_row_and_the_others_are_done(workers, roads):
    done = run_fleet(workers, roads, deadly(always=["road1"], after_s=NANNY_HEARS_S))
    assert statuses(done) == CALIBRATED | {"road1": Status.FAILED}
    assert "died" in done["road1"].outcome.reason


def test_a_recording_that_hangs_is_given_up_and_the_others_are_done(cluster, roads):
    done = run_fleet(DaskWorkers(cluster, HANGS_S), roads, deadly(hanging=("road1",)))
    assert statuses(done) == CALIBRATED | {"road1": Status.FAILED}
    assert "no frame came for 8 s" in done["road1"].outcome.reason


def test_nothing_is_left_in_the_cluster_when_the_caller_stops(cluster, workers, roads):
    class StopError(Exception):
        pass

    def on_done(item):
        raise StopError

    with pytest.raises(StopError):
        FleetRun(workers, SETTINGS).run([Bag.of(path, SETTINGS) for path in roads], on_done)
    assert not cluster.futures or all(state.status != "pending" for state in cluster.futures.values())


def test_no_task_has_the_name_of_one_of_another_run(cluster):
    """Runs one after the other are often at one address; what is cancelled of the first was the second's."""

    class Names:
        def __init__(self):
            self.keys = []
            self.status = "running"

        def submit(self, *_, key, **__):
            self.keys.append(key)
            raise WorkersError("enough")

        def cancel(self, *_, **__):
            pass

    names = Names()
    for _ in range(20):
        with pytest.raises(WorkersError, match="enough"):
            run_fleet(DaskWorkers(names, PATIENCE_S), ["road"], SETTINGS)
    assert len(set(names.keys)) == 20


def test_an_existing_cluster_is_used_by_its_address_with_tls(cluster, roads):
    with trusted(cluster) as address, existing_cluster(address) as client:
        done = run_fleet(DaskWorkers(client, PATIENCE_S), roads[:1], SETTINGS)
    assert address.startswith("tls://")
    assert statuses(done) == {"road0": Status.CALIBRATED}


def test_a_scheduler_that_says_two_things_at_once_is_asked_again(cluster, monkeypatch):
    """A client that expects one message fails; one that fails every time is told."""
    connect, failures = cluster_module.Client, [AssertionError, AssertionError]

    def flaky(*arguments, **settings):
        if failures:
            raise failures.pop()
        return connect(*arguments, **settings)

    monkeypatch.setattr(cluster_module, "Client", flaky)
    with trusted(cluster) as address:
        with existing_cluster(address) as client:
            assert client.status == "running"
        assert not failures
        failures += [AssertionError] * 5
        with pytest.raises(AssertionError), existing_cluster(address):
            pass
    assert not failures


def test_no_cluster_at_an_address(monkeypatch):
    monkeypatch.setattr("stereo_selfcal.fleet.cluster._CONNECT_S", 0.5)
    with (
        pytest.raises(WorkersError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"),
        existing_cluster("tcp://127.0.0.1:9"),
    ):
        pass


def test_workers_of_other_versions_are_refused(cluster, monkeypatch):
    monkeypatch.setattr("numpy.__version__", "0.1")  # of this process, not of the workers
    with (
        trusted(cluster) as address,
        pytest.raises(WorkersError, match=r"worker .* has .*, this process .* numpy 0\.1,"),
        existing_cluster(address),
    ):
        pass


def test_a_cluster_that_has_no_worker_left_ends_the_run_with_the_reason(tmp_path, roads):
    """Dask itself waits for ever."""
    pytest.importorskip("cryptography", reason="certificates of the processes here are made by cryptography")
    with local_cluster(workers=1, dashboard_port=0, folder=tmp_path) as client:
        client.cluster.scale(0)
        end_s = time.monotonic() + PATIENCE_S
        while client.nthreads() and time.monotonic() < end_s:
            time.sleep(0.1)
        with pytest.raises(WorkersError, match=r"the cluster has had no worker for 8 s; start workers"):
            run_fleet(DaskWorkers(client, HANGS_S), roads, SETTINGS)


def test_what_a_killed_cluster_has_left_in_the_folder_is_removed_by_the_next(tmp_path):
    left = tmp_path / ".stereo_selfcal_fleet.left"
    (left / "dask-scratch-space").mkdir(parents=True)
    with cluster_module._scratch(tmp_path) as scratch:
        assert not left.exists()
        with cluster_module._scratch(tmp_path):  # of a run beside it
            assert scratch.exists()
    assert not list(tmp_path.iterdir())
