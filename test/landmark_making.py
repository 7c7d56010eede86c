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

"""Landmarks of a cloud of points beside and on a street, seen from anywhere: no images are needed."""

from dataclasses import dataclass

import numpy as np
from street_making import Place

from stereo_selfcal import StereoRig
from stereo_selfcal.core.estimators.landmarks import Landmarks
from stereo_selfcal.synth.renderer import rotation

RIG = StereoRig(1240, 376, 720.0, 720.0, 610.0, 180.0, 0.54)
SHORT_RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.15)
FLIPPED_BITS = 12  # of 256, from one frame to the next


@dataclass(frozen=True)
class Cloud:
    """Points of a street (n, 3) with their descriptors (n, 32)."""

    points_m: np.ndarray
    descriptors: np.ndarray

    def moved(self, part, way_m):
        """Return the cloud with its first points moved along the street: another car."""
        points = self.points_m.copy()
        points[: int(part * len(points)), 0] += way_m
        return Cloud(points, self.descriptors)


def cloud(rng, n=1500, length_m=110.0):
    """Return points on the ground and on the fronts of houses."""
    x = rng.uniform(2.0, length_m, n)
    ground = rng.random(n) < 0.4
    side = np.where(rng.random(n) < 0.5, 1.0, -1.0)
    y = np.where(ground, rng.uniform(-6.0, 6.0, n), side * rng.uniform(6.0, 14.0, n))
    z = np.where(ground, 0.0, rng.uniform(0.0, 7.0, n))
    return Cloud(np.column_stack([x, y, z]), rng.integers(0, 256, (n, 32), dtype=np.uint8))


def seen(
    world, rig, place, rng, *, right_yaw_rad=0.0, right_ahead_m=0.0, place_px=0.5, disparity_px=0.15, most=350
):
    """Return the landmarks that the rig sees from a place, with noise.

    Args:
        world: The cloud.
        rig: Intrinsics and baseline.
        place: Where the left camera is.
        rng: Source of the noise.
        right_yaw_rad: Yaw of the right camera in the left one's body.
        right_ahead_m: How much farther ahead it sits.
        place_px: Standard deviation of the places [px].
        disparity_px: Standard deviation of the disparities [px].
        most: Number of landmarks.
    """
    body = (world.points_m - [place.x_m, place.y_m, place.z_m]) @ place.rotation
    of_right = (body - [right_ahead_m, -rig.baseline_m, 0.0]) @ rotation(0, 0, right_yaw_rad)
    left, right = (_pixels(each, rig) for each in (body, of_right))
    shown = (body[:, 0] > 2.0) & np.all((left >= 0) & (left < [rig.width, rig.height]), axis=1)
    index = np.flatnonzero(shown)
    index = np.sort(rng.permutation(index)[:most])
    error = place_px * rng.standard_normal((len(index), 2))
    left, right = left[index] + error, right[index] + error
    right[:, 0] += disparity_px * rng.standard_normal(len(index))
    bits = np.unpackbits(world.descriptors[index], axis=1)
    flips = rng.random(bits.shape) < FLIPPED_BITS / bits.shape[1]
    return Landmarks(
        left.astype(np.float32), right.astype(np.float32), np.packbits(bits ^ flips.astype(np.uint8), axis=1)
    )


def _pixels(body, rig):
    ahead = np.maximum(body[:, 0], 0.1)
    return np.column_stack([rig.cx - rig.fx * body[:, 1] / ahead, rig.cy - rig.fy * body[:, 2] / ahead])


@dataclass(frozen=True)
class Frame:
    """What the steps of a drive need of a frame."""

    stamp_s: float
    landmarks: Landmarks | None
    extrinsics: object = None


def drive(world, rig, places, rng, rate_hz=10.0, **seen_by):
    """Return the frames of a drive from place to place."""
    return [
        Frame(100.0 + i / rate_hz, seen(world, rig, place, rng, **seen_by)) for i, place in enumerate(places)
    ]


START = Place(yaw_rad=0.012, pitch_rad=0.035, roll_rad=0.01)
