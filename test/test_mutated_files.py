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

"""Mutated result, parameter and rig files: read, or refused in one line; the benchmark of it in short."""

import pytest

from benchmarks.mutated_files import KINDS, mutate_files


@pytest.mark.parametrize("name", KINDS)
def test_whatever_is_in_a_file_it_is_read_or_refused_in_one_line(name):
    found = mutate_files(name, 60, seed=1)
    assert (found.tracebacks, found.unclear, found.hangs) == ((), (), 0)
    assert found.read > 0 and found.refused > found.read
    assert found.read + found.refused == found.mutations
