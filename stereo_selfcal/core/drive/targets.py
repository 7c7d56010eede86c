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

"""When an estimate of the mount is good enough: standard deviations that a user asks for.

Where they are not reached, the terms of the estimate's covariance say what keeps it from them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..geometry.mount import MountEvidence
from ..geometry.pose import POSE_COMPONENTS, Extrinsics, PoseComponent
from ..geometry.uncertainty import TERMS, UncertaintyTerm
from ..results import CalibrationResult
from ..tolerances import DEFAULT_HEIGHT_STD_M, DEFAULT_PITCH_STD_RAD, DEFAULT_ROLL_STD_RAD
from ..types import Array

# Growth of the number of frames after which an estimate is made anew. An estimate takes the longer
# the more frames there are: 0.8 s for 3000 of them. All those of 3000 frames take half a minute together,
# and the frames 20 minutes.
_ESTIMATE_STEP = 50

# A calibration is less certain than another one from a hundredth on: less is no better for anybody, and
# depends on the last digits of a machine.
_NOTABLE = 1.01


@dataclass(frozen=True, slots=True)
class Targets:
    """Standard deviations that are good enough.

    Attributes:
        height_std_m: Of the height [m]; 0: any is.
        pitch_std_rad: Of the pitch [rad]; 0: any is.
        roll_std_rad: Of the roll [rad]; 0: any is.
        frames: Fewest accepted frames.
    """

    height_std_m: float = 0.0
    pitch_std_rad: float = 0.0
    roll_std_rad: float = 0.0
    frames: int = 1

    @property
    def std(self) -> Extrinsics:
        """The standard deviations of height, pitch and roll; 0: any is good enough."""
        return Extrinsics(self.height_std_m, self.pitch_std_rad, self.roll_std_rad)

    def reached(self, estimate: CalibrationResult) -> bool:
        """Whether an estimate of the mount is good enough."""
        if not estimate.accepted or estimate.std is None or estimate.n_frames < self.frames:
            return False
        asked = self.std.as_array()
        return bool(np.all((asked == 0.0) | (estimate.std.as_array() <= asked)))

    @property
    def any_std(self) -> bool:
        """Whether any standard deviation is good enough, so that the number of frames alone counts."""
        return not np.any(self.std.as_array())

    def describe(self) -> str:
        """Return what is asked as people read it, such as ``10 mm, 0.12, 0.25 deg``."""
        return describe_std(self.std)


USUAL_TARGETS = Targets(DEFAULT_HEIGHT_STD_M, DEFAULT_PITCH_STD_RAD, DEFAULT_ROLL_STD_RAD)


class EstimateTimes:
    """Says after which accepted frames the estimate is worth its time.

    The steps depend on the number of frames alone, so that a recording ends where the same drive did.

    Args:
        frames: Fewest accepted frames that are asked for: the estimate is made with them in any case.
    """

    def __init__(self, frames: int = 1) -> None:
        self._frames = frames
        self._next = 1
        self.accepted = 0

    def count(self) -> bool:
        """Count one more accepted frame, and return whether the estimate is to be made."""
        self.accepted += 1
        due = self.accepted >= self._next or self.accepted == self._frames
        if due:
            self._next = self.accepted + 1 + self.accepted // _ESTIMATE_STEP
        return due


def describe_std(std: Extrinsics) -> str:
    """Return standard deviations as people read them, with two digits; a 0 is ``any``."""
    known = [component for component in POSE_COMPONENTS if component.of(std)]
    last = {component.small_unit: component for component in known}  # the unit is written once, after it
    parts = []
    for component in POSE_COMPONENTS:
        unit = component.small_unit
        number = _short(component.of(std) * unit.per_si, 2)
        symbol = f" {unit.symbol}" if last.get(unit) is component else ""
        parts.append(number + symbol if component in known else "any")
    return ", ".join(parts)


def is_less_certain(old: CalibrationResult, new: CalibrationResult, targets: Targets) -> bool:
    """Return whether a calibration is less certain than another one.

    The greatest of the three standard deviations over what is asked of it counts: the one that keeps a user
    waiting. Where any is good enough for the user, the defaults are taken in its place. A calibration that
    does not say how the mount was reached (a file of schema 1) holds nothing of the car's motion in its
    standard deviations: it is less certain than any that does.

    Args:
        old: An accepted calibration.
        new: Another one.
        targets: What is asked.
    """
    if (old.mount is None) != (new.mount is None):
        return old.mount is None
    asked, usual = targets.std.as_array(), USUAL_TARGETS.std.as_array()
    asked = usual if targets.any_std else np.where(asked == 0.0, np.inf, asked)
    before, after = (_std_of(result) / asked for result in (old, new))
    return bool(before.max() > _NOTABLE * after.max())


class _Cause(Enum):
    """A kind of cause that keeps an estimate from its targets; the value is the remedy."""

    FEW_FRAMES = "more frames average it out: drive longer"
    MOTION = "drive longer"
    STANDING = "frames of one place do not average it out: drive"
    ROAD = "the same road does not average it out: drive on, where the road is even and flat"
    RIG = "it does not average out"

    @property
    def label(self) -> str:
        """The cause in plain words."""
        return _LABELS[self]


_LABELS = {
    _Cause.FEW_FRAMES: "few frames",
    _Cause.MOTION: "motion of the car",
    _Cause.STANDING: "a car that stands",
    _Cause.ROAD: "the road",
    _Cause.RIG: "the rig's part",
}
# The cause of each term of a covariance (`core.geometry.uncertainty.TERMS`). What the frames of one road
# share counts as road.
_CAUSES = {
    **dict.fromkeys(("noise", "misfit", "mismatch", "scatter"), _Cause.FEW_FRAMES),
    **dict.fromkeys(("stage_disagreement", "combination_disagreement", "turn_before"), _Cause.FEW_FRAMES),
    "motion": _Cause.MOTION,
    "standing": _Cause.STANDING,
    "lean": _Cause.ROAD,
    **dict.fromkeys(("roughness", "camber", "paint_angle", "crown", "kerb"), _Cause.ROAD),
    **dict.fromkeys(("slope_seen", "slope_unseen", "part_of_road"), _Cause.ROAD),
    **dict.fromkeys(("vergence", "rectification", "row_offset"), _Cause.RIG),
    **dict.fromkeys(("ahead", "synchronisation"), _Cause.RIG),
}
# What helps against a part of the rig, besides asking for less.
_AGAINST_RIG = {
    "row_offset": "drive where the road has texture",
    "synchronisation": "trigger both cameras together",
}


def explain_shortfall(estimate: CalibrationResult, targets: Targets) -> str:
    """Return what keeps an estimate from the targets, in one sentence; "" where they are reached.

    The sentence names the component that is farthest from its target, and the cause of most of its variance.
    Where the rig's part alone is beyond the target, that is the cause, as no more frames can help.

    Args:
        estimate: An estimate of the mount.
        targets: What is asked.
    """
    if not estimate.accepted or estimate.std is None:
        return estimate.message
    if targets.reached(estimate):
        return ""
    asked = targets.std.as_array()
    over = np.divide(_std_of(estimate), asked, out=np.zeros(3), where=asked > 0.0)
    sentences = []
    if estimate.n_frames < targets.frames:
        sentences.append(f"{estimate.n_frames} of at least {targets.frames} frames accepted: drive longer")
    if over.max() > 1.0:
        sentences.append(_explain_component(estimate, asked, int(np.argmax(over))))
    return "; ".join(sentences)


def _explain_component(estimate: CalibrationResult, asked: Array, axis: int) -> str:
    """Return why one component is not known as well as asked."""
    component, variances = POSE_COMPONENTS[axis], _variances_by_cause(estimate.uncertainty, axis)
    std, target, total = _std_of(estimate)[axis], asked[axis], sum(variances.values())
    text = f"the {component.label} has a std of {_of(component, std)}, asked {_of(component, target)}"
    if total <= 0.0:
        return f"{text}: drive longer"
    cause = max(variances, key=lambda each: variances[each])
    if variances.get(_Cause.RIG, 0.0) > target**2:
        cause = _Cause.RIG
    greatest = max(
        (term for term in estimate.uncertainty if _cause_of(term) is cause),
        key=lambda term: float(term.covariance[axis, axis]),
    )
    detail = TERMS.get(greatest.name, greatest.name.replace("_", " "))
    if cause is _Cause.MOTION and estimate.mount is not None:
        detail = _moments(estimate.mount, axis)
    elif cause is _Cause.FEW_FRAMES:
        detail = f"{estimate.n_frames} accepted; {detail}"
    remedy = cause.value
    if cause is _Cause.RIG:
        less = f"raise target_{component.std_name}"
        remedy += ": " + ", or ".join(filter(None, (_AGAINST_RIG.get(greatest.name), less)))
    return f"{text}: {variances[cause] / total:.0%} of its variance is {cause.label} ({detail}): {remedy}"


def _variances_by_cause(terms: Iterable[UncertaintyTerm], axis: int) -> dict[_Cause, float]:
    """Return the variance of one component by each kind of cause."""
    variances: dict[_Cause, float] = {}
    for term in terms:
        cause = _cause_of(term)
        variances[cause] = variances.get(cause, 0.0) + float(term.covariance[axis, axis])
    return variances


def _cause_of(term: UncertaintyTerm) -> _Cause:
    """Return the cause of a term; one that nobody has named is taken to average out."""
    return _CAUSES.get(term.name, _Cause.FEW_FRAMES)


def _moments(mount: MountEvidence, axis: int) -> str:
    """Return how many independent moments of the car's motion a drive shows."""
    return f"{mount.duration_s:.0f} s of drive show {mount.looks[axis]:.1f} independent moments of it"


def _std_of(result: CalibrationResult) -> Array:
    """Return the standard deviations (3,) of an accepted result."""
    if result.std is None:
        raise ValueError("only accepted results have standard deviations")
    return result.std.as_array()


def _of(component: PoseComponent, std: float) -> str:
    unit = component.small_unit
    return f"{_short(std * unit.per_si, 3)} {unit.symbol}"


def _short(value: float, digits: int) -> str:
    """Return a number with a few digits, without an exponent where people would write none."""
    return f"{float(f'{value:.{digits}g}'):g}"
