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

"""What the cameras of a car see while it drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from stereo_selfcal import StereoRig

from ..second_worlds.cameras import Array, Mount, Turn, camera_pair
from ..second_worlds.mesh import Mesh
from ..second_worlds.scenes import Scene
from ..second_worlds.sensors import Image, Sensor
from ..second_worlds.shading import picture
from .cars import Car
from .driving import STEP_S, Ride
from .streets import OtherCar, Street, joined

_LEAST_GAP_M = 9.0  # to the car ahead, from the centre of gravity to its middle
_SLOPE = (0.0, 0.0, 0.0)  # of the mirror that a wet road is: no road is wet


@dataclass(frozen=True, slots=True)
class Mounted:
    """How the camera is mounted in the car: p_vehicle = R_z(yaw) R_y(pitch) R_x(roll) p_camera.

    Attributes:
        yaw_rad: Left of the car's axis.
        pitch_rad: Nose down.
        roll_rad: Right side down.
        turn: What is left of the right camera's turn against the left one.
    """

    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    turn: Turn


@dataclass(frozen=True, eq=False)
class Film:
    """A drive that can be seen, frame by frame.

    Attributes:
        rig: The rig.
        car: The car.
        ride: What it does.
        mounted: How its camera is mounted.
        street: Where it drives.
        others: Cars that drive there, too.
        sensor: The cameras' sensors.
        seed: Of their noise.
    """

    rig: StereoRig
    car: Car
    ride: Ride
    mounted: Mounted
    street: Street
    others: tuple[OtherCar, ...]
    sensor: Sensor
    seed: tuple[int, ...]

    def pair(self, time_s: float) -> tuple[Image, Image]:
        """Return the left and the right image of a moment."""
        step = round(time_s / STEP_S)
        mesh = joined([self.street.seen_from(float(self.ride.along_m[step])), *self._others(time_s, step)])
        rotation, centre = self._pose(step)
        street = self.street
        # Scenes know roads of one bend; this one answers the same questions.
        scene = Scene(
            self.rig,
            Mount(self.car.camera_m[2], 0.0, 0.0, 0.0, 0.0),
            self.mounted.turn,
            cast(Any, street.way),
            street.surface,
            street.stripes,
            mesh,
            street.light,
            0.0,
            self.sensor,
            along_lane=True,
        )
        still = np.zeros(self.rig.height)
        cameras = camera_pair(self.rig, Mount(0.0, 0.0, 0.0, 0.0, 0.0), self.mounted.turn, still, still)
        images = []
        for number, camera in enumerate(cameras):
            placed = replace(
                camera,
                world_from_body=rotation @ camera.world_from_body,
                centre_m=centre + rotation @ camera.centre_m,
            )
            light, warmth = picture(scene, placed, _SLOPE)
            rng = np.random.default_rng([*self.seed, step, number])
            images.append(self.sensor.develop(light, warmth, bool(number), rng))
        return images[0], images[1]

    def _pose(self, step: int) -> tuple[Array, Array]:
        """Return rotation and place of the middle of the baseline in the world."""
        ride, mounted = self.ride, self.mounted
        body = rotation(
            float(ride.heading_rad[step]), float(ride.pitch_rad[step]), float(ride.roll_rad[step])
        )
        ahead, left, up = self.car.camera_m
        centre = ride.place_m[step] + body @ np.array([ahead - self.car.rear_m, left, up])
        return body @ rotation(mounted.yaw_rad, mounted.pitch_rad, mounted.roll_rad), centre

    def _others(self, time_s: float, step: int) -> list[Mesh]:
        own = float(self.ride.along_m[step])
        seen = []
        for other in self.others:
            along = other.start_m + other.speed_mps * time_s
            if other.speed_mps > 0:
                # It keeps its distance.
                along = own + max(_LEAST_GAP_M, other.start_m + 3.0 * math.sin(0.3 * time_s))
            if 2.0 < along - own < 100.0:
                seen.append(other.at(self.street.way, along))
        return seen


def rotation(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Array:
    """Return R_z(yaw) R_y(pitch) R_x(roll), by REP-103's axes."""
    cz, sz = math.cos(yaw_rad), math.sin(yaw_rad)
    cy, sy = math.cos(pitch_rad), math.sin(pitch_rad)
    cx, sx = math.cos(roll_rad), math.sin(roll_rad)
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    result: Array = about_z @ about_y @ about_x
    return result
