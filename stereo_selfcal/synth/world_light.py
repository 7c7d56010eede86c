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

"""Light of a world at night."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .ingredients import WorldScene
from .renderer import Array

# Right before the car the beam has not reached the road yet [m].
BEAM_BEGINS_M = 2.5


def lit(scene: WorldScene, s: npt.ArrayLike, d: npt.ArrayLike) -> Array | float:
    """Return the light at a place, as a share of the day's: 1 by day.

    Args:
        scene: The world.
        s: Positions along the road [m].
        d: Lateral positions [m].
    """
    lights = scene.headlights
    if lights is None:
        return 1.0
    s, d = np.asarray(s, np.float64), np.asarray(d, np.float64) - scene.lateral_offset_m
    ahead = np.maximum(s, 0.1)
    off = np.arctan2(d, ahead) / lights.spread_rad
    beam = 1 / (1 + (s * s + d * d) / lights.reach_m**2) * np.exp(-0.5 * off * off)
    beam *= 1 - np.exp(-np.square(ahead / BEAM_BEGINS_M))
    share: Array = lights.ambient + lights.near * beam
    return share
