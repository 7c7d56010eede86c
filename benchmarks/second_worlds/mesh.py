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

"""Flat convex polygons with a material: all that is rendered is made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from .cameras import Array, Array32

Ints = npt.NDArray[np.int32]


class Material(IntEnum):
    """What shades a polygon."""

    ROAD = 0  # the carriageway: asphalt, paint, seams
    GROUND = 1  # what else lies flat: grass, gravel, pavement, snow
    SOLID = 2  # anything with a texture and a grey level
    FACADE = 3  # a wall with windows
    LAMP = 4  # shines by itself


@dataclass(frozen=True)
class Look:
    """How a polygon looks.

    Attributes:
        material: What shades it.
        albedo: Share of the light it gives back.
        texture: Standard deviation of its texture, relative to its albedo.
        texel_m: Size of the finest grain.
        warmth: Colour from blue (-1) to yellow (+1), for colour sensors.
    """

    material: Material
    albedo: float
    texture: float = 0.1
    texel_m: float = 0.01
    warmth: float = 0.0


@dataclass(frozen=True)
class Mesh:
    """Polygons of four corners; a triangle has its last corner twice.

    Attributes:
        corners_m: Corners in the world, shape (n, 4, 3).
        material: Value of :class:`Material`, shape (n,).
        albedo, texture, texel_m, warmth: As in :class:`Look`, shape (n,).
        group: Polygons of one number are one smooth surface; silhouettes lie between groups. Shape (n,).
        thin: Whether a polygon may be narrower than a pixel, shape (n,).
    """

    corners_m: Array
    material: Ints
    albedo: Array32
    texture: Array32
    texel_m: Array32
    warmth: Array32
    group: Ints
    thin: npt.NDArray[np.bool_]

    def normals(self) -> Array:
        """Return the unit normals, shape (n, 3)."""
        normal = np.cross(
            self.corners_m[:, 2] - self.corners_m[:, 0], self.corners_m[:, 3] - self.corners_m[:, 1]
        )
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        result: Array = normal / np.maximum(length, 1e-12)
        return result

    def mirrored(self, plane: tuple[float, float, float], chosen: npt.NDArray[np.bool_]) -> Mesh:
        """Return the chosen polygons mirrored in the plane z = a + b x + c y."""
        a, b, c = plane
        normal = np.array([-b, -c, 1.0]) / np.sqrt(1 + b * b + c * c)
        corners = self.corners_m[chosen]
        height = (corners - np.array([0.0, 0.0, a])) @ normal
        return Mesh(
            corners - 2 * height[..., None] * normal,
            self.material[chosen],
            self.albedo[chosen],
            self.texture[chosen],
            self.texel_m[chosen],
            self.warmth[chosen],
            self.group[chosen],
            self.thin[chosen],
        )


@dataclass
class MeshBuilder:
    """Collects polygons."""

    _corners: list[Array] = field(default_factory=list)
    _looks: list[tuple[Look, int, int, bool]] = field(default_factory=list)
    _groups: int = 0

    def add(
        self, corners_m: npt.ArrayLike, look: Look, *, thin: bool = False, separate: bool = False
    ) -> None:
        """Add polygons of one look.

        Args:
            corners_m: Corners, shape (n, 4, 3) or (4, 3).
            look: How they look.
            thin: Whether they may be narrower than a pixel.
            separate: Whether each is a surface of its own, with edges to the others.
        """
        corners = np.asarray(corners_m, dtype=np.float64).reshape(-1, 4, 3)
        if not len(corners):
            return
        for part in corners[:, None] if separate else [corners]:
            self._corners.append(part)
            self._looks.append((look, len(part), self._groups, thin))
            self._groups += 1

    def box(
        self,
        centre_m: npt.ArrayLike,
        size_m: npt.ArrayLike,
        yaw_rad: float,
        look: Look,
        *,
        thin: bool = False,
    ) -> None:
        """Add a box without its bottom.

        Args:
            centre_m: Middle of its bottom.
            size_m: Length along its heading, width, height.
            yaw_rad: Heading.
            look: How it looks.
            thin: Whether it may be narrower than a pixel.
        """
        length, width, height = np.asarray(size_m, dtype=np.float64)
        x, y = length / 2, width / 2
        base = np.array([[x, y], [-x, y], [-x, -y], [x, -y]])
        turn = np.array([[np.cos(yaw_rad), np.sin(yaw_rad)], [-np.sin(yaw_rad), np.cos(yaw_rad)]])
        low = np.concatenate([base @ turn, np.zeros((4, 1))], axis=1) + np.asarray(centre_m)
        high = low + np.array([0.0, 0.0, height])
        sides = [[low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]] for i in range(4)]
        self.add(np.array([*sides, list(high)]), look, thin=thin, separate=True)

    def build(self) -> Mesh:
        """Return all that was added."""

        def column(values: list[float]) -> Array32:
            return np.repeat(np.array(values, dtype=np.float32), counts)

        counts = [count for _, count, _, _ in self._looks]
        looks = [look for look, _, _, _ in self._looks]
        return Mesh(
            np.concatenate(self._corners),
            np.repeat(np.array([look.material for look in looks], dtype=np.int32), counts),
            column([look.albedo for look in looks]),
            column([look.texture for look in looks]),
            column([look.texel_m for look in looks]),
            column([look.warmth for look in looks]),
            np.repeat(np.array([group for _, _, group, _ in self._looks], dtype=np.int32), counts),
            np.repeat(np.array([thin for _, _, _, thin in self._looks]), counts),
        )
