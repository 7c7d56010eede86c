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

"""Ordinary roads of three rigs, with the paint that is asked for, and any turn of the right camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import numpy as np

from stereo_selfcal.core.types import Image

from ..frames import READABLE
from ..road_pairs import RoadPair
from ..second_worlds.cameras import Turn
from ..second_worlds.drafts import SIDES, furnish, ordinary, sign
from ..second_worlds.scenes import Stripe
from ..second_worlds.worlds import World, finished
from .angles import AS_IT_IS, Angles

BOTH, ONE, NONE = "both lines", "one line", "no line"
PAINTS = (BOTH, ONE, NONE)
# A wide baseline, one of 12 cm with a short focal length, and the paper's: names of the second generator.
RIG_NAMES = ("kitti", "zed", "paper")
# How strong the texture of asphalt is that is called textured; bare asphalt has only what is larger than
# some metres.
_STRENGTH = (0.3, 1.2)


@dataclass(frozen=True)
class Road:
    """One road; with other paint, or another turn of the right camera, it is the same but for that.

    Attributes:
        rig_name: One of :data:`RIG_NAMES`.
        textured: Whether its asphalt has a texture.
        paint: Which lines it has, one of :data:`PAINTS`; all lines of the other side are out, too.
        seed: Seed of the series.
        index: Number within the series.
        paint_std_rad: Standard deviation of the angle between two lines; 0: they are parallel.
        plane: Whether the carriageway is a plane; otherwise it falls as roads do, the own lane to one side.
    """

    rig_name: str
    textured: bool
    paint: str
    seed: int
    index: int
    paint_std_rad: float = 0.0
    plane: bool = False

    @property
    def group(self) -> str:
        """What roads of its kind are called."""
        return f"{self.rig_name}, {'textured' if self.textured else 'bare'}, {self.paint}"

    @cached_property
    def world(self) -> World:
        """The road as a perfect rig sees it, with its paint."""
        world = self._ordinary()
        rng = np.random.default_rng([self.seed, self.index, RIG_NAMES.index(self.rig_name)])
        # Each line is as far from the lane's direction as the next one: the angle between them is drawn so.
        slopes = rng.normal(0.0, self.paint_std_rad / math.sqrt(2), len(world.scene.stripes))
        stripes = tuple(
            replace(stripe, slope=float(slope))
            for stripe, slope in zip(world.scene.stripes, slopes, strict=True)
            if self._has(stripe)
        )
        return replace(world, scene=replace(world.scene, stripes=stripes))

    @cached_property
    def _left(self) -> Image:
        return self.world.image("left")

    def pair(self, turn: Angles = AS_IT_IS, row_px: float = 0.0) -> RoadPair:
        """Render the road.

        Args:
            turn: How the right camera is turned.
            row_px: How many rows lower the content of the right image lies.
        """
        pitch, roll, yaw = np.radians(turn.as_array())
        world = replace(self.world, scene=replace(self.world.scene, turn=Turn(yaw, pitch, roll, row_px)))
        truth = world.truth.as_array() * READABLE
        return RoadPair(
            self.group,
            f"{self.seed}/{self.index}",
            self.group,
            "welcome",
            world.rig,
            self._left,
            world.image("right"),
            truth,
            truth,
        )

    def _ordinary(self) -> World:
        """Return the first good road of the rig among the draws of the series, with all its lines."""
        for attempt in count():
            number = RIG_NAMES.index(self.rig_name)
            rng = np.random.default_rng([self.seed, self.index, number, self.textured, attempt])
            draft = ordinary(rng, float(rng.uniform(*_STRENGTH)) if self.textured else 0.0)
            if draft.rig_name != self.rig_name:
                continue
            if self.plane:
                draft.crown = []
            furnish(draft)
            world = finished(draft, self.group, self.seed, self.index)
            if world.good:
                return world
        raise AssertionError("a series has no end")

    def _has(self, stripe: Stripe) -> bool:
        """Return whether a stripe is among the paint: an ordinary road has no other stripes than lines."""
        kept = sign(SIDES[self.index % 2])
        return self.paint == BOTH or (self.paint == ONE and stripe.t_m * kept > 0)


def roads(
    n_each: int,
    step: int,
    seed: int,
    textured: tuple[bool, ...] = (True, False),
    paints: tuple[str, ...] = PAINTS,
) -> list[Road]:
    """Return so many roads of each rig, surface and paint.

    Args:
        n_each: How many of each.
        step: One out of so many of them.
        seed: Seed of the series.
        textured: Whether their asphalt has a texture.
        paints: Their paint.
    """
    return [
        Road(rig_name, surface, paint, seed, index)
        for rig_name in RIG_NAMES
        for surface in textured
        for paint in paints
        for index in range(0, n_each, step)
    ]
