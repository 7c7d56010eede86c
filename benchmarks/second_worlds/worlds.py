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

"""A world by its seed and index: its truth, whether it is fair, and its two images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from stereo_selfcal import Extrinsics, StereoRig

from .cameras import Camera, camera_pair, pose_over_plane
from .drafts import SIDES, Draft, furnish
from .kinds import GOOD_KINDS, Kind
from .rigs import is_low
from .scenes import Scene, Stripe
from .sensors import Image
from .shading import picture
from .shapes import SHAPES
from .streets import STREETS
from .traps import TRAPS, TURNED
from .weather import WEATHER

# A road must be flat enough that its plane is defined [m].
FLAT_M = 0.015
# So many rows of both images must show paint of the own lane.
LEAST_ROWS = 60
# So many of them each of its two sides, where the asphalt itself shows little.
LEAST_ROWS_A_SIDE = 20
_WIDE_ENOUGH_PX = 1.0  # narrower paint does not count
_CLEAR_WEAR = 0.5  # of more worn paint only a part counts
_STEP_M = 0.02


@dataclass(frozen=True)
class World:
    """A stereo pair with its truth.

    Attributes:
        seed: Seed of the series.
        index: Number within the series.
        kind: Name of its kind.
        rig_name: Name of its rig.
        scene: All that is rendered.
        fair: Whether its kind is one that a calibration must answer.
        reach_m: From where to where the own lane is seen.
        tags: Words about it.
        lines: The own lane's lines by side.
        one_side: Whether the paint of one side is enough, as the asphalt shows the rest.
    """

    seed: int
    index: int
    kind: str
    rig_name: str
    scene: Scene
    fair: bool
    reach_m: tuple[float, float]
    tags: frozenset[str]
    lines: dict[str, tuple[Stripe, ...]]
    one_side: bool

    @property
    def rig(self) -> StereoRig:
        """The rig as its users know it."""
        return self.scene.rig

    @cached_property
    def truth(self) -> Extrinsics:
        """Height, pitch and roll over the plane of the own lane, 3 to 15 m ahead."""
        plane, _ = self.scene.road.plane()
        return Extrinsics(*pose_over_plane(self.scene.mount, plane))

    @cached_property
    def unevenness_m(self) -> float:
        """How far the own lane leaves its plane at most."""
        return self.scene.road.plane()[1]

    @cached_property
    def paint_rows(self) -> dict[str, int]:
        """Rows of both images in which paint of the own lane can be seen, by side, and of either as "any"."""
        rows = [self._rows_with_paint(camera) for camera in self._cameras()]
        both = {side: rows[0][side] & rows[1][side] for side in SIDES}
        return {side: int(both[side].sum()) for side in SIDES} | {
            "any": int((both["left"] | both["right"]).sum())
        }

    @cached_property
    def good(self) -> bool:
        """Whether a calibration must answer: a fair kind, paint in view, and a road that is flat enough."""
        rows = self.paint_rows
        both = min(rows[side] for side in SIDES) >= LEAST_ROWS_A_SIDE
        enough = rows["any"] >= LEAST_ROWS and (both or self.one_side)
        return self.fair and enough and self.unevenness_m <= FLAT_M

    def render(self) -> tuple[Image, Image]:
        """Return the left and the right image, shape (rows, cols), the same ones at each call."""
        return self.image("left"), self.image("right")

    def image(self, side: str) -> Image:
        """Return the image of one camera, shape (rows, cols), the same one at each call."""
        number = SIDES.index(side)
        plane, _ = self.scene.road.plane()
        light, warmth = picture(self.scene, self._cameras()[number], plane)
        rng = np.random.default_rng([self.seed, self.index, 1 + number])
        return self.scene.sensor.develop(light, warmth, bool(number), rng)

    def _cameras(self) -> tuple[Camera, Camera]:
        scene = self.scene
        shift = scene.sensor.row_shift_px(scene.rig.height)
        return camera_pair(scene.rig, scene.mount, scene.turn, shift, 0.6 * np.roll(shift, 7))

    def _rows_with_paint(self, camera: Camera) -> dict[str, npt.NDArray[np.bool_]]:
        road = self.scene.road
        found: dict[str, npt.NDArray[np.bool_]] = {}
        for side in SIDES:
            rows = np.zeros(camera.rig.height, bool)
            for line in self.lines.get(side, ()):
                s = np.arange(*self.reach_m, _STEP_M)
                if line.dash_m:
                    s = s[np.mod(s - line.phase_m, line.dash_m + line.gap_m) < line.dash_m]
                s = s[(s > line.start_m) & (s < line.end_m)]
                t = np.full(len(s), line.t_m)
                seen = camera.project(road.world(s, t, road.section_m(t)))
                wide = line.width_m * camera.rig.fx / np.maximum(seen[:, 2], 1e-3) >= _WIDE_ENOUGH_PX
                inside = (seen[:, 2] > 0.3) & (
                    np.abs(seen[:, 0] - camera.rig.width / 2) < camera.rig.width / 2 - 2
                )
                inside &= (seen[:, 1] > 0) & (seen[:, 1] < camera.rig.height - 1) & wide
                if line.wear > _CLEAR_WEAR:
                    inside[::2] = False
                rows[np.round(seen[inside, 1]).astype(int)] = True
            found[side] = rows
        return found


def kinds(turned: bool = False) -> tuple[Kind, ...]:
    """Return all kinds of worlds.

    Args:
        turned: Whether those with a turned right camera are among them.
    """
    return (*GOOD_KINDS, *SHAPES, *STREETS, *WEATHER, *TRAPS, *(TURNED if turned else ()))


def draw(seed: int, index: int, *, turned: bool = False, kind: str | None = None) -> World:
    """Return one world; the same seed, index and arguments give the same one.

    Args:
        seed: Seed of the series.
        index: Number within it.
        turned: Whether worlds with a turned right camera are drawn, which are expected to be refused, too.
        kind: Name of the kind, None: any.
    """
    rng = np.random.default_rng([seed, index])
    choice = kinds(turned)
    shares = np.array([each.share for each in choice], dtype=np.float64)
    chosen = choice[int(rng.choice(len(choice), p=shares / shares.sum()))]
    if kind is not None:
        named = [each for each in kinds(turned=True) if each.name == kind]
        if not named:
            raise ValueError(f"there is no kind {kind!r}")
        chosen = named[0]
    draft = chosen.draw(rng)
    furnish(draft)
    return finished(draft, chosen.name, seed, index)


def finished(draft: Draft, kind: str, seed: int, index: int) -> World:
    """Return the world of a draft that is not changed any more.

    Args:
        draft: The draft.
        kind: Name of its kind.
        seed: Seed of the series.
        index: Number within the series.
    """
    if is_low(draft.mount):
        draft.tags.add("low_rig")
    lines = {side: tuple(draft.lines.get(side, ())) for side in SIDES}
    return World(
        seed,
        index,
        kind,
        draft.rig_name,
        draft.scene(),
        draft.fair,
        (draft.near_m, draft.view_m),
        frozenset(draft.tags),
        lines,
        draft.one_side,
    )
