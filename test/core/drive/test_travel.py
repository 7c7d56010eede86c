import math
from dataclasses import replace

import numpy as np
import pytest
from landmark_making import RIG, START, Frame, cloud, drive
from street_making import Place, along

from stereo_selfcal.core.drive.motion_between_frames import FrameMotion
from stereo_selfcal.core.drive.travel import (
    MOST_STEP_S,
    Travel,
    TravelStep,
    estimate_travel,
    step_between,
    steps_of,
)
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road.priors import RIDE_MEMORY_S
from stereo_selfcal.synth.renderer import rotation

YAW, PITCH = 0.012, 0.035
NOISE = np.diag([1e-4, 1e-4, 1e-4, 5e-3, 1e-3, 1e-3, 1e-4]) ** 2


def step(i, yaw=YAW, pitch=PITCH, way_m=1.0, turn=0.0, period_s=0.1):
    """Return a step of a camera that points so against its direction, in the middle of the step."""
    middle = rotation(0, 0, yaw) @ rotation(0, pitch, 0)
    moved = rotation(0, 0, turn / 2) @ middle.T @ [way_m, 0.0, 0.0]
    motion = FrameMotion(np.array([0.0, 0.0, turn]), moved, 0.0, NOISE, 100, 1.0)
    return TravelStep(100.0 + i * period_s, period_s, motion)


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
    lever_m = 1.8
    curvatures = np.concatenate([np.zeros(20), np.full(30, 0.01), np.full(30, -0.006), np.zeros(20)])
    steps = [step(i, YAW - lever_m * each, turn=each) for i, each in enumerate(curvatures)]
    found = travel(steps)
    assert found.yaw_rad == pytest.approx(YAW, abs=math.radians(0.02))
    assert found.lever_m == pytest.approx(lever_m, abs=0.15)


def test_a_bend_alone_leaves_the_yaw_uncertain():
    straight = travel([step(i) for i in range(100)])
    bend = travel([step(i, YAW - 2.0 * 0.02, turn=0.02) for i in range(100)])
    assert bend.std[0] > 3.0 * straight.std[0]
    assert abs(bend.yaw_rad - YAW) < 2.0 * bend.std[0]
    assert bend.std[1] == pytest.approx(straight.std[1], rel=0.01)


def test_the_more_bends_the_less_certain_without_a_jump():
    stds = [travel([step(i, turn=turn) for i in range(50)]).std[0] for turn in np.linspace(0.0, 0.03, 61)]
    ratios = np.array(stds[1:]) / stds[:-1]
    assert np.all(ratios > 0.999)
    assert ratios.max() < 1.2


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
    short, long = (travel([step(i) for i in range(n)]).std for n in (20, 600))
    assert np.all(long < short / 3.0)


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
