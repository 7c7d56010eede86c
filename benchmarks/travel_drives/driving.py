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

"""A driver who keeps a car in its lane, and the way of its camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..second_worlds.cameras import Array
from .cars import GRAVITY_MPS2, Car, profile
from .ways import STEP_M, Way

STEP_S = 0.005
_KINEMATIC_MPS = 2.0  # tyres roll without slip below
# A driver looks ahead by about a second (McRuer et al., 1977), and steers with a lag of 0.1 to 0.2 s besides.
_PREVIEW_S, _LEAST_PREVIEW_M = 1.1, 6.0
_LAG_S = 0.15
_STEER_MEMORY_S = 0.35  # corrections of the wheel last about so long


@dataclass(frozen=True, slots=True)
class Driver:
    """How one drives.

    Attributes:
        weave_m: Standard deviation of the place in the lane that is aimed at.
        weave_s: How long such an aim lasts.
        unsteady_rad_s: Standard deviation of the turn rate that unsteady hands make.
        changes_s: Times at which another lane is aimed at.
        change_takes_s: How long a change takes.
    """

    weave_m: float
    weave_s: float
    unsteady_rad_s: float
    changes_s: tuple[float, ...] = ()
    change_takes_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Weather:
    """What the road and the air are like.

    Attributes:
        rough: Class of ISO 8608.
        wind_mps: Mean wind from the right.
        gust_mps: Standard deviation of its gusts.
    """

    rough: str
    wind_mps: float
    gust_mps: float


@dataclass(frozen=True, eq=False)
class Ride:
    """What a car has done, every :data:`STEP_S`.

    Attributes:
        place_m: Ground under its centre of gravity, shape (n, 3).
        heading_rad: Of its body, shape (n,).
        pitch_rad: Of its body against the horizon, nose down, shape (n,).
        roll_rad: Right side down, shape (n,).
        along_m: Where it is along the road, shape (n,).
        speed_mps: How fast it drives, shape (n,).
        turn_rad_s: How fast it turns, shape (n,).
        crab_rad: How far left of its way the body points at the rear axle, shape (n,).
    """

    place_m: Array
    heading_rad: Array
    pitch_rad: Array
    roll_rad: Array
    along_m: Array
    speed_mps: Array
    turn_rad_s: Array
    crab_rad: Array


def driven(
    car: Car, way: Way, driver: Driver, weather: Weather, speed_mps: Array, rng: np.random.Generator
) -> Ride:
    """Drive a car along a road.

    Args:
        car: The car.
        way: The road.
        driver: Who drives it.
        weather: Roughness and wind.
        speed_mps: Its speed every :data:`STEP_S`, shape (n,).
        rng: Source of what hands, wind and roughness do.
    """
    n = len(speed_mps)
    aim = driver.weave_m * wander(n, driver.weave_s, rng) + _lanes(driver, n)
    hands = wander(n, _STEER_MEMORY_S, rng)
    wind = weather.wind_mps + weather.gust_mps * wander(n, 2.0, rng)
    plane = _on_tyres(car, way, driver, speed_mps, aim, hands, wind)
    return _on_springs(car, way, weather, speed_mps, plane, rng)


def wander(n: int, memory_s: float, rng: np.random.Generator) -> Array:
    """Return smooth noise of standard deviation 1 of which the memory decays."""
    keep = math.exp(-STEP_S / memory_s)
    values, first, second = np.empty(n), 0.0, 0.0
    noise = rng.standard_normal(n + round(6 * memory_s / STEP_S))
    skipped = len(noise) - n
    for index, each in enumerate(noise):
        first = keep * first + (1 - keep) * each
        second = keep * second + (1 - keep) * first
        if index >= skipped:
            values[index - skipped] = second
    # Variance of white noise through two equal poles.
    gain = (1 - keep) ** 4 * (1 + keep**2) / (1 - keep**2) ** 3
    result: Array = values / math.sqrt(gain)
    return result


def _lanes(driver: Driver, n: int) -> Array:
    """Return the lane that is aimed at: the own one, the left one after a change, and back again."""
    times = STEP_S * np.arange(n)
    aim = np.zeros(n)
    for index, start in enumerate(driver.changes_s):
        part = np.clip((times - start) / driver.change_takes_s, 0.0, 1.0)
        aim += (-1) ** index * 3.5 * (1 - np.cos(np.pi * part)) / 2
    return aim


def _on_tyres(
    car: Car, way: Way, driver: Driver, speed: Array, aim: Array, hands: Array, wind: Array
) -> dict[str, Array]:
    """Return the motion on the road: place, heading, along, turn rate, side acceleration and crab."""
    curvature, fall, heading_of = (each.tolist() for each in (way.curvature_per_m, way.fall, way.heading_rad))
    last = len(curvature) - 2

    def looked_up(values: list[float], s: float) -> float:
        place = (s - way.start_m) / STEP_M
        index = min(max(int(place), 0), last)
        return values[index] + (values[index + 1] - values[index]) * (place - index)

    base = car.wheelbase_m
    s, t = 0.0, float(aim[0])
    first = looked_up(curvature, 0.0)
    v = float(speed[0])
    turn = v * first
    load = car.mass_kg * (v * turn + GRAVITY_MPS2 * looked_up(fall, 0.0)) * car.front_m / base
    side = car.rear_m * turn - load / car.rear_stiffness * v
    angle = -side / max(v, 1.0)
    steer = (base + car.understeer * v * v) * first
    names = ("x", "y", "heading", "s", "turn", "pull", "crab")
    rows: list[tuple[float, ...]] = []
    x, y = way.world(np.array(0.0), t, 0.0)[:2].tolist()
    for v, aimed, hand, air in zip(speed.tolist(), aim.tolist(), hands.tolist(), wind.tolist(), strict=True):
        bend, lean = looked_up(curvature, s), looked_up(fall, s)
        heading = looked_up(heading_of, s) + angle
        # What the driver wants.
        reach = max(_LEAST_PREVIEW_M, _PREVIEW_S * v)
        way_angle = angle + side / max(v, 1.0)
        off = aimed - t - reach * way_angle
        gain = (base + car.understeer * v * v) / max(v, 3.0)
        wanted = (base + car.understeer * v * v) * looked_up(curvature, s + 0.3 * v)
        wanted += 2 * (base + car.understeer * v * v) / reach**2 * off + gain * driver.unsteady_rad_s * hand
        steer += (wanted - steer) * STEP_S / _LAG_S
        # What the tyres do.
        if v < _KINEMATIC_MPS:
            turn = v * math.tan(steer) / base
            side = turn * car.rear_m
            pull = v * turn + GRAVITY_MPS2 * lean
        else:
            front = -car.front_stiffness * ((side + car.front_m * turn) / v - steer)
            rear = -car.rear_stiffness * (side - car.rear_m * turn) / v
            blown = car.wind_force_n(v, air)
            pull = (front + rear) / car.mass_kg
            side += STEP_S * (pull + blown / car.mass_kg - GRAVITY_MPS2 * lean - v * turn)
            torque = car.front_m * front - car.rear_m * rear + car.wind_arm_m * blown
            turn += STEP_S * torque / car.inertia
        crab = -(side - car.rear_m * turn) / max(v, 1.0)
        rows.append((x, y, heading, s, turn, pull, crab))
        # Where it goes.
        cos, sin = math.cos(heading), math.sin(heading)
        x += STEP_S * (v * cos - side * sin)
        y += STEP_S * (v * sin + side * cos)
        ahead = (v * math.cos(angle) - side * math.sin(angle)) / (1.0 - bend * t)
        t += STEP_S * (v * math.sin(angle) + side * math.cos(angle))
        s += STEP_S * ahead
        angle += STEP_S * (turn - bend * ahead)
    return dict(zip(names, np.array(rows).T, strict=True))


def _on_springs(
    car: Car, way: Way, weather: Weather, speed: Array, plane: dict[str, Array], rng: np.random.Generator
) -> Ride:
    """Add heave, pitch and roll of the body on its springs, and the shape of the road below."""
    s = plane["s"]
    ends = (float(s.min()) - 10.0, float(s.max()) + 10.0)
    middle = profile(*ends, weather.rough, 1.0, rng)
    # Left and right tracks differ by what is shorter than the track: half of the amplitude.
    skew = profile(*ends, weather.rough, 0.5, rng)
    front_height, rear_height = (
        way.at(way.middle_m[:, 2], s + reach) for reach in (car.front_m, -car.rear_m)
    )
    slope = (front_height - rear_height) / car.wheelbase_m
    ground = rear_height + slope * car.rear_m
    gain = np.gradient(speed, STEP_S) + GRAVITY_MPS2 * slope
    a, b = car.front_m, car.rear_m
    share = (b / car.wheelbase_m, a / car.wheelbase_m)  # of the mass on either axle
    stiff = tuple(part * (2 * math.pi * hz) ** 2 for part, hz in zip(share, car.heave_hz, strict=True))
    damp = tuple(
        2 * car.damping * part * 2 * math.pi * hz for part, hz in zip(share, car.heave_hz, strict=True)
    )
    inertia = a * b  # of pitch, per mass: each end bounces by itself (Gillespie, chapter 5)
    firm = a * a * stiff[0] + b * b * stiff[1]
    omega = 2 * math.pi * car.roll_hz
    z, sink, nose, dive, roll, lean = (0.0,) * 6
    nose = -car.dive_rad * float(gain[0])
    roll = car.lean_rad * float(plane["pull"][0])
    before = (middle.at(s[0] + a), middle.at(s[0] - b), 0.0)
    heave_all, nose_all, roll_all = np.empty(len(s)), np.empty(len(s)), np.empty(len(s))
    for index, (place, pull, gained) in enumerate(
        zip(s.tolist(), plane["pull"].tolist(), gain.tolist(), strict=True)
    ):
        now = (middle.at(place + a), middle.at(place - b), skew.at(place) / 1.5)
        rise = [(here - there) / STEP_S for here, there in zip(now, before, strict=True)]
        before = now
        front = -stiff[0] * (z - a * nose - now[0]) - damp[0] * (sink - a * dive - rise[0])
        rear = -stiff[1] * (z + b * nose - now[1]) - damp[1] * (sink + b * dive - rise[1])
        sink += STEP_S * (front + rear)
        dive += STEP_S * (-a * front + b * rear - firm * car.dive_rad * gained) / inertia
        lean += STEP_S * (
            omega**2 * (car.lean_rad * pull + now[2] - roll) + 2 * car.damping * omega * (rise[2] - lean)
        )
        z += STEP_S * sink
        nose += STEP_S * dive
        roll += STEP_S * lean
        heave_all[index], nose_all[index], roll_all[index] = z, nose, roll
    return Ride(
        np.stack([plane["x"], plane["y"], ground + heave_all], axis=1),
        plane["heading"],
        nose_all - np.arctan(slope),
        roll_all + np.arctan(way.at(way.fall, s)),
        s,
        speed,
        plane["turn"],
        plane["crab"],
    )
