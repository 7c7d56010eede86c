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

"""A calibrator whose estimate improves with the frames, as that of a moving car does, for tests of calls."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm, total_covariance
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, announce, rejected

POSE = Extrinsics(1.4, 0.05, -0.01)
# Of one frame; of n frames the square root of n less.
MOTION = Extrinsics(5e-3, np.radians(0.2), np.radians(0.3))
# What does not average out.
VERGENCE = Extrinsics(5e-3, np.radians(0.02), np.radians(0.1))
DARK = 50


class ImprovingCalibrator:
    """Refuses dark images; the others show the mount and the motion of the car.

    Attributes:
        estimates: How often the estimate was made, of all calibrators.
    """

    estimates: ClassVar[int] = 0
    made: ClassVar[list] = []

    def __init__(self, rig, config=None):
        self.rig, self.config, self.stamps_s, self.last = rig, config, [], None
        self.made.append(self)

    def add(self, left, right, stamp_s=0.0, stamp_difference_s=0.0):
        if left[0, 0] <= DARK:
            refusal = Rejection(RejectReason.ROAD_NOT_SEEN, "lines", 0, Bound.LEAST, 2, "", "drive on")
            self.last = rejected(refusal, stamp_s)
            return self.last
        self.stamps_s.append(stamp_s)
        return self._mean(self.stamps_s[-1:])

    @property
    def estimate(self):
        ImprovingCalibrator.estimates += 1
        return self._mean(self.stamps_s) if self.stamps_s else self.last

    @staticmethod
    def _mean(stamps_s):
        n = len(stamps_s)
        terms = (
            UncertaintyTerm("vergence", np.diag(VERGENCE.as_array() ** 2)),
            UncertaintyTerm("motion", np.diag(MOTION.as_array() ** 2) / n),
        )
        evidence = MountEvidence(
            stamps_s[-1] - stamps_s[0], 0, 0, False, MOTION, np.full(3, 1.0), np.full(3, float(n))
        )
        result = CalibrationResult(
            "",
            extrinsics=POSE,
            covariance=total_covariance(terms),
            uncertainty=terms,
            stamp_s=stamps_s[-1],
            n_frames=n,
            mount=evidence if n > 1 else None,
        )
        return replace(result, message=announce(result))


def reached_by(n_frames):
    """Return targets that so many frames reach, and no fewer: by the pitch."""
    variance = VERGENCE.pitch_rad**2 + MOTION.pitch_rad**2 / (n_frames - 0.5)
    return Targets(0.02, float(np.sqrt(variance)), 0.02)


def use_improving(monkeypatch, module):
    """Put it in the place of the calibrator of a module, for as long as ``monkeypatch`` lasts."""
    monkeypatch.setattr(module, "Calibrator", ImprovingCalibrator)
    monkeypatch.setattr(ImprovingCalibrator, "made", [])
    monkeypatch.setattr(ImprovingCalibrator, "estimates", 0)
    return ImprovingCalibrator
