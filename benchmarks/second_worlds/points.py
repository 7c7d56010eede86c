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

"""Where the samples of an image are in the world."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from .cameras import Array32, Camera
from .mesh import Mesh
from .raster import Planes, Samples


@dataclass(frozen=True)
class Points:
    """Points of surfaces that samples see, each field of shape (n,).

    Attributes:
        x, y, z: Place in the world [m].
        depth_m: Depth before the camera.
        pixel_m: Width of a pixel there, across the view.
        slant: Cosine of the angle between the ray and the surface's normal.
        step_x: How far the point moves in x and y with one column [m], shape (2, n).
        step_y: The same with one row.
        albedo, texture, texel_m, warmth: Of the polygon.
        polygon: Index of the polygon.
    """

    x: Array32
    y: Array32
    z: Array32
    depth_m: Array32
    pixel_m: Array32
    slant: Array32
    step_x: Array32
    step_y: Array32
    albedo: Array32
    texture: Array32
    texel_m: Array32
    warmth: Array32
    polygon: npt.NDArray[np.int32]

    def take(self, chosen: npt.NDArray[np.intp]) -> Points:
        """Return some of the points."""
        return Points(**{each.name: getattr(self, each.name)[..., chosen] for each in fields(self)})


def points_of(
    mesh: Mesh, camera: Camera, planes: Planes, samples: Samples, chosen: npt.NDArray[np.intp]
) -> Points:
    """Return where chosen samples of surfaces are."""
    polygon = samples.polygon[chosen]
    col, row = samples.col[chosen], samples.row[chosen]
    coefficients = planes.inverse_depth.astype(np.float32)[polygon]
    a, b = coefficients[:, 0], coefficients[:, 1]
    inverse = a * col + b * row + coefficients[:, 2]
    depth = 1 / np.maximum(inverse, np.float32(1e-6))
    ray = camera.directions(col, row)
    x, y, z = (np.float32(centre) + depth * part for centre, part in zip(camera.centre_m, ray, strict=True))
    axes = camera.optical_from_world.astype(np.float32)
    fx, fy = np.float32(camera.rig.fx), np.float32(camera.rig.fy)
    squared = depth * depth
    step_x = np.stack([depth * (axes[0, i] / fx) - ray[i] * squared * a for i in range(2)])
    step_y = np.stack([depth * (axes[1, i] / fy) - ray[i] * squared * b for i in range(2)])
    length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    slant = planes.distance_m.astype(np.float32)[polygon] * inverse / length
    return Points(
        x,
        y,
        z,
        depth,
        depth / fx,
        np.clip(slant, 1e-3, 1),
        step_x,
        step_y,
        mesh.albedo[polygon],
        mesh.texture[polygon],
        mesh.texel_m[polygon],
        mesh.warmth[polygon],
        polygon,
    )
