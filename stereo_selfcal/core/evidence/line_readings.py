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

"""What the gates read of lines that no road surface confirms: whether they are paint on one road."""

from __future__ import annotations

import math

import numpy as np

from ..rejection import Bound
from ..road.priors import MAX_CROSS_FALL
from ..tolerances import EXCLUDED_SIGMAS, WRONG
from .frame_evidence import Evidence
from .measurements import Reading
from .surface_measurements import read_surface_difference

# The widest lines, those of bus lanes and at motorway exits, are half a metre wide; they are measured to a
# tenth of that. The band of a guard rail is as wide or wider, where it is taken for paint on a road.
_MAX_STRIPE_M = 0.55
# A tilt counts when it exceeds what roads have by this many of its standard deviations.
_TILT_SIGMAS = 4.0


def read_sweep(evidence: Evidence) -> Reading | None:
    """Read how surely texture or tracks between the lines exclude that the road is near their plane."""
    line_pose = evidence.line_pose
    if not evidence.sweeps or line_pose is None:
        return None
    # What is unknown of both cameras is the same for the lines and for what lies between them.
    excluding = [sweep.excluding_sigmas(line_pose, WRONG) for sweep in evidence.sweeps]
    value = max(excluding)
    height_m, _ = evidence.sweeps[int(np.argmax(excluding))].best
    what = (
        f"the surface between the lane lines is a plane {height_m:.3f} m below the camera, and "
        "excludes theirs by {value} standard deviations"
    )
    return Reading(what, value, Bound.MOST, EXCLUDED_SIGMAS, "", value <= EXCLUDED_SIGMAS)


def read_all_against_lines(evidence: Evidence) -> Reading | None:
    """Read how surely faint texture and the road surface together exclude the plane of the lines.

    Each of them may be below its limit. They are different pixels, or different measures of the same ones, so
    that their standard deviations are added as squares.
    """
    sweep, surface = read_sweep(evidence), read_surface_difference(evidence)
    if sweep is None or surface is None:
        return None
    by_surface = EXCLUDED_SIGMAS * surface.value / surface.threshold
    value = math.hypot(max(sweep.value, 0.0), by_surface)
    what = (
        "faint texture and the road surface between the lane lines together exclude their plane by {value} "
        "standard deviations"
    )
    return Reading(what, value, Bound.MOST, EXCLUDED_SIGMAS, "", value <= EXCLUDED_SIGMAS)


def read_widest_stripe(evidence: Evidence) -> Reading | None:
    """Read the width of the wider one of the two lane lines."""
    if evidence.refined is None or len(evidence.refined.widths_m) < 2:
        return None
    value_m = float(evidence.refined.widths_m[:2].max())
    what = "a lane line would be {value} wide on the road"
    return Reading(what, value_m, Bound.MOST, _MAX_STRIPE_M, "m", value_m <= _MAX_STRIPE_M)


def read_stripe_tilt(evidence: Evidence) -> Reading | None:
    """Read by how much a painted stripe rises across its own width against the plane of both.

    Where one of two lines lies above the road, the plane through both is tilted; the paint of the other one
    still lies as the road does.
    """
    if evidence.refined is None:
        return None
    tilts = []
    for border in evidence.borders:
        width_m, step = float(evidence.refined.widths_m[border.line]), border.edge_step
        if math.isfinite(step.height_m):
            most = MAX_CROSS_FALL + _TILT_SIGMAS * step.std_m / width_m
            tilts.append((abs(step.height_m) / width_m, most))
    if not tilts:
        return None
    value, most = max(tilts, key=lambda each: each[0] / each[1])
    what = "a lane line and the plane of both differ in cross slope by {value}"
    degrees = math.degrees(math.atan(value)), math.degrees(math.atan(most))
    return Reading(what, degrees[0], Bound.MOST, degrees[1], "deg", value <= most)
