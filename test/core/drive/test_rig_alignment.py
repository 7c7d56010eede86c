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

"""The alignment over a drive: frames that tell nothing are no evidence of zero."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.alignment_verdict import AlignmentVerdict, verdict_of
from stereo_selfcal.core.drive.rig_alignment import SeenAlignment, drive_of_rig
from stereo_selfcal.core.evidence.told_alignment import UNTOLD_VARIANCES
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.road.priors import ROW_YAW_STD_RAD

RIG = StereoRig(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5, baseline_m=0.3)
UNTOLD = Alignment(0.0, 0.0, 0.0, np.diag(UNTOLD_VARIANCES))


def fused(alignments, every_s=10.0):
    """Return the alignment of frames of a drive."""
    seen = [SeenAlignment(every_s * index, each) for index, each in enumerate(alignments)]
    return drive_of_rig([], seen, [], RIG).alignment


@pytest.mark.parametrize("n_frames", [1, 2, 60])
def test_pictures_of_nothing_tell_no_alignment(n_frames):
    fog = np.full((RIG.height, RIG.width), 128, np.uint8)
    calibrator = Calibrator(RIG)
    result = calibrator.add(fog, fog, 0.0)
    for index in range(1, n_frames):
        calibrator.remember(replace(result, stamp_s=10.0 * index))
    alignment = calibrator.estimate.alignment
    assert np.allclose(alignment.std**2, UNTOLD_VARIANCES, rtol=1e-3)
    assert verdict_of(alignment) is AlignmentVerdict.NOT_SEEN


def test_frames_that_tell_nothing_do_not_change_what_others_tell():
    turn = np.radians([0.10, -0.20, 0.15])
    told = Alignment(*turn, np.diag(np.square(np.radians([0.003, 0.005, 0.02]))))
    alignment = fused([told, *[UNTOLD] * 100])
    assert np.allclose(alignment.as_array(), turn, rtol=1e-9)
    # As before, and by no frame better.
    assert np.allclose(alignment.std, told.std, rtol=1e-3)


def test_one_frame_is_told_as_it_is():
    told = Alignment(0.001, -0.002, 0.003, np.diag(np.square([1e-4, 2e-4, 4e-3])))
    alignment = fused([told])
    assert np.allclose(alignment.as_array(), told.as_array())
    assert np.allclose(alignment.covariance, told.covariance)


def test_two_bursts_of_frames_hours_apart_are_worth_two_frames_of_what_lasts():
    told = Alignment(0.0, 0.0, 0.0, np.diag(np.square(np.radians([0.05, 0.05, 0.01]))))
    times_s = np.concatenate([np.arange(20) * 0.1, 7200.0 + np.arange(20) * 0.1])

    def std(stamps_s):
        seen = [SeenAlignment(each, told) for each in stamps_s]
        return drive_of_rig([], seen, [], RIG).alignment.std

    # One burst leaves the half of the variance that lasts, two leave a quarter; out of order, it is the same.
    assert np.allclose(std(times_s[:20]) / told.std, np.sqrt(0.5 + 0.5 / 20), rtol=0.05)
    assert np.allclose(std(times_s) / told.std, np.sqrt(0.25 + 0.5 / 40), rtol=0.15)
    assert np.array_equal(std(times_s[::-1]), std(times_s))


def test_what_lenses_do_to_rows_is_not_averaged_away():
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(100):
        by_lenses = ROW_YAW_STD_RAD * rng.normal()
        # Half of the frames show two lines, too.
        lines = np.radians(0.05) * np.where(np.arange(200) % 2, 1.0, np.inf)
        variances = 1.0 / (ROW_YAW_STD_RAD**-2 + lines**-2)
        errors = np.where(np.isfinite(lines), np.radians(0.05), 0.0) * rng.normal(size=200)
        yaws = variances * (by_lenses / ROW_YAW_STD_RAD**2 + errors / lines**2)
        alignments = [
            Alignment(0.0, 0.0, yaw, np.diag([1e-8, 1e-8, variance]))
            for yaw, variance in zip(yaws, variances, strict=True)
        ]
        alignment = fused(alignments, every_s=30.0)
        ratios.append(alignment.yaw_rad / alignment.std[2])
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.2
