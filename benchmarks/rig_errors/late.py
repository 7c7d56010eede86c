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

"""Drives whose right images are late: the delay that is found, and what becomes of the frames."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal import Calibrator
from stereo_selfcal.core.geometry.travel import RightDelay
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.core.types import Image
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import named_scene
from stereo_selfcal.synth.world import Scene

from ..frames import READABLE
from ..options import Options
from ..road_verdicts import in_processes
from ..table import Table, numbers

# Asked: found to a millisecond.
DELAYS_MS = (0.0, 2.0, 5.0, 20.0)
MOST_OFF_MS = 1.0
N_FRAMES, RATE_HZ = 60, 10.0
_MEAN_MPS, _VARIES_MPS, _DRIFT_MPS = 10.0, 5.0, 0.3
_WEAVES_S = 4.0
# Grey levels: rough asphalt, whose points are found again in the next frame.
_TEXTURE = 25.0


@dataclass(frozen=True, slots=True)
class LateDrive:
    """A drive along a straight road, between 5 and 15 m/s unless the speed is constant.

    Attributes:
        delay_s: How much later the right images are taken [s].
        varies_mps: How far the speed leaves its mean of 10 m/s.
        stamped: Whether the stamps of the right images say so; otherwise those of a pair are equal.
        seed: Seed of road and noise.
        n_frames: Number of frames.
    """

    delay_s: float
    varies_mps: float = _VARIES_MPS
    stamped: bool = False
    seed: int = 1
    n_frames: int = N_FRAMES

    @property
    def scene(self) -> Scene:
        """The world of the first frame."""
        scene = named_scene("straight_road").scene
        road = replace(scene.road, texture_amplitude=_TEXTURE, texture_seed=self.seed)
        return replace(scene, road=road)

    def scene_at(self, time_s: float) -> Scene:
        """Return the world as the car sees it, which drifts from side to side."""
        # From the least speed to the greatest one, by 2.6 m/s^2 at most.
        turn = math.pi * RATE_HZ / self.n_frames
        way_m = _MEAN_MPS * time_s - self.varies_mps / turn * math.sin(turn * time_s)
        aside_m = _DRIFT_MPS * _WEAVES_S / (2.0 * math.pi) * math.sin(2.0 * math.pi * time_s / _WEAVES_S)
        return replace(self.scene, travelled_m=way_m, lateral_offset_m=aside_m)

    def pair(self, index: int) -> tuple[Image, Image]:
        """Render both images of a frame."""
        time_s = index / RATE_HZ
        left, _ = render(self.scene_at(time_s), np.random.default_rng([self.seed, index, 0]))
        _, right = render(self.scene_at(time_s + self.delay_s), np.random.default_rng([self.seed, index, 1]))
        return left, right

    @property
    def not_stamped_s(self) -> float:
        """The delay of which the stamps say nothing [s]."""
        return 0.0 if self.stamped else self.delay_s


@dataclass(frozen=True, slots=True, eq=False)
class LateVerdict:
    """What became of a drive.

    Attributes:
        drive: The drive.
        delay: The delay that was found; None where none was.
        reasons: How many frames were refused, by reason.
        sigmas: (N, 3) errors of the accepted frames over their standard deviations.
        height_mm: (N, 2) errors of their heights and standard deviations [mm].
    """

    drive: LateDrive
    delay: RightDelay | None
    reasons: Counter[str]
    sigmas: np.ndarray
    height_mm: np.ndarray


def judge_late(drive: LateDrive) -> LateVerdict:
    """Render a drive and calibrate from all of its frames."""
    scene = drive.scene
    calibrator, results = Calibrator(scene.rig), []
    for index in range(drive.n_frames):
        apart_s = drive.delay_s if drive.stamped else 0.0
        results.append(calibrator.add(*drive.pair(index), index / RATE_HZ, apart_s))
    errors = [_error(result, scene) for result in results if result.accepted]
    values = np.array(errors).reshape(-1, 2, 3)
    reasons = Counter(str(result.reason) for result in results if not result.accepted)
    heights = values[:, :, 0] * READABLE[0]
    return LateVerdict(drive, calibrator.estimate.delay, reasons, values[:, 0] / values[:, 1], heights)


def _error(result: CalibrationResult, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    assert result.extrinsics is not None and result.std is not None
    return result.extrinsics.as_array() - scene.extrinsics.as_array(), result.std.as_array()


def late_tables(options: Options) -> Iterator[Table]:
    """Judge drives whose right images are late, by a speed that varies and by a constant one."""
    drives = [
        *(LateDrive(delay_ms / 1e3, seed=options.seed) for delay_ms in DELAYS_MS),
        LateDrive(-0.005, seed=options.seed),
        LateDrive(0.005, stamped=True, seed=options.seed),
        LateDrive(0.005, varies_mps=0.0, seed=options.seed),
    ]
    n_frames = N_FRAMES if options.road_step == 1 else N_FRAMES // options.road_step
    drives = [replace(drive, n_frames=n_frames) for drive in drives]
    table = Table(
        "rig_late",
        f"Right images that are late: {n_frames} rendered frames at {RATE_HZ:g} Hz, 5 to 15 m/s",
        [
            "late (ms)",
            "drive",
            "found (ms)",
            "std",
            "to 1 ms",
            "accepted",
            "refused as",
            "worst error over std",
            "height, rms of error and std (mm)",
        ],
        "Found: less what the stamps say. At a constant speed the prior of the rig decides. The car drifts "
        f"from side to side by {_DRIFT_MPS:g} m/s at most.",
    )
    for each in in_processes(judge_late, drives, options.processes):
        table.add(*_cells(each))
    yield table


def _cells(verdict: LateVerdict) -> list[str]:
    drive, delay = verdict.drive, verdict.delay
    kind = "constant speed" if drive.varies_mps == 0.0 else "stamped" if drive.stamped else "equal stamps"
    found, std, met = "-", "-", "**no**"
    if delay is not None:
        found, std = f"{1e3 * delay.delay_s:+.2f}", f"{1e3 * float(delay.std[0]):.2f}"
        met = "yes" if abs(delay.delay_s - drive.not_stamped_s) <= MOST_OFF_MS / 1e3 else "**no**"
    accepted = len(verdict.sigmas)
    refused = ", ".join(f"{reason} {count}" for reason, count in verdict.reasons.most_common()) or "-"
    worst = numbers(np.abs(verdict.sigmas).max(axis=0), 2) if accepted else "-"
    rms = numbers(np.sqrt(np.mean(verdict.height_mm**2, axis=0)), 3) if accepted else "-"
    return [
        f"{1e3 * drive.delay_s:+g}",
        kind,
        found,
        std,
        met,
        f"{accepted} of {drive.n_frames}",
        refused,
        worst,
        rms,
    ]
