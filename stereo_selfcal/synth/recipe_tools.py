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

"""What the recipes of worlds have in common.

A recipe takes the scene so far and a generator, and returns the scene with its ingredient; None where
the ingredient does not fit into it (no kerb in a bend, say).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .ingredients import Paint, WorldScene

Rng = np.random.Generator
Change = Callable[[WorldScene, Rng], WorldScene | None]

# A strip without end, as far as anybody sees.
ENDLESS_M = 1e4


def side_of_choice(rng: Rng) -> int:
    """Return 1 (left) or -1 (right)."""
    return 1 if rng.random() < 0.5 else -1


def border(scene: WorldScene, side: int) -> float:
    """Return where the own lane ends on one side (1 left, -1 right) [m]."""
    return scene.lane_m[1] if side > 0 else scene.lane_m[0]


def own_line(scene: WorldScene, side: int) -> int:
    """Return the index of the own lane's line on one side (1 left, -1 right)."""
    at = border(scene, side)
    return min(range(len(scene.paints)), key=lambda i: abs(scene.paints[i].line.offset_m - at))


def outermost(scene: WorldScene, side: int) -> float:
    """Return the outer edge of the paint on one side [m]."""
    edges = [side * paint.line.offset_m + paint.line.width_m / 2 for paint in scene.paints]
    # Where there is no paint, the lane ends there.
    return side * max(edges, default=side * border(scene, side))


def strip(edge_m: float, side: int, width_m: float = ENDLESS_M) -> tuple[float, float]:
    """Return the right and the left border of a strip that begins at an edge and goes to one side [m]."""
    return (edge_m, edge_m + width_m) if side > 0 else (edge_m - width_m, edge_m)


def with_own_line(scene: WorldScene, side: int, paint: Paint | None) -> WorldScene:
    """Return the scene with another line of the own lane on one side, or with none."""
    index = own_line(scene, side)
    others = (*scene.paints[:index], *scene.paints[index + 1 :])
    return replace(scene, paints=others if paint is None else (*others, paint))


def without_paint(scene: WorldScene, side: int) -> WorldScene:
    """Return the scene without the paint on one side of the rig, tram rails apart."""
    kept = tuple(p for p in scene.paints if (p.line.offset_m - scene.lateral_offset_m) * side < 0)
    return replace(scene, paints=kept)


def straight_without_kerb(scene: WorldScene, side: int) -> bool:
    """Return whether a kerb fits on one side: the road is straight and there is no step yet."""
    at = [*(kerb.face_m for kerb in scene.kerbs), *(step.edge_m for step in scene.steps)]
    return scene.shape.curvature_per_m == 0 and not any(d_m * side > 0 for d_m in at)
