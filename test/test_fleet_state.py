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

"""What a disk or an attacker makes of a fleet's folder is done again or told, and never believed."""

import pytest

from benchmarks.fleet_state import mutate_states
from stereo_selfcal.fleet import store

MUTATIONS = 60


@pytest.mark.slow
def test_a_mutated_folder_is_recomputed_or_told_and_never_a_traceback(tmp_path):
    report = mutate_states(tmp_path, MUTATIONS, seed=3)
    assert report.mutations == MUTATIONS
    assert (report.wrong, report.tracebacks, report.hangs) == (0, 0, 0)
    assert report.recomputed > MUTATIONS / 2
    assert report.told


@pytest.mark.slow
def test_the_same_mutations_find_a_reader_that_does_not_look_at_the_hash(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "_check", lambda content: "none")
    assert mutate_states(tmp_path, MUTATIONS, seed=3).wrong
