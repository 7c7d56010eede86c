"""Height, pitch and roll of the rig over the road: the one place where signs and axes are defined.

``p_road = R_z(yaw) R_y(pitch) R_x(roll) p_camera + [0, 0, height_m]``, REP-103 axes (x forward,
y left, z up) in both frames. ``pitch_rad > 0``: nose down. ``roll_rad > 0``: right side down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import Array

# Body axes (x forward, y left, z up) from the optical axes of a camera (x right, y down, z forward).
BODY_FROM_OPTICAL: Array = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """Pose of the rig over the road, without yaw; frames and signs are those of this module.

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
        """Return (height_m, pitch_rad, roll_rad), shape (3,)."""
        return np.array([self.height_m, self.pitch_rad, self.roll_rad])

    @classmethod
    def from_array(cls, values: npt.ArrayLike) -> Extrinsics:
        """Build from (height_m, pitch_rad, roll_rad), shape (3,)."""
        height_m, pitch_rad, roll_rad = (float(v) for v in np.asarray(values, dtype=np.float64))
        return cls(height_m, pitch_rad, roll_rad)

    def describe(self) -> str:
        """Return the pose as people read it: metres and degrees."""
        return (
            f"height {self.height_m:.4f} m, pitch {math.degrees(self.pitch_rad):+.3f} deg, "
            f"roll {math.degrees(self.roll_rad):+.3f} deg"
        )


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
