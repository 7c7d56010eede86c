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

"""Equations without a solution: why there is none, and no exception."""

import numpy as np
import pytest

from stereo_selfcal.core.numerics.linear import (
    invert,
    invert_each,
    is_covariance,
    rank_of,
    solve_each,
    solve_linear,
)
from stereo_selfcal.core.rejection import NotFitted

REGULAR = np.array([[2.0, 1.0], [1.0, 3.0]])
SINGULAR = np.array([[1.0, 1.0], [1.0, 1.0]])


def test_what_has_a_solution_is_solved_as_numpy_does():
    right = np.array([1.0, 2.0])
    np.testing.assert_array_equal(solve_linear(REGULAR, right, "x"), np.linalg.solve(REGULAR, right))
    np.testing.assert_array_equal(invert(REGULAR, "x"), np.linalg.inv(REGULAR))
    each = np.stack([REGULAR, 2.0 * REGULAR])
    np.testing.assert_array_equal(invert_each(each), np.linalg.inv(each))
    right = np.ones((2, 2, 1))
    np.testing.assert_array_equal(solve_each(each, right), np.linalg.solve(each, right))


@pytest.mark.parametrize("fill", [np.nan, np.inf])
@pytest.mark.parametrize(
    "solve", [lambda a: invert(a, "numbers of x"), lambda a: solve_linear(a, a[0], "numbers of x")]
)
def test_what_has_none_says_how_much_is_determined(solve, fill):
    found = solve(SINGULAR)
    assert isinstance(found, NotFitted)
    assert found.reason == "numbers of x: 1, at least 2 needed"
    found = solve(np.full((2, 2), fill))
    assert isinstance(found, NotFitted) and found.value < found.limit


def test_among_many_equations_a_singular_one_spares_the_others():
    each = np.stack([REGULAR, SINGULAR])
    inverses = invert_each(each)
    np.testing.assert_allclose(inverses[0], np.linalg.inv(REGULAR), rtol=1e-12)
    np.testing.assert_allclose(inverses[1], SINGULAR / 4.0, atol=1e-12)
    solved = solve_each(each, np.ones((2, 2, 1)))
    np.testing.assert_allclose(solved[..., 0], [np.linalg.solve(REGULAR, [1.0, 1.0]), [0.5, 0.5]], atol=1e-12)
    broken = np.stack([REGULAR, SINGULAR, np.full((2, 2), np.nan)])
    np.testing.assert_allclose(invert_each(broken)[0], np.linalg.inv(REGULAR), rtol=1e-12)


def test_covariances_are_finite_and_positive_definite():
    assert is_covariance(REGULAR) and is_covariance(np.diag([1e-8, 1e-14, 1e-10]))
    for matrix in (SINGULAR, -REGULAR, np.zeros((2, 2)), REGULAR * np.nan, REGULAR * np.inf):
        assert not is_covariance(matrix)


def test_rank_of_what_is_not_finite_is_zero():
    assert (rank_of(REGULAR), rank_of(SINGULAR), rank_of(REGULAR * np.nan)) == (2, 1, 0)
