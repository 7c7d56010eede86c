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

"""What the gates read of the road surface: how lines differ from it, and its parts from each other."""

from __future__ import annotations

import math

import numpy as np

from ..numerics.linear import solve_linear
from ..rejection import Bound, NotFitted
from ..tolerances import (
    AGREEMENT,
    EXCLUDED_CHI2_3,
    EXCLUDED_SIGMAS,
    KERB_SIGMAS,
    MAX_DIFFERENCE,
    MAX_LINE_HEIGHT_M,
)
from .frame_evidence import Evidence
from .measurements import Reading, pose_difference


def read_surface_difference(evidence: Evidence) -> Reading | None:
    """Read how the plane of the lines and that of the road surface differ: the one that differs most."""
    if evidence.line_pose is None or not evidence.contradictors:
        return None
    what = "the lane lines and the road surface between them differ in {axis} by {value}"
    line_pose = evidence.line_pose.as_array()
    readings = []
    for each in evidence.contradictors:
        difference = line_pose - each.extrinsics.as_array()
        weighted = solve_linear(each.covariance, difference, "numbers of the difference that are known")
        # All three numbers together: the limit is where they would be as unlikely as EXCLUDED_SIGMAS.
        chi2 = 0.0 if isinstance(weighted, NotFitted) else float(difference @ weighted)
        unlikely = np.abs(difference) * math.sqrt(EXCLUDED_CHI2_3 / max(chi2, 1e-9))
        readings.append(pose_difference(what, difference, np.maximum(MAX_DIFFERENCE, unlikely)))
    return max(readings, key=lambda each: each.value / each.threshold)


def read_coarse_difference(evidence: Evidence) -> Reading | None:
    """Read how the plane of the lines and that of the dense disparities of the road differ."""
    if evidence.coarse is None or evidence.line_pose is None or evidence.std is None:
        return None
    difference = evidence.line_pose.as_array() - evidence.coarse.extrinsics.as_array()
    std = np.sqrt(np.diag(evidence.coarse.covariance) + evidence.std**2)
    what = "the lane lines and the dense disparities of the road differ in {axis} by {value}"
    return pose_difference(what, difference, np.maximum(MAX_DIFFERENCE, EXCLUDED_SIGMAS * std))


def read_halves_difference(evidence: Evidence) -> Reading | None:
    """Read how near and far, or left and right half of the road surface differ, for one without lines."""
    if not evidence.kerb_heights or evidence.texture is None or not evidence.texture.halves:
        return None
    what = "two halves of the road surface differ in {axis} by {value}"
    readings = [
        pose_difference(what, difference, np.maximum(MAX_DIFFERENCE, EXCLUDED_SIGMAS * std))
        for difference, std in evidence.texture.halves
    ]
    return max(readings, key=lambda each: each.value / each.threshold)


def read_kerb_heights(evidence: Evidence) -> Reading | None:
    """Read how far the plane of an estimate may lie above or below the surface of the own lane."""
    if not evidence.kerb_heights:
        return None
    most_m = max(abs(each.value_m) + KERB_SIGMAS * each.std_m for each in evidence.kerb_heights)
    limit_m = 2.0 * MAX_LINE_HEIGHT_M
    what = (
        "the road surface between the sides of the own lane leaves room for a kerb beside it: with two "
        "standard deviations, a height of {value}"
    )
    return Reading(what, 1e3 * most_m, Bound.MOST, 1e3 * limit_m, "mm", most_m <= limit_m)


def read_strip_difference(evidence: Evidence) -> Reading | None:
    """Read how the strip of the road under the car differs from all of its surface."""
    if evidence.texture is None or evidence.own_strip is None:
        return None
    difference = evidence.own_strip.extrinsics.as_array() - evidence.texture.extrinsics.as_array()
    std = np.sqrt(np.diag(evidence.own_strip.covariance))
    what = "the strip under the car and the whole road surface differ in {axis} by {value}"
    return pose_difference(what, difference, np.maximum(AGREEMENT, EXCLUDED_SIGMAS * std))
