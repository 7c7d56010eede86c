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

"""Steps of the ground of a world: kerbs, edges of new asphalt, rails of a railway.

Each is what lies between two surfaces at different heights over the road.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .ingredients import Kerb, Ridge, RoadStep, WorldScene
from .world_rays import Layer, Single, WorldRays, pixel_mean
from .world_surface import ground, light, noise_pattern

PAVEMENT_CELLS_M = (0.1, 0.3, 1.0)


def with_kerb(
    surface: Single, scene: WorldScene, rays: WorldRays, first: int, layer: Layer, kerb: Kerb
) -> Single:
    """Return the ground with a kerb and the pavement behind it in front of it."""
    side = 1 if kerb.face_m > scene.lateral_offset_m else -1
    top = Layer.seen(rays, first, kerb.height_m)

    def behind(seen: Layer, d_m: float) -> Single:
        return seen.left_of(d_m) if side > 0 else 1 - seen.left_of(d_m)

    on_top = behind(top, kerb.face_m) * top.meets
    # Ground behind the face is hidden by the face, unless the ray came over its upper edge.
    hidden = np.maximum(behind(layer, kerb.face_m) * layer.meets, on_top)
    pavement = behind(top, kerb.face_m + side * kerb.top_width_m) * top.meets
    s, d, size = top.pixels()
    texture = noise_pattern(scene.texture_seed + 1, PAVEMENT_CELLS_M, d, s, size)
    hidden, on_top, pavement = (pixel_mean(share) for share in (hidden, on_top, pavement))
    stone = np.float32(kerb.face_grey) * (hidden - on_top) + np.float32(kerb.top_grey) * (on_top - pavement)
    stone += (kerb.behind_grey + np.float32(kerb.behind_texture) * texture) * pavement
    result: Single = surface * (1 - hidden) + stone * light(scene, top)
    return result


def with_step(
    surface: Single, scene: WorldScene, rays: WorldRays, first: int, layer: Layer, step: RoadStep
) -> Single:
    """Return the ground with another level of it beyond a step."""
    side = 1 if step.edge_m > scene.lateral_offset_m else -1
    other = Layer.seen(rays, first, step.height_m)

    def beyond(seen: Layer) -> Single:
        share = seen.left_of(step.edge_m) if side > 0 else 1 - seen.left_of(step.edge_m)
        return pixel_mean(share * seen.meets)

    near, far = beyond(layer), beyond(other)
    level = ground(
        replace(scene, asphalt_grey=step.grey, texture_amplitude=step.texture_amplitude),
        other,
    )
    if step.height_m < 0:
        # The lane's own edge hides the face, and the ground right below it.
        lower: Single = surface + near * (level - surface)
        return lower
    hidden = np.maximum(near, far)
    face = np.float32(step.face_grey) * light(scene, other)
    raised: Single = surface * (1 - hidden) + face * (hidden - far) + level * far
    return raised


def with_ridge(
    surface: Single, scene: WorldScene, rays: WorldRays, first: int, layer: Layer, ridge: Ridge
) -> Single:
    """Return the ground with a ridge on it: its top, and the face that is turned to the camera."""
    right_m, left_m = ridge.d_m - ridge.width_m / 2, ridge.d_m + ridge.width_m / 2
    top = Layer.seen(rays, first, ridge.height_m)
    foot = [layer.left_of(d_m) * layer.meets for d_m in (right_m, left_m)]
    upper = [top.left_of(d_m) * top.meets for d_m in (right_m, left_m)]
    # A ray that meets the ground behind an edge, and the level of the top before it, meets the face.
    right_face, left_face = np.maximum(foot[0] - upper[0], 0), np.maximum(upper[1] - foot[1], 0)
    on_top, face = pixel_mean(upper[0] - upper[1]), pixel_mean(right_face + left_face)
    lit = light(scene, top)
    stone = (np.float32(ridge.top_grey) * on_top + np.float32(ridge.face_grey) * face) * lit
    result: Single = surface * (1 - np.clip(on_top + face, 0, 1)) + stone
    return result
