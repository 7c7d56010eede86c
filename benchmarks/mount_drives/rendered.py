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

"""Drives that are rendered, with the car's motion in every image, through the whole calibrator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal import Calibrator, Extrinsics, StereoRig
from stereo_selfcal.core.road.priors import CALIBRATED_TURN_STD_RAD
from stereo_selfcal.core.types import Array, Image
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import LEFT_PHOTOMETRY, RIGHT_PHOTOMETRY
from stereo_selfcal.synth.world import LaneLine, Road, Scene

from ..options import Options
from ..road_verdicts import in_processes
from ..second_worlds.cameras import Mount, Turn
from ..second_worlds.worlds import World
from ..table import Table
from .frame_errors import mounted
from .judged import Judged, cells_of, judged_estimate
from .rides import STEP_S, Ride, driven

_SEED = 2121
_BAD_PART = 0.1
# A lorry's back covers the road: from this part of the width and the height on, so far ahead [m].
_LORRY, _LORRY_M = (0.15, 0.9, 0.35), 7.0
_LORRY_GREY, _LORRY_TEXTURE = 70.0, 25.0
_NOISE_GREY = 60.0
# A right image that is so late is one of another place.
_LATE_S = 0.1
_SLOW_MPS = (6.0, 9.0)
View = Callable[[float, Array, int], tuple[Image, Image]]


@dataclass(frozen=True)
class Road3D:
    """A road on which a car can drive.

    Attributes:
        rig: Its rig.
        truth: The pose of the mount over the road (3,) [m, rad, rad].
        view: Renders both images, by the way [m], the motion (3,) and the number of the frame.
    """

    rig: StereoRig
    truth: Array
    view: View


@dataclass(frozen=True)
class Rendered:
    """One rendered drive.

    Attributes:
        rig_name: A rig of the second generator.
        plane: Whether the road is one of the first renderer: a plane with lines.
        duration_s: How long it is [s].
        rate_hz: Frames per second.
        ride: How the car is driven.
        index: Number of the road.
    """

    rig_name: str
    plane: bool
    duration_s: float
    rate_hz: float
    ride: Ride
    index: int


def _ride(mm: float, pitch_deg: float, roll_deg: float, memory_s: float, **more: float | bool) -> Ride:
    size = np.array([mm * 1e-3, math.radians(pitch_deg), math.radians(roll_deg)])
    ride = Ride(size, memory_s, speeds_mps=_SLOW_MPS)
    return replace(ride, **more)  # type: ignore[arg-type]


DRIVES = (
    Rendered("kitti", False, 12.0, 4.0, _ride(5, 0.15, 0.2, 1.5, springs=0.5), 100),
    Rendered("zed", False, 20.0, 3.0, _ride(8, 0.25, 0.3, 1.0, brakes_s=12.0), 101),
    Rendered("oak", False, 15.0, 4.0, _ride(3, 0.08, 0.1, 0.7, springs=0.9), 102),
    Rendered("paper", False, 30.0, 2.0, _ride(5, 0.15, 0.2, 4.0, leans=True), 103),
    Rendered("kitti", False, 24.0, 3.0, _ride(4, 0.1, 0.15, 2.0, stops=True), 104),
    Rendered("zed", False, 12.0, 3.0, _ride(5, 0.15, 0.2, 1.5, stands=True), 105),
    Rendered("paper", True, 15.0, 4.0, _ride(5, 0.15, 0.2, 1.5), 106),
    Rendered("oak", True, 20.0, 3.0, _ride(6, 0.2, 0.25, 2.5, springs=0.5, brakes_s=12.0), 107),
)


@dataclass(frozen=True, eq=False)
class RenderedVerdict:
    """What became of a rendered drive.

    Attributes:
        drive: The drive.
        judged: Its estimate; None where no frame was accepted.
        accepted: How many of the good frames were accepted, and how many there are.
        bad_accepted: The same of the bad ones.
        sigmas: (N, 3) errors of the good accepted frames over their std.
    """

    drive: Rendered
    judged: Judged | None
    accepted: tuple[int, int]
    bad_accepted: tuple[int, int]
    sigmas: Array


def rendered_tables(options: Options) -> Iterator[Table]:
    """Judge all drives; of a quick run, the first quarter."""
    drives = DRIVES if options.drives >= len(DRIVES) else DRIVES[: max(1, len(DRIVES) // 4)]
    # Another seed means other roads and other rides.
    drives = tuple(replace(each, index=each.index + 100 * (options.seed - 1)) for each in drives)
    verdicts = list(in_processes(judge_rendered, drives, options.processes))
    table = Table(
        "mount_rendered",
        "The mount by rendered drives",
        [
            "drive",
            "frames",
            "bad ones",
            "frames: error over std (rms)",
            "mount: error",
            "std",
            "error over std",
            "says",
        ],
        "Accepted of all. Height / pitch / roll in mm and degrees. 10 % of the frames are bad.",
    )
    for each in verdicts:
        drive = each.drive
        kind = "stands" if drive.ride.stands else f"memory {drive.ride.memory_s:g} s"
        name = f"{drive.rig_name} {drive.index}, {drive.duration_s:g} s, {drive.rate_hz:g} Hz, {kind}"
        rms = np.sqrt(np.mean(each.sigmas**2, axis=0)) if len(each.sigmas) else np.zeros(0)
        cells = [
            name,
            *(f"{some} of {all_}" for some, all_ in (each.accepted, each.bad_accepted)),
            _cell(rms),
        ]
        mount = each.judged
        if mount is None:
            table.add(*cells, "-", "-", "-", "refused")
        else:
            table.add(
                *cells, *(_cell(values) for values in (mount.error, mount.std, mount.sigmas)), mount.more
            )
    known = [each.judged for each in verdicts if each.judged is not None]
    if known:
        ratio, far, error, std = cells_of(known)[1:5]
        table.add("all (rms)", "", "", "", error, std, ratio, f"beyond 3 std: {far} %")
    yield table


def judge_rendered(drive: Rendered) -> RenderedVerdict:
    """Render a drive and calibrate from all of its frames."""
    rng = np.random.default_rng([_SEED, drive.index])
    road = (_plane if drive.plane else _second)(drive, rng)
    car = driven(drive.ride, drive.duration_s, rng)
    calibrator = Calibrator(road.rig)
    times = np.arange(0.0, drive.duration_s, 1.0 / drive.rate_hz)
    steps = np.round(times / STEP_S).astype(int)
    bad = rng.random(len(times)) < _BAD_PART
    kinds = rng.integers(3, size=len(times))
    accepted, bad_accepted, sigmas = 0, 0, []
    for number, (time_s, step) in enumerate(zip(times, steps, strict=True)):
        left, right = road.view(float(car.way_m[step]), car.motion[step], number)
        if bad[number]:
            late = min(step + round(_LATE_S / STEP_S), len(car.way_m) - 1)
            _, late_right = road.view(float(car.way_m[late]), car.motion[late], number)
            left, right = spoilt(int(kinds[number]), (left, right), late_right, road.rig, rng)
        result = calibrator.add(left, right, 1000.0 + float(time_s))
        if bad[number]:
            bad_accepted += result.accepted
        elif result.extrinsics is not None and result.std is not None:
            accepted += 1
            error = result.extrinsics.as_array() - road.truth - car.motion[step]
            sigmas.append(error / result.std.as_array())
    estimate = calibrator.estimate
    labels = {"seed": str(drive.index)}
    known = None if estimate.extrinsics is None else judged_estimate(estimate, road.truth, labels)
    counts = (accepted, int((~bad).sum())), (bad_accepted, int(bad.sum()))
    return RenderedVerdict(drive, known, *counts, np.array(sigmas).reshape(-1, 3))


def spoilt(
    kind: int, images: tuple[Image, Image], late_right: Image, rig: StereoRig, rng: np.random.Generator
) -> tuple[Image, Image]:
    """Return a bad frame: hidden by a lorry (0), full of noise (1), or of two moments (2)."""
    left, right = images
    if kind == 1:
        noisy = [image + rng.normal(0.0, _NOISE_GREY, image.shape) for image in images]
        first, second = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in noisy)
        return first, second
    if kind == 2:
        return left, late_right
    start, end, top = (
        round(part * size) for part, size in zip(_LORRY, (rig.width, rig.width, rig.height), strict=True)
    )
    shift = round(rig.fx * rig.baseline_m / _LORRY_M)
    back = _LORRY_GREY + rng.normal(0.0, _LORRY_TEXTURE, (rig.height - top, end - start))
    grey: Image = np.clip(np.rint(back), 0, 255).astype(np.uint8)
    left, right = left.copy(), right.copy()
    left[top:, start:end] = grey
    moved = max(start - shift, 0)
    right[top:, moved : end - shift] = grey[:, moved + shift - start :]
    return left, right


@dataclass(frozen=True)
class _Moved(Mount):
    """A mount that has come some way along the lane."""

    along_m: float = 0.0

    @property
    def centre_m(self) -> Array:
        """Middle of the baseline, shape (3,)."""
        return np.array([self.along_m, self.lateral_m, self.height_m])


def _second(drive: Rendered, rng: np.random.Generator) -> Road3D:
    """Return a road of the second generator, whose right camera is turned as calibrations leave it."""
    _, world = mounted(drive.rig_name, drive.index, _SEED)
    pitch, roll, yaw = rng.normal(0.0, CALIBRATED_TURN_STD_RAD)
    turn = Turn(float(yaw), float(pitch), float(roll))
    still = world.scene.mount

    def view(way_m: float, motion: Array, number: int) -> tuple[Image, Image]:
        mount = _Moved(
            still.height_m + float(motion[0]),
            still.pitch_rad + float(motion[1]),
            still.roll_rad + float(motion[2]),
            still.yaw_rad,
            still.lateral_m,
            way_m,
        )
        scene = replace(world.scene, mount=mount, turn=turn)
        # The index is the seed of the noise.
        frame: World = replace(world, scene=scene, index=1000 * drive.index + number)
        return frame.render()

    return Road3D(world.rig, world.truth.as_array(), view)


def _plane(drive: Rendered, rng: np.random.Generator) -> Road3D:
    """Return a plane road with lines, as the first renderer draws it."""
    _, world = mounted(drive.rig_name, drive.index, _SEED)
    still = world.scene.mount
    lines = (LaneLine(-1.75), LaneLine(1.75, dash_m=4.0, gap_m=2.0))
    road = Road(lines=lines, texture_amplitude=10.0, texture_seed=int(rng.integers(2**16)))
    truth = np.array([still.height_m, still.pitch_rad, still.roll_rad])

    def view(way_m: float, motion: Array, number: int) -> tuple[Image, Image]:
        scene = Scene(
            world.rig,
            Extrinsics.from_array(truth + motion),
            still.yaw_rad,
            still.lateral_m,
            way_m,
            road,
            left=LEFT_PHOTOMETRY,
            right=RIGHT_PHOTOMETRY,
        ).with_noise(0.01)
        return render(scene, np.random.default_rng([_SEED, drive.index, number]))

    return Road3D(world.rig, truth, view)


def _cell(values: Array) -> str:
    return " / ".join(f"{float(value):.3g}" for value in values) or "-"
