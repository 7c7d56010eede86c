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

"""The benchmark of the direction of travel drives cars as physics has it, and judges by what it says."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.travel_drives.cars import USUAL_FALL, any_car, profile
from benchmarks.travel_drives.driving import STEP_S, Driver, Weather, driven, wander
from benchmarks.travel_drives.filming import rotation
from benchmarks.travel_drives.judged import Verdict, read, tables
from benchmarks.travel_drives.kinds import Course, Surroundings, drive, plans
from benchmarks.travel_drives.ways import Bend, way

STEADY = Driver(0.0, 4.0, 0.0)
CALM = Weather("A", 0.0, 0.0)


def rng(seed=1):
    return np.random.default_rng(seed)


def ridden(car, road, speed_mps, duration_s, driver=STEADY):
    return driven(car, road, driver, CALM, np.full(round(duration_s / STEP_S), speed_mps), rng())


def test_a_place_in_the_world_is_found_along_the_road_again():
    road = way([Bend(60.0, 1 / 60), Bend(80.0, -1 / 150), Bend(50.0, 0.0)], 0.025, 0.04, True, rng())
    s, t = np.meshgrid(np.linspace(5, 150, 60), np.linspace(-8, 8, 9))
    points = road.world(s.ravel(), t.ravel(), 0.0).astype(np.float32)
    along, across, cos, sin = road.lane(points[:, 0], points[:, 1])
    assert np.abs(along - s.ravel()).max() < 0.1
    assert np.abs(across - t.ravel()).max() < 0.05
    np.testing.assert_allclose(np.hypot(cos, sin), 1.0, atol=1e-3)


@pytest.mark.parametrize("fall", [0.025, -0.03])
def test_a_car_points_up_the_fall_of_a_straight_road(fall):
    car = any_car(rng())
    ride = ridden(car, way([Bend(300.0, 0.0)], fall, 0.0, False, rng()), 15.0, 12.0)
    assert ride.crab_rad[-1] == pytest.approx(car.crab_rad(fall), rel=0.02)
    moved = np.diff(ride.place_m[-2:, :2], axis=0)[0]
    heading = ride.heading_rad[-1] - math.atan2(moved[1], moved[0])
    assert heading == pytest.approx(car.crab_rad(fall), rel=0.05)


def test_the_rear_axle_slips_outwards_in_a_fast_bend_and_not_in_a_slow_one():
    car = any_car(rng())
    road = way([Bend(300.0, 1 / 100)], 0.0, 0.0, False, rng())
    slow, fast = (ridden(car, road, speed, 10.0) for speed in (3.0, 14.0))
    pull = 14.0**2 / 100 * car.mass_kg * car.front_m / car.wheelbase_m
    assert fast.crab_rad[-1] == pytest.approx(pull / car.rear_stiffness, rel=0.1)
    assert abs(slow.crab_rad[-1]) < 0.1 * fast.crab_rad[-1]
    assert fast.turn_rad_s[-1] == pytest.approx(0.14, rel=0.02)
    assert fast.roll_rad[-1] == pytest.approx(car.lean_rad * 14.0**2 / 100, rel=0.1)


def test_a_braking_car_dives():
    car = any_car(rng())
    road = way([Bend(300.0, 0.0)], 0.0, 0.0, False, rng())
    speeds = np.concatenate([np.full(1000, 15.0), np.linspace(15.0, 9.0, 600)])
    ride = driven(car, road, STEADY, CALM, speeds, rng())
    assert np.mean(ride.pitch_rad[1200:]) == pytest.approx(2.0 * car.dive_rad, rel=0.2)
    assert abs(np.mean(ride.pitch_rad[200:1000])) < 0.2 * 2.0 * car.dive_rad


def test_noise_has_the_standard_deviation_it_is_drawn_with():
    values = np.concatenate([wander(4000, 0.3, rng(seed)) for seed in range(30)])
    assert values.std() == pytest.approx(1.0, abs=0.12)
    # Class A: 16e-6 m^3 at 0.1 waves per metre, which falls with the square, from 1/60 per metre on.
    heights = np.array(profile(0.0, 3000.0, "A", 1.0, rng()).heights_m)
    assert heights.std() == pytest.approx(math.sqrt(16e-6 * 0.01 * 60), rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1])
def test_the_truth_is_where_the_camera_goes_on_a_straight_road(index):
    plan = replace(plans(5, index, 1, small=True)[0], surroundings=Surroundings.BARE)
    driven_ = drive(plan)
    film, steps = driven_.film, np.round(driven_.times_s / STEP_S).astype(int)
    poses = [film._pose(step) for step in steps]
    angles = []
    for (axes, here), (_, there) in itertools.pairwise(poses):
        seen = rotation(0.0, 0.0, film.mounted.roll_rad) @ axes.T @ (there - here)
        angles.append([math.asin(-seen[1] / np.linalg.norm(seen)), math.atan2(seen[2], seen[0])])
    yaw, pitch = np.mean(angles, axis=0)
    other_fall = abs(film.car.crab_rad(driven_.labels["fall"] - USUAL_FALL))
    windy = math.radians(0.15)
    assert abs(yaw - driven_.yaw_rad) < other_fall + windy
    assert abs(pitch - driven_.pitch_rad) < math.radians(0.12)


def test_a_plan_is_the_same_drive_each_time():
    plan = replace(plans(5, 2, 1, small=True)[0], duration_s=2.0)
    one, two = drive(plan), drive(plan)
    np.testing.assert_array_equal(one.film.pair(0.5), two.film.pair(0.5))
    assert one.labels == two.labels


def verdict(**changes):
    base = Verdict(
        "abc", 1, 0, Course.STRAIGHT.value, "small", "zed", "town", "day", 30.0, 30.0, 1, 150, 100, 149,
        1.0, 2.0, 0.05, 0.05, -0.02, 0.02, 12.0, 5.0, 0.025, 0.0, 1.5, 0.1, 0.0, 0.4,
    )  # fmt: skip
    return replace(base, **changes)


@pytest.mark.parametrize(
    ("changes", "row"),
    [
        ({}, None),
        ({"yaw_error_deg": 0.1}, 0),
        ({"pitch_error_deg": 0.03}, 1),
        ({"yaw_std_deg": 0.11, "yaw_error_deg": 0.11}, 2),
        ({"course": Course.ONE_WAY.value}, 2),
        # A yaw that is not told is not counted.
        ({"course": Course.ONE_WAY.value, "yaw_std_deg": 2.0, "yaw_error_deg": 9.0}, None),
    ],
)
def test_each_demand_can_fail(changes, row):
    _, checks = tables([verdict(**changes)])
    failed = [index for index, each in enumerate(checks.rows) if each[-1] == "no"]
    assert failed == ([] if row is None else [row])


def test_a_drive_without_an_estimate_is_no_estimate_of_bends_and_none_of_a_straight_road():
    nothing = {"yaw_error_deg": math.nan, "yaw_std_deg": math.nan, "n_steps": 0}
    _, checks = tables([verdict(**nothing), verdict(course=Course.ALTERNATING.value, **nothing)])
    assert [each[-1] for each in checks.rows] == ["no", "yes"]


def test_no_file_has_no_verdicts(tmp_path):
    assert read(tmp_path / "none.csv") == []
