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

"""Recordings changed where their formats have a meaning: read, or refused in one printable sentence."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.mutations import KINDS, read_mutations

ROOT = Path(__file__).resolve().parent.parent
MOST_PEAK_MB = 1_000


def test_mutated_recordings_are_read_or_refused_in_one_sentence(tmp_path):
    counts = read_mutations(range(10 * len(KINDS)), tmp_path)
    assert counts.faults == ()
    assert counts.read + counts.in_part + counts.refused == counts.mutations == 10 * len(KINDS)
    assert min(counts.read, counts.refused) > counts.mutations / 5
    assert counts.in_part > 0


@pytest.mark.slow
def test_peak_memory_and_time_of_mutated_recordings_have_a_limit():
    """Numbers of its own, and one at which a damaged PNG once took 4 GB and half a minute."""
    command = [sys.executable, "-m", "benchmarks.mutations"]
    for start, stop in ((1000, 1300), (1640, 1650)):
        run = subprocess.run(
            [*command, str(start), str(stop)], cwd=ROOT, capture_output=True, text=True, check=True
        )
        found = json.loads(run.stdout)
        assert found["faults"] == []
        assert not found["peak_mb"] > MOST_PEAK_MB
