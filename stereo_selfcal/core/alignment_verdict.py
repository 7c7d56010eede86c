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

"""What the alignment of the right camera means for its user: the depths, the rows, and what is to be done."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from .camera.rig import StereoRig
from .geometry.alignment import ALIGNMENT_NAMES, Alignment
from .road.priors import CALIBRATED_TURN_STD_RAD
from .types import Array, Mask

# Standard deviations within which a normal error lies in 997 of 1000 cases.
_SIGMAS = 3.0
# What calibrations leave of pitch, roll and yaw: 0.03, 0.06 and 0.03 deg. Where an angle is not known as well
# as that, nothing tells whether it is good.
GOOD_LIMITS_RAD: Array = _SIGMAS * np.array(CALIBRATED_TURN_STD_RAD)
# Beyond, rows and disparities are so far off (6 px of a focal length of 720) that a pair of images is hardly
# matched at all; and no mount gives way so far that keeps its lenses as they were calibrated.
CORRECTABLE_LIMIT_RAD = math.radians(0.5)
# A smooth error of the rows that no turn explains. It is that of lenses, and as large as what calibrations
# leave of the pitch, three standard deviations.
UNEXPLAINED_LIMIT_RAD = _SIGMAS * CALIBRATED_TURN_STD_RAD[0]
# Depths at which errors are told: the end of the road that is used, and a third of it.
TOLD_DEPTHS_M = (10.0, 30.0)

_PITCH, _ROLL, _YAW = range(len(ALIGNMENT_NAMES))
_LEAST_PX = 0.01  # rows are not told to be better than that
_LEAST_DECIMALS, _MOST_DECIMALS = 2, 4  # of degrees: a hundredth is what calibrations leave


class AlignmentVerdict(Enum):
    """What is to be done about the alignment; ``str(verdict)`` is a stable snake_case word."""

    GOOD = "good"
    CORRECTABLE = "correctable"
    CALIBRATE_AGAIN = "calibrate_again"
    NOT_SEEN = "not_seen"

    def __str__(self) -> str:
        return self.value

    @property
    def is_fault(self) -> bool:
        """Whether somebody has to do something."""
        return self in (AlignmentVerdict.CORRECTABLE, AlignmentVerdict.CALIBRATE_AGAIN)


# What follows from a verdict, at the end of its sentence.
_REMEDIES = {
    AlignmentVerdict.GOOD: "good: no more than calibrations leave",
    AlignmentVerdict.CORRECTABLE: "correctable: a rotation of the right image explains all of it",
    AlignmentVerdict.CALIBRATE_AGAIN: "calibrate the cameras again: {why}",
    AlignmentVerdict.NOT_SEEN: "the rest is no more than calibrations leave",
}
_NOTHING_SEEN = "it is not seen how the right camera is turned"


@dataclass(frozen=True, slots=True)
class AlignmentReport:
    """An alignment in the user's units.

    Attributes:
        verdict: What is to be done.
        message: One sentence: what is wrong by how much, and what is to be done.
    """

    verdict: AlignmentVerdict
    message: str


def off_limits(alignment: Alignment) -> Mask:
    """Return which of pitch, roll and yaw is off (3,): more than calibrations leave and than the error."""
    expected = np.hypot(GOOD_LIMITS_RAD, _SIGMAS * alignment.std)
    off: Mask = np.abs(alignment.as_array()) > expected
    return off


def seen_angles(alignment: Alignment) -> Mask:
    """Return which of pitch, roll and yaw is seen (3,): well enough to tell whether it is good, or off."""
    seen: Mask = (alignment.std <= GOOD_LIMITS_RAD) | off_limits(alignment)
    return seen


def depth_error(alignment: Alignment, rig: StereoRig, depth_m: float) -> float:
    """Return by which part of itself the true depth differs from a measured one, > 0: measured too large.

    A measured depth is ``fx B / (d - fx yaw)`` in place of ``fx B / d``. So its error over the true depth is
    ``depth yaw / B``. At -1 and below, nothing is measured at that depth: infinity is measured nearer.

    Args:
        alignment: How the right camera is turned.
        rig: Its baseline counts.
        depth_m: The measured depth [m].
    """
    return depth_m * alignment.yaw_rad / rig.baseline_m


def verdict_of(alignment: Alignment | None) -> AlignmentVerdict:
    """Return what is to be done about an alignment, None where there is none."""
    if alignment is None:
        return AlignmentVerdict.NOT_SEEN
    if _why_again(alignment):
        return AlignmentVerdict.CALIBRATE_AGAIN
    if np.any(off_limits(alignment)):
        return AlignmentVerdict.CORRECTABLE
    return AlignmentVerdict.GOOD if np.all(seen_angles(alignment)) else AlignmentVerdict.NOT_SEEN


def report_alignment(alignment: Alignment | None, rig: StereoRig) -> AlignmentReport:
    """Return an alignment in the user's units.

    Args:
        alignment: How the right camera is turned; None where nothing tells.
        rig: Intrinsics and baseline.
    """
    verdict = verdict_of(alignment)
    if alignment is None or not np.any(seen_angles(alignment)):
        return AlignmentReport(verdict, _NOTHING_SEEN)
    parts = [_yaw(alignment, rig), _pitch(alignment, rig), _roll(alignment, rig)]
    parts.append(_REMEDIES[verdict].format(why=_why_again(alignment)))
    return AlignmentReport(verdict, "; ".join(parts))


def _why_again(alignment: Alignment) -> str:
    """Return why a rotation does not mend the pair, "" where it does."""
    beyond = off_limits(alignment) & (np.abs(alignment.as_array()) > CORRECTABLE_LIMIT_RAD)
    if np.any(beyond):
        return f"no turn of more than {math.degrees(CORRECTABLE_LIMIT_RAD):g} deg is corrected"
    if alignment.unexplained_rad > UNEXPLAINED_LIMIT_RAD:
        size, limit = (math.degrees(each) for each in (alignment.unexplained_rad, UNEXPLAINED_LIMIT_RAD))
        return f"no rotation explains the rows, which are off by {size:.3f} deg (limit: at most {limit:.2f})"
    return ""


def _yaw(alignment: Alignment, rig: StereoRig) -> str:
    if not seen_angles(alignment)[_YAW]:
        return _not_seen(alignment, _YAW)
    if not off_limits(alignment)[_YAW]:
        doubt = math.hypot(alignment.yaw_rad, float(alignment.std[_YAW])) / rig.baseline_m
        errors = " and ".join(f"{_percent(depth * doubt)} at {depth:g} m" for depth in TOLD_DEPTHS_M)
        return f"depths are right to {errors} ({_angle(alignment, _YAW)})"
    side = "left" if alignment.yaw_rad > 0.0 else "right"
    return f"the right camera looks {_amount(alignment, _YAW)} too far {side}: {_depths(alignment, rig)}"


def _depths(alignment: Alignment, rig: StereoRig) -> str:
    """Return by how much depths are wrong, for a yaw that is off."""
    errors = {depth: depth_error(alignment, rig, depth) for depth in TOLD_DEPTHS_M}
    size = "large" if alignment.yaw_rad > 0.0 else "small"
    possible = {depth: error for depth, error in errors.items() if error > -1.0}
    told = ", ".join(f"{_percent(abs(error))} at {depth:g} m" for depth, error in possible.items())
    text = f"depths are too {size}" + (f", by {told}" if told else "")
    if len(possible) < len(errors):
        text += f", and infinity is measured as {rig.baseline_m / -alignment.yaw_rad:.3g} m"
    return text


def _pitch(alignment: Alignment, rig: StereoRig) -> str:
    if not seen_angles(alignment)[_PITCH]:
        return _not_seen(alignment, _PITCH)
    rows_px = rig.fy * alignment.pitch_rad
    if not off_limits(alignment)[_PITCH]:
        doubt = rig.fy * math.hypot(alignment.pitch_rad, float(alignment.std[_PITCH]))
        return f"its rows are right to {_pixels(doubt)} ({_angle(alignment, _PITCH)})"
    side = "high" if rows_px > 0.0 else "low"
    return f"its rows lie {_pixels(abs(rows_px))} too {side} ({_angle(alignment, _PITCH)})"


def _roll(alignment: Alignment, rig: StereoRig) -> str:
    if not seen_angles(alignment)[_ROLL]:
        return _not_seen(alignment, _ROLL)
    border = rig.fy / rig.fx * rig.width / 2.0
    if not off_limits(alignment)[_ROLL]:
        doubt = border * math.hypot(alignment.roll_rad, float(alignment.std[_ROLL]))
        return f"it is upright to {_pixels(doubt)} at the borders ({_angle(alignment, _ROLL)})"
    lower, higher = ("right", "left") if alignment.roll_rad > 0.0 else ("left", "right")
    rows_px = border * abs(alignment.roll_rad)
    return (
        f"its {lower} side hangs {_amount(alignment, _ROLL)} too low: rows lie {_pixels(rows_px)} too high "
        f"at the {lower} border and too low at the {higher} one"
    )


def _not_seen(alignment: Alignment, index: int) -> str:
    return f"{_angle(alignment, index)} is not seen well enough to be judged"


def _decimals(alignment: Alignment, index: int) -> int:
    """Return the decimals of an angle in degrees: those of the first digit of its standard deviation."""
    std_deg = math.degrees(float(alignment.std[index]))
    if not 0.0 < std_deg < math.inf:
        return _LEAST_DECIMALS
    first_digit = float(f"{std_deg:.0e}")  # rounded: 0.0097 is told as 0.01
    return min(max(-math.floor(math.log10(first_digit)), _LEAST_DECIMALS), _MOST_DECIMALS)


def _amount(alignment: Alignment, index: int) -> str:
    """Return the size of an angle with its standard deviation: ``0.14 +- 0.01 deg``."""
    value, std = (math.degrees(each[index]) for each in (alignment.as_array(), alignment.std))
    decimals = _decimals(alignment, index)
    return f"{abs(value):.{decimals}f} +- {std:.{decimals}f} deg"


def _angle(alignment: Alignment, index: int) -> str:
    """Return an angle with its name and sign: ``pitch +0.024 +- 0.002 deg``."""
    value, std = (math.degrees(each[index]) for each in (alignment.as_array(), alignment.std))
    decimals = _decimals(alignment, index)
    name = ALIGNMENT_NAMES[index].rpartition("_")[0]
    value = round(value, decimals) + 0.0  # no -0.00
    return f"{name} {value:+.{decimals}f} +- {std:.{decimals}f} deg"


def _percent(part: float) -> str:
    percent = round(100.0 * part, 1)
    return f"{percent:.{1 if percent < 10.0 else 0}f} %"


def _pixels(size: float) -> str:
    size = max(size, _LEAST_PX)
    return f"{size:.{2 if size < 0.1 else 1}f} px"
