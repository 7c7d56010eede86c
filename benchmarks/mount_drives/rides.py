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

"""How a car moves its camera over the road, as those who build suspensions describe it.

The body heaves, pitches and rolls on its springs: as a damped oscillator at one to one and a half hertz, and
as a wander that decays without one. It dives when it brakes and squats when it accelerates, in proportion to
the acceleration. It leans where the road falls to a side. Standing, it rests on the heights of the road under
its four wheels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stereo_selfcal.core.types import Array, Mask

STEP_S = 0.02
_WHEELBASE_M, _TRACK_M = 2.7, 1.6
# Heights of the road under the wheels of a standing car, against the plane of the road ahead.
_WHEEL_STD_M = 0.003
# Springs with friction do not come back to the same place.
_STICKING_DEG = 0.02
# Frequencies of a car's body on its springs [Hz].
_BODY_HZ = (1.0, 1.5)
# Cars dive by 1.5 to 3 degrees for each g, so by 1 degree when they brake hard (3 to 5 m/s^2). A camera
# behind the windscreen is half a metre to one metre before the point about which they turn.
_DIVE_RAD_PER_MPS2 = (math.radians(1.5) / 9.81, math.radians(3.0) / 9.81)
_LEVER_M = (0.5, 1.0)
_BRAKE_MPS2, _BRAKE_S = (2.0, 4.5), (2.0, 5.0)
_GAIN_MPS2 = (1.0, 2.5)
_DIVE_TAKES_S = 0.3  # until the body follows
_STOP_MPS2, _STOP_S = (1.0, 2.5), (5.0, 20.0)
_SPEED_MPS = (8.0, 20.0)
# A road falls by 1 to 3 % to a side: at 3 to 6 degrees of roll for each g, the car leans by about a tenth.
_LEAN_DEG, _LEAN_S = (0.04, 0.1), (15.0, 60.0)


@dataclass(frozen=True, slots=True)
class Ride:
    """How a car is driven.

    Attributes:
        size: Standard deviations (3,) of its motion on the springs [m, rad, rad].
        memory_s: How long a state of this motion lasts [s].
        springs: Part of its variance that oscillates; the rest wanders.
        brakes_s: Mean time between two changes of the speed [s]; infinite: it never changes.
        stops: Whether it stands at a traffic light for a while.
        leans: Whether it leans with the road's fall.
        stands: Whether it stands all the time.
        speeds_mps: Between which its usual speed is drawn [m/s].
    """

    size: Array
    memory_s: float
    springs: float = 0.0
    brakes_s: float = math.inf
    stops: bool = False
    leans: bool = False
    stands: bool = False
    speeds_mps: tuple[float, float] = _SPEED_MPS


@dataclass(frozen=True, eq=False)
class Drive:
    """What a car has done, at steps of :data:`STEP_S`.

    Attributes:
        motion: (T, 3) by which the camera is above the mount [m], nose down [rad], right side down [rad].
        way_m: (T,) how far it has come.
        standing: (T,) whether it stands.
    """

    motion: Array
    way_m: Array
    standing: Mask


def driven(ride: Ride, duration_s: float, rng: np.random.Generator) -> Drive:
    """Drive a car for a while.

    Args:
        ride: How.
        duration_s: For how long [s].
        rng: Source of everything that is drawn.
    """
    n = round(duration_s / STEP_S) + 1
    if ride.stands:
        return Drive(np.tile(at_rest(rng), (n, 1)), np.zeros(n), np.ones(n, bool))
    speed, acceleration = _speeds(ride, n, rng)
    standing = speed <= 0.0
    motion = on_springs(ride, n, rng)
    dive = -rng.uniform(*_DIVE_RAD_PER_MPS2) * _followed(acceleration)
    motion[:, 1] += dive
    motion[:, 0] -= rng.uniform(*_LEVER_M) * dive
    if ride.leans:
        lean = math.radians(rng.uniform(*_LEAN_DEG))
        motion[:, 2] += lean * wander(n, rng.uniform(*_LEAN_S), rng)
    # The springs come to rest when the car does.
    rest = _followed(standing.astype(float))[:, None]
    rest[standing & (np.roll(rest[:, 0], 1) > 0.9)] = 1.0
    motion = (1.0 - rest) * motion + rest * at_rest(rng)
    return Drive(motion, np.cumsum(speed) * STEP_S, standing)


def at_rest(rng: np.random.Generator) -> Array:
    """Return where (3,) the camera of a standing car is, by the heights under its wheels."""
    front_left, front_right, rear_left, rear_right = rng.normal(0.0, _WHEEL_STD_M, 4)
    front, rear = (front_left + front_right) / 2, (rear_left + rear_right) / 2
    left, right = (front_left + rear_left) / 2, (front_right + rear_right) / 2
    stuck = np.radians(rng.normal(0.0, _STICKING_DEG, 2))
    pitch, roll = (rear - front) / _WHEELBASE_M, (left - right) / _TRACK_M
    return np.array([(front + rear) / 2, pitch + stuck[0], roll + stuck[1]])


def on_springs(ride: Ride, n: int, rng: np.random.Generator) -> Array:
    """Return the motion (n, 3) on the springs."""
    columns = []
    for size in ride.size:
        oscillating = oscillation(n, ride.memory_s, rng.uniform(*_BODY_HZ), rng)
        slow = wander(n, ride.memory_s, rng)
        columns.append(size * (math.sqrt(ride.springs) * oscillating + math.sqrt(1.0 - ride.springs) * slow))
    return np.stack(columns, axis=1)


def wander(n: int, memory_s: float, rng: np.random.Generator) -> Array:
    """Return a Gauss-Markov process (n,) of variance one that forgets within its memory."""
    keeps = math.exp(-STEP_S / memory_s)
    noise = rng.normal(size=n) * math.sqrt(1.0 - keeps * keeps)
    values = np.empty(n)
    value = rng.normal()
    for index in range(n):
        value = keeps * value + noise[index]
        values[index] = value
    return values


def oscillation(n: int, memory_s: float, frequency_hz: float, rng: np.random.Generator) -> Array:
    """Return an oscillator (n,) of variance one, driven by white noise, whose amplitude decays so fast.

    ``x'' + 2 x' / memory + omega^2 x = noise``: its steps are exact, whatever their length.
    """
    decay = 1.0 / memory_s
    omega2 = (2.0 * math.pi * frequency_hz) ** 2 + decay**2
    damped = 2.0 * math.pi * frequency_hz
    c, s = math.cos(damped * STEP_S), math.sin(damped * STEP_S)
    fades = math.exp(-decay * STEP_S)
    step = fades * np.array(
        [[c + decay / damped * s, s / damped], [-omega2 / damped * s, c - decay / damped * s]]
    )
    stationary = np.diag([1.0, omega2])
    root = np.linalg.cholesky(stationary - step @ stationary @ step.T)
    noise = rng.normal(size=(n, 2)) @ root.T
    state = rng.normal(size=2) * np.sqrt(np.diag(stationary))
    values = np.empty(n)
    for index in range(n):
        state = step @ state + noise[index]
        values[index] = state[0]
    return values


def _speeds(ride: Ride, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return speed [m/s] and acceleration [m/s^2] (n,)."""
    usual = rng.uniform(*ride.speeds_mps)
    wanted = np.zeros(n)
    index = 0
    while math.isfinite(ride.brakes_s) and index < n:
        index += round(rng.exponential(ride.brakes_s) / STEP_S)
        brakes = rng.random() < 0.5
        strength = -rng.uniform(*_BRAKE_MPS2) if brakes else rng.uniform(*_GAIN_MPS2)
        end = index + round(rng.uniform(*_BRAKE_S) / STEP_S)
        wanted[index:end] = strength
        index = end
    stop_at = round(rng.uniform(0.2, 0.6) * n) if ride.stops else n
    stops_by, goes_on = rng.uniform(*_STOP_MPS2), math.inf
    speed, acceleration = np.empty(n), np.empty(n)
    now = usual
    for index in range(n):
        if stop_at <= index < goes_on:
            if now > 0.0:
                change = -float(np.interp(now, [0.0, 1.5, 3.0], [0.3, 1.0, 1.0])) * stops_by
            else:
                change = 0.0
                if math.isinf(goes_on):
                    goes_on = index + rng.uniform(*_STOP_S) / STEP_S
        elif wanted[index] and 3.0 < now < 2.0 * usual:
            change = wanted[index]
        else:
            # Back to the usual speed, gently.
            change = float(np.clip((usual - now) / 4.0, -1.0, 1.5))
        later = max(now + change * STEP_S, 0.0)
        acceleration[index] = (later - now) / STEP_S
        now = 0.0 if later < 0.02 and stop_at <= index < goes_on else later
        speed[index] = now
    return speed, acceleration


def _followed(wanted: Array) -> Array:
    """Return how the body follows what acts on it."""
    keeps = math.exp(-STEP_S / _DIVE_TAKES_S)
    values = np.empty(len(wanted))
    value = wanted[0]
    for index, each in enumerate(wanted):
        value = keeps * value + (1.0 - keeps) * each
        values[index] = value
    return values
