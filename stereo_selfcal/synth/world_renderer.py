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

"""Pictures of worlds with height: crowns, crests, kerbs, rails, cars, foliage, shadows and faults.

The renderer of plane scenes (``renderer.py``) stays as it is; this one is sampled: four sub-rows per
pixel, along a row the exact area under every edge that runs along the road. Surfaces are met by Newton's
method on the height of the road; a kerb and a rail are what lies between two such surfaces; cars are
boxes. No code of the estimator is used.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from .ingredients import Glare, WorldScene
from .renderer import Frame, Picture, blur, vignette
from .world import Side
from .world_objects import draw_barrier, draw_car, draw_facade, draw_rail, draw_wall
from .world_rays import Layer, WorldRays, pixel_mean
from .world_sensor import capture
from .world_steps import with_kerb, with_ridge, with_step
from .world_surface import ground
from .world_weather import draw_lamps, rain_streaks, wetted

SKY_GRADIENT = 40.0  # as in plane scenes: grey levels per unit of slope


def render_scene(scene: WorldScene, rng: np.random.Generator) -> tuple[Frame, Frame]:
    """Render a stereo frame with noise, as the cameras deliver it.

    Args:
        scene: The scene to render.
        rng: Source of the noise; the left camera draws first.

    Returns:
        Left and right image, (H, W) uint8 each; exchanged where the scene says so.
    """
    left = capture(render_side(scene, "left"), scene.left, rng)
    right = capture(render_side(scene, "right"), scene.right, rng)
    return (right, left) if scene.swapped else (left, right)


def render_side(scene: WorldScene, side: Side) -> Picture:
    """Render one camera without noise and before quantisation, (H, W) float32."""
    rig, camera = scene.rig, scene.camera(side)
    photometry = camera.photometry
    picture = _world(scene, WorldRays(scene, side))
    if camera.glare is not None:
        picture += _glare(camera.glare, picture.shape)
    if camera.rain is not None:
        picture += rain_streaks(camera.rain, picture.shape)
    if photometry.psf_sigma_px > 0:
        picture = blur(blur(picture, photometry.psf_sigma_px, axis=0), photometry.psf_sigma_px, axis=1)
    if photometry.vignetting > 0:
        picture *= vignette(rig.width, rig.height, rig.cx, rig.cy, photometry.vignetting)
    picture *= np.float32(photometry.gain)
    picture += np.float32(photometry.offset)
    return picture


def _world(scene: WorldScene, rays: WorldRays) -> Picture:
    """Return the grey levels an ideal camera sees."""
    rig = scene.rig
    columns, rows = np.arange(rig.width), np.arange(rig.height)[:, None]
    _, _, slope = rays.directions(columns, rows)
    picture = _backdrop(scene, rays)
    # A dip lifts the horizon: the road may rise above the level of the camera.
    steepest = max(scene.shape.grade_change, 0.0)
    below = np.flatnonzero((slope < steepest + 0.5 / rig.fy).any(axis=1))
    if not below.size:
        return picture
    first = int(below[0])
    layer = Layer.seen(rays, first)
    surface = ground(scene, layer)
    for step in scene.steps:
        surface = with_step(surface, scene, rays, first, layer, step)
    for kerb in scene.kerbs:
        surface = with_kerb(surface, scene, rays, first, layer, kerb)
    # What stands farther to the side is behind.
    for ridge in sorted(scene.ridges, key=lambda ridge: -abs(ridge.d_m - rays.centre_m[1])):
        surface = with_ridge(surface, scene, rays, first, layer, ridge)
    if scene.wet is not None:
        mirror = rays.mirrored()
        above = _backdrop(scene, mirror)
        _draw_upright(above, scene, mirror)
        surface = wetted(surface, above[first:], scene, rays, layer)
    part = picture[first:]
    _, _, fine_slope = rays.directions(columns, np.arange(first, rig.height)[:, None])
    share = pixel_mean(layer.meets.astype(np.float32))
    if scene.shape.plane:
        share = np.clip(0.5 - fine_slope * rig.fy, 0.0, 1.0).astype(np.float32)
    part += share * (surface - part)
    for rail in scene.rails:
        draw_rail(part, scene, rays, first, layer, rail)
    _draw_upright(picture, scene, rays)
    return picture


def _backdrop(scene: WorldScene, rays: WorldRays) -> Picture:
    """Return the sky, and what stands across the view."""
    rig = scene.rig
    _, _, slope = rays.directions(np.arange(rig.width), np.arange(rig.height)[:, None])
    gradient = SKY_GRADIENT * (1.0 if scene.headlights is None else scene.headlights.ambient)
    picture = (scene.sky_grey + gradient * np.maximum(slope, 0.0)).astype(np.float32)
    for wall in scene.walls:
        if not wall.along:
            draw_wall(picture, scene, rays, wall)
    return picture


def _draw_upright(picture: Picture, scene: WorldScene, rays: WorldRays) -> None:
    """Draw what stands beside and on the road, from the sides to the middle, and lamps."""
    beside = [(wall.at_m, partial(draw_wall, wall=wall)) for wall in scene.walls if wall.along]
    beside += [(facade.d_m, partial(draw_facade, facade=facade)) for facade in scene.facades]
    for _, draw in sorted(beside, key=lambda item: -abs(item[0] - rays.centre_m[1])):
        draw(picture, scene, rays)
    for barrier in sorted(scene.barriers, key=lambda barrier: -abs(barrier.d_m - rays.centre_m[1])):
        draw_barrier(picture, scene, rays, barrier)
    for car in sorted(scene.cars, key=lambda car: -car.s_m):
        draw_car(picture, scene, rays, car)
    draw_lamps(picture, scene, rays)


def _glare(glare: Glare, shape: tuple[int, ...]) -> Picture:
    """Return the light a bright patch adds, (H, W)."""
    u = (np.arange(shape[1]) - glare.u_px) / glare.sigma_u_px
    v = (np.arange(shape[0]) - glare.v_px) / glare.sigma_v_px
    patch: npt.NDArray[np.float64] = glare.grey * np.exp(-0.5 * u * u) * np.exp(-0.5 * v * v)[:, None]
    return patch.astype(np.float32)
