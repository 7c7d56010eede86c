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

"""Random worlds like real roads, good and bad mixed, each with its truth and the expected verdict.

With a probability of :data:`GOOD_SHARE` nothing in a world prevents a calibration. One is expected then,
unless the noise hides the paint or too little paint is in view. With :data:`BAD_SHARE` something prevents it,
and a wrong calibration is the fault to be avoided. In all other worlds a calibration is welcome if it is
right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal.core.errors import ConfigError

from ..core.geometry.pose import Extrinsics
from .ingredients import Camera, Paint, WorldScene
from .regression_worlds import REGRESSION_WORLDS
from .renderer import Frame
from .world import LaneLine, Photometry, Side
from .world_light import lit
from .world_rays import WorldRays
from .world_recipes import ALL, FIRST, INGREDIENTS, Catalogue, Expected, Ingredient
from .world_renderer import render_scene
from .world_rigs import RIGS, Mount

GOOD_SHARE, BAD_SHARE = 0.60, 0.25
# A world is no longer good where the noise of a pixel exceeds half the contrast of its palest line in
# the deepest shadow: the paper's own limit, noise of 20 % with paint 123 grey levels above asphalt, is 2.4.
MIN_CONTRAST_TO_NOISE = 2.0
# Nor where fewer rows than this share of the image show paint: one short dash is no line.
MIN_ROWS = 0.1
LIT_M = 10.0  # at night, the light that counts is that on the lines so far ahead
SEEN_M, SEEN_SAMPLES = (1.0, 80.0), 1500  # where to look for paint, in steps well below a row
MOST_INGREDIENTS = 4  # harmless ones in one world

SIDES: tuple[Side, ...] = ("left", "right")

ROLL_DEG = 3.0
YAW_DEG = 2.0
OFFSET_M = 0.4
LANE_WIDTH_M = (2.7, 3.75)
LINE_WIDTH_M = (0.10, 0.30)
NOISE_MAX = 0.10
TEXTURE_MAX = 6.0
BARE_SHARE = 0.15  # share of the worlds whose road surface has no texture

# Length of dash and gap [m] by national standard; None is a solid line.
DASHES: dict[str, tuple[float, float] | None] = {
    "solid": None,
    "de_urban": (3.0, 6.0),  # RMS: urban
    "de_rural": (4.0, 8.0),  # RMS: rural
    "de_warning": (4.0, 2.0),  # RMS: warning line
    "de_motorway": (6.0, 12.0),  # RMS: motorway
    "us": (3.05, 9.14),  # MUTCD: 10 ft and 30 ft
    "fr_t1": (3.0, 10.0),  # IISR: T1
    "uk_1005": (2.0, 7.0),  # TSRGD: lane line
    "jp": (5.0, 5.0),  # lane line on ordinary roads
}
SOLID_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class World:
    """A stereo frame to be rendered and judged.

    Attributes:
        scene: The scene.
        truth: The pose a calibration should find; see :meth:`WorldScene.truth` for roads with height.
        ingredients: Names of what is in it beyond painted lines on a plane.
        expected: "accept", "either" or "refuse", the worst of its ingredients.
        rig_name: Which of the rigs.
    """

    scene: WorldScene
    truth: Extrinsics
    ingredients: tuple[str, ...]
    expected: Expected
    rig_name: str


def render_world(world: World, rng: np.random.Generator) -> tuple[Frame, Frame]:
    """Render both cameras, (H, W) uint8 each; ``rng`` draws the noise."""
    return render_scene(world.scene, rng)


def render_named_world(name: str) -> tuple[World, Frame, Frame]:
    """Return a world by its name and its images, (H, W) uint8 each: the same bytes every time."""
    drawn = REGRESSION_WORLDS.get(name)
    # The noise that the world had when it was calibrated wrongly.
    seed = 1 if drawn is None else [drawn.seed, drawn.index, 1]
    world = named_world(name)
    return world, *render_world(world, np.random.default_rng(seed))


def random_world(rng: np.random.Generator, catalogue: Catalogue = ALL) -> World:
    """Draw a world: rig, pose, lane, lines, light and further objects.

    Args:
        rng: Source of all draws.
        catalogue: The rigs and the ingredients to be drawn from.
    """
    names = list(catalogue.rigs)
    rig_name = names[int(rng.choice(len(names), p=list(catalogue.rigs.values())))]
    scene = _random_base(rng, RIGS[rig_name])
    draw = rng.random()
    chosen = _draw(rng, catalogue.good, int(rng.integers(0, MOST_INGREDIENTS + 1)))
    if draw > 1 - BAD_SHARE:
        chosen += _draw(rng, catalogue.bad, 1)
    elif draw > GOOD_SHARE:
        chosen += _draw(rng, catalogue.unsure, 1)
    # Ingredients that shape the road come first, because a kerb depends on whether the road bends.
    chosen.sort(key=lambda item: item.name not in ("bend", "slight_bend"))
    return _world(scene, chosen, rng, rig_name)


def named_world(name: str) -> World:
    """Return a world by its name.

    Args:
        name: "plain", a lane between solid lines and nothing else; or the name of an ingredient, which is in
            the plain world alone; or that of a random world that was calibrated wrongly once.

    Raises:
        ConfigError: There is no such world.
    """
    if name in REGRESSION_WORLDS:
        drawn = REGRESSION_WORLDS[name]
        return random_world(np.random.default_rng([drawn.seed, drawn.index]), FIRST)
    if name != "plain" and name not in INGREDIENTS:
        known = ", ".join([*INGREDIENTS, *REGRESSION_WORLDS])
        raise ConfigError(f"there is no world {name!r}: they are plain, {known}")
    lines = (Paint(LaneLine(-1.75)), Paint(LaneLine(1.75)))
    camera = Camera(Photometry(noise_fraction=0.01))
    pose = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))
    scene = WorldScene(
        RIGS["paper"].rig,
        pose,
        (-1.75, 1.75),
        0.01,
        0.1,
        paints=lines,
        texture_seed=7,
        left=camera,
        right=camera,
    )
    chosen = [] if name == "plain" else [INGREDIENTS[name]]
    return _world(scene, chosen, np.random.default_rng(1), "paper")


def _world(
    scene: WorldScene, ingredients: list[Ingredient], rng: np.random.Generator, rig_name: str
) -> World:
    """Put those ingredients into a scene that fit."""
    present: list[Ingredient] = []
    last = {item.part: item for item in ingredients}
    for item in ingredients:
        if item.part and last[item.part] is not item:
            continue
        changed = item.change(scene, rng)
        if changed is not None:
            scene = changed
            present.append(item)
    verdicts: tuple[Expected, ...] = ("accept", "either", "refuse")
    rank = max((verdicts.index(item.expected) for item in present), default=0)
    if _contrast_to_noise(scene) < MIN_CONTRAST_TO_NOISE or painted_rows(scene) < MIN_ROWS * scene.rig.height:
        rank = max(rank, verdicts.index("either"))
    return World(scene, scene.truth(), tuple(item.name for item in present), verdicts[rank], rig_name)


def painted_rows(scene: WorldScene) -> float:
    """Return how many rows show paint of a line, on the side and in the camera with fewer of them."""
    s = np.geomspace(*SEEN_M, SEEN_SAMPLES)
    worst = math.inf
    for camera in SIDES:
        rays = WorldRays(scene, camera)
        best = {-1: 0.0, 1: 0.0}
        for paint in scene.paints:
            line = paint.line
            x, y = scene.shape.place(s, line.offset_m)
            z, _, _ = scene.shape.height(s, line.offset_m)
            pixels = rays.project(np.stack([x, y, z], axis=1))
            inside = np.all((pixels >= 0) & (pixels < (scene.rig.width, scene.rig.height)), axis=1)
            if line.dash_m is not None and line.gap_m is not None:
                inside &= (s - line.phase_m) % (line.dash_m + line.gap_m) < line.dash_m
            rows = np.abs(np.diff(pixels[:, 1]))[inside[1:] & inside[:-1]].sum() * (1 - paint.worn)
            side = 1 if line.offset_m > scene.lateral_offset_m else -1
            best[side] = max(best[side], float(rows))
        worst = min(worst, *best.values())
    return worst


def _contrast_to_noise(scene: WorldScene) -> float:
    """Return the contrast of the palest paint in the deepest shadow or the headlights, over the noise."""
    paint = min((p.line.grey for p in scene.paints if p.line.grey > scene.asphalt_grey), default=math.inf)
    light = math.prod(shadow.light for shadow in scene.shadows)
    light *= min(float(lit(scene, LIT_M, border)) for border in scene.lane_m)
    cameras = [camera.photometry for camera in (scene.left, scene.right)]
    return min(
        (paint - scene.asphalt_grey) * light * camera.gain / max(255 * camera.noise_fraction, 0.3)
        for camera in cameras
    )


def _draw(rng: np.random.Generator, items: tuple[Ingredient, ...], number: int) -> list[Ingredient]:
    """Draw different ingredients by their weights."""
    weights = np.array([item.weight for item in items])
    chosen = rng.choice(len(items), size=number, replace=False, p=weights / weights.sum())
    return [items[int(i)] for i in chosen]


def _random_base(rng: np.random.Generator, mount: Mount) -> WorldScene:
    """Draw a plane road with the lines of the own lane and sometimes of others, and a pose over it."""
    half_m = float(rng.uniform(*LANE_WIDTH_M)) / 2
    width_m = float(rng.uniform(*LINE_WIDTH_M))
    grey = float(rng.uniform(175, 235))
    asphalt = float(rng.uniform(65, 110))
    borders = [-half_m, half_m]
    if rng.random() < 0.4:
        borders.append(half_m + 2 * half_m)  # the opposite lane's far line
    if rng.random() < 0.2:
        borders.append(-half_m - 2 * half_m)  # another lane on the right
    # At least one of the own lane's lines is solid: with dashes alone little may be in view.
    solid = int(rng.integers(2))
    paints = []
    for index, border in enumerate(borders):
        dash, gap = None, None
        if index != solid and rng.random() > SOLID_SHARE:
            lengths = DASHES[str(rng.choice([name for name in DASHES if DASHES[name]]))]
            dash, gap = lengths if lengths is not None else (None, None)
        line = LaneLine(border, width_m, dash, gap, float(rng.uniform(0, 20)), grey)
        paints.append(Paint(line))
    pose = Extrinsics(
        float(rng.uniform(*mount.height_m)),
        math.radians(float(rng.uniform(*mount.pitch_deg))),
        math.radians(float(rng.uniform(-ROLL_DEG, ROLL_DEG))),
    )
    noise = float(rng.uniform(0, NOISE_MAX)) * float(rng.random())  # mild more often than strong
    left = Photometry(vignetting=float(rng.uniform(0, 0.2)), noise_fraction=noise)
    right = replace(left, gain=float(rng.uniform(0.95, 1.05)), offset=float(rng.uniform(0, 3)))
    return WorldScene(
        mount.rig,
        pose,
        (-half_m, half_m),
        math.radians(float(rng.uniform(-YAW_DEG, YAW_DEG))),
        float(rng.uniform(-OFFSET_M, OFFSET_M)),
        paints=tuple(paints),
        asphalt_grey=asphalt,
        texture_amplitude=0.0 if rng.random() < BARE_SHARE else float(rng.uniform(1.0, TEXTURE_MAX)),
        texture_seed=int(rng.integers(2**16)),
        sky_grey=float(rng.uniform(130, 220)),
        left=Camera(left),
        right=Camera(right),
    )
