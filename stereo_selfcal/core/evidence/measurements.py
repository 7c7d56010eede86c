"""What the gates read: one number each, from what the stages have found, beside its limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..estimators.stripe_fit import BLUR_MAX_PX
from ..tolerances import AGREEMENT, MAX_DIFFERENCE, MAX_LINE_HEIGHT_M, MAX_STD
from ..types import Array
from .frame_evidence import Evidence
from .stripe_border import LEFT_OF_EDGES

# An estimate this close to a side of the search box, as a fraction of its length, has been
# stopped by it: the genetic algorithm ends with its whole population within 1e-7.
_EDGE_FRACTION = 1e-3

# A curvature counts when it is this many standard deviations from straight: one false alarm
# in 15 000 frames for normal errors.
_CURVATURE_SIGMAS = 4.0

# The pixels of a line weigh as the slope of the road 8 m ahead does: with this radius, it differs by 0.25 deg
# there, which is what stripes and asphalt have to agree within.
_MIN_VERTICAL_RADIUS_M = 1800.0

# Lines of one rectified pair over any flat road agree within their standard deviations, which
# real roads exceed up to five times (edges are not straight to a hundredth of a pixel); 40 % are to spare. A
# right camera turned by 0.02 rad about its axis gives 37, a vertical offset of a quarter of a pixel 21.
_MAX_MISFIT_SIGMAS = 7.0

# The narrowest lines there are, rails of trams; and half of the narrowest lane, where an arrow in its middle
# is taken for a line.
_MIN_STRIPE_M, _MIN_LANE_M = 0.05, 1.25

# How far the refinement may lead away from the lines: by what the asphalt can tell apart, or, in noise, by
# this many standard deviations of the lines' estimate: edges are rough, as above.
_MAX_STAGE_SIGMAS = 10.0

# The fit of the stripes ends at its greatest blur: one within 3 % of it may be any.
_MAX_BLUR_PX = 0.97 * BLUR_MAX_PX

# Clipped grey values say nothing; half of the lower half of an image has to be left.
_MAX_CLIPPED = 0.5

# A vertical offset moves the lines of either side against each other: half a pixel is 0.7 deg of roll with a
# rig of 720 px and 0.5 m, nearly what stripes and asphalt have to agree within.
_MAX_VERTICAL_PX = 0.5
# Half a pixel 300 px beside the middle of the image.
_MAX_TURN_RAD = math.radians(0.1)
# An offset or a height counts when it is surely there.
_SHAPE_SIGMAS = 3.0

# Between a painted stripe and its lane there is nothing: in random worlds shadows, dapples and noise leave up
# to 5 % of the paint's contrast, kerbs show a face of 7 % and more.
_MAX_RIM = 0.06
# Where both edges of a stripe lie in the road: two lines that pass for one differ by up to 19 % there, the
# halves of a rail by 24 % and more.
_MAX_OWN_TONE = 0.2
# What is as narrow as the face of the lowest kerb: 99 % of the roads of random worlds leave less than 7 %
# there, faces that are seen 12 % and more.
_MAX_FACE = 0.10
# What no line and no slope may do by chance, of the standard deviations of what is measured.
_SURELY_SIGMAS = 4.0

_AXES = ("height", "pitch", "roll")
_UNITS = ("m", "deg", "deg")
_READABLE = np.array([1.0, math.degrees(1.0), math.degrees(1.0)])


@dataclass(frozen=True, slots=True)
class Reading:
    """A measured value beside its limit.

    Attributes:
        what: What was measured, in words.
        value: The value.
        threshold: The limit.
        unit: Unit of both.
        passed: Whether the value is good.
    """

    what: str
    value: float
    threshold: float
    unit: str
    passed: bool


def inside(evidence: Evidence) -> Reading | None:
    """Read how far the estimate is from the border of the search box."""
    estimate = evidence.genetic or (evidence.texture.extrinsics if evidence.texture else None)
    if estimate is None:
        return None
    search = evidence.config.search
    lower = np.array([search.height_min_m, -search.pitch_max_rad, -search.roll_max_rad])
    upper = np.array([search.height_max_m, search.pitch_max_rad, search.roll_max_rad])
    pose = estimate.as_array()
    nearest = np.where(pose - lower < upper - pose, lower, upper)
    gap = np.abs(pose - nearest) / (upper - lower)
    worst = int(np.argmin(gap))
    value, limit = ((each * _READABLE)[worst] for each in (pose, nearest))
    what = f"best {_AXES[worst]} is at the edge of the search space"
    return Reading(what, float(value), float(limit), _UNITS[worst], bool(gap[worst] > _EDGE_FRACTION))


def fitness(evidence: Evidence) -> Reading | None:
    """Read the fitness of the lines under the estimate."""
    if evidence.genetic is None:
        return None
    limit_px = evidence.config.fitness.max_misfit_px
    threshold = 1.0 / (limit_px**2 + evidence.config.fitness.k)
    miss = f"the lines miss every road plane by {evidence.misfit_px:.2f} px, limit {limit_px:g} px"
    what = f"best fitness ({miss})"
    return Reading(what, evidence.fitness, threshold, "", evidence.fitness >= threshold)


def _radius(what: str, curvature_per_m: float, std_per_m: float, least_m: float) -> Reading:
    """Return the reading of a radius, which may be less where noise alone may have made it."""
    curvature = max(abs(curvature_per_m), 1e-9)  # a million kilometres
    limit = max(1.0 / least_m, _CURVATURE_SIGMAS * std_per_m)
    return Reading(what, 1.0 / curvature, 1.0 / limit, "m", curvature <= limit)


def straight(evidence: Evidence) -> Reading | None:
    """Read the radius of the lane."""
    if evidence.bends is None:
        return None
    bends = evidence.bends
    side = "left" if bends.lateral_per_m > 0 else "right"
    least_m = evidence.config.extraction.min_radius_m
    return _radius(
        f"the lane lines bend to the {side}, radius", bends.lateral_per_m, bends.lateral_std_per_m, least_m
    )


def flat(evidence: Evidence) -> Reading | None:
    """Read the radius of the road's profile, as the lines bend."""
    if evidence.bends is None:
        return None
    bends = evidence.bends
    kind = "dip" if bends.vertical_per_m > 0 else "crest"
    what = f"the road goes over a {kind}, radius"
    return _radius(what, bends.vertical_per_m, bends.vertical_std_per_m, _MIN_VERTICAL_RADIUS_M)


def determined(evidence: Evidence) -> Reading | None:
    """Two lines that coincide leave one of the six parameters open."""
    if evidence.bends is None:  # before the lines are fitted
        return None
    n = 1 if evidence.lines is None else 2
    return Reading("the lines leave part of the pose undetermined; independent lines", n, 2, "", n == 2)


def consistent(evidence: Evidence) -> Reading | None:
    """Read how far the lines are from those of any flat road."""
    if evidence.lines is None:
        return None
    sigmas = evidence.lines.misfit_sigmas
    what = "the lines of the two cameras contradict each other whatever the road, by"
    return Reading(what, sigmas, _MAX_MISFIT_SIGMAS, "standard deviations", sigmas <= _MAX_MISFIT_SIGMAS)


def certain(evidence: Evidence) -> Reading | None:
    """Read whether an estimate tells anything, by its own account."""
    if evidence.std is None:
        return None
    return _difference("the lines alone leave a standard deviation", evidence.std, MAX_STD)


def _difference(what: str, difference: Array, limits: Array) -> Reading:
    """Return the reading of the worst of height, pitch and roll."""
    difference = np.abs(difference)
    worst = int(np.argmax(difference / limits))
    scale, unit = (1e3, "mm") if worst == 0 else (math.degrees(1.0), "deg")
    value, limit = float(difference[worst]), float(limits[worst])
    return Reading(f"{what} in {_AXES[worst]}", value * scale, limit * scale, unit, value <= limit)


def stages(evidence: Evidence) -> Reading | None:
    """Read how far the refinement has led away from the lines."""
    if evidence.refined is None or evidence.lines is None or evidence.genetic is None:
        return None
    sigmas = np.sqrt(np.diag(evidence.lines.covariance) + np.diag(evidence.refined.covariance))
    limits = np.maximum(AGREEMENT, _MAX_STAGE_SIGMAS * sigmas)
    change = evidence.refined.extrinsics.as_array() - evidence.genetic.as_array()
    return _difference("lines and grey values of the stripes differ", change, limits)


def stripe_width(evidence: Evidence) -> Reading | None:
    """Read the width of the boundaries' stripes on the road."""
    if evidence.refined is None or len(evidence.refined.widths_m) < 2:
        return None
    value_m = float(evidence.refined.widths_m[:2].min())
    what = "the lines of both cameras are those of one road only if they are this narrow"
    return Reading(what, value_m, _MIN_STRIPE_M, "m", value_m >= _MIN_STRIPE_M)


def lane_width(evidence: Evidence) -> Reading | None:
    """Read how far the boundaries are apart on the road."""
    if evidence.refined is None or len(evidence.refined.positions_m) < 2:
        return None
    value_m = float(np.ptp(evidence.refined.positions_m[:2]))
    what = "the lines of both cameras are those of one road only if they are this near to each other"
    return Reading(what, value_m, _MIN_LANE_M, "m", value_m >= _MIN_LANE_M)


def blur(evidence: Evidence) -> Reading | None:
    """Read the blur of the stripes' edges."""
    if evidence.refined is None:
        return None
    blur_px = float(np.max(evidence.refined.blur_px))
    return Reading("blur of the stripes' edges", blur_px, _MAX_BLUR_PX, "px", blur_px <= _MAX_BLUR_PX)


def exposure(evidence: Evidence) -> Reading | None:
    """Read how much of the images is clipped."""
    if evidence.clipped is None:
        return None
    what = "part of the road that is black or white in an image"
    return Reading(what, evidence.clipped, _MAX_CLIPPED, "", evidence.clipped <= _MAX_CLIPPED)


def asphalt(evidence: Evidence) -> Reading | None:
    """Read how the planes of lines and asphalt differ."""
    if evidence.texture is None or evidence.of_lines is None:
        return None
    difference = evidence.of_lines.as_array() - evidence.texture.extrinsics.as_array()
    return _difference("the lines and the asphalt between them differ", difference, MAX_DIFFERENCE)


def line_heights(evidence: Evidence) -> Reading | None:
    """Read how high the lines lie over the asphalt."""
    if evidence.heights_m is None:
        return None
    value = float(np.abs(evidence.heights_m).max())
    what = "the lines and the asphalt between them differ in height of a line over the asphalt"
    return Reading(what, 1e3 * value, 1e3 * MAX_LINE_HEIGHT_M, "mm", value <= MAX_LINE_HEIGHT_M)


def own_heights(evidence: Evidence) -> Reading | None:
    """Read how high the boundaries lie over the asphalt between them, whatever is beyond."""
    if evidence.own_m is None:
        return None
    heights_m, stds_m = evidence.own_m
    limits_m = np.maximum(MAX_LINE_HEIGHT_M, _SHAPE_SIGMAS * stds_m)
    worst = int(np.argmax(np.abs(heights_m) / limits_m))
    value_m, limit_m = float(abs(heights_m[worst])), float(limits_m[worst])
    what = "the lines and the asphalt between them, without what is beyond, differ in height of a line"
    return Reading(what, 1e3 * value_m, 1e3 * limit_m, "mm", value_m <= limit_m)


def witness(evidence: Evidence) -> Reading | None:
    """Read whether the asphalt can confirm the lines, where that is required."""
    if evidence.witness is None:
        return None
    what = "texture and evenness of the asphalt over what makes it a witness"
    return Reading(what, evidence.witness, 1.0, "", evidence.witness >= 1.0)


def rectified(evidence: Evidence) -> Reading | None:
    """Read the vertical offset between the images."""
    if evidence.vertical is None:
        return None
    value = abs(evidence.vertical.offset_px)
    limit = max(_MAX_VERTICAL_PX, _SHAPE_SIGMAS * evidence.vertical.std_px)
    return Reading("vertical offset between the images", value, limit, "px", value <= limit)


def turned(evidence: Evidence) -> Reading | None:
    """Read the turn of one camera against the other."""
    if evidence.vertical is None:
        return None
    value = abs(evidence.vertical.roll_rad)
    limit = max(_MAX_TURN_RAD, _SHAPE_SIGMAS * evidence.vertical.roll_std_rad)
    what = "turn of one camera against the other about its axis"
    return Reading(what, math.degrees(value), math.degrees(limit), "deg", value <= limit)


def lines_below_plane(evidence: Evidence) -> Reading | None:
    """Read how deep another line lies below the plane."""
    if evidence.below is None or evidence.bends is None:  # what bends is said to bend
        return None
    depth, what = evidence.below, "another line lies below the plane of the lines, by"
    return Reading(what, 1e3 * depth.depth_m, 1e3 * depth.limit_m, "mm", not depth.surely_below)


def near_and_far(evidence: Evidence) -> Reading | None:
    """Read how near and far parts of the road differ, as planes."""
    profile = evidence.wide_profile
    if profile is None:
        return None
    limits = np.maximum(AGREEMENT[:2], _SURELY_SIGMAS * profile.std)
    change, limits = np.append(profile.change, 0.0), np.append(limits, 1.0)
    return _difference("the road 5 to 20 m ahead and the plane of the lines differ", change, limits)


def painted(evidence: Evidence) -> Reading | None:
    """Read what lies between the stripes and the lane."""
    if not evidence.rims:
        return None
    beside, within = "between a stripe and the lane", "within a stripe"
    steps = []
    for rim in evidence.rims:
        # Where the edges do not show whether they are level, the strip beside has to be bare.
        most = LEFT_OF_EDGES if math.isnan(rim.lower.height_m) else _MAX_RIM
        steps.append((rim.step, rim.step_std, most, beside))
        level = rim.lower.surely_lower_than(MAX_LINE_HEIGHT_M)  # a shadow, or one of two lines, may end in it
        tone, most = (rim.own_tone, _MAX_OWN_TONE) if level else (rim.tone, _MAX_RIM)
        steps.append((tone, rim.tone_std, most, within))
    steps += [(rim.face, rim.face_std, _MAX_FACE, beside) for rim in evidence.rims if math.isfinite(rim.face)]
    limits = [(abs(step), max(most, _SURELY_SIGMAS * std), where) for step, std, most, where in steps]
    step, limit, where = max(limits, key=lambda each: each[0] / each[1])
    return Reading(f"step of grey {where}, over the contrast of the stripe", step, limit, "", step <= limit)


def level_stripes(evidence: Evidence) -> Reading | None:
    """Read how low the edges of the stripes towards the lane lie below their others."""
    faces = [rim.lower for rim in evidence.rims if math.isfinite(rim.lower.height_m)]
    if not faces:
        return None
    limits = [(abs(face.height_m), max(MAX_LINE_HEIGHT_M, _SURELY_SIGMAS * face.std_m)) for face in faces]
    value_m, limit_m = max(limits, key=lambda each: each[0] / each[1])
    what = "one edge of a stripe lies lower than the other, by"
    return Reading(what, 1e3 * value_m, 1e3 * limit_m, "mm", value_m <= limit_m)


def fitted(evidence: Evidence) -> Reading | None:
    """Read whether the stripes' grey values could be fitted."""
    if evidence.fitted is None:
        return None
    n = 2 if evidence.fitted else 0
    return Reading("lines that show both edges of a painted stripe in enough rows", n, 2, "", evidence.fitted)


def coplanar(evidence: Evidence) -> Reading | None:
    """Read how far a line between the boundaries lies beside their plane."""
    if evidence.between_m is None:
        return None
    height_m, std_m = evidence.between_m
    limit_m = max(MAX_LINE_HEIGHT_M, _SURELY_SIGMAS * std_m)
    what = "a line between the two lies beside their plane, by"
    return Reading(what, 1e3 * abs(height_m), 1e3 * limit_m, "mm", abs(height_m) <= limit_m)
