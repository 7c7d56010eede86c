"""When an estimate of the mount is good enough: standard deviations that a user asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.pose import Extrinsics
from ..results import CalibrationResult

# Defaults of what a user asks for: what half a minute of a usual drive reaches with each kind of rig. The
# angles are 0.15 and 0.35 deg.
DEFAULT_HEIGHT_STD_M = 0.015
DEFAULT_PITCH_STD_RAD = 0.0026
DEFAULT_ROLL_STD_RAD = 0.0061


@dataclass(frozen=True, slots=True)
class Targets:
    """Standard deviations that are good enough.

    Attributes:
        height_std_m: Of the height [m]; 0: any is.
        pitch_std_rad: Of the pitch [rad]; 0: any is.
        roll_std_rad: Of the roll [rad]; 0: any is.
        frames: Fewest accepted frames.
    """

    height_std_m: float = 0.0
    pitch_std_rad: float = 0.0
    roll_std_rad: float = 0.0
    frames: int = 1

    @property
    def std(self) -> Extrinsics:
        """The standard deviations of height, pitch and roll; 0: any is good enough."""
        return Extrinsics(self.height_std_m, self.pitch_std_rad, self.roll_std_rad)

    def reached(self, estimate: CalibrationResult) -> bool:
        """Whether an estimate of the mount is good enough."""
        if not estimate.accepted or estimate.std is None or estimate.n_frames < self.frames:
            return False
        asked = self.std.as_array()
        return bool(np.all((asked == 0.0) | (estimate.std.as_array() <= asked)))
