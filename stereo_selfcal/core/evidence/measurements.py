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

"""What the gates read: for each gate, one number from the evidence of a frame, and its limit.

Each reading has a sentence for :class:`.Rejection`, in which ``{value}`` and ``{limit}`` stand for the
numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..estimators.stripe_fit import BLUR_MAX_PX
from ..geometry.pose import POSE_COMPONENTS
from ..rejection import Bound
from ..tolerances import AGREEMENT, MAX_LINE_HEIGHT_M, WRONG
from ..types import Array
from .frame_evidence import Evidence
from .stripe_border import EDGE_REMAINDER

# An estimate this close to an end of the search range, as a fraction of the range, was stopped by it: the
# genetic algorithm ends with its whole population within 1e-7.
_EDGE_FRACTION = 1e-3

# A curvature counts when it is this many standard deviations from zero: one false alarm in 15 000 frames for
# normal errors.
_CURVATURE_SIGMAS = 4.0

# The pixels of a line have most weight 8 m ahead. With this radius, the slope of the road differs there by
# 0.25 deg, which is what stripes and road surface have to agree within.
_MIN_VERTICAL_RADIUS_M = 1800.0

# The lines of one rectified pair over any flat road agree within their standard deviations. Real roads exceed
# these up to five times, as edges are not straight to a hundredth of a pixel; the limit is 40 % above that. A
# right camera turned by 0.02 rad about its axis gives 37, a vertical offset of a quarter of a pixel 21.
_MAX_MISFIT_SIGMAS = 7.0

# The narrowest lines are rails of trams. The least lane is half of the narrowest one, as an arrow in the
# middle of a lane may be taken for a line.
_MIN_STRIPE_M, _MIN_LANE_M = 0.05, 1.25

# The fit of the stripes may differ from the lines by what the texture of the road surface can tell apart
# (AGREEMENT). In noise, it may differ by this many standard deviations of both estimates, as edges are rough.
_MAX_STAGE_SIGMAS = 10.0

# The fit of the stripes stops at BLUR_MAX_PX. A blur within 3 % of it was stopped there: the true one may be
# greater.
_MAX_BLUR_PX = 0.97 * BLUR_MAX_PX

# A black or white pixel has no usable grey value. Of the lower half of an image, this part may be such.
_MAX_CLIPPED = 0.5

# An offset, an angle or a height counts when it is this many of its standard deviations from zero.
SHAPE_SIGMAS = 3.0

# The grey value changes in one step from a painted stripe to the lane beside it. In random worlds, shadows,
# dapples and noise leave another step of up to 5 % of the paint's contrast, the faces of kerbs 7 % and more.
_MAX_BORDER_STEP = 0.06
# The same between the two halves of a stripe whose edges both lie in the road. Two lines that were taken for
# one differ by up to 19 %, the halves of a rail by 24 % and more.
_MAX_HALF_DIFFERENCE = 0.2
# The same for a strip as narrow as the face of the lowest kerb: 99 % of the roads of random worlds have a
# step of less than 7 %, faces that are seen one of 12 % and more.
_MAX_NARROW_STEP = 0.10
# A difference counts when it is this many of its standard deviations from zero.
_SURELY_SIGMAS = 4.0


@dataclass(frozen=True, slots=True)
class Reading:
    """A measured value beside its limit.

    Attributes:
        what: What was measured, as in :class:`.Rejection`.
        value: The value.
        bound: Whether the limit is the least or the most that is good.
        threshold: The limit.
        unit: Unit of both.
        passed: Whether the value is good.
    """

    what: str
    value: float
    bound: Bound
    threshold: float
    unit: str
    passed: bool


def read_search_edge(evidence: Evidence) -> Reading | None:
    """Read the component of the pose that is nearest to an end of its search range, and that end."""
    estimate = evidence.genetic or (evidence.texture.extrinsics if evidence.texture else None)
    if estimate is None:
        return None
    lower, upper = (np.array(bound) for bound in evidence.config.search.bounds())
    pose = estimate.as_array()
    at_lower = pose - lower < upper - pose
    nearest = np.where(at_lower, lower, upper)
    gap = np.abs(pose - nearest) / (upper - lower)
    worst = int(np.argmin(gap))
    component = POSE_COMPONENTS[worst]
    label, unit = component.label, component.unit
    value, limit = (float(each[worst]) * unit.per_si for each in (pose, nearest))
    bound, end = (Bound.LEAST, "least") if at_lower[worst] else (Bound.MOST, "greatest")
    what = (
        f"the best {label}, {{value}}, is at the edge of the search space: "
        f"the {end} {label} searched is {{limit}}"
    )
    return Reading(what, value, bound, limit, unit.symbol, bool(gap[worst] > _EDGE_FRACTION))


def read_fitness(evidence: Evidence) -> Reading | None:
    """Read the fitness of the lines under the estimate."""
    if evidence.genetic is None:
        return None
    limit_px = evidence.config.fitness.max_misfit_px
    threshold = 1.0 / (limit_px**2 + evidence.config.fitness.k)
    what = (
        f"the lines miss every road plane by {evidence.misfit_px:.2f} px, at most {limit_px:g} px allowed "
        "(fitness {value}, at least {limit} needed)"
    )
    return Reading(what, evidence.fitness, Bound.LEAST, threshold, "", evidence.fitness >= threshold)


def _radius(what: str, curvature_per_m: float, std_per_m: float, least_m: float) -> Reading:
    """Return the reading of a radius; the limit is smaller where noise alone may explain the curvature."""
    curvature = max(abs(curvature_per_m), 1e-9)  # a million kilometres
    limit = max(1.0 / least_m, _CURVATURE_SIGMAS * std_per_m)
    return Reading(what, 1.0 / curvature, Bound.LEAST, 1.0 / limit, "m", curvature <= limit)


def read_lane_radius(evidence: Evidence) -> Reading | None:
    """Read the radius of the lane in the plane of the road."""
    if evidence.bends is None:
        return None
    bends = evidence.bends
    side = "left" if bends.lateral_per_m > 0 else "right"
    what = f"the lane lines bend to the {side} with a radius of {{value}}"
    least_m = evidence.config.extraction.min_radius_m
    return _radius(what, bends.lateral_per_m, bends.lateral_std_per_m, least_m)


def read_vertical_radius(evidence: Evidence) -> Reading | None:
    """Read the radius of the road's profile, from the curvature of the lines."""
    if evidence.bends is None:
        return None
    bends = evidence.bends
    kind = "dip" if bends.vertical_per_m > 0 else "crest"
    what = f"the road goes over a {kind} with a radius of {{value}}"
    return _radius(what, bends.vertical_per_m, bends.vertical_std_per_m, _MIN_VERTICAL_RADIUS_M)


def read_independent_lines(evidence: Evidence) -> Reading | None:
    """Read how many lines are independent: two that coincide determine only five of the six parameters."""
    if evidence.bends is None:  # before the lines are fitted
        return None
    n = 1 if evidence.lines is None else 2
    what = "the lines leave part of the pose undetermined: only {value} of {limit} is independent"
    return Reading(what, n, Bound.LEAST, 2, "", n == 2)


def read_line_misfit(evidence: Evidence) -> Reading | None:
    """Read how far the lines are from those of any flat road, in standard deviations."""
    if evidence.lines is None:
        return None
    sigmas = evidence.lines.misfit_sigmas
    what = "the lines in the two images contradict each other on any flat road, by {value}"
    good = sigmas <= _MAX_MISFIT_SIGMAS
    return Reading(what, sigmas, Bound.MOST, _MAX_MISFIT_SIGMAS, "standard deviations", good)


def read_uncertainty(evidence: Evidence) -> Reading | None:
    """Read the standard deviations of the estimate."""
    if evidence.std is None:
        return None
    return pose_difference("the {axis} is known with a standard deviation of {value}", evidence.std, WRONG)


def pose_difference(what: str, difference: Array, limits: Array) -> Reading:
    """Return the reading of the component of the pose that differs most, relative to its limit.

    ``{axis}`` in the sentence stands for the name of that component.
    """
    difference = np.abs(difference)
    worst = int(np.argmax(difference / limits))
    component = POSE_COMPONENTS[worst]
    unit = component.small_unit
    value, limit = float(difference[worst]), float(limits[worst])
    text = what.replace("{axis}", component.label)
    return Reading(text, value * unit.per_si, Bound.MOST, limit * unit.per_si, unit.symbol, value <= limit)


def read_stage_difference(evidence: Evidence) -> Reading | None:
    """Read how far the fit of the stripes differs from the estimate from the lines."""
    if evidence.refined is None or evidence.lines is None or evidence.genetic is None:
        return None
    sigmas = np.sqrt(np.diag(evidence.lines.covariance) + np.diag(evidence.refined.covariance))
    limits = np.maximum(AGREEMENT, _MAX_STAGE_SIGMAS * sigmas)
    change = evidence.refined.extrinsics.as_array() - evidence.genetic.as_array()
    what = "the lines and the grey values of their stripes differ in {axis} by {value}"
    return pose_difference(what, change, limits)


def read_stripe_width(evidence: Evidence) -> Reading | None:
    """Read the width of the lane lines on the road."""
    if evidence.refined is None or len(evidence.refined.widths_m) < 2:
        return None
    value_m = float(evidence.refined.widths_m[:2].min())
    what = "the two images fit one road only if a lane line is as narrow as {value}"
    return Reading(what, value_m, Bound.LEAST, _MIN_STRIPE_M, "m", value_m >= _MIN_STRIPE_M)


def read_lane_width(evidence: Evidence) -> Reading | None:
    """Read the distance between the lane lines on the road."""
    if evidence.refined is None or len(evidence.refined.positions_m) < 2:
        return None
    value_m = float(np.ptp(evidence.refined.positions_m[:2]))
    what = "the two images fit one road only if the lane lines are as near to each other as {value}"
    return Reading(what, value_m, Bound.LEAST, _MIN_LANE_M, "m", value_m >= _MIN_LANE_M)


def read_blur(evidence: Evidence) -> Reading | None:
    """Read the blur of the stripes' edges."""
    if evidence.refined is None:
        return None
    blur_px = float(np.max(evidence.refined.blur_px))
    what = f"the blur of the stripes' edges is {{value}} (the fit ends at {BLUR_MAX_PX:g} px)"
    return Reading(what, blur_px, Bound.MOST, _MAX_BLUR_PX, "px", blur_px <= _MAX_BLUR_PX)


def read_clipped_part(evidence: Evidence) -> Reading | None:
    """Read which part of the images is black or white."""
    if evidence.clipped is None:
        return None
    what = "the part of the road that is black or white in an image is {value}"
    good = evidence.clipped <= _MAX_CLIPPED
    return Reading(what, evidence.clipped, Bound.MOST, _MAX_CLIPPED, "", good)


def read_height_over_surface(evidence: Evidence) -> Reading | None:
    """Read how high the lines lie over the road surface beside them."""
    if not evidence.surface_heights:
        return None
    value_m = max(abs(height.value_m) for height in evidence.surface_heights)
    what = "a lane line and the road surface beside it differ in height by {value}"
    good = value_m <= MAX_LINE_HEIGHT_M
    return Reading(what, 1e3 * value_m, Bound.MOST, 1e3 * MAX_LINE_HEIGHT_M, "mm", good)


def read_height_over_lane(evidence: Evidence) -> Reading | None:
    """Read how high the lane lines lie over the road surface between them, which is aligned alone."""
    if not evidence.lane_heights:
        return None
    limits = [
        (abs(height.value_m), max(MAX_LINE_HEIGHT_M, SHAPE_SIGMAS * height.std_m))
        for height in evidence.lane_heights
    ]
    value_m, limit_m = max(limits, key=lambda each: each[0] / each[1])
    what = (
        "a lane line and the road surface between the lines, without what is beyond them, differ in "
        "height by {value}"
    )
    return Reading(what, 1e3 * value_m, Bound.MOST, 1e3 * limit_m, "mm", value_m <= limit_m)


def read_texture_sufficiency(evidence: Evidence) -> Reading | None:
    """Read the texture of the road surface over what a check of the lines needs, where one is required."""
    if evidence.texture_sufficiency is None:
        return None
    what = "the road surface has {value} of the texture and evenness that a check of the lines needs"
    value = evidence.texture_sufficiency
    return Reading(what, value, Bound.LEAST, 1.0, "", value >= 1.0)


def read_depth_below_plane(evidence: Evidence) -> Reading | None:
    """Read how deep another line lies below the plane of the lane lines."""
    if evidence.below is None or evidence.bends is None:  # a bend is refused as such, by an earlier gate
        return None
    depth, what = evidence.below, "another line lies {value} below the plane of the lane lines"
    return Reading(what, 1e3 * depth.depth_m, Bound.MOST, 1e3 * depth.limit_m, "mm", not depth.surely_below)


def read_profile_change(evidence: Evidence) -> Reading | None:
    """Read how the road 5 to 20 m ahead differs from the plane of the lines."""
    profile = evidence.wide_profile
    if profile is None:
        return None
    limits = np.maximum(AGREEMENT[:2], _SURELY_SIGMAS * profile.std)
    change, limits = np.append(profile.change, 0.0), np.append(limits, 1.0)
    what = "the road 5 to 20 m ahead and the plane of the lane lines differ in {axis} by {value}"
    return pose_difference(what, change, limits)


def read_border_step(evidence: Evidence) -> Reading | None:
    """Read the steps of grey between the stripes and the lane, and within the stripes."""
    if not evidence.borders:
        return None
    beside, within = "between a stripe and the lane", "within a stripe"
    steps = []
    for border in evidence.borders:
        # Where the heights of the edges were not measured, no strip beside the stripe is allowed.
        most = EDGE_REMAINDER if math.isnan(border.edge_step.height_m) else _MAX_BORDER_STEP
        steps.append((border.step, border.step_std, most, beside))
        # The halves of a level stripe may differ: a shadow may end in it, or it may be two lines.
        if border.edge_step.surely_lower_than(MAX_LINE_HEIGHT_M):
            difference, most = border.unshaded_difference, _MAX_HALF_DIFFERENCE
        else:
            difference, most = border.half_difference, _MAX_BORDER_STEP
        steps.append((difference, border.half_difference_std, most, within))
    steps += [
        (each.narrow_step, each.narrow_step_std, _MAX_NARROW_STEP, beside)
        for each in evidence.borders
        if math.isfinite(each.narrow_step)
    ]
    limits = [(abs(step), max(most, _SURELY_SIGMAS * std), where) for step, std, most, where in steps]
    step, limit, where = max(limits, key=lambda each: each[0] / each[1])
    what = f"the grey value changes {where} by {{value}} of the contrast of the stripe"
    return Reading(what, step, Bound.MOST, limit, "", step <= limit)


def read_edge_heights(evidence: Evidence) -> Reading | None:
    """Read how low the edges of the stripes towards the lane lie below their other edges."""
    steps = [border.edge_step for border in evidence.borders if math.isfinite(border.edge_step.height_m)]
    if not steps:
        return None
    limits = [(abs(step.height_m), max(MAX_LINE_HEIGHT_M, _SURELY_SIGMAS * step.std_m)) for step in steps]
    value_m, limit_m = max(limits, key=lambda each: each[0] / each[1])
    what = "the two edges of a stripe differ in height by {value}"
    return Reading(what, 1e3 * value_m, Bound.MOST, 1e3 * limit_m, "mm", value_m <= limit_m)


def read_fitted_stripes(evidence: Evidence) -> Reading | None:
    """Read whether the grey values of both stripes could be fitted."""
    if evidence.stripes_fitted is None:
        return None
    n = 2 if evidence.stripes_fitted else 0
    what = (
        "{value} of {limit} lane lines could be fitted to the grey values: too few rows show both edges of a "
        "painted stripe"
    )
    return Reading(what, n, Bound.LEAST, 2, "", evidence.stripes_fitted)


def read_inner_line_height(evidence: Evidence) -> Reading | None:
    """Read how far a line between the lane lines lies above or below their plane."""
    if evidence.inner_line_height is None:
        return None
    height_m = abs(evidence.inner_line_height.value_m)
    limit_m = max(MAX_LINE_HEIGHT_M, _SURELY_SIGMAS * evidence.inner_line_height.std_m)
    what = "a line between the two lane lines lies {value} above or below their plane"
    return Reading(what, 1e3 * height_m, Bound.MOST, 1e3 * limit_m, "mm", height_m <= limit_m)
