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

"""What the gates read of the rig: how the images lie to each other against their calibration."""

from __future__ import annotations

import math

from ..rejection import Bound
from .frame_evidence import Evidence
from .measurements import SHAPE_SIGMAS, Reading

# A right camera that is turned in pitch changes the disparities of the left and of the right line in opposite
# directions: by this, the roll by 0.7 deg with a rig of half a metre, nearly what stripes and road surface
# have to agree within.
_MAX_PITCH_RAD = math.radians(0.04)
# As much at half the way to the border of a usual image.
_MAX_ROLL_RAD = math.radians(0.1)


def read_row_offset(evidence: Evidence) -> Reading | None:
    """Read the pitch of the right camera against the left one, by the rows of both images."""
    if evidence.rows is None:
        return None
    value = abs(evidence.rows.pitch_rad)
    limit = max(_MAX_PITCH_RAD, SHAPE_SIGMAS * float(evidence.rows.std_rad[0]))
    what = "the rows of the right image are off by {value}"
    return Reading(what, math.degrees(value), Bound.MOST, math.degrees(limit), "deg", value <= limit)


def read_camera_turn(evidence: Evidence) -> Reading | None:
    """Read the angle between the cameras about their optical axes."""
    if evidence.rows is None:
        return None
    value = abs(evidence.rows.roll_rad)
    limit = max(_MAX_ROLL_RAD, SHAPE_SIGMAS * float(evidence.rows.std_rad[1]))
    what = "one camera is turned against the other about its optical axis, by {value}"
    return Reading(what, math.degrees(value), Bound.MOST, math.degrees(limit), "deg", value <= limit)


def read_lateness(evidence: Evidence) -> Reading | None:
    """Read the way of the car between both images."""
    if evidence.lateness is None:
        return None
    value, limit = abs(evidence.lateness.way_m), evidence.most_way_m
    return Reading(evidence.lateness.what, value, Bound.MOST, limit, "m", value <= limit)


def read_yaw(evidence: Evidence) -> Reading | None:
    """Read the angle by which the right camera has turned about the vertical."""
    yaw = evidence.yaw
    if yaw is None:
        return None
    value, limit = abs(yaw.yaw_rad), evidence.wrong_yaw_rad
    side = "left" if yaw.yaw_rad > 0.0 else "right"
    what = (
        f"by rows, lane lines and far things, the right camera looks {{value}} farther to the {side} than "
        f"its calibration has it (std {math.degrees(yaw.std_rad):.3f} deg)"
    )
    return Reading(what, math.degrees(value), Bound.MOST, math.degrees(limit), "deg", value <= limit)
