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

"""Linear equations that may have no solution: the reason why in place of an exception.

NumPy raises for a matrix that is exactly singular, and returns NaN for one with NaN in it. Images can lead to
both: two lines of one slope, cells in one column, a stripe without contrast.
"""

from __future__ import annotations

import numpy as np

from ..rejection import Bound, NotFitted
from ..types import Array


def solve_linear(matrix: Array, right: Array, what: str) -> Array | NotFitted:
    """Return the solution of linear equations, or why there is none.

    Args:
        matrix: (N, N) coefficients.
        right: (N,) or (N, K) right sides.
        what: What the equations determine: "numbers of the ... that the ... determine".
    """
    try:
        solution = np.asarray(np.linalg.solve(matrix, right), np.float64)
    except np.linalg.LinAlgError:
        return _undetermined(matrix, what)
    return solution if np.all(np.isfinite(solution)) else _undetermined(matrix, what)


def invert(matrix: Array, what: str) -> Array | NotFitted:
    """Return the inverse of a matrix (N, N), or why there is none; ``what`` as of :func:`solve_linear`."""
    try:
        inverse = np.asarray(np.linalg.inv(matrix), np.float64)
    except np.linalg.LinAlgError:
        return _undetermined(matrix, what)
    return inverse if np.all(np.isfinite(inverse)) else _undetermined(matrix, what)


def solve_each(matrices: Array, right: Array) -> Array:
    """Return the solutions of many symmetric equations; what one of them leaves open becomes zero.

    Args:
        matrices: (..., N, N) coefficients.
        right: (..., N, K) right sides.
    """
    try:
        return np.asarray(np.linalg.solve(matrices, right), np.float64)
    except np.linalg.LinAlgError:
        return invert_each(matrices) @ right


def invert_each(matrices: Array) -> Array:
    """Return the inverses of many symmetric matrices (..., N, N); pseudo-inverses where one is singular."""
    try:
        return np.asarray(np.linalg.inv(matrices), np.float64)
    except np.linalg.LinAlgError:
        finite = np.all(np.isfinite(matrices), axis=(-1, -2), keepdims=True)
        return np.linalg.pinv(np.where(finite, matrices, 0.0), hermitian=True)


def rank_of(matrix: Array, hermitian: bool = False) -> int:
    """Return the rank of a matrix; 0 where it is not finite."""
    return int(np.linalg.matrix_rank(matrix, hermitian=hermitian)) if np.all(np.isfinite(matrix)) else 0


def is_covariance(matrix: Array) -> bool:
    """Whether a symmetric matrix is finite and positive definite, so that it can be inverted to a weight."""
    if not np.all(np.isfinite(matrix)):
        return False
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _undetermined(matrix: Array, what: str) -> NotFitted:
    size = len(matrix)
    # Rounding may give a full rank to a matrix that has no finite inverse.
    return NotFitted(what, min(rank_of(matrix), size - 1), Bound.LEAST, size)
