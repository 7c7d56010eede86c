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

"""An offset and a turn through the cells of a band: values, their uncertainty, cells that are wrong."""

import numpy as np
import pytest

from stereo_selfcal.core.evidence.row_offset import combine_cells
from stereo_selfcal.core.rejection import NotFitted

COLUMNS = np.linspace(-300.0, 300.0, 40)
OFFSET_PX, TURN_RAD = 0.4, 0.003


def cells_of(rng=None, std_px=0.0):
    cells = OFFSET_PX + TURN_RAD * COLUMNS
    return cells if rng is None else cells + std_px * rng.normal(size=len(cells))


def combine(cells, variance=1e-4, columns=COLUMNS):
    return combine_cells(cells, np.broadcast_to(variance, cells.shape), columns)


def gave_up(outcome):
    return isinstance(outcome, NotFitted)


def test_cells_on_a_line_give_it():
    found = combine(cells_of())
    assert found.offset_px == pytest.approx(OFFSET_PX, abs=1e-6)
    assert found.roll_rad == pytest.approx(TURN_RAD, abs=1e-8)


def test_cells_that_show_nothing_have_no_say():
    cells, variance = cells_of(), np.full(40, 1e-4)
    cells[::3], variance[::3] = 9.0, np.inf
    found = combine(cells, variance)
    assert found.offset_px == pytest.approx(OFFSET_PX, abs=1e-6)


@pytest.mark.parametrize("std_px", [0.01, 0.1])
def test_the_scatter_of_the_cells_is_the_uncertainty(std_px):
    """Whatever they say of their noise: it is the road that scatters, not the noise."""
    rng, off = np.random.default_rng(0), []
    for _ in range(300):
        found = combine(cells_of(rng, std_px))
        off.append(
            [(found.offset_px - OFFSET_PX) / found.std_px, (found.roll_rad - TURN_RAD) / found.roll_std_rad]
        )
    # Of 300 draws: to 4 %; a scale by the median of 40 residuals scatters by more.
    np.testing.assert_allclose(np.std(off, axis=0), 1.0, atol=0.3)
    assert found.std_px == pytest.approx(std_px / np.sqrt(40), rel=0.5)


def test_no_cell_counts_for_more_than_a_typical_one():
    """One that claims a thousandth of the others' deviation is off: the road scatters there as elsewhere."""
    rng, variance = np.random.default_rng(1), np.full(40, 1e-2)
    variance[35] = 1e-8
    errors = []
    for _ in range(100):
        errors.append(combine(cells_of(rng, 0.1), variance).offset_px - OFFSET_PX)
    assert np.sqrt(np.mean(np.square(errors))) < 1.4 * 0.1 / np.sqrt(40)


def test_wrong_cells_are_left_out():
    rng = np.random.default_rng(2)
    cells = cells_of(rng, 0.02)
    cells[3::4] += 1.5
    found = combine(cells)
    assert abs(found.offset_px - OFFSET_PX) < 4.0 * found.std_px
    assert abs(found.roll_rad - TURN_RAD) < 4.0 * found.roll_std_rad
    assert found.std_px < 0.02


def test_few_cells_are_no_offset():
    variance = np.full(40, np.inf)
    variance[:5] = 1e-4
    assert gave_up(combine_cells(cells_of(), variance, COLUMNS, least_cells=6))
    variance[5] = 1e-4
    assert not gave_up(combine_cells(cells_of(), variance, COLUMNS, least_cells=6))
