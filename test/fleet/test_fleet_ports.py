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

"""What another user of the machine can reach of a fleet that runs: as such a user, where tests are root."""

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fleet_making import make_bags

ROOT = Path(__file__).resolve().parent.parent.parent
NOBODY = 65534
PATIENCE_S = 120.0
RECORDINGS = 200

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        None in (shutil.which("ss"), shutil.which("ps")),
        reason="ports are listed by ss (iproute2) and ps (procps)",
    ),
]
as_another_user = pytest.mark.skipif(os.geteuid() != 0, reason="only root can try it as another user")

# Speaks to a port in every way that Dask and HTTP know, and prints what it has got: as another user, once all
# is imported that root alone may read.
INTRUDER = f"""
import os, signal, sys, urllib.request
address, mark = sys.argv[1:]
tls = None
try:
    from distributed import Client
    from distributed.security import Security
    tls = Security.temporary()
except ImportError:
    pass
os.setgroups([]); os.setgid({NOBODY}); os.setuid({NOBODY})
def too_long(*_):
    raise TimeoutError
signal.signal(signal.SIGALRM, too_long)
def attempt(name, act):
    signal.alarm(10)
    try:
        print(name, repr(act())[:300], flush=True)
    except BaseException as error:
        print("refused", name, type(error).__name__, flush=True)
    signal.alarm(0)
def get(path):
    return urllib.request.urlopen(f"http://{{address}}{{path}}", timeout=1).read()
for path in ("/", "/status", "/info/main/workers.html", "/metrics", "/health", "/json/counts.json"):
    attempt(path, lambda: get(path))
def run(protocol, security):
    client = Client(f"{{protocol}}://{{address}}", timeout=3, security=security)
    client.run_on_scheduler(lambda: open(mark, "w").close())
    return "ran code"
attempt("tcp", lambda: run("tcp", None))
attempt("tls", lambda: run("tls", tls))
os._exit(0)
"""


def processes_of(group):
    """Return the ids of the processes of a session."""
    listed = subprocess.run(
        ["ps", "-o", "pid=", "-s", str(group)], capture_output=True, text=True, check=False
    )
    return set(listed.stdout.split())


def ports_of(group):
    """Return the addresses on which the processes of a session listen, as ss lists them."""
    listed = subprocess.run(["ss", "-Hltnup"], capture_output=True, text=True, check=True).stdout
    pids, found = processes_of(group), set()
    for line in listed.splitlines():
        if pids & set(re.findall(r"pid=(\d+)", line)):
            found.add(line.split()[4])
    return found


@pytest.fixture
def fleet(tmp_path):
    """Start the command on recordings that take many minutes; return how."""
    (bag,) = make_bags(tmp_path / "bags", 1, n_frames=10)
    for index in range(RECORDINGS):
        shutil.copytree(bag, tmp_path / "bags" / f"copy{index}")
    runs = []

    def start(*options):
        command = [sys.executable, "-m", "stereo_selfcal", "fleet", str(tmp_path / "bags"), "--workers", "2"]
        command += ["--output", str(tmp_path / "out"), "--stretch", "0", *options]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        run = subprocess.Popen(command, env=environment, start_new_session=True, **pipes)
        runs.append(run)
        end_s = time.monotonic() + PATIENCE_S
        # The command, its workers, and what multiprocessing starts besides.
        while len(processes_of(run.pid)) < 4 and time.monotonic() < end_s:
            assert run.poll() is None, run.stderr.read()
            time.sleep(0.05)
        return run

    yield start
    for run in runs:
        run.kill()
        run.communicate()


def intrude(folder, addresses):
    """Return what another user was given at each port, a line each; nothing where all was refused."""
    marks = {address: folder / address.rpartition(":")[2] for address in addresses}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    runs = {
        address: subprocess.Popen([sys.executable, "-c", INTRUDER, address, str(mark)], **pipes)
        for address, mark in marks.items()
    }
    found = {}
    for address, run in runs.items():
        out, errors = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 0, errors
        found[address] = [line for line in out.splitlines() if not line.startswith("refused")]
        code_ran = any(line.startswith(("tcp", "tls")) for line in found[address])
        assert marks[address].exists() == code_ran
    return found


@as_another_user
def test_another_user_runs_code_where_dask_is_left_as_it_is(tmp_path):
    """What is tried here does find an open door."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=0, dashboard_address=None, host="127.0.0.1") as cluster:
        address = cluster.scheduler_address.removeprefix("tcp://")
        assert intrude(tmp_path, [address]) == {address: ["tcp 'ran code'"]}


def test_a_fleet_on_this_machine_has_no_port(fleet):
    run = fleet()
    seen = set()
    end_s = time.monotonic() + 3.0
    while time.monotonic() < end_s:
        assert run.poll() is None, "it ended too soon to be looked at"
        seen |= ports_of(run.pid)
        time.sleep(0.1)
    assert not seen


@as_another_user
def test_with_a_dashboard_another_user_reads_it_and_is_kept_out_of_every_other_port(fleet, tmp_path):
    pytest.importorskip("distributed")
    pytest.importorskip("cryptography", reason="certificates of the processes here are made by cryptography")
    run = fleet("--dashboard-port", "0")
    line = ""
    while "dashboard" not in line:
        line = run.stderr.readline().decode()
        assert line, "it ended"
    dashboard = re.search(r"127\.0\.0\.1:\d+", line)[0]
    ports = ports_of(run.pid)
    assert dashboard in ports
    assert len(ports) > 3
    assert all(address.startswith("127.0.0.1:") for address in ports)
    found = intrude(tmp_path, ports)
    assert run.poll() is None, "it ended too soon to be tried"
    assert not any(line.startswith(("tcp", "tls")) for line in found[dashboard])
    assert any("/status" in line for line in found.pop(dashboard))
    assert not any(found.values()), found
