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
from dataclasses import replace

import numpy as np
import pytest
from landmark_making import RIG, START, Frame, cloud, drive
from street_making import Place, along
from travel_making import PITCH, YAW, step

from stereo_selfcal.core.drive.travel import (
    MOST_STEP_S,
    Travel,
    estimate_travel,
    step_between,
    steps_of,
)
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road.priors import RIDE_MEMORY_S
from stereo_selfcal.synth.renderer import rotation


def travel(steps):
    found = estimate_travel(steps)
    assert isinstance(found, Travel), found.reason
    return found


def test_signs_left_of_the_travel_and_nose_down_are_positive():
    found = travel([step(i) for i in range(100)])
    assert found.yaw_rad == pytest.approx(YAW, abs=1e-4)
    assert found.pitch_rad == pytest.approx(PITCH, abs=1e-4)
    assert found.n_steps == 100


def test_a_drive_through_points_gives_yaw_and_pitch():
    places = [along(START, 1.1 * i) for i in range(25)]
    found = travel(
        steps_of(drive(cloud(np.random.default_rng(1)), RIG, places, np.random.default_rng(2)), RIG)
    )
    assert found.yaw_rad == pytest.approx(START.yaw_rad, abs=math.radians(0.06))
    assert found.pitch_rad == pytest.approx(START.pitch_rad, abs=math.radians(0.06))


def test_late_right_images_bend_nothing_where_landmarks_know_it():
    places = [along(START, 1.1 * i) for i in range(12)]
    world = cloud(np.random.default_rng(1))
    frames = drive(world, RIG, places, np.random.default_rng(2), right_ahead_m=0.25)
    told = [Frame(each.stamp_s, replace(each.landmarks, ahead=0.25 / RIG.baseline_m)) for each in frames]
    way_m = [each.way_m for each in steps_of(told, RIG)]
    assert np.median(way_m) == pytest.approx(1.1, abs=0.01)
    assert travel(steps_of(told, RIG)).pitch_rad == pytest.approx(START.pitch_rad, abs=math.radians(0.1))


def test_in_a_bend_the_camera_moves_sideways_and_the_heading_is_found_all_the_same():
    lever_m, slip = 1.8, 0.004
    straight, bends = np.zeros(100), np.repeat([0.01, -0.006, 0.008, -0.012], 30)
    steps = []
    for i, curvature in enumerate(np.concatenate([straight, bends, straight, bends, straight])):
        way_m = 0.5 if i < 250 else 1.5
        aside = -lever_m * curvature + slip * (way_m / 0.1) ** 2 * curvature
        steps.append(step(i, YAW + aside, way_m=way_m, turn=curvature * way_m))
    found = travel(steps)
    assert found.yaw_rad == pytest.approx(YAW, abs=math.radians(0.02))
    assert found.lever_m == pytest.approx(lever_m, abs=0.3)


def test_a_bend_alone_leaves_the_yaw_uncertain():
    straight = travel([step(i) for i in range(100)])
    bend = travel([step(i, YAW - 2.0 * 0.02, turn=0.02) for i in range(100)])
    assert bend.std[0] > 3.0 * straight.std[0]
    assert abs(bend.yaw_rad - YAW) < 2.0 * bend.std[0]
    assert bend.std[1] == pytest.approx(straight.std[1], rel=0.01)
    assert straight.tells_yaw and not bend.tells_yaw


# Slower in the widest bends, the heading changes by no more than that of a car that weaves in its lane.
@pytest.mark.parametrize(
    ("radius_m", "speed_mps"),
    [(30.0, 8.0), (100.0, 8.0), (100.0, 14.0), (300.0, 8.0), (300.0, 14.0), (300.0, 22.0), (800.0, 22.0)],
)
@pytest.mark.parametrize("alternating_s", [math.inf, 8.0, 4.0])
def test_a_drive_of_bends_alone_never_tells_the_yaw_to_three_tenths_of_a_degree(
    radius_m, speed_mps, alternating_s
):
    steps = []
    for i in range(300):
        # From one bend into the other, as fast as a steering wheel is turned.
        turns = (
            1.0
            if alternating_s == math.inf
            else np.clip(3.0 * math.sin(i / 10 / alternating_s * math.pi), -1, 1)
        )
        curvature, way_m = float(turns) / radius_m, speed_mps / 10.0
        steps.append(step(i, YAW - 1.3 * curvature, way_m=way_m, turn=curvature * way_m))
    assert math.degrees(travel(steps).std[0]) > 0.3


def test_weaving_in_the_lane_leaves_the_yaw_nearly_as_certain_as_driving_straight():
    straight, weaving = [], []
    for i in range(300):
        turn = math.radians(0.5) * 2 * math.pi / 6.0 * math.cos(2 * math.pi * i / 10 / 6.0) / 10.0
        straight.append(step(i, way_m=1.4))
        weaving.append(step(i, YAW - 1.3 * turn / 1.4, way_m=1.4, turn=turn))
    assert travel(weaving).std[0] < 1.4 * travel(straight).std[0]
    assert math.degrees(travel(weaving).std[0]) < 0.1


def test_the_more_bends_the_less_certain_without_a_jump():
    stds = [travel([step(i, turn=turn) for i in range(50)]).std[0] for turn in np.linspace(0.0, 0.006, 121)]
    ratios = np.array(stds[1:]) / stds[:-1]
    assert np.all(ratios > 0.999)
    assert ratios.max() < 1.2


def test_what_the_roll_of_the_camera_does_to_the_angles_is_taken_back():
    roll = math.radians(4.0)
    body = (rotation(0, 0, YAW) @ rotation(0, 0.15, 0) @ rotation(roll, 0, 0)).T @ [1.0, 0.0, 0.0]
    steps = [replace(step(i), motion=replace(step(i).motion, moved_m=body)) for i in range(60)]
    found = estimate_travel(steps, (roll, math.radians(0.1)))
    assert isinstance(found, Travel)
    assert (found.yaw_rad, found.pitch_rad) == pytest.approx((YAW, 0.15), abs=1e-6)
    rough = estimate_travel(steps, (roll, math.radians(5.0)))
    assert isinstance(rough, Travel)
    assert rough.std[0] > math.sin(0.15) * math.radians(4.9) > found.std[0]


def test_the_std_holds_for_a_car_that_pitches_slowly():
    rng = np.random.default_rng(3)
    n, period_s, scatter = 300, 0.1, math.radians(0.25)
    keep = math.exp(-period_s / RIDE_MEMORY_S)
    ratios = []
    for _ in range(60):
        motion = np.empty((n, 2))
        motion[0] = scatter * rng.standard_normal(2)
        for i in range(1, n):
            motion[i] = keep * motion[i - 1] + scatter * math.sqrt(1 - keep**2) * rng.standard_normal(2)
        found = travel([step(i, YAW + yaw, PITCH + pitch) for i, (yaw, pitch) in enumerate(motion)])
        ratios.append(([found.yaw_rad, found.pitch_rad] - np.array([YAW, PITCH])) / found.std)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.3)), rms


def test_longer_drives_are_more_certain():
    level = (0.0, 0.0)
    short, long = (estimate_travel([step(i) for i in range(n)], level).std for n in (20, 600))
    assert long[1] < short[1] / 3.0
    # The slip on a road that falls by 2 % more than others remains, in the yaw.
    assert 0.02 * 9.81 * 0.006 < long[0] < 0.7 * short[0]


def test_wrong_steps_do_not_count():
    steps = [step(i) for i in range(60)]
    for i in range(0, 60, 5):
        steps[i] = step(i, YAW + 0.1, PITCH - 0.1)
    found = travel(steps)
    assert found.yaw_rad == pytest.approx(YAW, abs=1e-3)
    assert found.n_steps == 48


def test_standing_and_reversing_are_no_travel():
    found = estimate_travel([step(i, way_m=way) for i, way in enumerate([0.0, 0.01, -1.0, -2.0, 1.0])])
    assert isinstance(found, NotFitted)
    assert found.value == 1


@pytest.mark.parametrize("apart_s", [MOST_STEP_S + 0.01, 0.0, -0.1, math.nan])
def test_frames_far_apart_or_out_of_order_make_no_step(apart_s):
    rng = np.random.default_rng(4)
    first, second = drive(cloud(rng), RIG, [Place(), Place(x_m=1.0)], rng)
    assert isinstance(step_between(first, Frame(first.stamp_s + apart_s, second.landmarks), RIG), NotFitted)


def test_frames_without_landmarks_make_no_step():
    rng = np.random.default_rng(4)
    first, second = drive(cloud(rng), RIG, [Place(), Place(x_m=1.0)], rng)
    blind = Frame(first.stamp_s + 0.05, None)
    assert steps_of([first, blind, second], RIG) == []
    assert len(steps_of([first, second], RIG)) == 1
