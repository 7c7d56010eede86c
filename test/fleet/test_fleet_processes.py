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

"""Workers of this machine: killed at their start, at work, all of them; stopped; recordings that hang."""

import multiprocessing
import os
import signal
import threading
import time

import pytest
from fleet_making import QUICK, Slow, deadly, make_bags, make_copies, run_fleet

from stereo_selfcal.fleet import processes
from stereo_selfcal.fleet.outcome import Status
from stereo_selfcal.fleet.processes import ProcessWorkers
from stereo_selfcal.fleet.scheduling import FleetRun
from stereo_selfcal.fleet.store import Bag
from stereo_selfcal.fleet.work import FleetSettings
from stereo_selfcal.fleet.workers import Failure, Job, WorkersError

pytestmark = pytest.mark.slow

SETTINGS = FleetSettings(QUICK)
HANGS_S = 8.0  # far longer than these recordings are silent, also on a busy machine
SILENT_S = 4.0  # longer than they are silent on a machine that does little else
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    return make_copies(tmp_path_factory.mktemp("fleet"), 3)


def statuses(done):
    return {name: item.outcome.status for name, item in done.items()}


def kill_at_start(monkeypatch, after_s, most):
    """Kill workers so long after their start, so many of them; return a list that gets one entry for each."""
    start, killed = processes._start_worker, []

    def start_and_kill():
        worker = start()
        if len(killed) < most:
            killed.append(worker)
            threading.Timer(after_s, worker.process.kill).start()
        return worker

    monkeypatch.setattr(processes, "_start_worker", start_and_kill)
    return killed


@pytest.mark.parametrize("after_s", [0.0, 0.05, 0.5])
def test_a_worker_killed_as_it_starts_is_replaced(roads, monkeypatch, after_s):
    killed = kill_at_start(monkeypatch, after_s, 2)
    with ProcessWorkers(2, PATIENCE_S) as workers:
        done = run_fleet(workers, roads, SETTINGS)
    assert len(killed) == 2
    assert statuses(done) == dict.fromkeys(["road0", "road1", "road2"], Status.CALIBRATED)


def test_where_every_worker_is_killed_as_it_starts_the_run_ends_with_the_reason(roads, monkeypatch):
    kill_at_start(monkeypatch, 0.0, 1000)
    with (
        ProcessWorkers(2, PATIENCE_S) as workers,
        pytest.raises(WorkersError, match=r"no worker is left: 5 in a row .* killed by signal 9"),
    ):
        run_fleet(workers, roads, SETTINGS)


def test_where_no_process_can_be_started_the_run_ends_with_the_reason(roads, monkeypatch):
    def refuse():
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(processes, "_start_worker", refuse)
    with (
        ProcessWorkers(2, PATIENCE_S) as workers,
        pytest.raises(WorkersError, match=r"no worker is left.*Resource temporarily unavailable"),
    ):
        run_fleet(workers, roads, SETTINGS)


def test_when_all_workers_are_killed_others_go_on(roads):
    with ProcessWorkers(2, PATIENCE_S) as workers:
        done = {}
        killed = []

        def on_done(item):
            done[item.bag.path.name] = item
            if len(done) == 1:
                killed.extend(worker.process.pid for worker in workers._workers)
                for pid in killed:
                    os.kill(pid, signal.SIGKILL)

        bags = [Bag.of(path, SETTINGS) for path in roads]
        FleetRun(workers, SETTINGS).run(bags, on_done)
    assert len(killed) == 2
    assert statuses(done) == dict.fromkeys(["road0", "road1", "road2"], Status.CALIBRATED)


def test_where_every_recording_kills_its_worker_each_is_a_row_and_the_run_ends(roads):
    with ProcessWorkers(2, PATIENCE_S) as workers:
        done = run_fleet(workers, roads, deadly(always=["road0", "road1", "road2"]))
    assert set(statuses(done).values()) == {Status.FAILED}
    assert all("the last one killed by signal 9" in item.outcome.reason for item in done.values())


@pytest.mark.parametrize("how", ["hanging", "stopping"])
def test_a_recording_that_hangs_is_given_up_and_the_others_are_done(roads, how):
    with ProcessWorkers(2, HANGS_S) as workers:
        done = run_fleet(workers, roads, deadly(**{how: ("road1",)}))
    assert statuses(done) == {
        "road0": Status.CALIBRATED,
        "road1": Status.FAILED,
        "road2": Status.CALIBRATED,
    }
    assert "no frame came for 8 s" in done["road1"].outcome.reason
    assert "--patience" in done["road1"].outcome.reason


def test_a_recording_that_gives_frames_may_take_longer_than_the_patience(tmp_path, monkeypatch):
    """Time counts between frames, not for the whole recording."""
    settings = Slow(QUICK)
    (path,) = make_bags(tmp_path, 1, n_frames=8)
    with ProcessWorkers(1, 60.0) as workers:
        begin_s = time.monotonic()
        run_fleet(workers, [path], settings)
        took_s = time.monotonic() - begin_s
    with ProcessWorkers(1, max(took_s * 0.9, SILENT_S)) as workers:
        assert statuses(run_fleet(workers, [path], settings)) == {path.name: Status.CALIBRATED}


def test_what_cannot_be_sent_or_raises_is_the_outcome_of_its_job_alone():
    jobs = [
        Job("unsendable", ("", "", 0), print, (lambda: 1,)),
        Job("raises", ("", "", 0), int, ("x",)),
        Job("unreturnable", ("", "", 0), memoryview, (b"x",)),
        Job("good", ("", "", 0), int, ("7",)),
    ]
    with ProcessWorkers(1, PATIENCE_S) as workers:
        for job in jobs:
            workers.submit(job)
        found = {}
        end_s = time.monotonic() + PATIENCE_S
        while len(found) < len(jobs) and time.monotonic() < end_s:
            done = workers.result(0.1)
            if done is not None:
                found[done[0].task] = done[1]
    assert found.pop("good") == 7
    assert set(found) == {"unsendable", "raises", "unreturnable"}
    assert all(isinstance(each, Failure) and "internal error" in each.reason for each in found.values())


def test_no_process_is_left_at_the_end(roads):
    with ProcessWorkers(2, PATIENCE_S) as workers:
        run_fleet(workers, roads[:1], SETTINGS)
        pids = [worker.process.pid for worker in workers._workers]
    assert pids
    assert not {child.pid for child in multiprocessing.active_children()} & set(pids)
