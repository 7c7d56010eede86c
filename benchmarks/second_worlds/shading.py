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

"""Light of everything that stands upright, of the sky, and the whole image of a camera."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from .cameras import Array, Array32, Camera
from .ground import shade_ground
from .lighting import light_on
from .mesh import Material, Mesh
from .points import Points, points_of
from .raster import SKY, Samples, planes_before, rasterise
from .scenes import Scene
from .textures import SIZE, stack

_SKY_SCALE = 0.35  # tiles of cloud per unit of direction
_FLOOR_M = 3.0  # between two floors of a house


def picture(scene: Scene, camera: Camera, plane: tuple[float, float, float]) -> tuple[Array32, Array32]:
    """Return light and warmth of each pixel, shape (rows, cols).

    Args:
        scene: The world.
        camera: The camera.
        plane: The plane of the road, in which a wet one mirrors.
    """
    light, warmth, gloss = _rendered(scene, scene.mesh, camera)
    if scene.wet:
        mesh = scene.mesh
        upright = mesh.material >= Material.SOLID
        mirrored, _, _ = _rendered(scene, mesh.mirrored(plane, upright), camera, upside_down=True)
        size = max(3, int(camera.rig.fy / 60)) | 1
        rough = cv2.blur(mirrored, (1, size)) if scene.wet < 0.8 else cv2.blur(mirrored, (1, 3))
        light = light + gloss * rough
    return light, warmth


def _rendered(
    scene: Scene, mesh: Mesh, camera: Camera, upside_down: bool = False
) -> tuple[Array32, Array32, Array32]:
    """Return light, warmth and share of mirrored light of each pixel."""
    planes = planes_before(mesh, camera)
    samples = rasterise(mesh, camera, planes)
    count = len(samples.pixel)
    light, warmth, gloss = (np.zeros(count, np.float32) for _ in range(3))
    material = np.append(mesh.material, np.int32(-1))[samples.polygon]
    sky = np.flatnonzero(samples.polygon == SKY)
    light[sky] = _sky(scene, camera, samples, sky, upside_down)
    warmth[sky] = -0.3 * light[sky]
    flat = np.flatnonzero((material == Material.ROAD) | (material == Material.GROUND))
    if len(flat):
        points = points_of(mesh, camera, planes, samples, flat)
        light[flat], warmth[flat] = shade_ground(scene, points, material[flat] == Material.ROAD)
        _haze(scene, points, light, flat)
        if scene.wet:
            gloss[flat] = _gloss(scene, points) * (material[flat] == Material.ROAD)
    upright = np.flatnonzero(material >= Material.SOLID)
    if len(upright):
        points = points_of(mesh, camera, planes, samples, upright)
        light[upright] = _solid(scene, mesh, camera, points, material[upright])
        warmth[upright] = points.warmth * light[upright]
        _haze(scene, points, light, upright)
    return (
        _gathered(camera, samples, light),
        _gathered(camera, samples, warmth),
        _gathered(camera, samples, gloss),
    )


def _gathered(camera: Camera, samples: Samples, values: Array32) -> Array32:
    rig = camera.rig
    image = np.bincount(samples.pixel, values * samples.weight, minlength=rig.width * rig.height)
    return image.reshape(rig.height, rig.width).astype(np.float32)


def _haze(scene: Scene, points: Points, light: Array32, chosen: npt.NDArray[np.intp]) -> None:
    share = np.exp(points.depth_m * np.float32(-1 / scene.light.haze_m))
    light[chosen] = share * light[chosen] + (1 - share) * np.float32(scene.light.sky[1])


def _sky(
    scene: Scene, camera: Camera, samples: Samples, chosen: npt.NDArray[np.intp], upside_down: bool
) -> Array32:
    x, y, z = camera.directions(samples.col[chosen], samples.row[chosen])
    ahead = np.maximum(x, np.float32(0.1))
    side, up = y / ahead, (-z if upside_down else z) / ahead
    high, low = scene.light.sky
    share = np.clip(up * 1.6, 0, 1)
    base = np.float32(low) + np.float32(high - low) * share
    scale = np.float32(_SKY_SCALE)
    cloud = stack("cloud", 1, 0).sample(
        (up + np.float32(1)) * np.float32(2.5 * _SKY_SCALE),
        (side * scale).astype(np.float32),
        np.full(len(chosen), 2.0, np.float32),
    )
    result: Array32 = base * np.clip(1 + np.float32(scene.light.clouds) * cloud, 0.2, 3)
    return result


def _gloss(scene: Scene, points: Points) -> Array32:
    """Return which share of the light that falls from the mirror's direction a wet road gives back."""
    fresnel = 0.02 + 0.98 * (1 - points.slant) ** 5
    level = np.full(len(points.x), 4.0, np.float32)
    puddles = stack("cloud", 1, 0).sample(points.x * np.float32(1 / 13), points.y * np.float32(1 / 7), level)
    share: Array32 = fresnel * np.clip(0.35 + np.float32(scene.wet) * (0.3 + 0.5 * puddles), 0.05, 1)
    return share


def _solid(
    scene: Scene, mesh: Mesh, camera: Camera, points: Points, material: npt.NDArray[np.int32]
) -> Array32:
    normals = mesh.normals()
    middle = mesh.corners_m.mean(axis=1)
    towards = np.einsum("ij,ij->i", normals, camera.centre_m - middle)
    normals = normals * np.where(towards < 0, -1.0, 1.0)[:, None]
    facing = np.clip(normals @ np.array(scene.light.sun), 0, None).astype(np.float32)
    sun, lamps = light_on(scene, points.x, points.y, points.z, facing[points.polygon])
    albedo = points.albedo * _texture(normals, points)
    walls = np.flatnonzero(material == Material.FACADE)
    if len(walls):
        albedo[walls] *= _windows(mesh, normals, points.take(walls))
    light = albedo * (sun + lamps)
    shining = material == Material.LAMP
    light[shining] = points.albedo[shining]
    return light


def _axes(normals: Array) -> Array32:
    """Return the horizontal tangent of each polygon, shape (n, 2); of a flat one the x axis."""
    tangent = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.where(length > 0.2, tangent / np.maximum(length, 1e-6), [[1.0, 0.0]])
    return tangent.astype(np.float32)


def _on_wall(normals: Array, points: Points) -> tuple[Array32, Array32]:
    """Return places on the surfaces: horizontally, and upwards (or across, where they lie flat)."""
    tangent: Array32 = _axes(normals)[points.polygon]
    flat = (np.abs(normals[:, 2]) > 0.98)[points.polygon]
    # A mirrored wall lies below the road.
    return points.x * tangent[:, 0] + points.y * tangent[:, 1], np.where(flat, points.y, np.abs(points.z))


def _texture(normals: Array, points: Points) -> Array32:
    along, up = _on_wall(normals, points)
    texel = points.texel_m
    pixel = points.pixel_m * np.maximum(1, 0.4 / points.slant)
    tile = texel * SIZE
    level = np.log2(pixel / texel)
    noise = stack("leaf", 1, 0).sample(up / tile, along / tile, level)
    larger = stack("cloud", 1, 0).sample(up / tile, along / tile, level)
    values: Array32 = np.clip(1 + points.texture * (0.7 * noise + 0.7 * larger), 0.1, 3)
    return values


def _windows(mesh: Mesh, normals: Array, points: Points) -> Array32:
    """Return the factor of the grey of a wall: dark windows with bright frames, and bands at each floor."""
    along, up = _on_wall(normals, points)
    kind = mesh.group[points.polygon]
    pitch = (2.2 + 0.31 * (kind % 7)).astype(np.float32)
    wide, high = (np.float32(0.3) * pitch).astype(np.float32), np.float32(0.8)
    height_m = points.pixel_m
    width_m = (height_m / np.maximum(points.slant, np.float32(0.05))).astype(np.float32)
    place: Array32 = along - pitch * np.round(along / pitch)
    middle = up - np.float32(0.55 * _FLOOR_M)
    level: Array32 = middle - np.float32(_FLOOR_M) * np.round(middle / np.float32(_FLOOR_M))
    frame = _share(place, wide + np.float32(0.09), width_m) * _share(level, high + np.float32(0.09), height_m)
    pane = _share(place, wide, width_m) * _share(level, high, height_m)
    bar = _share(place, np.float32(0.03), width_m)
    above: Array32 = np.abs(level) - np.float32(0.5 * _FLOOR_M)
    band = _share(above, np.float32(0.09), height_m)
    factor = 1 + 0.35 * band + 0.45 * frame
    factor += pane * (0.25 + 0.05 * (kind % 4) + 0.6 * bar - factor)
    result: Array32 = factor.astype(np.float32)
    return result


def _share(place: Array32, half: Array32 | np.float32, pixel: Array32) -> Array32:
    part = np.minimum(place + pixel / 2, half) - np.maximum(place - pixel / 2, -half)
    share: Array32 = np.clip(part / pixel, 0, 1)
    return share
