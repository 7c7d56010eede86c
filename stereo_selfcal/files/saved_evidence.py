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

"""How a calibration was reached, in a result file: its terms, the drive, and what was asked for.

Each is a section of ``provenance``, of scalars and of lists of numbers, as ROS 2 parameters are. A section is
missing where nothing is known. Every field is checked when it is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.drive.targets import Targets
from ..core.geometry.mount import MountEvidence
from ..core.geometry.pose import STD_NAMES, Extrinsics
from ..core.geometry.travel import RightDelay, Travel
from ..core.geometry.uncertainty import UncertaintyTerm, total_covariance
from ..core.results import CalibrationResult
from ..core.types import Array
from .field_checks import (
    GREATEST_WHOLE,
    ROUNDING,
    covariance_of,
    mapping,
    number,
    numbers,
    part_of_covariance,
    whole,
    wrong,
    yes_or_no,
)

TERMS, MOUNT, TRAVEL, DELAY, TARGETS = SECTIONS = ("terms", "mount", "travel", "delay", "targets")
# Names of terms that a later version may add are read as well; they end up in reports.
_TERM_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}", re.ASCII)
_MOST_TERMS = 64
# Limits that no drive exceeds; they detect edited files.
_LONGEST_S = 2.0**31 - 1
_MOST_LOOKS = 1e9
_LONGEST_DELAY_S = 10.0
_FARTHEST_M = 100.0
_FASTEST_MPS = 300.0
GREATEST_ANGLE_RAD = math.pi / 2  # a camera that looks ahead


@dataclass(frozen=True, slots=True, eq=False)
class SavedEvidence:
    """How a calibration was reached, as far as a file says it.

    Attributes:
        uncertainty: Terms that add up to the covariance; empty where they are not known.
        mount: What the drive has shown of the mount; None where it is not known.
        travel: The camera against the direction of travel; None where it is not known.
        delay: When the right images are taken; None where it is not known.
        targets: Standard deviations that were asked for; None where none were.
    """

    uncertainty: tuple[UncertaintyTerm, ...] = ()
    mount: MountEvidence | None = None
    travel: Travel | None = None
    delay: RightDelay | None = None
    targets: Targets | None = None


def evidence_to_mapping(result: CalibrationResult, targets: Targets | None) -> dict[str, Any]:
    """Return the sections of a result that there is something to say in.

    Args:
        result: An accepted result.
        targets: Standard deviations that were asked for, None where none were.
    """
    sections: dict[str, Any] = {}
    if result.uncertainty:
        sections[TERMS] = {term.name: _listed(term.covariance) for term in result.uncertainty}
    mount, travel, delay = result.mount, told_travel(result), result.delay
    if mount is not None and _is_finite(
        mount.duration_s, mount.motion.as_array(), mount.memory_s, mount.looks
    ):
        sections[MOUNT] = {
            "duration_s": float(mount.duration_s),
            "outliers": int(mount.n_outliers),
            "known_starts": int(mount.n_known),
            "stood": bool(mount.stood),
            "motion": dict(zip(STD_NAMES, map(float, mount.motion.as_array()), strict=True)),
            "memory_s": _listed(mount.memory_s),
            "looks": _listed(mount.looks),
        }
    if travel is not None:
        sections[TRAVEL] = {
            "yaw_rad": float(travel.yaw_rad),
            "pitch_rad": float(travel.pitch_rad),
            "covariance": _listed(travel.covariance),
            "steps": int(travel.n_steps),
            "lever_m": float(travel.lever_m),
            "driven_s": float(travel.driven_s),
        }
    if delay is not None and _is_told(delay):
        std_s, std_m = map(float, delay.std)
        sections[DELAY] = {
            "delay_s": float(delay.delay_s),
            "delay_std_s": std_s,
            "offset_m": float(delay.offset_m),
            "offset_std_m": std_m,
            "covariance": _listed(delay.covariance),
            "frames": int(delay.n_frames),
            "speeds_mps": [float(speed) for speed in delay.speeds_mps],
        }
    if targets is not None:
        sections[TARGETS] = {
            **dict(zip(STD_NAMES, map(float, targets.std.as_array()), strict=True)),
            "frames": int(targets.frames),
            "reached": targets.reached(result),
        }
    return sections


def evidence_from_mapping(
    sections: Mapping[str, Any], covariance: Array, n_frames: int, greatest_std: Extrinsics
) -> SavedEvidence:
    """Read what :func:`evidence_to_mapping` returned.

    Args:
        sections: The sections that the file has, of :data:`SECTIONS`.
        covariance: (3, 3) covariance of the calibration.
        n_frames: Number of frames behind it.
        greatest_std: Standard deviations beyond which nothing is known.

    Raises:
        ConfigError: A field is missing or cannot be right.
    """
    return SavedEvidence(
        _terms(sections[TERMS], covariance) if TERMS in sections else (),
        _mount(sections[MOUNT], n_frames, greatest_std) if MOUNT in sections else None,
        _travel(sections[TRAVEL]) if TRAVEL in sections else None,
        _delay(sections[DELAY]) if DELAY in sections else None,
        _targets(sections[TARGETS], covariance, n_frames, greatest_std) if TARGETS in sections else None,
    )


def told_travel(result: CalibrationResult) -> Travel | None:
    """Return the camera against the direction of travel where it has numbers that can be told, else None."""
    travel = result.travel
    if travel is None or not _is_finite(
        travel.yaw_rad, travel.pitch_rad, travel.covariance, travel.lever_m, travel.driven_s
    ):
        return None
    least_std, greatest_std = float(travel.std.min()), float(travel.std.max())
    usual = max(abs(travel.yaw_rad), abs(travel.pitch_rad), greatest_std) <= GREATEST_ANGLE_RAD
    known = usual and least_std > 0.0 and abs(travel.lever_m) <= _FARTHEST_M
    return travel if known and travel.n_steps > 0 and 0.0 < travel.driven_s <= _LONGEST_S else None


def _listed(values: Array) -> list[float]:
    return [float(value) for value in values.ravel()]


def _is_finite(*values: Any) -> bool:
    return all(bool(np.all(np.isfinite(value))) for value in values)


def _is_told(delay: RightDelay) -> bool:
    """Whether a delay has numbers that can be told: finite ones, of a drive of this world."""
    if not _is_finite(delay.delay_s, delay.offset_m, delay.covariance, delay.speeds_mps):
        return False
    std_s, std_m = delay.std
    return bool(
        max(abs(delay.delay_s), std_s) <= _LONGEST_DELAY_S
        and max(abs(delay.offset_m), std_m) <= _FARTHEST_M
        and min(std_s, std_m) > 0.0
        and 0.0 <= delay.speeds_mps[0] <= delay.speeds_mps[1] <= _FASTEST_MPS
    )


def _terms(values: Any, covariance: Array) -> tuple[UncertaintyTerm, ...]:
    full_name = f"provenance.{TERMS}"
    section = mapping(values, full_name, "the causes of the uncertainty")
    std = np.sqrt(np.diagonal(covariance))
    if not 0 < len(section) <= _MOST_TERMS:
        raise wrong(full_name, values, f"1 ... {_MOST_TERMS} causes of the uncertainty are needed")
    terms = []
    for name, listed in section.items():
        if not _TERM_NAME.fullmatch(name):
            raise wrong(f"the name of a cause in {full_name}", name, "a word in snake_case is needed")
        part = part_of_covariance(listed, f"{full_name}.{name}", std)
        terms.append(UncertaintyTerm(name, part))
    left = (total_covariance(terms) - covariance) / np.outer(std, std)
    if np.any(np.abs(left) > ROUNDING):
        raise wrong(full_name, values, "they do not add up to provenance.covariance")
    return tuple(terms)


def _mount(values: Any, n_frames: int, greatest_std: Extrinsics) -> MountEvidence:
    prefix = f"provenance.{MOUNT}"
    section = mapping(values, prefix, "the facts of the drive")
    motion = mapping(section.get("motion"), f"{prefix}.motion", "the standard deviations of the car's motion")
    n_outliers = whole(section, "outliers", 0, GREATEST_WHOLE, prefix)
    return MountEvidence(
        number(section, "duration_s", 0.0, _LONGEST_S, "s", prefix),
        n_outliers,
        whole(section, "known_starts", 0, n_frames + n_outliers, prefix),
        yes_or_no(section, "stood", prefix),
        _std(motion, f"{prefix}.motion", greatest_std),
        numbers(section.get("memory_s"), f"{prefix}.memory_s", 3, 0.0, _LONGEST_S, "s"),
        numbers(section.get("looks"), f"{prefix}.looks", 3, 0.0, _MOST_LOOKS),
    )


def _travel(values: Any) -> Travel:
    prefix = f"provenance.{TRAVEL}"
    section = mapping(values, prefix, "the numbers of the direction of travel")
    yaw_rad, pitch_rad = (
        number(section, name, -GREATEST_ANGLE_RAD, GREATEST_ANGLE_RAD, "rad", prefix)
        for name in ("yaw_rad", "pitch_rad")
    )
    listed, name = section.get("covariance"), f"{prefix}.covariance"
    variances = np.diag(numbers(listed, name, 4).reshape(2, 2))
    if np.any(variances <= 0.0) or np.any(variances > GREATEST_ANGLE_RAD**2):
        raise wrong(name, listed, "variances greater than 0 of two angles are needed")
    driven_s = number(section, "driven_s", 0.0, _LONGEST_S, "s", prefix)
    if driven_s == 0.0:
        raise wrong(f"{prefix}.driven_s", driven_s, "it must be greater than 0")
    return Travel(
        yaw_rad,
        pitch_rad,
        part_of_covariance(listed, name, np.sqrt(variances)),
        whole(section, "steps", 1, GREATEST_WHOLE, prefix),
        number(section, "lever_m", -_FARTHEST_M, _FARTHEST_M, "m", prefix),
        driven_s,
    )


def _delay(values: Any) -> RightDelay:
    prefix = f"provenance.{DELAY}"
    section = mapping(values, prefix, "the numbers of the delay")
    std = []
    for name, most, unit in (
        ("delay_std_s", _LONGEST_DELAY_S, "s"),
        ("offset_std_m", _FARTHEST_M, "m"),
    ):
        std.append(number(section, name, 0.0, most, unit, prefix))
        if std[-1] == 0.0:
            raise wrong(f"{prefix}.{name}", std[-1], "it must be greater than 0")
    slowest, fastest = numbers(section.get("speeds_mps"), f"{prefix}.speeds_mps", 2, 0.0, _FASTEST_MPS, "m/s")
    if slowest > fastest:
        raise wrong(f"{prefix}.speeds_mps", section["speeds_mps"], "the least and the greatest are needed")
    return RightDelay(
        number(section, "delay_s", -_LONGEST_DELAY_S, _LONGEST_DELAY_S, "s", prefix),
        number(section, "offset_m", -_FARTHEST_M, _FARTHEST_M, "m", prefix),
        covariance_of(section.get("covariance"), f"{prefix}.covariance", np.array(std)),
        whole(section, "frames", 1, GREATEST_WHOLE, prefix),
        (float(slowest), float(fastest)),
    )


def _targets(values: Any, covariance: Array, n_frames: int, greatest_std: Extrinsics) -> Targets:
    prefix = f"provenance.{TARGETS}"
    section = mapping(values, prefix, "the standard deviations that were asked for")
    asked = _std(section, prefix, greatest_std)
    frames = whole(section, "frames", 1, GREATEST_WHOLE, prefix)
    targets = Targets(asked.height_m, asked.pitch_rad, asked.roll_rad, frames)
    reached = yes_or_no(section, "reached", prefix)
    estimate = CalibrationResult("", covariance=covariance, n_frames=n_frames)
    if reached != targets.reached(estimate):
        raise wrong(f"{prefix}.reached", reached, "it contradicts the standard deviations")
    return targets


def _std(section: Mapping[str, Any], prefix: str, greatest: Extrinsics) -> Extrinsics:
    """Return three standard deviations, of which each may be 0."""
    named = zip(STD_NAMES, greatest.as_array(), strict=True)
    return Extrinsics(
        *(number(section, name, 0.0, float(most), name.rpartition("_")[2], prefix) for name, most in named)
    )
