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

"""A calibrator that accepts what it is told to, for tests of everything around it."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from stereo_selfcal.core.drive.drive import estimate_drive
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.offline import run as run_module

POSE = Extrinsics(1.4, 0.05, -0.01)
COVARIANCE = np.diag([1e-6, 1e-8, 1e-8])


def refusal(stamp_s=0.0):
    rejection = Rejection(RejectReason.NO_LINES_FOUND, "lines found", 0, Bound.LEAST, 2, "", "paint some")
    return rejected(rejection, stamp_s)


class FakeCalibrator:
    """Accepts what it is told to; each accepted frame is a little higher than the one before."""

    accept = staticmethod(lambda index: True)
    travel_steps = ()
    made: ClassVar[list] = []

    def __init__(self, rig, config=None):
        self.rig, self.config, self.stamps, self.accepted = rig, config, [], []
        self.remembered, self.turn_rates = [], []
        self.made.append(self)

    def note_turn_rate(self, rate):
        self.turn_rates.append(rate)

    def remember(self, result, moved=None):
        self.remembered.append(result)
        return result

    def calibrate_next(self, left, right, stamp_s=0.0, stamp_difference_s=0.0):
        self.stamps.append(stamp_s)
        if not self.accept(len(self.stamps) - 1):
            return refusal(stamp_s)
        pose = replace(POSE, height_m=POSE.height_m + 0.01 * len(self.accepted))
        self.accepted.append(pose)
        return CalibrationResult("good", None, pose, COVARIANCE, 0.1, stamp_s=stamp_s, n_frames=1)

    @property
    def estimate(self):
        if not self.accepted:
            return refusal(self.stamps[-1])
        pose = Extrinsics.from_array(np.mean([p.as_array() for p in self.accepted], axis=0))
        result = CalibrationResult(
            "fused", None, pose, COVARIANCE, 0.1, stamp_s=self.stamps[-1], n_frames=len(self.accepted)
        )
        return replace(result, message=pose.describe(result.std))

    travel_steps = ()

    @property
    def drive(self):
        accepted = [each for each in self.remembered if each.accepted]
        return estimate_drive(accepted, self.rig, self.estimate)


def use_fake(monkeypatch):
    """Put it in the place of the calibrator, for as long as ``monkeypatch`` lasts."""
    monkeypatch.setattr(run_module, "Calibrator", FakeCalibrator)
    monkeypatch.setattr(FakeCalibrator, "made", [])
    return FakeCalibrator
