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

"""A car: its tyres, its springs, where its camera is, and what the wind and the road do to it.

Single-track ("bicycle") model with linear tyres for the motion on the road, as in Rajamani, "Vehicle Dynamics
and Control" (2006), chapter 2; a half-car on springs for heave and pitch, as in Gillespie, "Fundamentals of
Vehicle Dynamics" (1992), chapter 5. Axes are REP-103's: x forward, y left, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..second_worlds.cameras import Array

GRAVITY_MPS2 = 9.81
# Carriageways fall by 2.5 % to a side to let rain run off (Germany: RAL, RASt; AASHTO: 1.5
# to 2 %); to the right, where one drives on the right.
USUAL_FALL = 0.025
_AIR_KG_M3 = 1.2
# ISO 8608: displacement spectra of class A (very good) and B (good) at 0.1 waves per metre.
_ROUGH_M3 = {"A": 16e-6, "B": 64e-6}
_REFERENCE_WAVES_PER_M = 0.1
_LONGEST_WAVE_M = 60.0  # of roughness; what is longer is the road's shape
_PATCH_M = 0.4  # over which a tyre and its unsprung mass even the road out
_PROFILE_STEP_M = 0.05


@dataclass(frozen=True, slots=True)
class Car:
    """A car as it is loaded.

    Attributes:
        mass_kg: Its mass.
        inertia: About the vertical axis [kg m^2].
        front_m: From its centre of gravity ahead to the front axle.
        rear_m: Back to the rear axle.
        front_stiffness: Side force of the front axle per slip angle [N/rad].
        rear_stiffness: The same of the rear axle.
        dive_rad: Nose down per m/s^2 of braking.
        lean_rad: Outer side down per m/s^2 to the inner one.
        heave_hz: Frequency of the body on its front and on its rear springs.
        roll_hz: Frequency of its roll.
        damping: Of these, relative to the critical one.
        side_area_m2: Side area times the coefficient of side force per radian of slip of the air.
        wind_arm_m: How far before its centre of gravity the wind attacks.
        camera_m: Middle of the baseline: ahead of the rear axle, left, and above the road.
    """

    mass_kg: float
    inertia: float
    front_m: float
    rear_m: float
    front_stiffness: float
    rear_stiffness: float
    dive_rad: float
    lean_rad: float
    heave_hz: tuple[float, float]
    roll_hz: float
    damping: float
    side_area_m2: float
    wind_arm_m: float
    camera_m: tuple[float, float, float]

    @property
    def wheelbase_m(self) -> float:
        """From axle to axle."""
        return self.front_m + self.rear_m

    @property
    def understeer(self) -> float:
        """What a bend asks of the steering besides its geometry [rad per m/s^2]."""
        load = self.mass_kg / self.wheelbase_m
        return load * (self.rear_m / self.front_stiffness - self.front_m / self.rear_stiffness)

    def crab_rad(self, fall: float) -> float:
        """Return how far left of its way it points on a straight road that falls to the right."""
        rear_force = self.mass_kg * GRAVITY_MPS2 * fall * self.front_m / self.wheelbase_m
        return rear_force / self.rear_stiffness

    def wind_force_n(self, speed_mps: float, wind_mps: float) -> float:
        """Return the side force of a wind from the right."""
        squared = speed_mps**2 + wind_mps**2
        return 0.5 * _AIR_KG_M3 * squared * self.side_area_m2 * math.atan2(wind_mps, max(speed_mps, 1.0))


def any_car(rng: np.random.Generator) -> Car:
    """Return a car of any size.

    Rajamani's example has 1573 kg, 2873 kg m^2, 1.1 and 1.58 m, and 160 kN/rad an axle. So much is 18 and
    25 /rad per newton of load; radial tyres alone have about 12 /rad (Gillespie, chapter 6). The slip of the
    rear axle is 2 to 5 deg for each g here, with the compliance of the suspension. The yaw inertia is about
    mass x front x rear. Body frequencies of 1.0 to 1.5 Hz with a rear one that is higher (Olley; Gillespie,
    chapter 5), pitch of 1 to 3 deg and roll of 3 to 7 deg for each g (Gillespie; Milliken and Milliken,
    1995), and side force coefficients of 2 to 2.6 per radian (Hucho, "Aerodynamics of Road Vehicles",
    chapter 5).
    """
    wheelbase = float(rng.uniform(2.45, 2.95))
    mass = float(rng.uniform(1100, 2000))
    front = wheelbase * float(rng.uniform(0.40, 0.50))
    rear = wheelbase - front
    # Of an axle, per newton of its load; more at the rear: cars understeer.
    per_load = float(rng.uniform(10.0, 18.0))
    front_stiffness = per_load * mass * GRAVITY_MPS2 * rear / wheelbase
    rear_stiffness = per_load * float(rng.uniform(1.1, 1.45)) * mass * GRAVITY_MPS2 * front / wheelbase
    heave = float(rng.uniform(1.0, 1.4))
    # From behind the windscreen (1.3 to 2 m ahead of the rear axle) to a roof rack or the bonnet.
    ahead = float(rng.uniform(0.9, 2.3))
    return Car(
        mass_kg=mass,
        inertia=mass * front * rear * float(rng.uniform(0.9, 1.05)),
        front_m=front,
        rear_m=rear,
        front_stiffness=front_stiffness,
        rear_stiffness=rear_stiffness,
        dive_rad=math.radians(rng.uniform(1.0, 3.0)) / GRAVITY_MPS2,
        lean_rad=math.radians(rng.uniform(3.0, 7.0)) / GRAVITY_MPS2,
        heave_hz=(heave, heave * float(rng.uniform(1.05, 1.25))),
        roll_hz=float(rng.uniform(1.3, 2.0)),
        damping=float(rng.uniform(0.2, 0.4)),
        side_area_m2=float(rng.uniform(2.0, 2.5)) * float(rng.uniform(2.0, 2.6)),
        wind_arm_m=float(rng.uniform(0.2, 0.6)),
        camera_m=(ahead, float(rng.uniform(-0.3, 0.3)), float(rng.uniform(1.2, 1.7))),
    )


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights of a rough road along one track.

    Attributes:
        heights_m: Every :data:`_PROFILE_STEP_M`.
        start_m: Place of the first one.
    """

    heights_m: list[float]
    start_m: float

    def at(self, s_m: float) -> float:
        """Return the height at a place."""
        place = (s_m - self.start_m) / _PROFILE_STEP_M
        index = int(place)
        part = place - index
        return self.heights_m[index] * (1 - part) + self.heights_m[index + 1] * part


def profile(start_m: float, end_m: float, name: str, share: float, rng: np.random.Generator) -> Profile:
    """Return a rough road of a class of ISO 8608.

    Its slope is white noise (the spectrum of its heights falls with the square of the waves per metre),
    without what is longer than the roughness, and evened out by the tyre.

    Args:
        start_m: Where it begins.
        end_m: Where it ends.
        name: The class.
        share: Of its amplitude.
        rng: Source of the noise.
    """
    count = math.ceil((end_m - start_m) / _PROFILE_STEP_M) + 2
    slope_spectrum = (2 * math.pi * _REFERENCE_WAVES_PER_M) ** 2 * _ROUGH_M3[name]
    steps = rng.normal(0.0, math.sqrt(slope_spectrum * _PROFILE_STEP_M / 2), count)
    waves = np.fft.rfft(steps)
    per_m = np.fft.rfftfreq(count, _PROFILE_STEP_M)
    with np.errstate(divide="ignore", invalid="ignore"):
        waves = waves / (2j * np.pi * per_m * _PROFILE_STEP_M)
    waves *= np.where(per_m > 1 / _LONGEST_WAVE_M, 1.0, 0.0) * np.sinc(per_m * _PATCH_M)
    waves[0] = 0.0
    heights: Array = share * np.fft.irfft(waves, count)
    return Profile(heights.tolist(), start_m)
