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

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from landmark_making import RIG, SHORT_RIG, START, cloud, drive
from street_making import along

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.drive.travel import steps_of
from stereo_selfcal.core.drive.travel_vergence import (
    RightYaw,
    pitch_by_right_yaw,
    vergence_of_parallax,
    vergence_of_travel,
)
from stereo_selfcal.core.rejection import NotFitted

RIGHT_YAW = math.radians(0.1)


@dataclass(frozen=True)
class Pose:
    stamp_s: float
    extrinsics: Extrinsics | None


def plane_pitch(rig, height_m, pitch_rad, right_yaw_rad):
    """Return the pitch of the plane that the disparities of a flat road seem to lie on."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(4.0, 15.0, 300), rng.uniform(-2.0, 2.0, 300)
    ground = np.column_stack([x, y, np.full(300, -height_m)])
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    ahead, left, up = (ground @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])).T
    u, v = -left / ahead, -up / ahead
    # The right camera looks farther left by the yaw: its content moves to the right.
    of_right = -(left + rig.baseline_m) / ahead
    nearness = (u - of_right - right_yaw_rad * (1.0 + of_right**2)) / rig.baseline_m
    points = np.column_stack([np.ones(300), -u, -v]) / nearness[:, None]
    normal = np.linalg.lstsq(points, -np.ones(300), rcond=None)[0]
    return math.atan2(-normal[0], normal[2])


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
def test_the_derivative_is_that_of_a_road_seen_with_a_turned_camera(rig):
    pose = Extrinsics(1.5, 0.035, 0.0)
    assert plane_pitch(rig, 1.5, 0.035, 0.0) == pytest.approx(0.035, abs=1e-9)
    change = (plane_pitch(rig, 1.5, 0.035, 1e-4) - plane_pitch(rig, 1.5, 0.035, -1e-4)) / 2e-4
    assert pitch_by_right_yaw(rig, pose) == pytest.approx(change, rel=0.05)
    assert change < 0.0


def steps(rig, right_yaw_rad, n=25, seed=1):
    places = [along(START, 1.1 * i) for i in range(n)]
    frames = drive(
        cloud(np.random.default_rng(seed)),
        rig,
        places,
        np.random.default_rng(seed + 1),
        right_yaw_rad=right_yaw_rad,
    )
    return frames, steps_of(frames, rig)


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
@pytest.mark.parametrize("right_yaw_rad", [0.0, RIGHT_YAW, -RIGHT_YAW])
def test_the_direction_of_travel_tells_a_turn_of_the_right_camera(rig, right_yaw_rad):
    frames, driven = steps(rig, right_yaw_rad)
    pitch = plane_pitch(rig, 1.5, START.pitch_rad, right_yaw_rad)
    poses = [Pose(each.stamp_s, Extrinsics(1.5, pitch, 0.0)) for each in frames]
    found = vergence_of_travel(driven, poses, rig)
    assert isinstance(found, RightYaw)
    assert found.yaw_rad == pytest.approx(right_yaw_rad, abs=math.radians(0.025))
    assert abs(found.yaw_rad - right_yaw_rad) < 2.5 * found.std_rad


def test_slopes_of_the_road_are_in_the_std():
    frames, driven = steps(RIG, 0.0)
    poses = [Pose(each.stamp_s, Extrinsics(1.5, START.pitch_rad, 0.0)) for each in frames]
    found = vergence_of_travel(driven, poses, RIG)
    # A drive of 26 m may be a single slope of a third of a degree.
    assert math.radians(0.05) < found.std_rad < math.radians(0.12)


@pytest.mark.parametrize("rig", [RIG, SHORT_RIG])
@pytest.mark.parametrize("right_yaw_rad", [0.0, RIGHT_YAW, -RIGHT_YAW])
def test_the_parallax_tells_a_turn_of_the_right_camera(rig, right_yaw_rad):
    _, driven = steps(rig, right_yaw_rad)
    found = vergence_of_parallax(driven, rig)
    assert isinstance(found, RightYaw)
    assert found.yaw_rad == pytest.approx(right_yaw_rad, abs=math.radians(0.02))
    assert abs(found.yaw_rad - right_yaw_rad) < 3.0 * found.std_rad


def test_errors_of_the_parallax_are_as_its_std_says():
    ratios = []
    for seed in range(12):
        found = vergence_of_parallax(steps(RIG, RIGHT_YAW, 12, 10 * seed)[1], RIG)
        ratios.append((found.yaw_rad - RIGHT_YAW) / found.std_rad)
    # The std allows for distortion that these points do not have.
    assert np.sqrt(np.mean(np.square(ratios))) < 1.2


def test_without_a_drive_or_poses_there_is_no_vergence():
    frames, driven = steps(RIG, 0.0, 6)
    pose = Extrinsics(1.5, 0.035, 0.0)
    poses = [Pose(each.stamp_s, pose) for each in frames]
    late = [replace(each, stamp_s=each.stamp_s + 100.0) for each in poses]
    for found in (
        vergence_of_travel([], poses, RIG),
        vergence_of_travel(driven, [], RIG),
        vergence_of_travel(driven, late, RIG),
        vergence_of_travel(driven, [Pose(100.0, None), *poses], RIG),
        vergence_of_parallax(driven[:2], RIG),
    ):
        assert isinstance(found, NotFitted)
