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

"""The drives of a series: what is driven, where, by which car, and with which rig."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from stereo_selfcal import StereoRig

from ..second_worlds.cameras import Array, Turn
from ..second_worlds.sensors import Sensor
from .cars import USUAL_FALL, any_car
from .driving import STEP_S, Driver, Weather, driven
from .filming import Film, Mounted
from .streets import Hour, OtherCar, Surroundings, other_car, street
from .ways import Bend, way

_SERIES = 2222
_TIGHTEST_M, _WIDEST_M = 30.0, 800.0
# Drivers take bends at up to 2 to 3 m/s^2 (Reymond et al., 2001), and many far below, behind others.
_BEND_MPS2 = (0.2, 2.5)
_MOST_TURN_RAD = 5.0  # so that the road does not meet itself
# Residual turn of a calibrated right camera: a tenth of a pixel at f = 700.
_LEFT_TURN_RAD = math.radians(0.008)
RIGS = {
    "kitti": StereoRig(1242, 375, 721.5, 721.5, 609.56, 172.85, 0.5327),
    "zed": StereoRig(1280, 720, 700.0, 700.0, 641.3, 356.2, 0.12),
    "paper": StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481),
}


class Course(Enum):
    """What is driven."""

    STRAIGHT = "straight"
    CHANGES = "lane changes"
    STOPS = "straight, stop and go"
    WITH_BENDS = "with bends"
    ONE_WAY = "only bends one way"
    ALTERNATING = "only bends, alternating"


ONLY_BENDS = (Course.ONE_WAY, Course.ALTERNATING)


@dataclass(frozen=True, slots=True)
class Plan:
    """One drive of a series.

    Attributes:
        seed: Seed of the series.
        index: Its number in the series.
        course: What is driven.
        duration_s: How long.
        rig: Name of a rig.
        scale: Part of its size that is rendered: 1, or about a half.
        surroundings: What the street runs through.
        hour: The light.
    """

    seed: int
    index: int
    course: Course
    duration_s: float
    rig: str
    scale: float
    surroundings: Surroundings
    hour: Hour

    @property
    def name(self) -> str:
        """Course and duration."""
        return f"{self.course.value} {self.duration_s:g} s"


_DAY, _NIGHT = Hour.DAY, Hour.NIGHT
_TOWN, _SUBURB, _COUNTRY, _BARE = Surroundings
# In the order of their importance; a series repeats them with other rigs, cars and roads.
_CYCLE = (
    (Course.STRAIGHT, 30.0, _TOWN, _DAY),
    (Course.STRAIGHT, 10.0, _SUBURB, _DAY),
    (Course.ONE_WAY, 15.0, _SUBURB, _DAY),
    (Course.WITH_BENDS, 20.0, _SUBURB, _DAY),
    (Course.CHANGES, 20.0, _COUNTRY, _DAY),
    (Course.ALTERNATING, 15.0, _SUBURB, _DAY),
    (Course.STRAIGHT, 30.0, _SUBURB, _DAY),
    (Course.ONE_WAY, 10.0, _COUNTRY, _DAY),
    (Course.STRAIGHT, 10.0, _TOWN, _NIGHT),
    (Course.STOPS, 30.0, _TOWN, _DAY),
    (Course.STRAIGHT, 30.0, _COUNTRY, _DAY),
    (Course.WITH_BENDS, 30.0, _COUNTRY, _DAY),
    (Course.ALTERNATING, 20.0, _TOWN, _DAY),
    (Course.CHANGES, 15.0, _SUBURB, _NIGHT),
    (Course.STRAIGHT, 10.0, _COUNTRY, _DAY),
    (Course.ONE_WAY, 20.0, _TOWN, _DAY),
    (Course.STRAIGHT, 20.0, _BARE, _DAY),
)
_NAMES = tuple(RIGS)
# Of a small image, to the rig's: as many pixels as a small one of KITTI, or less.
_SMALL = {"kitti": 0.5, "zed": 0.4, "paper": 0.5}
_STEP_M = (2.5, 5.0)  # between frames, at 5 to 10 of them a second


def plans(seed: int, first: int, count: int, *, small: bool) -> list[Plan]:
    """Return drives of a series.

    Args:
        seed: Seed of the series.
        first: Number of the first one.
        count: How many.
        small: Whether images are small.
    """
    result = []
    for index in range(first, first + count):
        course, duration, surroundings, hour = _CYCLE[index % len(_CYCLE)]
        # Seventeen courses and three rigs: each course meets each rig.
        rig = _NAMES[index % len(_NAMES)]
        result.append(
            Plan(seed, index, course, duration, rig, _SMALL[rig] if small else 1.0, surroundings, hour)
        )
    return result


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive that can be filmed, with what is true of it.

    Attributes:
        plan: What was planned.
        film: Its images.
        times_s: When frames are taken, shape (n,).
        yaw_rad: Of the camera against the way on a straight level road of the usual fall.
        pitch_rad: Of the camera against the way, the car at rest on its springs.
        labels: What else is worth to be known: speed, fall, wind, lever.
    """

    plan: Plan
    film: Film
    times_s: Array
    yaw_rad: float
    pitch_rad: float
    labels: dict[str, float]


def drive(plan: Plan) -> Drive:
    """Return a planned drive; the same plan gives the same one."""
    rng = np.random.default_rng([_SERIES, plan.seed, plan.index])
    car = any_car(rng)
    bends, speed_mps = _road(plan, rng)
    # Most roads fall to the right, some to the left: the left lanes of motorways, and roads with one fall.
    fall = float(rng.normal(USUAL_FALL, 0.007) * (1.0 if rng.random() < 0.8 else -1.0))
    road = way(bends, fall, float(rng.uniform(0.0, 0.05)), bool(rng.random() < 0.5), rng)
    speeds = _speeds(plan, speed_mps, rng)
    wind = float(rng.normal(0.0, 3.0))
    weather = Weather(str(rng.choice(["A", "B"])), wind, 0.3 * abs(wind) + 0.3)
    ride = driven(car, road, _driver(plan, speed_mps, rng), weather, speeds, rng)
    mounted = Mounted(
        math.radians(rng.uniform(-3, 3)),
        math.radians(rng.uniform(-2, 6)),
        math.radians(rng.uniform(-2, 2)),
        Turn(*rng.normal(0.0, _LEFT_TURN_RAD, 3)),
    )
    length = float(ride.along_m.max())
    scenery = street(road, plan.surroundings, plan.hour, length, rng)
    rate = float(np.clip(math.ceil(speed_mps / rng.uniform(*_STEP_M)), 5, 10))
    times = np.arange(0.0, plan.duration_s - STEP_S, 1.0 / rate)
    film = Film(
        _scaled(RIGS[plan.rig], plan.scale),
        car,
        ride,
        mounted,
        scenery,
        _others(plan, speed_mps, length, rng),
        _sensor(plan, scenery.surface.albedo, rng),
        (_SERIES, plan.seed, plan.index),
    )
    labels = {
        "speed_mps": speed_mps,
        "rate_hz": rate,
        "fall": fall,
        "wind_mps": wind,
        "lever_m": car.camera_m[0],
        "crab_deg": math.degrees(car.crab_rad(USUAL_FALL)),
        "mean_turn_deg_s": math.degrees(float(ride.turn_rad_s.mean())),
        "rms_turn_deg_s": math.degrees(float(np.sqrt(np.mean(ride.turn_rad_s**2)))),
    }
    return Drive(plan, film, times, mounted.yaw_rad + car.crab_rad(USUAL_FALL), mounted.pitch_rad, labels)


def _scaled(rig: StereoRig, scale: float) -> StereoRig:
    if scale == 1.0:
        return rig
    width, height = round(rig.width * scale), round(rig.height * scale)
    centre = ((rig.cx + 0.5) * scale - 0.5, (rig.cy + 0.5) * scale - 0.5)
    return StereoRig(width, height, rig.fx * scale, rig.fy * scale, *centre, rig.baseline_m)


def _road(plan: Plan, rng: np.random.Generator) -> tuple[list[Bend], float]:
    """Return the bends of a road, and how fast one drives there."""
    if plan.course not in (Course.WITH_BENDS, *ONLY_BENDS):
        town = plan.surroundings is Surroundings.TOWN
        speed = float(rng.uniform(6, 14) if town else rng.uniform(9, 25))
        return [Bend(speed * plan.duration_s + 60.0, 0.0)], speed
    radius = math.exp(rng.uniform(math.log(_TIGHTEST_M), math.log(_WIDEST_M)))
    speed = float(np.clip(math.sqrt(rng.uniform(*_BEND_MPS2) * radius), 4.0, 22.0))
    if plan.course is Course.ONE_WAY:
        speed = min(speed, _MOST_TURN_RAD * radius / plan.duration_s)
    sign = float(rng.choice([-1.0, 1.0]))
    bends: list[Bend] = []
    length = 0.0
    while length < speed * plan.duration_s + 20.0:
        # Radii of neighbouring bends differ by less than a factor of 1.5 or 2 (RAL: "Radientulpe").
        curvature = sign / min(_WIDEST_M, radius * float(rng.uniform(1.0, 1.6)))
        part = float(rng.uniform(2.0, 5.0)) * speed
        bends.append(Bend(part, curvature))
        if plan.course is not Course.ONE_WAY:
            # Not farther than a third of a circle in one direction.
            bends[-1] = Bend(min(part, 2.0 / abs(curvature)), curvature)
            sign = -sign
        if plan.course is Course.WITH_BENDS:
            bends.append(Bend(float(rng.uniform(3.0, 6.0)) * speed, 0.0))
        length = sum(each.length_m for each in bends)
    return bends, speed


def _speeds(plan: Plan, speed_mps: float, rng: np.random.Generator) -> Array:
    """Return the speed every step: nearly constant, or with stops."""
    n = round(plan.duration_s / STEP_S) + 1
    times = STEP_S * np.arange(n)
    if plan.course is Course.STOPS:
        # Acceleration of 1 to 2 and deceleration of 1.5 to 3 m/s^2 are usual in towns (Wang et al., 2004).
        gain, loss = float(rng.uniform(1.0, 2.0)), float(rng.uniform(1.5, 3.0))
        stop = float(rng.uniform(0.3, 0.5)) * plan.duration_s
        start = stop + speed_mps / loss + float(rng.uniform(2.0, 5.0))
        speeds = np.minimum(
            np.where(times < stop, speed_mps, np.maximum(speed_mps - loss * (times - stop), 0.0)), speed_mps
        )
        again = np.clip(gain * (times - start), 0.0, speed_mps)
        values = np.maximum(speeds, again)
    else:
        phase, period = float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(10, 25))
        values = speed_mps * (1 + float(rng.uniform(0, 0.12)) * np.sin(2 * math.pi * times / period + phase))
    # Nobody's acceleration jumps: it follows within half a second.
    width = round(0.5 / STEP_S)
    padded = np.pad(values, (width, width), mode="edge")
    smooth: Array = np.convolve(padded, np.hanning(2 * width + 1) / np.hanning(2 * width + 1).sum(), "valid")
    return np.clip(smooth, 0.0, None)


def _driver(plan: Plan, speed_mps: float, rng: np.random.Generator) -> Driver:
    """Return any driver.

    The standard deviation of the place in the lane is 0.1 to 0.25 m (Green et al., 2004, "Driving performance
    measures"; Verster and Roth, 2011), lane changes take 3 to 7 s (Toledo and Zohar, 2007: 4.6 on average).
    """
    takes = float(np.clip(rng.normal(4.6, 1.2), 3.0, 7.0)) if speed_mps > 8 else 6.5
    changes: tuple[float, ...] = ()
    if plan.course is Course.CHANGES:
        first = float(rng.uniform(1.0, 4.0))
        changes = (first, first + takes + float(rng.uniform(1.5, 4.0)))
        changes = tuple(each for each in changes if each + takes < plan.duration_s) or changes[:1]
    weave = float(rng.uniform(0.08, 0.25))
    return Driver(weave, float(rng.uniform(3.0, 6.0)), math.radians(rng.uniform(0.2, 0.6)), changes, takes)


def _others(plan: Plan, speed_mps: float, length_m: float, rng: np.random.Generator) -> tuple[OtherCar, ...]:
    """Return cars that come towards the camera, and one that leads in a third of the drives."""
    if plan.course is Course.CHANGES:  # both lanes are one's own
        return ()
    others = []
    start = float(rng.uniform(40, 120))
    while start < 2.0 * length_m and plan.surroundings is not Surroundings.BARE:
        others.append(other_car(start, -speed_mps * float(rng.uniform(0.7, 1.2)), 3.5, rng))
        start += float(rng.uniform(40, 200))
    if rng.random() < 0.33:
        others.append(other_car(float(rng.uniform(12, 35)), speed_mps, float(rng.uniform(-0.3, 0.3)), rng))
    return tuple(others)


def _sensor(plan: Plan, albedo: float, rng: np.random.Generator) -> Sensor:
    grey = float(rng.uniform(60, 110))
    gain = grey / albedo
    if plan.hour is Hour.NIGHT:
        # Exposed at its limit, with a gain that shows the noise.
        gain *= 2.2
        return Sensor((gain, gain), noise=5.0, shot=0.4, blur_px=0.5, vignette=0.1)
    return Sensor(
        (gain, gain * float(rng.uniform(0.985, 1.015))),
        noise=float(rng.uniform(0.8, 2.0)),
        shot=0.02,
        blur_px=float(rng.uniform(0.35, 0.6)),
        vignette=float(rng.uniform(0.0, 0.15)),
    )
