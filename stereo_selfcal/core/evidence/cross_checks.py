"""What else the images say of an estimate from two lines: the asphalt, or what lines alone have beside them.

Residuals and covariance do not show the gross errors: a kerb is as straight as a line, and a turned camera
fits as well as another height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.texture_alignment import TextureFit, align_texture
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..lanes.extra_lines import height_between
from ..lanes.hypotheses import Points
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import lane_in_road
from ..lanes.matching import Matches
from ..results import CalibrationResult, rejected
from ..road.cell_grid import CELL_WIDTH_M
from ..types import Array, Image
from .cue_fusion import combine
from .frame_evidence import Evidence
from .gates import evaluate_gates
from .horizon import horizon_offset
from .lane_heights import heights_over_asphalt, surely_no_kerb
from .nuisances import (
    crown_covariance,
    kerb_covariance,
    paint_angle_covariance,
    rectification_covariance,
    road_shape_covariance,
    seen_slope_covariance,
    slope_ahead_unknown,
    unseen_slope_covariance,
)
from .profile import profile_of_asphalt
from .row_offset import vertical_offset
from .stripe_border import measure_borders

# The road goes on beyond its lines by a shoulder or another lane: a cell more on either side has the lines
# inside of the surface they are compared with, not on its rim.
_BESIDE_M = CELL_WIDTH_M
# What is beyond a line that is a kerb is no road, and may be all there is to see. So the asphalt between the
# lines is asked once more, alone: from where the lane begins beside a kerb's face of 15 cm
# (`core.evidence.stripe_border`), and half a stripe.
_WITHIN_M = 0.3
OTHER_SLOPE = "the road is not seen far enough to exclude another slope of it ahead"


@dataclass(frozen=True, slots=True, eq=False)
class FrameObservations:
    """What was found in a frame before its lines are fitted.

    Attributes:
        images: Left and right image, (H, W) uint8.
        points: Stripe points of both, None where they were not looked at for the lines.
        matches: Lines both cameras see.
        shown: The asphalt that has shown where the lines are, None where they were found without it.
    """

    images: tuple[Image, Image]
    points: Points | None = None
    matches: Matches = ([], [])
    shown: TextureFit | None = None


def cross_check_texture(
    result: CalibrationResult,
    evidence: Evidence,
    seen: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> CalibrationResult:
    """Ask the asphalt whether the lines lie in it, and where it does not know, all there is besides.

    Args:
        result: An accepted estimate from lines.
        evidence: What the stages have found.
        seen: The frame.
        rig: Intrinsics and baseline.
        config: Settings.

    Where between the lines it is no witness, the asphalt that has shown where they are still is one.

    Returns:
        Lines and asphalt combined; the estimate with a note, where the asphalt has no say; or a refusal.
    """
    pattern, lines, of_lines = result.pattern, result.extrinsics, result.covariance
    if pattern is None or lines is None or of_lines is None:
        raise ValueError("only an accepted result can be compared with the road")
    if not config.texture.check:
        return cross_check_lines_only(result, evidence, seen, rig, config)
    _, left_m, right_m = lane_in_road(pattern.boundaries, rig, lines)
    limits_m = (float(right_m) - _BESIDE_M, float(left_m) + _BESIDE_M)
    yaw = result.lane_yaw_rad or 0.0
    fit = align_texture(seen.images, rig, lines, yaw, limits_m=limits_m)
    if seen.shown is not None and (fit is None or fit.sufficiency < 1.0):
        fit = seen.shown
    if fit is not None:  # a road that is no plane is so for the lines, be it a witness or not
        known_road = (pattern, rig, lines, fit.shape)
        of_lines = of_lines + road_shape_covariance(*known_road) + paint_angle_covariance(*known_road)
    result = replace(result, covariance=of_lines)
    lacking = ""
    if fit is None or not fit.enough_texture or not fit.even_enough:
        lacking = "too uneven" if fit is not None and fit.enough_texture else "too little texture"
        sufficiency = 0.0 if fit is None else fit.sufficiency
    else:
        within_m = (float(right_m) + _WITHIN_M, float(left_m) - _WITHIN_M)
        between = align_texture(seen.images, rig, lines, yaw, limits_m=within_m)
        own_m = _heights_over_own(pattern, rig, lines, between)
        sufficiency = 0.0 if own_m is None else surely_no_kerb(*own_m)
        if between is not None and between.enough_texture:  # less may be aligned by chance
            evidence = replace(evidence, own_m=own_m)
        if sufficiency < 1.0:
            lacking = "too little texture between the lines"
    if fit is None or lacking:
        if config.texture.required:
            evidence = replace(evidence, witness=sufficiency)
        notes = (*result.notes, f"not checked against the asphalt: {lacking}")
        return cross_check_lines_only(replace(result, notes=notes), evidence, seen, rig, config)
    evidence = replace(
        evidence,
        texture=fit,
        heights_m=heights_over_asphalt(pattern, rig, lines, fit)[0],
        vertical=vertical_offset(seen.images, rig, fit.extrinsics, yaw, limits_m=limits_m)
        or horizon_offset(seen.images, rig, fit.extrinsics),
    )
    result = _judged(replace(result, stages={**result.stages, "textured": fit.extrinsics}), evidence)
    if not result.accepted:
        return result
    extrinsics, covariance = combine(lines, of_lines, fit)
    covariance = covariance + rectification_covariance(rig, extrinsics)
    profiles = (evidence.profile, profile_of_asphalt(fit))
    covariance = covariance + seen_slope_covariance(*profiles) + unseen_slope_covariance(*profiles)
    if slope_ahead_unknown(*profiles):
        result = replace(result, notes=(*result.notes, OTHER_SLOPE))
    stages = {**result.stages, "combined": extrinsics}
    return replace(result, stages=stages, extrinsics=extrinsics, covariance=covariance)


def cross_check_lines_only(
    result: CalibrationResult,
    evidence: Evidence,
    seen: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> CalibrationResult:
    """Judge an estimate that rests on the lines alone by what else the images show."""
    pattern, extrinsics, covariance = result.pattern, result.extrinsics, result.covariance
    assert pattern is not None and extrinsics is not None and covariance is not None
    covariance = covariance + crown_covariance(evidence.refined)
    if evidence.refined is not None and evidence.profile is not None:
        of_sight = unseen_slope_covariance(evidence.profile)
        if slope_ahead_unknown(evidence.profile):  # also where it is seen to bend
            result = replace(result, notes=(*result.notes, OTHER_SLOPE))
        rims = measure_borders(seen.images, pattern, evidence.refined, rig)
        evidence = replace(evidence, rims=rims)
        certain = {rim.line for rim in rims if not rim.doubtful}
        doubtful = [line for line in range(2) if line not in certain]
        covariance = covariance + of_sight + kerb_covariance(pattern, rig, extrinsics, doubtful)
        if doubtful:
            kerb = "what lies beside a line may be, or hide, the face of a kerb"
            result = replace(result, notes=(*result.notes, kerb))
    result = replace(result, covariance=covariance)
    std = np.sqrt(np.diag(covariance))
    evidence = replace(evidence, fitted=evidence.refined is not None, std=std)
    if seen.points is not None:
        plane = plane_from_pose(extrinsics, rig)
        between = height_between(pattern, plane, seen.matches, seen.points, rig, config)
        evidence = replace(evidence, between_m=between)
    vertical = horizon_offset(seen.images, rig, extrinsics)
    return _judged(result, replace(evidence, vertical=vertical))


def _heights_over_own(
    pattern: LanePattern, rig: StereoRig, lines: Extrinsics, between: TextureFit | None
) -> tuple[Array, Array] | None:
    """Return how high the boundaries lie over the asphalt between them, and the standard deviations [m]."""
    if between is None or not between.seen:
        return None
    return heights_over_asphalt(pattern.boundaries, rig, lines, between)


def _judged(result: CalibrationResult, evidence: Evidence) -> CalibrationResult:
    """Return an accepted result with all gates read, or its refusal."""
    gates, refusal = evaluate_gates(evidence, already=result.gates)
    if refusal is None:
        return replace(result, gates=gates)
    known = {"pattern": result.pattern, "genetic": result.genetic, "stages": result.stages}
    return rejected(refusal, result.stamp_s, gates=gates, **known)
