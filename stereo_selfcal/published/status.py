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

"""The values of ``/diagnostics``: numbers in SI units, whose unit ends the key; else words and sentences.

A number that is not known has no key. So a program reads a value by its key alone, and every number with
``float()``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from ..core.alignment_verdict import report_alignment
from ..core.camera.rig import StereoRig
from ..core.delay_report import describe_delay
from ..core.geometry.alignment import Alignment
from ..core.geometry.pose import STD_NAMES, Extrinsics
from ..core.geometry.travel import RightDelay, Travel
from ..core.rejection import Rejection
from ..core.results import CalibrationResult


class StatusLevel(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus that are sent."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, slots=True)
class StatusReport:
    """One diagnostic_msgs/DiagnosticStatus.

    Attributes:
        level: What is to be done.
        name: What it is of.
        message: One sentence.
        values: Its values by their keys.
    """

    level: StatusLevel
    name: str
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def number_values(numbers: Mapping[str, float | None]) -> dict[str, str]:
    """Return numbers with all their digits; those that are not known, or not finite, are left out."""
    return {
        key: repr(float(value))
        for key, value in numbers.items()
        if value is not None and math.isfinite(value)
    }


def pose_values(pose: Extrinsics | None, std: Extrinsics | None = None) -> dict[str, str]:
    """Return a pose, ``height_m`` and so on, and its standard deviations, ``height_std_m`` and so on.

    Args:
        pose: The pose; None: there are no values.
        std: Its standard deviations.
    """
    if pose is None:
        return {}
    stds = {} if std is None else dict(zip(STD_NAMES, std.as_dict().values(), strict=True))
    return number_values(pose.as_dict() | stds)


def estimate_values(result: CalibrationResult) -> dict[str, str]:
    """Return pose, number of frames and reservations of a result; without a pose, nothing."""
    if result.extrinsics is None or result.std is None:
        return {}
    values = pose_values(result.extrinsics, result.std) | {"from_frames": str(result.n_frames)}
    return values | ({"notes": "; ".join(result.notes)} if result.notes else {})


def yaw_values(travel: Travel | None) -> dict[str, str]:
    """Return the yaw against the direction of travel where it is known, ``yaw_rad`` and ``yaw_std_rad``."""
    return {} if travel is None else number_values(travel.yaw_dict())


def alignment_numbers(prefix: str, alignment: Alignment | None) -> dict[str, str]:
    """Return the known angles of an alignment and their standard deviations [rad].

    Args:
        prefix: What the keys begin with, ``alignment``.
        alignment: The alignment.
    """
    known = {} if alignment is None else alignment.as_dict() | alignment.std_dict()
    return number_values({f"{prefix}_{name}": value for name, value in known.items()})


def alignment_values(alignment: Alignment | None, rig: StereoRig) -> dict[str, str]:
    """Return how the right camera is turned: its angles, the verdict, and the same as a sentence."""
    told = report_alignment(alignment, rig)
    verdict = {"alignment_verdict": str(told.verdict), "alignment": told.message}
    return alignment_numbers("alignment", alignment) | verdict


def delay_values(delay: RightDelay | None) -> dict[str, str]:
    """Return when the right images are taken against what their stamps say, where it is told."""
    if delay is None:
        return {}
    numbers = {"right_delay_s": delay.delay_s, "right_delay_std_s": float(delay.std[0])}
    return number_values(numbers) | {"synchronisation": describe_delay(delay)}


def rejection_values(prefix: str, rejection: Rejection) -> dict[str, str]:
    """Return a refusal. The unit of its two numbers depends on the reason, so it has a key of its own.

    Args:
        prefix: Key of the reason, with which the others begin.
        rejection: The refusal.
    """
    numbers = {f"{prefix}_measured": rejection.value, f"{prefix}_limit": rejection.threshold}
    return {
        prefix: str(rejection.reason),
        f"{prefix}_finding": rejection.finding,
        **number_values(numbers),
        f"{prefix}_bound": str(rejection.bound),
        f"{prefix}_unit": rejection.unit,
        f"{prefix}_remedy": rejection.remedy,
    }


def rig_values(rig: StereoRig) -> dict[str, str]:
    """Return size, intrinsics and baseline of a rig."""
    size = {"width_px": str(rig.width), "height_px": str(rig.height)}
    pixels = {f"{name}_px": getattr(rig, name) for name in ("fx", "fy", "cx", "cy")}
    return size | number_values(pixels | {"baseline_m": rig.baseline_m})


def describe_rig(rig: StereoRig, source: str) -> str:
    """Return a rig in a sentence.

    Args:
        rig: The rig.
        source: Where it comes from.
    """
    return f"{rig.width} x {rig.height} px, baseline {rig.baseline_m:.4f} m, from {source}"
