"""Mutated result, parameter and rig files: read, or refused in one line; the benchmark of it in short."""

import pytest

from benchmarks.mutated_files import KINDS, mutate_files


@pytest.mark.parametrize("name", KINDS)
def test_whatever_is_in_a_file_it_is_read_or_refused_in_one_line(name):
    found = mutate_files(name, 60, seed=1)
    assert (found.tracebacks, found.unclear, found.hangs) == ((), (), 0)
    assert found.read > 0 and found.refused > found.read
    assert found.read + found.refused == found.mutations
