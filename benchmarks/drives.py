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

"""Drives on a suspension: how often a move of the mount is found, missed, or seen where there was none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from stereo_selfcal import CalibrationResult, Calibrator, Extrinsics
from stereo_selfcal.core.drive.drive import Drive, estimate_drive, fuse_frames
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, custom_scene

from .frames import READABLE
from .options import Options
from .table import Table

Array = npt.NDArray[np.float64]

# A car at 50 to 100 km/h on a country road, as recordings show it: height [m], pitch, roll [rad].
MOTION = np.array([0.006, np.radians(0.2), np.radians(0.3)])
NOISE = np.array([0.008, np.radians(0.06), np.radians(0.15)])
POSE = Extrinsics(1.4, np.radians(3.0), np.radians(0.5))
DRIVE_S = 3600.0
RATE_HZ = 1.0
OUTLIERS = 0.03
OUTLIER = np.array([0.05, np.radians(0.5), np.radians(1.0)])
BRAKES_PER_HOUR = 20
BRAKE = np.array([-0.02, np.radians(1.0), 0.0])
BUMP_AT_S = 2000.0
# Of the rendered drive; with as little height as a bump that turns the camera gives.
BUMP = np.array([-0.012, np.radians(0.8), 0.0])


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of drive.

    Attributes:
        name: For the table.
        pitch_steps_deg: Times [s] and changes of the pitch [deg].
        moves: How many of them are moves of the mount.
        correlation_s: How long the car's motion lasts [s].
        brakes: Whether the car brakes hard now and then.
        gaps: Whether a part of the drive has no accepted frames.
        drift_deg: Change of the pitch over the drive [deg].
    """

    name: str
    pitch_steps_deg: tuple[tuple[float, float], ...] = ()
    moves: int = 0
    correlation_s: float = 2.0
    brakes: bool = False
    gaps: bool = False
    drift_deg: float = 0.0


def _bump(pitch_deg: float) -> Kind:
    return Kind(f"a bump of {pitch_deg:g} deg", ((BUMP_AT_S, pitch_deg),), 1)


KINDS = (
    Kind("nothing, motion of 0.5 s", correlation_s=0.5),
    Kind("nothing, motion of 2 s"),
    Kind("nothing, motion of 5 s", correlation_s=5.0),
    Kind("nothing, 20 times hard on the brakes, gaps", brakes=True, gaps=True),
    Kind("nothing, a drift of 0.3 deg", drift_deg=0.3),
    Kind("away by 0.8 deg for a minute, and back", ((BUMP_AT_S, 0.8), (BUMP_AT_S + 60.0, -0.8))),
    _bump(0.15),
    _bump(0.2),
    _bump(0.3),
    _bump(0.5),
    _bump(1.0),
    Kind("a bump of 0.5 deg, brakes, gaps", ((BUMP_AT_S, 0.5),), 1, brakes=True, gaps=True),
    Kind("0.5 deg, and back after ten minutes", ((1500.0, 0.5), (2100.0, -0.5)), 2),
)


def drive_table(options: Options) -> Iterator[Table]:
    """Moves found in simulated drives, and in a rendered one."""
    table = Table(
        "drives",
        f"Moves of the mount: {options.drives} simulated drives of an hour each",
        [
            "drive",
            "too few",
            "as many as there were",
            "too many",
            "off by [s]: median / 90 %",
            "inside the 95 % interval",
            "poses within 3 std",
        ],
        f"One frame per {1 / RATE_HZ:g} s; the car pitches by {np.degrees(MOTION[1]):.1f} deg, a frame has "
        f"{np.degrees(NOISE[1]):.2f} deg of noise, {OUTLIERS:.0%} are outliers. Last three columns: of the "
        "drives with as many moves as there were.",
    )
    for kind in KINDS:
        table.add(kind.name, *_cells(kind, options.drives))
    yield table
    yield _rendered(options.drive_frames)


def _cells(kind: Kind, n_drives: int) -> list[str]:
    counts = np.zeros(3, dtype=int)
    late, inside, good = [], [], []
    truths = POSE.as_array() + np.cumsum(
        [[0.0, 0.0, 0.0], *([0.0, np.radians(step), 0.0] for _, step in kind.pitch_steps_deg)], axis=0
    )
    for seed in range(n_drives):
        drive = _simulated(kind, seed)
        counts[1 + np.sign(len(drive.changes) - kind.moves)] += 1
        if len(drive.changes) != kind.moves:
            continue
        for change, (at_s, _) in zip(drive.changes, kind.pitch_steps_deg, strict=False):
            late.append(abs(change.at_s - at_s))
            inside.append(late[-1] <= change.within_s)
        if kind.moves == len(kind.pitch_steps_deg) and not kind.drift_deg:
            for segment, truth in zip(drive.segments, truths, strict=True):
                good.append(bool(np.all(np.abs(_in_stds(segment.estimate, truth)) <= 3.0)))
    times = f"{np.median(late):.1f} / {np.quantile(late, 0.9):.1f}" if late else "-"
    shares = [f"{np.mean(each):.1%}" if each else "-" for each in (inside, good)]
    return [*(f"{count}" for count in counts), times, *shares]


def _in_stds(result: CalibrationResult, truth: Array) -> Array:
    """Return the error of an estimate in its standard deviations, (3,)."""
    if result.extrinsics is None or result.std is None:
        raise ValueError("only an accepted result has an error")
    error: Array = (result.extrinsics.as_array() - truth) / result.std.as_array()
    return error


def _motion(rng: np.random.Generator, n: int, rate_hz: float, correlation_s: float) -> Array:
    """Return (n, 3) of unit variance: an Ornstein-Uhlenbeck process."""
    keep = np.exp(-1.0 / (rate_hz * correlation_s))
    steps = np.sqrt(1.0 - keep**2) * rng.normal(size=(n, 3))
    steps[0] /= np.sqrt(1.0 - keep**2)
    for i in range(1, n):
        steps[i] += keep * steps[i - 1]
    return steps


def _simulated(kind: Kind, seed: int) -> Drive:
    rng = np.random.default_rng([seed, 11])
    n = round(DRIVE_S * RATE_HZ)
    stamps = np.arange(n) / RATE_HZ
    poses = POSE.as_array() + _motion(rng, n, RATE_HZ, kind.correlation_s) * MOTION
    poses += rng.normal(size=(n, 3)) * NOISE
    wild = rng.random(n) < OUTLIERS
    poses[wild] += rng.normal(size=(np.count_nonzero(wild), 3)) * OUTLIER
    poses[:, 1] += np.radians(kind.drift_deg) * stamps / DRIVE_S
    for at_s, pitch_deg in kind.pitch_steps_deg:
        poses[stamps >= at_s, 1] += np.radians(pitch_deg)
    kept = np.ones(n, dtype=bool)
    for _ in range(BRAKES_PER_HOUR * kind.brakes):
        start_s = rng.uniform(0.0, DRIVE_S)
        poses[(stamps > start_s) & (stamps < start_s + rng.uniform(3.0, 15.0))] += BRAKE
    for _ in range(10 * kind.gaps):
        start_s = rng.uniform(0.0, DRIVE_S)
        kept &= ~((stamps > start_s) & (stamps < start_s + rng.uniform(10.0, 120.0)))
    covariance = np.diag(NOISE**2)
    frames = [
        CalibrationResult(
            "", None, pose, covariance, 0.0, stages={"refined": pose}, stamp_s=float(stamp), n_frames=1
        )
        for stamp, pose in zip(stamps[kept], map(Extrinsics.from_array, poses[kept]), strict=True)
    ]
    return estimate_drive(frames, PAPER_RIG, fuse_frames(frames, PAPER_RIG))


def _rendered(n_frames: int) -> Table:
    """Render an hour with one bump, on a moving car, and calibrate every frame."""
    rate_hz = n_frames / DRIVE_S
    scene = custom_scene(
        height_m=POSE.height_m,
        pitch_rad=POSE.pitch_rad,
        roll_rad=POSE.roll_rad,
        noise_fraction=0.02,
        n_frames=n_frames,
        rate_hz=rate_hz,
        bump_at_s=BUMP_AT_S,
        bump_height_m=float(BUMP[0]),
        bump_pitch_rad=float(BUMP[1]),
    )
    table = Table(
        "drives_rendered",
        f"A rendered drive of an hour with one bump: {n_frames} frames, 2 % noise, the car moving",
        ["", "height [mm]", "pitch [deg]", "roll [deg]", "error / std"],
    )
    calibrator = Calibrator(PAPER_RIG)
    frames: list[CalibrationResult] = []
    rng = np.random.default_rng(5)
    motion = _motion(rng, n_frames, rate_hz, 2.0) * MOTION
    for index in range(n_frames):
        world = scene.scene_at(index)
        pose = Extrinsics.from_array(world.extrinsics.as_array() + motion[index])
        left, right = render(replace(world, extrinsics=pose), np.random.default_rng([5, index]))
        result = calibrator.calibrate_frame(left, right, index / rate_hz)
        if result.accepted:
            frames.append(result.slim())
    drive = estimate_drive(frames, PAPER_RIG, fuse_frames(frames, PAPER_RIG))
    table.note = f"{len(frames)} frames accepted. " + (
        f"Moved at {BUMP_AT_S:g} s; found at "
        + ", ".join(f"{change.at_s:.1f} s within {change.within_s:.1f} s" for change in drive.changes)
        + "."
    )
    truths = (POSE.as_array(), POSE.as_array() + BUMP)
    for segment, truth in zip(drive.segments, truths, strict=False):
        sigmas, std = _in_stds(segment.estimate, truth), segment.estimate.std
        assert std is not None
        error = sigmas * std.as_array() * READABLE
        name = f"{segment.start_s:.0f} to {segment.end_s:.0f} s"
        table.add(f"{name}: error", *_numbers(error), " / ".join(f"{each:+.2f}" for each in sigmas))
        table.add("its standard deviation", *_numbers(std.as_array() * READABLE), "")
        table.add("spread over time", *_numbers(segment.spread.as_array() * READABLE), "")
    return table


def _numbers(values: Array) -> list[str]:
    return [f"{values[0]:.2f}", f"{values[1]:.4f}", f"{values[2]:.4f}"]
