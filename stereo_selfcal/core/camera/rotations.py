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

"""Rotation matrices that come from outside: whether they are rotations, and by how much they turn."""

from __future__ import annotations

import math

import numpy as np

from ..types import Array

# R of a CameraInfo is written with six digits or more, so a rotation is orthogonal to about 1e-6.
ROTATION_TOLERANCE = 1e-3


def rotation_error(matrix: Array) -> float:
    """Return by how much ``matrix @ matrix.T`` differs from the identity; infinite for a reflection.

    Args:
        matrix: (3, 3), of whatever numbers.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # impossible values may give infinity or NaN
        error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
        return math.inf if np.linalg.det(matrix) < 0 else error


def turn_deg(matrix: Array) -> float:
    """Return the angle of a rotation matrix (3, 3) [deg], infinite where it is none."""
    if not rotation_error(matrix) <= ROTATION_TOLERANCE:
        return math.inf
    return math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(matrix)) - 1.0) / 2.0))))
