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

"""The watch over simulated drives: false alarms, and how long it takes to see that a camera was moved.

What is simulated are the results of frames, not images: the pose, what suspension and road do to it, noise of
the promised size, wrong frames, and stretches of road without any usable frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator, Extrinsics
from stereo_selfcal.core.analysis.detection import least_delay_s
from stereo_selfcal.core.drive.fusion import fuse_frames
from stereo_selfcal.core.drive.watch import ALARM_SIGMAS, Watch
from stereo_selfcal.core.geometry.pose import POSE_COMPONENTS
from stereo_selfcal.core.types import Array
from stereo_selfcal.files.node_settings import NODE_SETTINGS
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

from .options import Options
from .table import Table, number

PERIOD_S = float(next(setting.default for setting in NODE_SETTINGS if setting.name == "monitor_period_s"))
_HOUR_S = 3600.0
# The camera is moved between these times of a drive, and watched for so long.
_BUMP_S = (600.0, 1200.0)
_PATIENCE_S = 1800.0

_POSE = np.array([1.4, math.radians(3.0), math.radians(0.8)])
# Of one frame of a recorded road: height, pitch, roll.
_NOISE_STD = np.array([0.003, math.radians(0.02), math.radians(0.05)])
_WRONG_FRACTION = 0.1
_WRONG_STD = np.array([0.06, math.radians(1.0), math.radians(2.0)])
# Mean lengths of road with and without usable frames.
_ROAD_S, _PAUSE_S = 120.0, 30.0
_PAUSE_COUNTS_S = PERIOD_S  # as good road
# Braking and driving off: a part of the variance of the pitch.
_BRAKING_PART = 0.3
_BRAKING_EVERY_S, _BRAKING_S = 40.0, 4.0
# Rate of false alarms that any test is held to, and periods of frames that are compared [s].
_ALARM_HOURS = 100.0
_PERIODS_S = (2.0, 1.0, 0.5, 0.1)
# Rendered frames before and after a bump.
_RENDERED_BEFORE, _RENDERED_AFTER = 150, 200


@dataclass(frozen=True, slots=True)
class Ride:
    """How a car moves over its road.

    Attributes:
        name: For the tables.
        std: Standard deviations of height [m], pitch [deg] and roll [deg].
        memory_s: How long a state of the springs lasts; cambers last twice as long.
    """

    name: str
    std: tuple[float, float, float]
    memory_s: float

    def describe(self) -> str:
        """Return it for a cell."""
        height_m, pitch_deg, roll_deg = self.std
        return f"{self.name}: {height_m * 1e3:g} mm, {pitch_deg:g}°, {roll_deg:g}°; {self.memory_s:g} s"


RIDES = (
    Ride("calm", (0.003, 0.1, 0.1), 2.0),
    Ride("usual", (0.005, 0.15, 0.2), 2.0),
    Ride("rough", (0.008, 0.2, 0.3), 2.0),
    Ride("rough, slow", (0.008, 0.3, 0.3), 4.0),
)
BUMPS = {
    "pitch 0.3°": np.array([0.0, math.radians(0.3), 0.0]),
    "roll 0.3°": np.array([0.0, 0.0, math.radians(0.3)]),
    "height 2 cm": np.array([0.02, 0.0, 0.0]),
    "pitch 0.1°": np.array([0.0, math.radians(0.1), 0.0]),
    "roll 0.1°": np.array([0.0, 0.0, math.radians(0.1)]),
}


def drive(ride: Ride, seconds: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return times (N,) [s] and measured poses (N, 3) of the usable frames of a drive."""
    times = np.arange(int(seconds / PERIOD_S)) * PERIOD_S
    n, motion = len(times), moved(ride, times, rng)
    wrong = rng.random(n) < _WRONG_FRACTION
    wrong[0] = False  # a calibration that is wrong is rightly doubted
    poses = _POSE + motion + _NOISE_STD * rng.standard_normal((n, 3))
    poses += wrong[:, None] * _WRONG_STD * rng.standard_normal((n, 3))
    usable, now_s = np.zeros(n, dtype=bool), 0.0
    while now_s < seconds:
        end_s = now_s + rng.exponential(_ROAD_S)
        usable |= (times >= now_s) & (times < end_s)
        now_s = end_s + rng.exponential(_PAUSE_S)
    usable[0] = True
    return times[usable], poses[usable]


def moved(ride: Ride, times: Array, rng: np.random.Generator) -> Array:
    """Return (N, 3) what suspension and road do to height, pitch and roll at some times."""
    n = len(times)
    height_m, pitch_deg, roll_deg = ride.std
    springs = math.sqrt(1.0 - _BRAKING_PART)
    return np.column_stack(
        [
            height_m * _wander(n, ride.memory_s, rng),
            math.radians(pitch_deg) * (springs * _wander(n, ride.memory_s, rng) + _brakings(times, rng)),
            math.radians(roll_deg) * _wander(n, 2.0 * ride.memory_s, rng),
        ]
    )


def _wander(n: int, memory_s: float, rng: np.random.Generator) -> Array:
    """Return (N,) a Gauss-Markov process of variance 1."""
    keep = math.exp(-PERIOD_S / memory_s)
    fresh = math.sqrt(1.0 - keep**2) * rng.standard_normal(n)
    values = np.empty(n)
    values[0] = rng.standard_normal()
    for i in range(1, n):
        values[i] = keep * values[i - 1] + fresh[i]
    return values


def _brakings(times: Array, rng: np.random.Generator) -> Array:
    """Return (N,) what braking and driving off do, of variance _BRAKING_PART."""
    values, now_s = np.zeros(len(times)), rng.exponential(_BRAKING_EVERY_S)
    size = math.sqrt(_BRAKING_PART * (_BRAKING_EVERY_S + _BRAKING_S) / _BRAKING_S)
    while now_s < times[-1]:
        during = (times >= now_s) & (times < now_s + _BRAKING_S)
        values[during] = size * rng.standard_normal()
        now_s += _BRAKING_S + rng.exponential(_BRAKING_EVERY_S)
    return values


def frame(pose: Array, time_s: float) -> CalibrationResult:
    """Return the result of a frame."""
    covariance = np.diag(_NOISE_STD**2)
    return CalibrationResult("", None, Extrinsics.from_array(pose), covariance, stamp_s=time_s, n_frames=1)


@dataclass(slots=True)
class Run:
    """What became of one drive; times are good road [s], without the pauses.

    Attributes:
        greatest: Greatest |z| of the drift test before the bump.
        false_alarm: Whether there was an alarm before it.
        alarm_s: From the bump to the alarm, None if there was none.
        proof_s: From the bump to the proof.
        better_s: From the bump to a better calibration.
        error: (3,) of that calibration over its standard deviations.
    """

    greatest: float = 0.0
    false_alarm: bool = False
    alarm_s: float | None = None
    proof_s: float | None = None
    better_s: float | None = None
    error: Array | None = None


def run(ride: Ride, seed: int, bump: Array | None = None) -> Run:
    """Drive for an hour, or until a bump has led to a better calibration."""
    rng = np.random.default_rng(seed)
    at_s = rng.uniform(*_BUMP_S) if bump is not None else math.inf
    times, poses = drive(ride, _HOUR_S if bump is None else at_s + _PATIENCE_S, rng)
    watch, outcome, bumped_s, road_s = Watch(), Run(), 0.0, 0.0
    watch.start(fuse_frames([frame(poses[0], 0.0)], PAPER_RIG))
    for i in range(1, len(times)):
        bumped = times[i] >= at_s
        road_s += min(times[i] - times[i - 1], _PAUSE_COUNTS_S)
        bumped_s = bumped_s if bumped else road_s
        verdict = watch.add(frame(poses[i] + bump if bumped and bump is not None else poses[i], times[i]))
        if not bumped:
            outcome.greatest = max(outcome.greatest, watch.deviation)
            if verdict.doubted:
                outcome.false_alarm = True
                return outcome
            continue
        if verdict.doubted and outcome.alarm_s is None:
            outcome.alarm_s = road_s - bumped_s
        if verdict.proven and outcome.proof_s is None:
            outcome.proof_s = road_s - bumped_s
        better = watch.proposal(PAPER_RIG)
        if better is not None and better.extrinsics is not None and better.std is not None:
            assert bump is not None
            outcome.better_s = road_s - bumped_s
            error = better.extrinsics.as_array() - _POSE - bump
            outcome.error = error / better.std.as_array()
            return outcome
    return outcome


def watch_tables(options: Options) -> Iterator[Table]:
    """False alarms over hours without a change, and delays after a bump."""
    how = (
        f"Results of frames are simulated, one every {PERIOD_S:g} s: motion of the standard deviations and "
        f"memory named (cambers: twice that memory; {_BRAKING_PART:.0%} of the variance of the pitch is "
        f"braking, {_BRAKING_S:g} s every {_BRAKING_EVERY_S:g} s), noise of 3 mm, 0.02°, 0.05°, "
        f"{_WRONG_FRACTION:.0%} wrong frames (60 mm, 1°, 2°), and {_PAUSE_S:g} s without usable frames after "
        f"every {_ROAD_S:g} s of road. The calibration in force is one frame of the drive."
    )
    calm = Table(
        "watch_alarms",
        f"The watch over {options.watch_hours} drives of an hour without a change",
        [
            "ride: height, pitch, roll; memory",
            "drives with an alarm",
            "greatest deviation: median",
            "90 %",
            "most",
        ],
        f"{how} The alarm is raised at {ALARM_SIGMAS:g} standard deviations.",
    )
    for ride in RIDES:
        runs = [run(ride, seed) for seed in range(options.watch_hours)]
        greatest = np.array([r.greatest for r in runs])
        cells = [number(value) for value in (*np.percentile(greatest, (50, 90)), greatest.max())]
        calm.add(ride.describe(), f"{sum(r.false_alarm for r in runs)} of {len(runs)}", *cells)
    yield calm
    bumps = Table(
        "watch_bumps",
        f"Good road until a bump is reported, {options.bumps} drives each",
        [
            "ride: height, pitch, roll; memory",
            "bump",
            "in time",
            "alarm: median",
            "90 %",
            "proof: median",
            "better calibration: median",
            "its error / std (RMS)",
            "false alarms before",
        ],
        f"{how} The camera is moved after 10 to 20 minutes. In time: of a bump of 0.3° within 60 s, of 2 cm "
        f"or 0.1° within 5 minutes of good road. '-': not within {_PATIENCE_S / 60:g} minutes.",
    )
    for ride in RIDES:
        for name, bump in BUMPS.items():
            runs = [run(ride, seed, bump) for seed in range(10_000, 10_000 + options.bumps)]
            limit_s = 60.0 if "0.3" in name else 300.0
            bumps.add(ride.describe(), name, *_cells(runs, limit_s))
    yield bumps
    yield _bound_table()
    if options.all_sizes:
        yield _rendered_table()


def _bound_table() -> Table:
    """Return how soon any test can see the bumps at a rate of false alarms, with more frames and fewer."""
    table = Table(
        "watch_bound",
        f"The least mean delay of any test with one false alarm in {_ALARM_HOURS:g} hours",
        ["ride: height, pitch, roll; memory", "bump", *(f"a frame every {each:g} s" for each in _PERIODS_S)],
        "It knows the mean before, the motion and the size of the bump, and has neither wrong frames nor "
        "pauses. Braking is left out. A sudden step stands out of the motion of a Gauss-Markov process the "
        "more, the faster frames come; the springs of a car are smoother than that, and its road has steps.",
    )
    for ride in RIDES:
        for name, bump in BUMPS.items():
            axis = int(np.argmax(np.abs(bump) > 0.0))
            std = (ride.std[0], *np.radians(ride.std[1:]))[axis]
            memory_s = ride.memory_s * (2.0 if axis == len(bump) - 1 else 1.0)
            delays = (
                least_delay_s(bump[axis], std, memory_s, _NOISE_STD[axis], period_s, _ALARM_HOURS)
                for period_s in _PERIODS_S
            )
            table.add(ride.describe(), name, *(f"{delay:.0f} s" if delay >= 1 else "1 s" for delay in delays))
    return table


def _rendered_table() -> Table:
    table = Table(
        "watch_rendered",
        "The watch over rendered images",
        ["ride", "bump", "accepted", "alarm", "proof", "better calibration", "its error: mm, deg, deg"],
        f"The pipeline as it is: the country road of bags/straight_road is rendered every {PERIOD_S:g} s "
        f"with the motion named and calibrated; the camera is moved after {_RENDERED_BEFORE * PERIOD_S:g} s. "
        "Every tenth frame shows no lines. One drive each.",
    )
    for ride, name in ((RIDES[0], "pitch 0.1°"), (RIDES[1], "pitch 0.3°"), (RIDES[1], "height 2 cm")):
        table.add(ride.describe(), name, *_rendered(ride, BUMPS[name]))
    return table


def _rendered(ride: Ride, bump: Array) -> list[str]:
    rng = np.random.default_rng(0)
    road, empty = named_scene("straight_road"), named_scene("no_lines")
    base = road.scene.extrinsics.as_array()
    times = np.arange(_RENDERED_BEFORE + _RENDERED_AFTER) * PERIOD_S
    motion, watch = moved(ride, times, rng), Watch()
    accepted, told = 0, dict.fromkeys(("alarm", "proof"), "-")
    for i, time_s in enumerate(times):
        pose = base + motion[i] + (bump if i >= _RENDERED_BEFORE else 0.0)
        scene = empty.scene if i % 10 == 9 else replace(road.scene, extrinsics=Extrinsics.from_array(pose))
        scene = replace(scene, travelled_m=road.speed_mps * time_s)
        result = Calibrator(scene.rig).add(*render(scene, rng), time_s)
        accepted += result.accepted
        if i == 0:
            watch.start(fuse_frames([result], scene.rig))
            continue
        verdict = watch.add(result)
        after = f"{time_s - times[_RENDERED_BEFORE]:.0f} s"
        for key, is_so in (("alarm", verdict.doubted), ("proof", verdict.proven)):
            if is_so and told[key] == "-":
                told[key] = after
        better = watch.proposal(scene.rig)
        if better is not None and better.extrinsics is not None:
            error = better.extrinsics.as_array() - base - bump
            parts = zip(POSE_COMPONENTS, error, strict=True)
            shown = ", ".join(component.small_unit.number(off, "+") for component, off in parts)
            return [f"{accepted} of {i + 1}", *told.values(), after, shown]
    return [f"{accepted} of {len(times)}", *told.values(), "-", "-"]


def _cells(runs: list[Run], limit_s: float) -> list[str]:
    true = [r for r in runs if not r.false_alarm]
    alarms = _times([r.alarm_s for r in true])
    errors = np.array([r.error for r in true if r.error is not None])
    rms = (
        " / ".join(number(value, 2) for value in np.sqrt(np.mean(errors**2, axis=0))) if len(errors) else "-"
    )
    return [
        f"{np.mean(alarms <= limit_s):.0%}",
        _seconds(alarms, 50),
        _seconds(alarms, 90),
        _seconds(_times([r.proof_s for r in true]), 50),
        _seconds(_times([r.better_s for r in true]), 50),
        rms,
        f"{len(runs) - len(true)}",
    ]


def _times(values: list[float | None]) -> Array:
    return np.array([math.inf if value is None else value for value in values])


def _seconds(times: Array, percent: float) -> str:
    value = float(np.percentile(times, percent, method="higher"))
    return f"{value:.0f} s" if math.isfinite(value) else "-"
