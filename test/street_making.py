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

"""A street of textured planes, seen from anywhere: for drives whose motion is known.

The geometry is derived from REP-103's axes, without any code of the estimator.
"""

from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal import StereoRig
from stereo_selfcal.synth.renderer import rotation, sample_tile, texture_tile

# Ground, two walls along the street and one far across it: a point of the plane, its normal and two axes.
X, Y, Z = np.eye(3)
PLANES = (
    (np.array([0.0, 0.0, 0.0]), Z, (X, Y), (0.03, 0.08, 0.2, 0.5)),
    (np.array([0.0, 7.0, 0.0]), Y, (X, Z), (0.1, 0.3, 0.9, 2.0)),
    (np.array([0.0, -9.0, 0.0]), Y, (X, Z), (0.1, 0.3, 0.9, 2.0)),
    (np.array([160.0, 0.0, 0.0]), X, (Y, Z), (0.5, 1.5, 4.0)),
)
WALL_HEIGHT_M = 8.0
SKY, MEAN, AMPLITUDE = 190.0, 110.0, 32.0


@dataclass(frozen=True)
class Place:
    """Where the rig is: its middle in the street, and its angles against the street."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 1.5
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    @property
    def rotation(self):
        """Street axes from the body's."""
        return rotation(0, 0, self.yaw_rad) @ rotation(0, self.pitch_rad, 0) @ rotation(self.roll_rad, 0, 0)


def along(place, way_m):
    """Return a place farther along the street."""
    return replace(place, x_m=place.x_m + way_m)


def street_pair(rig: StereoRig, place: Place, *, right_yaw_rad=0.0, right_place=None, noise=1.0, seed=0):
    """Return the images of both cameras, (H, W) uint8.

    Args:
        rig: Intrinsics and baseline.
        place: Where the rig is.
        right_yaw_rad: Yaw of the right camera in the left one's body.
        right_place: Where the rig is when the right camera takes its image; None: at the same place.
        noise: Standard deviation of the noise [grey levels].
        seed: Its seed.
    """
    rng = np.random.default_rng(seed)
    right_place = right_place or place
    sides = ((place, 0.5, 0.0), (right_place, -0.5, right_yaw_rad))
    return tuple(
        _image(
            rig,
            where.rotation @ rotation(0, 0, yaw),
            _centre(where) + half * rig.baseline_m * where.rotation[:, 1],
            noise,
            rng,
        )
        for where, half, yaw in sides
    )


def _centre(place):
    return np.array([place.x_m, place.y_m, place.z_m])


def _image(rig, street_from_body, centre, noise, rng):
    u, v = np.meshgrid(np.arange(rig.width), np.arange(rig.height))
    body = np.stack([np.ones(u.shape), -(u - rig.cx) / rig.fx, -(v - rig.cy) / rig.fy], axis=-1)
    rays = body @ street_from_body.T
    nearest = np.full(u.shape, np.inf)
    picture = np.full(u.shape, SKY)
    for number, (point, normal, axes, cells) in enumerate(PLANES):
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (point - centre) @ normal / (rays @ normal)
        hit = centre + depth[..., None] * rays
        seen = (depth > 0.2) & (depth < nearest) & (hit[..., 2] < WALL_HEIGHT_M) & (hit[..., 2] > -0.01)
        if not seen.any():
            continue
        at = [hit[..., :] @ axis for axis in axes]
        at = [np.where(seen, each, 0.0) for each in at]
        size = np.maximum(
            *(np.abs(np.gradient(each, axis=0)) + np.abs(np.gradient(each, axis=1)) for each in at)
        )
        grey = np.full(u.shape, MEAN)
        for octave, cell_m in enumerate(cells):
            fade = np.clip(2.0 * (1.0 - size / cell_m), 0.0, 1.0)
            tile = texture_tile(100 + number, octave)
            grey += AMPLITUDE / np.sqrt(len(cells)) * fade * sample_tile(tile, at[0] / cell_m, at[1] / cell_m)
        picture = np.where(seen, grey, picture)
        nearest = np.where(seen, depth, nearest)
    picture = picture + noise * rng.standard_normal(picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
