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

"""The pose of the greatest fitness, by Gauss-Newton steps from the closed form.

The fitness is that of the greater one of two sums of squares (:mod:`.fitness`). At its optimum, one of them
is least, or both are equal. So it is the least of a weighted sum of both, for one weight: of many weights,
that whose optimum has the greatest fitness is taken. The closed form needs no search, and is close enough for
these steps. The genetic algorithm finds the same pose from nothing; where the camera is known, it is not
needed.
"""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import SIDES
from ..geometry.pose import Extrinsics
from ..lanes.closed_form import solve_plane
from ..lanes.lane_pair import LanePattern
from ..numerics.linear import solve_each
from ..rejection import NotFitted
from ..types import Array
from .fitness import PatternFitness

# Weights of the parallelism that are tried: none, and so many powers of ten either way of the weight at which
# both sums bend equally. In each round they are closer to the best one of the round before.
_POWERS = np.linspace(-5.0, 5.0, 17)
_ROUNDS, _CLOSER = 5, 1 / 6


def fittest_nearby(
    pattern: LanePattern, fitness: PatternFitness, rig: StereoRig
) -> tuple[Extrinsics, float] | None:
    """Return the pose of the greatest fitness near the closed form, and its fitness; None without one.

    Args:
        pattern: The lines.
        fitness: Their fitness.
        rig: Intrinsics and baseline.
    """
    closed = solve_plane(pattern, rig)
    if isinstance(closed, NotFitted):
        return None
    start = closed.extrinsics.as_array()
    found = [_climb(fitness, camera, start) for camera in range(len(SIDES))]
    pose, value = max(found, key=lambda each: each[1])
    return Extrinsics.from_array(pose), value


def _climb(fitness: PatternFitness, camera: int, start: Array) -> tuple[Array, float]:
    """Return the pose of the greatest fitness in one camera, and its fitness."""
    best, value = start, float(fitness.fitness_in_camera(camera, start[None])[0])
    weights = np.concatenate([[0.0], 10.0**_POWERS])
    for closer in _CLOSER ** np.arange(1.0, _ROUNDS + 1.0):
        matching, parallelism = fitness.normal_equations(camera, best)
        unit = np.trace(matching[0]) / max(float(np.trace(parallelism[0])), np.finfo(np.float64).tiny)
        scaled = weights[:, None] * unit
        normal = matching[0] + scaled[..., None] * parallelism[0]
        tried = best + solve_each(normal, (matching[1] + scaled * parallelism[1])[..., None])[..., 0]
        values = np.nan_to_num(fitness.fitness_in_camera(camera, tried))
        first = int(np.argmax(values))
        if values[first] > value:
            best, value = tried[first], float(values[first])
        weights = weights[first] * 10.0 ** (closer * _POWERS) if weights[first] > 0.0 else weights[:1]
    return best, value
