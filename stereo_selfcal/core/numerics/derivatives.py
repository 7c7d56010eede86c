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

"""Derivatives by central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..types import Array

Function = Callable[[Array], Array]


def central_difference(function: Function, at: Array, steps: npt.ArrayLike) -> Array:
    """Return the derivative of a function of P numbers.

    The truncation error grows with the square of the steps, the rounding error with their inverse.

    Args:
        function: Takes points (B, P), returns values (B, ...), all points at once (:func:`point_by_point`).
        at: (P,) point at which the derivative is taken.
        steps: (P,) steps to either side, or one step for all. A number with a step of 0 is not varied; its
            derivative is 0.

    Returns:
        (P, ...) derivative by each of the numbers.
    """
    steps = np.broadcast_to(np.asarray(steps, dtype=np.float64), at.shape)
    return _quotients(function(_around(at, steps)), steps)


def linearise(function: Function, at: Array, steps: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the value of a function (...) and its derivative (P, ...).

    The arguments are those of :func:`central_difference`.
    """
    steps = np.broadcast_to(np.asarray(steps, dtype=np.float64), at.shape)
    values = function(np.concatenate([at[None], _around(at, steps)]))
    return values[0], _quotients(values[1:], steps)


def point_by_point(function: Callable[[Array], npt.ArrayLike]) -> Function:
    """Return a function of many points (B, P) from one that takes a single point (P,)."""
    return lambda points: np.stack([np.asarray(function(point), dtype=np.float64) for point in points])


def _around(at: Array, steps: Array) -> Array:
    """Return the points after ``at``, then those before it, for each of V varied numbers, (2 V, P)."""
    changes = np.diag(steps)[steps != 0.0]
    return np.concatenate([at + changes, at - changes])


def _quotients(values: Array, steps: Array) -> Array:
    """Return the difference quotients (P, ...) of values (2 V, ...) at the points of :func:`_around`."""
    varied = steps != 0.0
    after, before = values[: len(values) // 2], values[len(values) // 2 :]
    quotients = np.zeros((len(steps), *values.shape[1:]))
    quotients[varied] = (after - before) / (2.0 * steps[varied]).reshape(-1, *[1] * (values.ndim - 1))
    return quotients
