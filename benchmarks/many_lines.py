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

"""What more lines than two are worth: the same frames, with a second line painted beside each boundary."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stereo_selfcal import calibrate
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene
from stereo_selfcal.synth.world import Scene

from .frames import FIRST_POSE_SEED, READABLE, UNITS, noise_std, pose_error
from .options import Options
from .table import Table

NOISES = (0.01, 0.05, 0.10, 0.20)
# Distance of the second line outwards [m]: that of a double line, and of a line for another kind of traffic.
BESIDE_M = (0.35, 1.25)


def many_lines_table(options: Options) -> Iterator[Table]:
    """Errors with two lines and with four, of the same road."""
    table = Table(
        "many_lines",
        "Two lines against four: RMS error, bare asphalt",
        ["noise", "lines", "accepted", "lines used", *UNITS, "error / std by noise: RMS"],
        "The height of a further line over the plane of the boundaries is taken as unknown to 1 cm, and to "
        "2.5 % of the distance from them: it says where the road leads, less so how high it is.",
    )
    for noise in NOISES:
        table.add(f"{noise:.0%}", "2", *_row(options.poses, noise, None))
        for beside_m in BESIDE_M:
            table.add(f"{noise:.0%}", f"4, {beside_m:g} m beside", *_row(options.poses, noise, beside_m))
    yield table


def _row(poses: int, noise: float, beside_m: float | None) -> list[str]:
    errors, ratios, used = [], [], []
    for seed in range(FIRST_POSE_SEED, FIRST_POSE_SEED + poses):
        scene = random_scene(np.random.default_rng(seed), noise, texture_amplitude=0.0)
        if beside_m is not None:
            scene = _with_more_lines(scene, beside_m)
        result = calibrate(*render(scene, np.random.default_rng(seed)), scene.rig)
        std = noise_std(result)
        if result.extrinsics is None or std is None:
            continue
        error = pose_error(result.extrinsics, scene)
        errors.append(error * READABLE)
        ratios.append(error / std)
        used.append(0 if result.pattern is None else len(result.pattern.lines[0]))
    rms, ratio = (np.sqrt(np.mean(np.square(values), axis=0)) for values in (errors, ratios))
    shown = [f"{rms[0]:.2f}", f"{rms[1]:.4f}", f"{rms[2]:.3f}"]
    told = " / ".join(f"{value:.2f}" for value in ratio)
    return [f"{len(errors)}/{poses}", f"{np.mean(used):.1f}", *shown, told]


def _with_more_lines(scene: Scene, beside_m: float) -> Scene:
    left, right = scene.road.lines[:2]
    more = (
        replace(left, offset_m=left.offset_m + beside_m),
        replace(right, offset_m=right.offset_m - beside_m),
    )
    return replace(scene, road=replace(scene.road, lines=(*scene.road.lines, *more)))
