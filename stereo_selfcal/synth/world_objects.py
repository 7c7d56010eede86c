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

"""Pictures of what stands on and beside the road of a world: rails, foliage, cars."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from .ingredients import Barrier, Car, Facade, GuardRail, House, Wall, WorldScene
from .renderer import Array, Picture
from .world_light import lit
from .world_rays import Layer, WorldRays, pixel_mean
from .world_surface import FACADE_SEED, WALL_SEED, noise_pattern
from .world_upright import Upright

POSTS_TO_M = 80.0  # farther posts are narrower than a pixel
SUB_SAMPLES = 3  # of a pixel of a car, along either axis
# Parts of the front of a house [m].
PLINTH_M, CORNICE_M, FRAME_M = 0.6, 0.3, 0.1
WALL_CELLS_M = (0.15, 0.35, 0.8, 2.0)

# Of a car's height: where the cabin begins, and what the box clears the ground by.
CABIN_FROM = 0.55
CLEARANCE_M = 0.2
WINDOW_GREY = 45.0
TOP_LIGHT, SIDE_LIGHT = 1.25, 0.8  # a roof is brighter than the rear, a flank darker
CAR_CELLS_M = (0.2, 0.6)
CAR_TEXTURE = 4.0


def draw_rail(
    part: Picture, scene: WorldScene, rays: WorldRays, first: int, layer: Layer, rail: GuardRail
) -> None:
    """Draw a guard rail over the ground, between the surfaces of its edges."""
    left_side = rail.d_m > rays.centre_m[1]
    middle_m = (rail.bottom_m + rail.top_m) / 2
    shares = []
    for height_m in (rail.bottom_m, middle_m, rail.top_m):
        seen = Layer.seen(rays, first, height_m)
        passed = seen.left_of(rail.d_m) if left_side else 1 - seen.left_of(rail.d_m)
        shares.append(pixel_mean(passed * seen.meets))
    light = np.asarray(lit(scene, pixel_mean(layer.s), rail.d_m), np.float32)
    for (low, high), sign in zip(pairwise(shares), (-1, 1), strict=True):
        part += np.maximum(low - high, 0) * (np.float32(rail.grey + sign * rail.relief / 2) * light - part)


def draw_barrier(picture: Picture, scene: WorldScene, rays: WorldRays, barrier: Barrier) -> None:
    """Draw the posts of a barrier, from far to near, and its strands over them."""
    posts = barrier.posts
    if posts is not None:
        half = np.array([posts.width_m, posts.width_m, posts.height_m]) / 2
        first = posts.first_m % posts.every_m
        for s in np.arange(first, POSTS_TO_M, posts.every_m)[::-1]:
            ground_m = float(scene.shape.height(s, posts.d_m)[0])
            centre = np.array([s, posts.d_m, ground_m + posts.height_m / 2])
            shade = posts.grey * float(lit(scene, s, posts.d_m))
            _draw_box(picture, scene, rays, centre, half, 0.0, shade, False)
    low = min(strand.bottom_m - strand.sag_m for strand in barrier.strands)
    seen = Upright.seen(rays, barrier.d_m, low, max(strand.top_m for strand in barrier.strands))
    if seen is None:
        return
    part = picture[slice(*seen.rows), slice(*seen.columns)]
    for strand in barrier.strands:
        over = seen.over
        if strand.sag_m:
            # A wire hangs as a parabola, as far as anybody sees.
            place = ((seen.along.value - strand.hung_m) / strand.span_m) % 1.0
            sag, slope = 4 * place * (1 - place), 4 * (1 - 2 * place) / strand.span_m
            over = seen.over_curve(-strand.sag_m * sag, -strand.sag_m * slope)
        share = over.between(strand.bottom_m, strand.top_m) * seen.meets
        grey = strand.grey * lit(scene, seen.along.value, barrier.d_m)
        part += (share * (grey - part)).astype(np.float32)


def draw_wall(picture: Picture, scene: WorldScene, rays: WorldRays, wall: Wall) -> None:
    """Draw an upright textured plane over what is behind it."""
    rig = scene.rig
    dx, dy, dz = rays.directions(np.arange(rig.width), np.arange(rig.height)[:, None])
    towards, ahead = (dy, wall.at_m - rays.centre_m[1]) if wall.along else (dx, wall.at_m - rays.centre_m[0])
    depth = ahead / np.where(np.abs(towards) < 1e-9, 1e-9, towards)
    meets = (depth > 0.5) & (depth < 400.0)
    depth = np.where(meets, depth, 400.0)
    z = rays.centre_m[2] + depth * dz
    position = (rays.centre_m[0] + depth * dx) if wall.along else (rays.centre_m[1] + depth * dy)
    size = (depth / min(rig.fx, rig.fy)).astype(np.float32)
    if wall.along:
        # Seen at a grazing angle, a pixel covers more of it along the road.
        size = (size * np.maximum(1.0, np.abs(dx / np.where(np.abs(dy) < 1e-6, 1e-6, dy)))).astype(np.float32)
    along, up = position.astype(np.float32), z.astype(np.float32)
    edge = noise_pattern(scene.texture_seed + WALL_SEED, (1.5, 4.0), along, np.zeros_like(along), size)
    top = wall.height_m + wall.ragged_m * edge
    pixel = depth / rig.fy
    base, _, _ = scene.shape.height(*((position, wall.at_m) if wall.along else (wall.at_m, position)))
    share = np.clip((top - up) / pixel + 0.5, 0, 1) * np.clip((up - base) / pixel + 0.5, 0, 1) * meets
    texture = noise_pattern(scene.texture_seed + WALL_SEED + 1, WALL_CELLS_M, along, up, size)
    # Foliage is darker below than above.
    grey = (
        wall.grey + 15 * np.tanh((up - wall.height_m / 2) / wall.height_m) + wall.texture_amplitude * texture
    )
    grey = np.maximum(grey, 5.0) * lit(
        scene, *((position, wall.at_m) if wall.along else (wall.at_m, position))
    )
    picture += (share * (grey - picture)).astype(np.float32)


def draw_facade(picture: Picture, scene: WorldScene, rays: WorldRays, facade: Facade) -> None:
    """Draw the fronts of houses over what is behind them."""
    seen = Upright.seen(rays, facade.d_m, 0.0, max(house.height_m for house in facade.houses))
    if seen is None:
        return
    for house in facade.houses:
        front = seen.section(house.begin_m, house.end_m)
        if front is not None:
            part = picture[slice(*front.rows), slice(*front.columns)]
            share = front.along.between(house.begin_m, house.end_m) * front.over.between(0.0, house.height_m)
            light = lit(scene, front.along.value, facade.d_m)
            part += (share * front.meets * (_front(scene, front, house) * light - part)).astype(np.float32)


def _front(scene: WorldScene, front: Upright, house: House) -> Array:
    """Return the grey levels of the front of a house by day."""
    along, over = (each.value.astype(np.float32) for each in (front.along, front.over))
    size = np.maximum(front.along.span, front.over.span).astype(np.float32)
    plaster = noise_pattern(scene.texture_seed + FACADE_SEED, WALL_CELLS_M, along, over, size)
    grey: Array = house.grey + house.texture_amplitude * plaster.astype(np.float64)
    grey += front.over.between(0.0, PLINTH_M) * (0.7 * house.grey - grey)
    grey += front.over.above(house.height_m - CORNICE_M) * (1.2 * house.grey - grey)
    # As many windows as fit in, with frames around them; none cut by the end of the house.
    room_m = house.end_m - house.begin_m
    every = room_m / max(round(room_m / house.window_every_m), 1)
    wide, high = 0.45 * every, 0.55 * house.floor_m
    first, sill = house.begin_m + (every - wide) / 2, 0.3 * house.floor_m
    in_rows = front.over.between(PLINTH_M, house.height_m - CORNICE_M)
    for border_m, pane in ((FRAME_M, 1.3 * house.grey), (0.0, house.window_grey)):
        window = front.along.periodic(first - border_m, wide + 2 * border_m, every)
        window *= front.over.periodic(sill - border_m, high + 2 * border_m, house.floor_m)
        grey += window * in_rows * (pane - grey)
    return grey


def draw_car(picture: Picture, scene: WorldScene, rays: WorldRays, car: Car) -> None:
    """Draw a car: its body, then its cabin."""
    x, y = scene.shape.place(car.s_m + car.length_m / 2, car.d_m)
    ground_m = float(scene.shape.height(car.s_m, car.d_m)[0])
    yaw = scene.shape.curvature_per_m * (car.s_m + car.length_m / 2)
    waist_m = CLEARANCE_M + CABIN_FROM * (car.height_m - CLEARANCE_M)
    body = np.array([car.length_m, car.width_m, waist_m - CLEARANCE_M]) / 2
    cabin = np.array([0.6 * car.length_m, 0.85 * car.width_m, car.height_m - waist_m]) / 2
    for half, z, windows in ((body, CLEARANCE_M + body[2], False), (cabin, waist_m + cabin[2], True)):
        centre = np.array([float(x), float(y), ground_m + z])
        grey = car.grey * float(lit(scene, car.s_m, car.d_m))
        _draw_box(picture, scene, rays, centre, half, yaw, grey, windows)


def _draw_box(
    picture: Picture,
    scene: WorldScene,
    rays: WorldRays,
    centre: Array,
    half: Array,
    yaw: float,
    grey: float,
    windows: bool,
) -> None:
    """Draw an upright box, its rays tested against the three slabs between its faces."""
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1.0]])
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = rays.project(centre + (signs * half) @ turn.T)
    height, width = picture.shape
    if np.isnan(corners).any():
        return
    u0, v0 = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    u1, v1 = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, [width, height])
    if u0 >= u1 or v0 >= v1:
        return
    fine = (np.arange(SUB_SAMPLES) + 0.5) / SUB_SAMPLES - 0.5
    u = (np.arange(u0, u1)[:, None] + fine).ravel()
    v = (np.arange(v0, v1)[:, None] + fine).ravel()[:, None]
    to_box = turn.T
    ray = np.tensordot(to_box, np.stack(np.broadcast_arrays(*rays.directions(u, v))), axes=1)
    ray = np.where(np.abs(ray) < 1e-9, 1e-9, ray)
    start = (to_box @ (rays.centre_m - centre))[:, None, None]
    size = half[:, None, None]
    enter = np.minimum((-size - start) / ray, (size - start) / ray)
    leave = np.maximum((-size - start) / ray, (size - start) / ray)
    depth = enter.max(axis=0)
    hit = (depth < leave.min(axis=0)) & (depth > 0)
    face = enter.argmax(axis=0)
    point = start + depth * ray
    shade = np.select([face == 2, face == 1], [TOP_LIGHT, SIDE_LIGHT], 1.0) * grey
    if windows:
        inset = (np.abs(point[0]) < half[0] - 0.1) | (face != 1)
        pane = (face != 2) & inset & (np.abs(point[2]) < half[2] - 0.06)
        pane &= (np.abs(point[1]) < half[1] - 0.08) | (face != 0)
        shade = np.where(pane, WINDOW_GREY, shade)
    near = np.full(hit.shape, max(float(centre[0] - half[0]), 1.0) / scene.rig.fx, np.float32)
    across = np.where(face == 1, point[0], point[1]).astype(np.float32)
    lift = np.where(face == 2, point[0], point[2]).astype(np.float32)
    shade = shade + CAR_TEXTURE * noise_pattern(scene.texture_seed + 7, CAR_CELLS_M, across, lift, near)
    shape = (v1 - v0, SUB_SAMPLES, u1 - u0, SUB_SAMPLES)
    share = hit.reshape(shape).mean(axis=(1, 3))
    seen = (hit * shade).reshape(shape).mean(axis=(1, 3))
    part = picture[v0:v1, u0:u1]
    part += (seen - share * part).astype(np.float32)
