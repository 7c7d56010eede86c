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

"""The watch of a car that stands: a stop is one look at one place, however long it lasts."""

from dataclasses import replace

import numpy as np

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive.fusion import fuse_frames
from stereo_selfcal.core.drive.watch import Watch
from stereo_selfcal.synth.scenes import PAPER_RIG

STD = np.array([0.003, 3e-4, 8e-4])
POSE = np.array([1.4, 0.05, 0.01])
PLACE = np.array([0.0, np.radians(0.3), 0.0])  # a place that is uneven, or lies before a ramp


def frame(pose, stamp_s, stood=False):
    return CalibrationResult(
        "",
        extrinsics=Extrinsics.from_array(pose),
        covariance=np.diag(STD**2),
        stamp_s=stamp_s,
        n_frames=1,
        stood=stood,
    )


def doubted_after_a_stop(told):
    """Watch ten minutes of driving and five of standing at an uneven place; return whether it is doubted."""
    rng = np.random.default_rng(4)
    moved = POSE + rng.normal(size=(300, 3)) * [0.003, np.radians(0.05), np.radians(0.05)]
    watch = Watch()
    watch.start(fuse_frames([frame(pose, 0.1 * i) for i, pose in enumerate(moved[:100])], PAPER_RIG))
    for i, pose in enumerate(moved):
        watch.add(frame(pose, 100.0 + 2.0 * i))
    standing = (frame(POSE + PLACE + rng.normal(size=3) * STD, 702.0 + 2.0 * i) for i in range(150))
    return any(watch.add(replace(each, stood=told and i > 0)).doubted for i, each in enumerate(standing))


def test_a_long_stop_at_an_uneven_place_is_no_drift():
    assert not doubted_after_a_stop(told=True)
    assert doubted_after_a_stop(told=False)  # the same frames of a car that drives
