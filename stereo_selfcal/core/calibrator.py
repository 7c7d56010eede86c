"""The calibrator: every stage on one frame, and the fusion of frames. Live and replay use it alike."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .config import CalibratorConfig
from .results import CalibrationResult
from .rig import StereoRig

Image = npt.NDArray[np.uint8]


class Calibrator:
    """Stateful calibrator of one rig: add frames, read the fused estimate."""

    def __init__(self, rig: StereoRig, config: CalibratorConfig | None = None) -> None:
        self.rig = rig
        self.config = config or CalibratorConfig()

    def add(self, left: Image, right: Image, stamp_s: float = 0.0) -> CalibrationResult:
        """Calibrate one frame and remember it when it is accepted.

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.
            stamp_s: Time stamp of the frame [s].
        """
        raise NotImplementedError

    @property
    def estimate(self) -> CalibrationResult:
        """The accepted frames so far, fused; rejected with ``no_frames`` when there is none."""
        raise NotImplementedError


def calibrate(
    left: Image, right: Image, rig: StereoRig, seed: int = 0, config: CalibratorConfig | None = None
) -> CalibrationResult:
    """Calibrate one stereo frame.

    Args:
        left: (H, W) uint8 rectified image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        seed: Seed of the random numbers; same input and seed, same result.
        config: Settings; its seed is replaced by ``seed``.
    """
    raise NotImplementedError
