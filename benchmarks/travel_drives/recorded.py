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

"""The direction of travel of recorded drives: against their references, and one half against the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stereo_selfcal import Calibrator

from ..options import Options
from ..road_pairs import RoadPair, pairs_of
from ..second_worlds.cameras import Array
from ..table import Table

# Least and greatest yaw and pitch [deg] that stereo odometry, either camera alone, and GPS with IMU give
# (README of the data).
REFERENCES = {
    "kitti_odometry07": ((-0.45, -0.13), (1.02, 1.21)),
    "kitti_odometry02": ((-0.29, -0.15), (0.67, 0.85)),
}
_MOST_OFF_DEG, _MOST_SIGMAS = 0.3, 3.0
_RATE_HZ = 10.0


def recorded_tables(options: Options) -> Iterator[Table]:
    """Judge both recordings: whole, and by halves."""
    del options
    table = Table(
        "travel_recorded",
        "The direction of travel by recorded drives",
        ["drive", "part", "steps of frames", "yaw, pitch", "std", "off", "off over std", "met"],
        "Degrees. Whole drives are off the nearer end of their reference's range, "
        f"by {_MOST_OFF_DEG} at most, and halves are off each other, by {_MOST_SIGMAS:g} std at most.",
    )
    for source, ranges in REFERENCES.items():
        pairs = list(pairs_of((source,)))
        half = len(pairs) // 2
        parts = {"all": pairs, "first half": pairs[:half], "second half": pairs[half:]}
        known = {name: travelled(part) for name, part in parts.items()}
        for name, part in known.items():
            if part is None:
                table.add(source, name, f"0 of {len(parts[name])}", "-", "-", "-", "-", "no estimate")
                continue
            angles, std, steps = part
            cells = [f"{steps} of {len(parts[name])}", _cell(angles), _cell(std)]
            if name == "all":
                off = angles - np.clip(angles, *np.array(ranges).T)
                cells += [_cell(off), _cell(off / std), _yes(bool(np.all(np.abs(off) <= _MOST_OFF_DEG)))]
            else:
                cells += ["", "", ""]
            table.add(source, name, *cells)
        first, second = known["first half"], known["second half"]
        if first is not None and second is not None:
            off = second[0] - first[0]
            sigmas = off / np.hypot(first[1], second[1])
            met = _yes(bool(np.all(np.abs(sigmas) <= _MOST_SIGMAS)))
            table.add(source, "halves", "", "", "", _cell(off), _cell(sigmas), met)
    yield table


def travelled(pairs: list[RoadPair]) -> tuple[Array, Array, int] | None:
    """Return yaw and pitch [deg], their std [deg], and the steps of consecutive pairs; None: not known."""
    calibrator = Calibrator(pairs[0].rig)
    for index, pair in enumerate(pairs):
        calibrator.add(pair.left, pair.right, index / _RATE_HZ)
    travel = calibrator.estimate.travel
    if travel is None:
        return None
    std: Array = np.degrees(np.sqrt(np.diag(travel.covariance)))
    return np.degrees([travel.yaw_rad, travel.pitch_rad]), std, travel.n_steps


def _cell(values: Array) -> str:
    return " / ".join(f"{float(value):+.3f}" for value in values)


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
