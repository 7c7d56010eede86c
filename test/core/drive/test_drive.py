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

"""The estimate of a drive: that of all frames, or of those since the mount was moved."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drive_making import POSE, make_drive

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.drive.drive import clock, estimate_drive, fuse_frames
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
BUMP = np.array([-0.02, math.radians(0.8), 0.0])


def results_of(stamps, poses, covariances):
    return [
        CalibrationResult(
            message="",
            extrinsics=Extrinsics.from_array(pose),
            covariance=covariance,
            lane_yaw_rad=0.01,
            stages={"refined": Extrinsics.from_array(pose)},
            stamp_s=float(stamp),
            n_frames=1,
        )
        for stamp, pose, covariance in zip(stamps, poses, covariances, strict=True)
    ]


def test_without_a_move_it_is_the_estimate_of_all_frames():
    results = results_of(*make_drive(duration_s=1200.0, outliers=0.0))
    fused = fuse_frames(results, RIG)
    drive = estimate_drive(results, RIG, fused)
    assert drive.judged
    assert drive.changes == ()
    (segment,) = drive.segments
    assert segment.estimate is drive.estimate is fused
    error, std = segment.standard_error.as_array(), fused.std.as_array()
    assert np.all(error > 0.0) and np.all(error < std)
    # Of 600 frames, some of which repeat each other.
    assert np.all(segment.spread.as_array() > 8.0 * error)


def test_frames_that_promise_too_much_count_as_others_where_the_car_moves():
    """Frames that see themselves as ten times better are as wrong as the others."""
    results = results_of(*make_drive(duration_s=1200.0, outliers=0.0))
    for index in range(0, len(results), 50):
        results[index] = replace(results[index], covariance=results[index].covariance / 100)
    fused = fuse_frames(results, RIG)
    assert np.all(np.abs(fused.extrinsics.as_array() - POSE) < 3.0 * fused.std.as_array())
    # Beside motion, noise matters little: without the twelve, the mean is the same to a fraction of its std.
    others = [each for index, each in enumerate(results) if index % 50]
    change = fused.extrinsics.as_array() - fuse_frames(others, RIG).extrinsics.as_array()
    assert np.all(np.abs(change) < 0.7 * fused.std.as_array())


def test_unknowns_of_the_rig_are_neither_noise_nor_motion():
    """Frames that have them scatter no less: motion and moves are those without them."""
    part = UncertaintyTerm("vergence", np.diag([0.02, 0.005, 0.005]) ** 2)
    plain = results_of(*make_drive(duration_s=1200.0, steps=((600.0, BUMP),), outliers=0.0))
    whole = [
        replace(
            each,
            covariance=each.covariance + part.covariance,
            uncertainty=(UncertaintyTerm("noise", each.covariance), part),
        )
        for each in plain
    ]
    without, drive = (estimate_drive(each, RIG, fuse_frames(each, RIG)) for each in (plain, whole))
    assert [change.at_s for change in drive.changes] == [change.at_s for change in without.changes]
    assert len(drive.changes) == 1
    np.testing.assert_allclose(
        drive.estimate.covariance - without.estimate.covariance, part.covariance, rtol=1e-6, atol=1e-15
    )


@pytest.mark.parametrize("steps", [(), ((600.0, BUMP),)])
def test_alignment_is_that_of_the_rig_whatever_the_mount_does(steps):
    results = results_of(*make_drive(duration_s=1200.0, steps=steps))
    alignment = Alignment(1e-4, 0.0, 2e-3, np.eye(3) * 1e-10)
    drive = estimate_drive(results, RIG, replace(fuse_frames(results, RIG), alignment=alignment))
    assert drive.judged and len(drive.changes) == len(steps)
    assert all(each.alignment is alignment for each in (drive.estimate, drive.segments[0].estimate))


def test_a_short_drive_is_the_fused_estimate_as_it_is():
    results = results_of(*make_drive(duration_s=4.0, rate_hz=5.0))
    fused = fuse_frames(results, RIG)
    drive = estimate_drive(results, RIG, fused)
    assert drive.estimate is fused
    assert not drive.judged
    # Of four seconds hardly two moments are independent.
    (segment,) = drive.segments
    assert np.all(segment.standard_error.as_array() > 0.4 * fused.mount.motion.as_array())


def test_a_car_that_stood_has_no_error_by_its_motion():
    results = results_of(*make_drive(duration_s=4.0, rate_hz=5.0, outliers=0.0))
    stood = [results[0], *(replace(each, stood=True) for each in results[1:])]
    drive = estimate_drive(stood, RIG, fuse_frames(stood, RIG))
    assert drive.segments[0].standard_error is None
    assert drive.estimate.mount.stood


def test_after_a_move_it_is_where_the_camera_is_now():
    results = results_of(*make_drive(duration_s=1200.0, steps=((600.0, BUMP),), outliers=0.01))
    drive = estimate_drive(results, RIG, fuse_frames(results, RIG))
    (change,) = drive.changes
    assert change.at_s == pytest.approx(700.0, abs=5.0)
    for segment, truth in zip(drive.segments, (POSE, POSE + BUMP), strict=True):
        error = segment.estimate.extrinsics.as_array() - truth
        assert np.all(np.abs(error) < 3 * segment.estimate.std.as_array())
    assert drive.estimate.extrinsics == drive.segments[-1].estimate.extrinsics == change.after
    assert change.before == drive.segments[0].estimate.extrinsics
    assert np.all(np.abs(change.shift.as_array() - BUMP) < [0.003, 0.002, 0.003])
    assert f"; since the camera was moved at {clock(change.at_s)}" in drive.estimate.message
    assert drive.estimate.n_frames <= len(results) // 2


def test_the_order_of_the_frames_does_not_matter():
    results = results_of(*make_drive(duration_s=600.0, steps=((300.0, 2 * BUMP),)))
    fused = fuse_frames(results, RIG)
    there, back = (estimate_drive(each, RIG, fused) for each in (results, results[::-1]))
    assert len(there.changes) == 1
    assert there.changes[0].at_s == back.changes[0].at_s
    assert there.estimate.message == back.estimate.message


def test_without_an_accepted_frame_it_is_the_refusal():
    refusal = rejected(Rejection(RejectReason.NO_LINES_FOUND, "rows", 0, Bound.LEAST, 40, "px", "find lines"))
    drive = estimate_drive([], RIG, refusal)
    assert drive.estimate is refusal
    assert (drive.segments, drive.changes, drive.judged) == ((), (), False)


@pytest.mark.parametrize(
    ("stamp_s", "text"), [(123.45, "123.5 s"), (1_700_000_000.0, "22:13:20 UTC"), (0.0, "0.0 s")]
)
def test_times_are_those_of_a_clock_where_there_is_one(stamp_s, text):
    assert clock(stamp_s) == text
