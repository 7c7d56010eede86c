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

"""How long to drive for which standard deviation of the mount, by rig and ride."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from stereo_selfcal import Calibrator
from stereo_selfcal.core.types import Array

from ..frames import READABLE
from ..options import Options
from ..table import Table
from .draws import Kind, drawn
from .frame_errors import RIG_NAMES, FrameError, read_frames
from .rides import Ride

_RATE_HZ = 5.0
_AFTER_S = (0.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0)
# Each table cell is the median of so many drives, for every hundred that are asked for.
_PART_OF_DRIVES = 0.05
RIDES = {
    "calm: 3 mm, 0.08, 0.1 deg; 1.5 s": Ride(np.array([0.003, math.radians(0.08), math.radians(0.1)]), 1.5),
    "usual: 5 mm, 0.15, 0.2 deg; 1.5 s": Ride(
        np.array([0.005, math.radians(0.15), math.radians(0.2)]), 1.5, brakes_s=60.0
    ),
    "rough: 8 mm, 0.3, 0.3 deg; 2 s": Ride(
        np.array([0.008, math.radians(0.3), math.radians(0.3)]), 2.0, brakes_s=40.0, leans=True
    ),
}


def how_long_tables(options: Options) -> Iterator[Table]:
    """Standard deviations of the mount after some seconds of a drive."""
    n_drives = max(2, round(_PART_OF_DRIVES * options.drives))
    every = read_frames()
    table = Table(
        "mount_how_long",
        "How long to drive: standard deviations of the mount (height mm / pitch deg / roll deg)",
        ["rig", "ride: motion; memory", *("1 frame" if not s else f"{s:g} s" for s in _AFTER_S)],
        f"Medians of {n_drives} drawn drives, {_RATE_HZ:g} frames a second, 10 % of them bad. Frames "
        "are those of the rig in `mount_frames`. What is left after minutes is the rig's and the road's.",
    )
    for rig_name in RIG_NAMES:
        frames = [frame for frame in every if frame.rig_name == rig_name]
        for name, ride in RIDES.items():
            stds = [_stds(ride, frames, seed) for seed in range(n_drives)]
            medians = np.nanmedian(np.array(stds), axis=0)
            table.add(rig_name, name, *(f"{mm:.1f} / {p:.2f} / {r:.2f}" for mm, p, r in medians))
    yield table


def _stds(ride: Ride, frames: list[FrameError], seed: int) -> Array:
    """Return the standard deviations (T, 3) after each time, in millimetres and degrees."""
    rng = np.random.default_rng([seed, 5])
    drive = drawn(Kind(ride, _AFTER_S[-1], _RATE_HZ, gaps=False), frames, rng)
    calibrator = Calibrator(frames[0].rig)
    start_s = next(result.stamp_s for result in drive.results if result.accepted)
    stds = np.full((len(_AFTER_S), 3), np.nan)
    left = list(_AFTER_S)
    for result in drive.results:
        if left and result.stamp_s - start_s > left[0] and calibrator.estimate.std is not None:
            stds[len(_AFTER_S) - len(left)] = calibrator.estimate.std.as_array() * READABLE
            left.pop(0)
        calibrator.remember(result)
    if left and calibrator.estimate.std is not None:
        stds[len(_AFTER_S) - len(left)] = calibrator.estimate.std.as_array() * READABLE
    return stds
