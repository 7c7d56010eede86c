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

"""Result files for tests."""

import dataclasses

import numpy as np

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.travel import RightDelay, Travel
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.files.result_file import write_result

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
# Awkward on purpose: no short decimal, and so small that repr() has an exponent without a point.
EXTRINSICS = Extrinsics(1 / 3, 1e-05, -2 / 7)
COVARIANCE = np.diag([1e-6, 1e-10, 4e-8])


def a_result(**changes):
    result = CalibrationResult(
        "fine", extrinsics=EXTRINSICS, covariance=COVARIANCE, stamp_s=1_700_000_000.123456789, n_frames=3
    )
    return dataclasses.replace(result, **changes)


def write(path, result=None, source="bags/straight_road", **options):
    write_result(path, result or a_result(), RIG, source=source, seed=7, **options)


MOTION = np.array([[2.5e-7, 1e-9, 2e-9], [1e-9, 6e-11, 0.0], [2e-9, 0.0, 3e-8]])
TERMS = (UncertaintyTerm("noise", COVARIANCE - MOTION), UncertaintyTerm("motion", MOTION))
MOUNT = MountEvidence(
    duration_s=100 / 3,
    n_outliers=1,
    n_known=2,
    stood=False,
    motion=Extrinsics(0.005, 1 / 300, 0.0035),
    memory_s=np.array([1.5, 4 / 3, 2.0]),
    looks=np.array([10.0, 11.5, 7.25]),
)
DELAY = RightDelay(-1 / 3000, 1e-5, np.array([[4e-8, -1e-8], [-1e-8, 2.5e-5]]), 3, (2.5, 14 / 3))
TRAVEL = Travel(-1 / 30, 1e-05, np.array([[4e-6, -1e-7 / 3], [-1e-7 / 3, 9e-6]]), 41, 4 / 3, 25.5)


def a_mount(**changes):
    """Return the estimate of a drive, with all that a file says of it."""
    return a_result(**{"uncertainty": TERMS, "mount": MOUNT, "delay": DELAY} | changes)
