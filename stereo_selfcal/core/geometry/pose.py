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

"""Height, pitch and roll of the rig over the road: the one place where signs, names and units are defined.

``p_road = R_z(yaw) R_y(pitch) R_x(roll) p_camera + [0, 0, height_m]``, REP-103 axes (x forward,
y left, z up) in both frames. ``pitch_rad > 0``: nose down. ``roll_rad > 0``: right side down.

A further number of the pose needs a line in :data:`POSE_COMPONENTS` and a field of :class:`Extrinsics`.
Files, ROS parameters, tables, charts and messages list the components from here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..types import Array

# Body axes (x forward, y left, z up) from the optical axes of a camera (x right, y down, z forward).
BODY_FROM_OPTICAL: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class DisplayUnit:
    """A unit in which people read a number. The code, the files and the messages hold SI units.

    Attributes:
        symbol: Symbol of the unit.
        per_si: How many of this unit are one SI unit.
        decimals: Number of decimals.
        fine_decimals: Number of decimals where a value stands beside its standard deviation.
    """

    symbol: str
    per_si: float
    decimals: int
    fine_decimals: int

    def number(self, value: float, sign: str = "", *, fine: bool = False, more: int = 0) -> str:
        """Return a value without its unit.

        Args:
            value: The value in its SI unit.
            sign: "+" to write the sign of positive values too.
            fine: Whether the value stands beside its standard deviation.
            more: Number of additional decimals.
        """
        decimals = (self.fine_decimals if fine else self.decimals) + more
        return f"{value * self.per_si:{sign}.{decimals}f}"

    def text(self, value: float, sign: str = "", *, fine: bool = False) -> str:
        """Return a value with its unit. The arguments are those of :meth:`number`."""
        return f"{self.number(value, sign, fine=fine)} {self.symbol}"


METRES = DisplayUnit("m", 1.0, 4, 4)
MILLIMETRES = DisplayUnit("mm", 1e3, 1, 1)
DEGREES = DisplayUnit("deg", math.degrees(1.0), 3, 4)


@dataclass(frozen=True, slots=True)
class PoseComponent:
    """One number of a pose.

    Attributes:
        name: Public name, which ends in the SI unit: the attribute of :class:`Extrinsics`, the key of files
            and of ROS parameters.
        unit: Unit of the value for people.
        small_unit: Unit of differences and standard deviations for people.
        sign: "+" where people need the sign of positive values too.
        description: What is measured, and what a positive value means.
    """

    name: str
    unit: DisplayUnit
    small_unit: DisplayUnit
    sign: str
    description: str

    @property
    def label(self) -> str:
        """The name without the unit, such as ``height``."""
        return self.name.rpartition("_")[0]

    @property
    def si_unit(self) -> str:
        """The SI unit, such as ``m``."""
        return self.name.rpartition("_")[2]

    @property
    def std_name(self) -> str:
        """Public name of the standard deviation, such as ``height_std_m``."""
        return f"{self.label}_std_{self.si_unit}"

    @property
    def heading(self) -> str:
        """Heading of a column of values, such as ``height [m]``."""
        return f"{self.label} [{self.unit.symbol}]"

    def of(self, pose: Extrinsics) -> float:
        """Return the value that a pose has for this component [SI unit]."""
        return float(getattr(pose, self.name))

    def describe(self, pose: Extrinsics, std: Extrinsics | None = None, *, fine: bool = True) -> str:
        """Return the value that a pose has for this component as people read it.

        Args:
            pose: The pose.
            std: Its standard deviations, None to leave them out.
            fine: Whether a value beside its standard deviation has as many decimals as that.
        """
        if std is None:
            return self.unit.text(self.of(pose), self.sign)
        spread = self.small_unit.number(self.of(std), fine=True)
        if self.small_unit != self.unit:
            spread += f" {self.small_unit.symbol}"
        return f"{self.unit.text(self.of(pose), self.sign, fine=fine)} (std {spread})"


# In the order of Extrinsics.as_array() and of every covariance of a pose.
POSE_COMPONENTS: tuple[PoseComponent, ...] = (
    PoseComponent("height_m", METRES, MILLIMETRES, "", "Height of the middle of the baseline over the road"),
    PoseComponent("pitch_rad", DEGREES, DEGREES, "+", "Pitch of the camera over the road, > 0: nose down"),
    PoseComponent(
        "roll_rad", DEGREES, DEGREES, "+", "Roll of the camera over the road, > 0: right side down"
    ),
)
# Names of the values and of their standard deviations, in the order of result files and tables.
POSE_NAMES = tuple(component.name for component in POSE_COMPONENTS)
STD_NAMES = tuple(component.std_name for component in POSE_COMPONENTS)


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """Pose of the rig over the road. It has no yaw: the road frame points along the camera's heading.

    Attributes:
        height_m: Height of the middle of the baseline over the road [m].
        pitch_rad: Rotation about y (left) [rad]; > 0: nose down. The paper's alpha is its negative.
        roll_rad: Rotation about x (forward) [rad]; > 0: right side down. The paper's beta.
    """

    height_m: float
    pitch_rad: float
    roll_rad: float

    @classmethod
    def from_paper(cls, height_m: float, alpha_rad: float, beta_rad: float) -> Extrinsics:
        """Convert the paper's height, pitch alpha (> 0: nose up) and roll beta."""
        return cls(height_m, -alpha_rad, beta_rad)

    def to_paper(self) -> tuple[float, float, float]:
        """Return (H [m], alpha [rad], beta [rad]) of the paper's section 2.1."""
        return self.height_m, -self.pitch_rad, self.roll_rad

    def as_array(self) -> Array:
        """Return the components in the order of :data:`POSE_COMPONENTS`, shape (3,)."""
        return np.array([getattr(self, name) for name in POSE_NAMES])

    @classmethod
    def from_array(cls, values: npt.ArrayLike) -> Extrinsics:
        """Build from the components in the order of :data:`POSE_COMPONENTS`, shape (3,)."""
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (len(POSE_NAMES),):
            raise ValueError(f"a pose is ({', '.join(POSE_NAMES)}), not an array of shape {array.shape}")
        return cls(**dict(zip(POSE_NAMES, map(float, array), strict=True)))

    def as_dict(self) -> dict[str, float]:
        """Return the components by name, as numbers that JSON and YAML take."""
        return {name: float(getattr(self, name)) for name in POSE_NAMES}

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Extrinsics:
        """Build from the components by name. Other keys are passed over.

        Raises:
            KeyError: A component is missing.
            TypeError: A value is no number.
            ValueError: A value is a text that is no number.
        """
        return cls(**{name: float(values[name]) for name in POSE_NAMES})

    def describe(self, std: Extrinsics | None = None) -> str:
        """Return the pose as people read it, in metres and degrees.

        Args:
            std: The standard deviations, None to leave them out.
        """
        return ", ".join(f"{each.label} {each.describe(self, std)}" for each in POSE_COMPONENTS)


def road_from_camera_rotation(pitch_rad: float, roll_rad: float, yaw_rad: float = 0.0) -> Array:
    """Return R_z(yaw) R_y(pitch) R_x(roll), shape (3, 3): road axes from camera body axes."""
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
