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

"""The camera against the direction of travel as a part of the estimate of a drive."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drive_making import POSE, make_drive
from travel_making import PITCH, YAW, step

from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.drive.drive import estimate_drive, fuse_frames
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.reservations import ReservationKind
from stereo_selfcal.core.results import CalibrationResult, rejected

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
NOT_OF_TRAVEL = ReservationKind.PITCH_NOT_OF_TRAVEL


def frames_of(pitch_rad, duration_s=30.0, **more):
    stamps, poses, covariances = make_drive(duration_s, 2.0, outliers=0.0, **more)
    poses[:, 1] += pitch_rad - POSE[1]
    return [
        CalibrationResult(
            "", extrinsics=Extrinsics.from_array(pose), covariance=covariance, stamp_s=stamp, n_frames=1
        )
        for stamp, pose, covariance in zip(map(float, stamps), poses, covariances, strict=True)
    ]


def drive_of(frames, steps):
    return estimate_drive(frames, RIG, fuse_frames(frames, RIG), steps)


def test_estimate_has_the_direction_of_travel_and_says_so():
    estimate = drive_of(frames_of(PITCH), [step(i) for i in range(300)]).estimate
    assert estimate.travel.yaw_rad == pytest.approx(YAW, abs=1e-3)
    yaw_deg = math.degrees(estimate.travel.yaw_rad)
    assert f", yaw {yaw_deg:+.4f} deg (std 0.0" in estimate.message
    assert estimate.message.endswith("against the direction of travel")
    assert not estimate.reservations


def test_yaw_of_a_drive_of_bends_alone_is_not_announced():
    estimate = drive_of(frames_of(PITCH), [step(i, turn=0.02) for i in range(300)]).estimate
    assert estimate.travel is not None and not estimate.travel.tells_yaw
    assert "yaw" not in estimate.message


def test_roll_of_the_mount_is_taken_from_the_angles():
    frames = frames_of(0.15)
    roll = fuse_frames(frames, RIG).extrinsics.roll_rad
    steps = []
    for i in range(300):
        plain = step(i, pitch=0.15)
        c, s = math.cos(roll), math.sin(roll)
        ahead, left, up = plain.motion.moved_m
        moved = np.array([ahead, c * left + s * up, c * up - s * left])
        steps.append(replace(plain, motion=replace(plain.motion, moved_m=moved)))
    assert drive_of(frames, steps).estimate.travel.yaw_rad == pytest.approx(YAW, abs=1e-4)


def test_a_pitch_over_the_road_that_contradicts_the_travel_is_told_with_its_size():
    steps = [step(i) for i in range(300)]
    told = drive_of(frames_of(PITCH + math.radians(1.2)), steps).estimate
    (reservation,) = [each for each in told.reservations if each.kind is NOT_OF_TRAVEL]
    assert reservation.detail.startswith("+1.2")
    assert "pitch over the road is not that against the direction of travel" in told.message
    assert told.with_reservations


def test_after_a_move_the_yaw_is_that_of_the_drive_since():
    bump = np.array([-0.02, math.radians(0.8), 0.0])
    frames = frames_of(PITCH, duration_s=1200.0, steps=((600.0, bump),))
    # Steps of a part of the time are enough.
    before = [replace(step(0), stamp_s=100.0 + 0.1 * i) for i in range(300)]
    after = [replace(step(0, yaw=YAW + 0.02), stamp_s=1000.0 + 0.1 * i) for i in range(300)]
    drive = drive_of(frames, before + after)
    assert len(drive.changes) == 1
    assert drive.segments[0].estimate.travel.yaw_rad == pytest.approx(YAW, abs=1e-3)
    assert drive.estimate.travel.yaw_rad == pytest.approx(YAW + 0.02, abs=1e-3)
    assert drive.estimate.message.index("yaw") < drive.estimate.message.index("since the camera was moved")


def test_frames_that_are_all_refused_tell_the_direction_of_travel_all_the_same():
    refusal = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines", 0, Bound.LEAST, 2, "", "paint some"))
    drive = estimate_drive([], RIG, refusal, [step(i) for i in range(100)])
    assert drive.estimate.travel.yaw_rad == pytest.approx(YAW, abs=1e-3)
    assert drive.estimate.message == refusal.message
