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

"""Drives that were recorded: against their reference, and one half against the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator, StereoRig
from stereo_selfcal.core.evidence.rig_unknowns import RIG_TERMS
from stereo_selfcal.core.geometry.uncertainty import total_covariance
from stereo_selfcal.core.types import Array

from ..frames import READABLE
from ..options import Options
from ..road_pairs import SEQUENCE_MEAN, pairs_of
from ..table import Table

# Asked: odometry02 against its reference (mm, deg, deg), and halves of a drive against each other.
MOST_OFF = np.array([10.0, 0.08, 0.25])
MOST_SIGMAS = 3.0
_RATE_HZ = 10.0


def recorded_tables(options: Options) -> Iterator[Table]:
    """Judge both recordings: whole, and by halves."""
    del options
    table = Table(
        "mount_recorded",
        "The mount by recorded drives",
        [
            "drive",
            "part",
            "accepted",
            "pose (mm, deg, deg)",
            "std",
            "against",
            "off",
            "off over std",
            "met",
            "says",
        ],
        f"Asked: odometry02 within {_cell(MOST_OFF)} of its reference, and halves within {MOST_SIGMAS:g} std "
        "of each other. A second line of halves leaves out the terms of the rig, which both share.",
    )
    for source in ("kitti_odometry02", "kitti_odometry07"):
        pairs = list(pairs_of((source,)))
        rig = pairs[0].rig
        results = [
            Calibrator(rig).calibrate_frame(pair.left, pair.right, index / _RATE_HZ)
            for index, pair in enumerate(pairs)
        ]
        reference = np.mean([pair.low for pair in pairs], axis=0) if source.endswith("02") else SEQUENCE_MEAN
        whole = _fused(rig, results)
        off = _pose(whole) - reference
        close = not source.endswith("02") or bool(np.all(np.abs(off) <= MOST_OFF))
        held = bool(np.all(np.abs(off / _std(whole)) <= MOST_SIGMAS))
        _add(table, source, "all", whole, len(results), "reference", off, off / _std(whole), close and held)
        half = len(results) // 2
        first, second = _fused(rig, results[:half]), _fused(rig, results[half:])
        for name, part, number in (("first half", first, half), ("second half", second, len(results) - half)):
            off = _pose(part) - _pose(whole)
            _add(table, source, name, part, number, "all", off, off / _std(part), None)
        off = _pose(second) - _pose(first)
        for name, std in (("std", _std), ("std without the rig", _std_of_road)):
            sigmas = off / np.hypot(std(first), std(second))
            met = bool(np.all(np.abs(sigmas) <= MOST_SIGMAS))
            _add(
                table,
                source,
                f"halves by {name}",
                second,
                len(results) - half,
                "first half",
                off,
                sigmas,
                met,
            )
    yield table


def _fused(rig: StereoRig, results: Sequence[CalibrationResult]) -> CalibrationResult:
    calibrator = Calibrator(rig)
    for result in results:
        calibrator.remember(result)
    return calibrator.estimate


def _pose(result: CalibrationResult) -> Array:
    assert result.extrinsics is not None
    pose: Array = result.extrinsics.as_array() * READABLE
    return pose


def _std(result: CalibrationResult) -> Array:
    assert result.std is not None
    std: Array = result.std.as_array() * READABLE
    return std


def _std_of_road(result: CalibrationResult) -> Array:
    terms = [term for term in result.uncertainty if term.name not in RIG_TERMS]
    std: Array = np.sqrt(np.diag(total_covariance(terms))) * READABLE
    return std


def _add(
    table: Table,
    source: str,
    part: str,
    result: CalibrationResult,
    frames: int,
    against: str,
    off: Array,
    sigmas: Array,
    met: bool | None,
) -> None:
    stds = {term.name: np.sqrt(np.diag(term.covariance)) * READABLE for term in result.uncertainty}
    says = ", ".join(f"{name} {_cell(std)}" for name, std in stds.items()) if met is None else ""
    word = "" if met is None else "yes" if met else "**no**"
    cells = (_cell(_pose(result), 5), _cell(_std(result)), against, _cell(off), _cell(sigmas))
    table.add(source, part, f"{result.n_frames} of {frames}", *cells, word, says)


def _cell(values: Array, digits: int = 3) -> str:
    return " / ".join(f"{float(value):.{digits}g}" for value in values)
