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

"""A process that is killed while it writes leaves the last acknowledged result, or a newer one."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KILLS = 30

# A writer that is not atomic, and a little slow so that few kills will do.
CARELESS = """
import sys, time
from pathlib import Path
from benchmarks import kills
from stereo_selfcal.files import result_file

def careless(path, content):
    with Path(path).open("wb") as file:
        file.write(content[: len(content) // 2])
        file.flush()
        time.sleep(0.005)
        file.write(content[len(content) // 2 :])

result_file.write_atomically = careless
kills.main(sys.argv[1:])
"""


def report_of(folder, *program, seed=1):
    """Run in a process of its own, as it forks."""
    command = [sys.executable, *program, str(folder), str(KILLS), str(seed)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True)
    return json.loads(run.stdout)


def test_killed_writers_lose_nothing_that_was_acknowledged(tmp_path):
    # On a machine that does much else no writer may come to an end in its 30 ms: then others are started.
    acknowledged = 0
    for seed in range(1, 21):
        report = report_of(tmp_path, "-m", "benchmarks.kills", seed=seed)
        assert report["kills"] == KILLS
        assert (report["unreadable"], report["mixed"], report["older"]) == (0, 0, 0)
        assert report["left_after_restart"] == 0
        assert [path.name for path in tmp_path.iterdir()] == ["result.yaml"]
        acknowledged += report["acknowledged"]
        if acknowledged:
            break
    assert acknowledged > 0


def test_the_same_kills_find_a_writer_that_is_not_atomic(tmp_path):
    faults = 0
    for seed in range(1, 21):
        report = report_of(tmp_path, "-c", CARELESS, seed=seed)
        faults += report["unreadable"] + report["mixed"] + report["older"]
        if faults:
            break
    assert faults > 0
