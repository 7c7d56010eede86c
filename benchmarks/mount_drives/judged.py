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

"""What drives that are drawn say of their mount, against where it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator
from stereo_selfcal.core.types import Array

from ..frames import READABLE
from ..options import Options
from ..road_verdicts import in_processes
from ..table import Table
from .draws import BAD_PART, DrawnDrive, Kind, drawn
from .frame_errors import RIG_NAMES, FrameError, read_frames
from .rides import Ride

# Asked: error over std, and what motion leaves after 30 s of the usual ride (mm, deg, deg).
LEAST_RATIO, MOST_RATIO = 0.8, 1.25
MOST_MOTION = np.array([6.0, 0.06, 0.08])
USUAL = Ride(np.array([0.005, math.radians(0.15), math.radians(0.2)]), 1.5)
_FAR_SIGMAS = 3.0
DURATIONS_S, RATES_HZ = (12.0, 30.0, 120.0), (2.0, 5.0, 10.0)
# Sizes of pitch and roll [deg]; the height goes by 2 to 10 mm with them.
SIZES_DEG = {"small": (0.05, 0.1), "usual": (0.1, 0.2), "large": (0.2, 0.3)}
_HEIGHT_M = {"small": (0.002, 0.004), "usual": (0.003, 0.007), "large": (0.006, 0.01)}
_MEMORY_S = (0.5, 4.0)
_BRAKES_S = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One estimate of a mount, in millimetres and degrees.

    Attributes:
        labels: What kind of drive it is of, by heading.
        error: Estimate minus truth (3,).
        std: Its standard deviations (3,).
        motion: Those of the term of motion (3,).
        n_frames: Frames behind it.
        more: What the estimate says of the motion.
    """

    labels: dict[str, str]
    error: Array
    std: Array
    motion: Array
    n_frames: int
    more: str = ""

    @property
    def sigmas(self) -> Array:
        """Error over std (3,)."""
        sigmas: Array = self.error / self.std
        return sigmas


def judged(drive: DrawnDrive, labels: dict[str, str], first: int | None = None) -> Judged:
    """Return what a drive says of its mount.

    Args:
        drive: The drive.
        labels: What kind of drive it is.
        first: Only so many of its accepted frames are seen; None: all.
    """
    calibrator = Calibrator(drive.frames[0].rig)
    accepted = 0
    for result in drive.results:
        calibrator.remember(result)
        accepted += result.accepted
        if accepted == first:
            break
    return judged_estimate(calibrator.estimate, drive.mount.as_array(), labels)


def judged_estimate(estimate: CalibrationResult, truth: Array, labels: dict[str, str]) -> Judged:
    """Return an estimate against the truth (3,) [m, rad, rad]."""
    assert estimate.extrinsics is not None and estimate.std is not None
    motion = np.zeros((3, 3))
    for term in estimate.uncertainty:
        if term.name in ("motion", "standing"):
            motion = motion + term.covariance
    return Judged(
        labels,
        (estimate.extrinsics.as_array() - truth) * READABLE,
        estimate.std.as_array() * READABLE,
        np.sqrt(np.diag(motion)) * READABLE,
        estimate.n_frames,
        _evidence(estimate),
    )


def _evidence(estimate: CalibrationResult) -> str:
    mount = estimate.mount
    if mount is None:
        return ""
    motion = mount.motion.as_array() * READABLE
    cells = [f"out {mount.n_outliers}", "stood" if mount.stood else ""]
    cells += ["motion " + _cell(motion), "memory " + _cell(mount.memory_s), "looks " + _cell(mount.looks)]
    return ", ".join(cell for cell in cells if cell)


def any_kind(seed: int) -> tuple[str, Kind, dict[str, str]]:
    """Return the rig, the kind and the labels of a drive of the series: rigs and durations take turns."""
    rng = np.random.default_rng([seed, 1])
    rig_name = RIG_NAMES[seed % len(RIG_NAMES)]
    duration_s = DURATIONS_S[seed // len(RIG_NAMES) % len(DURATIONS_S)]
    size = list(SIZES_DEG)[int(rng.integers(len(SIZES_DEG)))]
    sizes = np.array([rng.uniform(*_HEIGHT_M[size]), *np.radians(rng.uniform(*SIZES_DEG[size], 2))])
    memory_s = float(np.exp(rng.uniform(*np.log(_MEMORY_S))))
    brakes, stops, leans = (bool(rng.random() < part) for part in (0.5, 0.25, 0.3))
    springs = float(rng.choice([0.0, 0.5, 0.9]))
    ride = Ride(sizes, memory_s, springs, _BRAKES_S if brakes else math.inf, stops, leans)
    kind = Kind(ride, duration_s, float(rng.choice(RATES_HZ)))
    labels = {
        "rig": rig_name,
        "duration": f"{duration_s:g} s",
        "motion": size,
        "memory": "below 1.5 s" if memory_s < 1.5 else "above 1.5 s",
        "rate": f"{kind.rate_hz:g} Hz",
        "springs": f"{springs:g} oscillating",
        "brakes": "brakes" if brakes else "steady speed",
        "stops": "stops" if stops else "goes on",
        "leans": "leans" if leans else "upright",
    }
    return rig_name, kind, labels


def draw_any(
    seed: int, frames: list[FrameError], measured: bool = True, bad_part: float = BAD_PART
) -> tuple[DrawnDrive, dict[str, str]]:
    """Return one drive of the series, and its labels."""
    rig_name, kind, labels = any_kind(seed)
    rng = np.random.default_rng([seed, 2])
    kind = replace(kind, measured=measured, bad_part=bad_part)
    return drawn(kind, _of_rig(frames, rig_name), rng), labels | {"seed": str(seed)}


def draw_as_said(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return one drive of the series whose frames are as wrong as they say."""
    return draw_any(seed, frames, measured=False)


def draw_good(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return one drive of the series without bad frames: of one or two, nobody can tell which are bad."""
    return draw_any(seed, frames, bad_part=0.0)


def draw_perfect(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return one drive of the series whose frames have noise alone, so that motion is all that matters."""
    rig_name, kind, labels = any_kind(seed)
    kind = replace(kind, measured=False, noise_alone=True)
    rng = np.random.default_rng([seed, 2])
    return drawn(kind, _of_rig(frames, rig_name), rng), labels | {"seed": str(seed)}


def draw_usual(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return half a minute of the usual ride, and its labels."""
    rig_name = RIG_NAMES[seed % len(RIG_NAMES)]
    rng = np.random.default_rng([seed, 3])
    drive = drawn(Kind(USUAL, 30.0, float(rng.choice(RATES_HZ))), _of_rig(frames, rig_name), rng)
    return drive, {"rig": rig_name, "seed": str(seed)}


def draw_undisturbed(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return half a minute of the usual ride, without bad frames or gaps, and its labels."""
    rig_name = RIG_NAMES[seed % len(RIG_NAMES)]
    rng = np.random.default_rng([seed, 3])
    kind = Kind(USUAL, 30.0, float(rng.choice(RATES_HZ)), bad_part=0.0, gaps=False)
    return drawn(kind, _of_rig(frames, rig_name), rng), {"rig": rig_name, "seed": str(seed)}


def draw_standing(seed: int, frames: list[FrameError]) -> tuple[DrawnDrive, dict[str, str]]:
    """Return twelve seconds of a car that stands, and its labels."""
    rig_name = RIG_NAMES[seed % len(RIG_NAMES)]
    rng = np.random.default_rng([seed, 4])
    ride = replace(USUAL, stands=True)
    drive = drawn(Kind(ride, 12.0, float(rng.choice(RATES_HZ))), _of_rig(frames, rig_name), rng)
    return drive, {"rig": rig_name, "seed": str(seed)}


def _of_rig(frames: list[FrameError], rig_name: str) -> list[FrameError]:
    return [frame for frame in frames if frame.rig_name == rig_name]


@dataclass(frozen=True)
class _Task:
    """One drive to be judged, by the function that draws it."""

    draw: Callable[..., tuple[DrawnDrive, dict[str, str]]]
    seed: int
    first: int | None = None


def _judge(task: _Task) -> Judged:
    drive, labels = task.draw(task.seed, read_frames())
    return judged(drive, labels, task.first)


def drive_tables(options: Options) -> Iterator[Table]:
    """Judge drives of all kinds, single frames, pairs of them, the usual ride and standing cars."""
    seeds = range(options.drives)
    run = partial(in_processes, _judge, processes=options.processes)
    all_kinds = list(run([_Task(draw_any, seed) for seed in seeds]))
    as_said = list(run([_Task(draw_as_said, seed) for seed in seeds]))
    perfect = list(run([_Task(draw_perfect, seed) for seed in seeds]))
    usual = list(run([_Task(draw_usual, seed) for seed in seeds]))
    undisturbed = list(run([_Task(draw_undisturbed, seed) for seed in seeds]))
    groups = {
        "drives": all_kinds,
        "drives whose frames are as wrong as they say": as_said,
        "drives whose frames have noise alone": perfect,
        "30 s of the usual ride": usual,
        "the same without bad frames and gaps": undisturbed,
        "one frame": list(run([_Task(draw_good, seed, 1) for seed in seeds])),
        "two frames": list(run([_Task(draw_good, seed, 2) for seed in seeds])),
        "five frames": list(run([_Task(draw_good, seed, 5) for seed in seeds])),
        "ten frames": list(run([_Task(draw_any, seed, 10) for seed in seeds])),
        "12 s of a standing car": list(run([_Task(draw_standing, seed) for seed in seeds])),
    }
    yield _group_table(groups)
    yield _split_table("mount_drives", "The mount by kind of drive", all_kinds)
    yield _split_table("mount_noise_alone", "The mount by kind of drive, frames with noise alone", perfect)
    yield _motion_table({"": usual, "no bad frames, no gaps": undisturbed})
    yield _every_table(groups)


_HEADER = ["drives", "error over std (rms)", "beyond 3 std (%)", "error (rms; mm, deg, deg)", "std", "met"]


def _group_table(groups: dict[str, list[Judged]]) -> Table:
    table = Table(
        "mount_groups",
        "The mount by drives whose truth is known",
        ["of", *_HEADER],
        f"Height / pitch / roll. Asked: error over std {LEAST_RATIO:g} to {MOST_RATIO:g}. 10 % of the frames "
        "are bad, but of one, two and five none is. The std is the median.",
    )
    for name, group in groups.items():
        table.add(name, *cells_of(group))
    return table


def _split_table(name: str, title: str, group: list[Judged]) -> Table:
    table = Table(name, title, ["kind", "is", *_HEADER], "As above, of drives.")
    for heading in group[0].labels:
        if heading != "seed":
            for value in dict.fromkeys(each.labels[heading] for each in group):
                mine = [each for each in group if each.labels[heading] == value]
                table.add(heading, value, *cells_of(mine))
    return table


def _motion_table(groups: dict[str, list[Judged]]) -> Table:
    table = Table(
        "mount_motion",
        "What motion leaves of the mount after 30 s of the usual ride (5 mm, 0.15, 0.2 deg; 1.5 s)",
        ["rig", "frames", "drives", "median (mm, deg, deg)", "95 of 100 below", "most", "met"],
        f"Asked: at most {_cell(MOST_MOTION)}. The verdict is that of the median.",
    )
    for name, group in groups.items():
        for rig_name in (*RIG_NAMES, "all"):
            motion = np.array([each.motion for each in group if rig_name in (each.labels["rig"], "all")])
            if not len(motion):
                continue
            median, most = np.median(motion, axis=0), motion.max(axis=0)
            high = np.percentile(motion, 95.0, axis=0)
            met = "yes" if np.all(median <= MOST_MOTION) else "**no**"
            table.add(rig_name, name, str(len(motion)), _cell(median), _cell(high), _cell(most), met)
    return table


def _every_table(groups: dict[str, list[Judged]]) -> Table:
    table = Table(
        "mount_every",
        "Every drive",
        ["group", "seed", "kind", "frames", "error", "std", "motion", "error over std", "evidence"],
        shown=False,
    )
    for name, group in groups.items():
        for each in group:
            kind = ", ".join(value for heading, value in each.labels.items() if heading != "seed")
            cells = (_cell(values) for values in (each.error, each.std, each.motion, each.sigmas))
            table.add(name, each.labels["seed"], kind, str(each.n_frames), *cells, each.more)
    return table


def cells_of(group: list[Judged]) -> list[str]:
    """Return the cells of some estimates."""
    sigmas = np.array([each.sigmas for each in group])
    ratio = np.sqrt(np.mean(sigmas**2, axis=0))
    far = 100.0 * np.mean(np.abs(sigmas) > _FAR_SIGMAS, axis=0)
    error = np.sqrt(np.mean(np.array([each.error for each in group]) ** 2, axis=0))
    std = np.median([each.std for each in group], axis=0)
    met = "yes" if np.all((ratio >= LEAST_RATIO) & (ratio <= MOST_RATIO)) else "**no**"
    return [str(len(group)), f"{_cell(ratio)}", _cell(far), _cell(error), _cell(std), met]


def _cell(values: Array) -> str:
    return " / ".join(f"{float(value):.3g}" for value in values)
