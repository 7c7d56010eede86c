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
