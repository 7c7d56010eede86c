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

"""Standard streams that are closed when a program starts: its files are written, its status is right."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bag_making import cameras, make_bag

ROOT = Path(__file__).resolve().parent.parent
CLOSED = [">&-", "2>&-", "<&- >&- 2>&-"]


def run(arguments, closed, folder):
    """Return exit status, and what is said on the streams that are open."""
    words = " ".join(f"'{each}'" for each in (sys.executable, "-m", "stereo_selfcal", *arguments))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", f"exec {words} {closed}"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("closed", CLOSED)
def test_every_command_writes_its_files_with_the_status_it_always_has(tmp_path, closed):
    bag = make_bag(tmp_path / "bag", cameras(), n_frames=1)
    cases = [
        (["replay", bag, "--csv", "out.csv", "--jobs", "2"], 1, "out.csv"),
        (["fleet", bag, "--output", "fleet", "--workers", "1", "--no-report"], 1, "fleet/index.html"),
        (["limits", "--plot", "out.png"], 0, "out.png"),
        (["synth", "made", "--frames", "1"], 0, "made/metadata.yaml"),
        (["replay", "nothing"], 2, None),
        (["replay", "--help"], 0, None),
        (["fly"], 2, None),
    ]
    for arguments, status, written in cases:
        found, text = run(arguments, closed, tmp_path)
        assert (arguments[0], found) == (arguments[0], status), text
        assert "Traceback" not in text and "Exception ignored" not in text
        assert written is None or (tmp_path / written).stat().st_size > 0


CODE = """
import os, sys
from stereo_selfcal.closed_streams import open_closed_streams
open_closed_streams()
with open("file.txt", "w") as file:
    os.system("echo a child; echo its complaint >&2")  # to the numbers 1 and 2, whatever they are now
    print("a line"); print("a complaint", file=sys.stderr)
    file.write(str(file.fileno() > 2))
"""


def test_no_file_gets_the_number_of_a_closed_stream_and_what_others_print(tmp_path):
    command = f"exec '{sys.executable}' -c '{CODE}' <&- >&- 2>&-"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, env=environment, check=False).returncode == 0
    assert (tmp_path / "file.txt").read_text() == "True"


@pytest.mark.slow
@pytest.mark.parametrize("closed", CLOSED)
def test_the_node_runs_and_ends_with_its_streams_closed(tmp_path, closed):
    pytest.importorskip("rclpy")
    from ros_domain import own_domain  # noqa: PLC0415 - for the node alone

    command = f"exec '{sys.executable}' -m stereo_selfcal node --ros-args -p output_path:=out.yaml {closed}"
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "ROS_LOG_DIR": str(tmp_path / "log"),
        "ROS_DOMAIN_ID": str(own_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    with subprocess.Popen(
        ["sh", "-c", command],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as node:
        until_s = time.monotonic() + 90
        while not list(tmp_path.glob("log/*")) and node.poll() is None and time.monotonic() < until_s:
            time.sleep(0.1)
        time.sleep(1.0)  # its log begins before its handlers of signals stand
        node.send_signal(signal.SIGINT)
        text, _ = node.communicate(timeout=90)
    assert node.returncode == 0, text
    assert "Traceback" not in text
