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

"""Turns of the right camera: the one notation of this package, and the turns that are tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
NAMES = ("pitch", "roll", "yaw")


@dataclass(frozen=True, slots=True)
class Angles:
    """The body of the right camera in the left one's, REP-103: R_z(yaw) R_y(pitch) R_x(roll).

    Attributes:
        pitch_deg: > 0: nose down, its content moves up.
        roll_deg: > 0: right side down.
        yaw_deg: > 0: it looks further left, its content moves right.
    """

    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    yaw_deg: float = 0.0

    @property
    def name(self) -> str:
        """What is turned, and by how much."""
        told = [f"{name} {value:+g}" for name, value in zip(NAMES, self.as_array(), strict=True) if value]
        return ", ".join(told) or "as it is"

    def as_array(self) -> Array:
        """Return (pitch, roll, yaw) [deg], the order of the alignment."""
        return np.array([self.pitch_deg, self.roll_deg, self.yaw_deg])


AS_IT_IS = Angles()
# The turns that issue 20 lists.
TURNS = (
    *(Angles(yaw_deg=sign * size) for size in (0.03, 0.06, 0.12, 0.2) for sign in (1, -1)),
    *(Angles(pitch_deg=sign * size) for size in (0.02, 0.05) for sign in (1, -1)),
    *(Angles(roll_deg=sign * size) for size in (0.1, 0.3) for sign in (1, -1)),
)


def rotation_of(angles: Angles) -> Array:
    """Return the rotation (3, 3): the left body's axes from the right one's."""
    pitch, roll, yaw = np.radians(angles.as_array())
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array(
        [[np.cos(pitch), 0.0, np.sin(pitch)], [0.0, 1.0, 0.0], [-np.sin(pitch), 0.0, np.cos(pitch)]]
    )
    about_x = np.array(
        [[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)], [0.0, np.sin(roll), np.cos(roll)]]
    )
    rotation: Array = about_z @ about_y @ about_x
    return rotation


def turned_on(angles: Array, turn: Angles) -> Array:
    """Return (pitch, roll, yaw) [deg] of a right camera that has such angles and is turned on from there."""
    rotation = rotation_of(Angles(*angles)) @ rotation_of(turn)
    pitch = -np.arcsin(rotation[2, 0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    degrees: Array = np.degrees([pitch, roll, yaw])
    return degrees
