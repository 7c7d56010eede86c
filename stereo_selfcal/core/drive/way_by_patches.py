"""How far a car has driven between two frames, by the surface of the road alone.

For roads with nothing beside them, where too few landmarks are found again. The near part of the later view
from above is looked for in the earlier one (normalised cross-correlation). It tells speed, and no angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ..estimators.road_patch import CELL_M, RoadPatch
from ..rejection import Bound, NotFitted
from ..types import Floats

_TEMPLATE_M, _ASIDE_M = 3.5, 0.3  # length of what is looked for, and how far aside it may be
_BLUR_CELLS = 3.0  # far cells are not sharper than this
_LEAST_CORRELATION = 0.4
# Best correlation of another way over that of the best one: dashes of a line repeat themselves.
_MOST_OF_OTHERS = 0.8
_OTHER_WAY_M = 0.5
# Errors of the way: of its place in the view, and of the pose (1 % of the height, a tenth of a degree).
_PLACE_STD_M, _STD_OF_WAY = 0.03, 0.02


@dataclass(frozen=True, slots=True)
class PatchStep:
    """How far the car has driven between two frames.

    Attributes:
        stamp_s: Time stamp of the first frame [s].
        duration_s: Time to the second frame [s].
        way_m: The way [m].
        std_m: Its standard deviation [m].
    """

    stamp_s: float
    duration_s: float
    way_m: float
    std_m: float

    @property
    def middle_s(self) -> float:
        """Time of the middle of the step [s]."""
        return self.stamp_s + self.duration_s / 2.0

    @property
    def speed_mps(self) -> float:
        """Mean speed [m/s]."""
        return self.way_m / self.duration_s


def road_step(before: tuple[float, RoadPatch], after: tuple[float, RoadPatch]) -> PatchStep | NotFitted:
    """Return how far the car has driven ahead between two frames.

    Args:
        before: Time stamp [s] and view of the road of the first frame.
        after: Those of the second frame.

    Returns:
        The step, or why there is none: the road has no texture, or one that repeats itself.
    """
    duration_s = after[0] - before[0]
    if not duration_s > 0.0:
        return NotFitted("time between two frames", duration_s, Bound.LEAST, 0.0, "s")
    earlier, later = (_texture(patch) for _, patch in (before, after))
    aside, rows = round(_ASIDE_M / CELL_M), round(_TEMPLATE_M / CELL_M)
    template = later[:rows, aside:-aside]
    if not float(template.std()) > 0.0:
        return NotFitted("correlation of the road in two frames", 0.0, Bound.LEAST, _LEAST_CORRELATION)
    found = np.asarray(cv2.matchTemplate(earlier, template, cv2.TM_CCOEFF_NORMED), np.float64)
    along = found.max(axis=1)
    best = int(along.argmax())
    peak = float(along[best])
    if not peak >= _LEAST_CORRELATION:
        return NotFitted("correlation of the road in two frames", peak, Bound.LEAST, _LEAST_CORRELATION)
    other = np.abs(np.arange(len(along)) - best) > _OTHER_WAY_M / CELL_M
    second = float(along[other].max(initial=0.0))
    if second > _MOST_OF_OTHERS * peak:
        return NotFitted(
            "correlation of another way over the best", second / peak, Bound.MOST, _MOST_OF_OTHERS
        )
    if not 0 < best < len(along) - 1:
        return NotFitted("way on the road in view", best * CELL_M, Bound.MOST, (len(along) - 2) * CELL_M, "m")
    below, above = float(along[best - 1]), float(along[best + 1])
    part = 0.5 * (below - above) / (below - 2.0 * peak + above)
    way_m = (best + part) * CELL_M + before[1].near_m - after[1].near_m
    return PatchStep(before[0], duration_s, way_m, math.hypot(_PLACE_STD_M, _STD_OF_WAY * way_m))


def _texture(patch: RoadPatch) -> Floats:
    """Return the grey values without what runs along the road: lines do not tell how far it is."""
    smooth = cv2.GaussianBlur(patch.grey.astype(np.float32), (0, 0), _BLUR_CELLS)
    texture: Floats = smooth - smooth.mean(axis=0)
    return texture
