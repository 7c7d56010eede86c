"""Independent checks of an estimate from two lines, by other evidence in the images.

Residuals and covariance do not show gross errors: a kerb is as straight as a line, and a camera that has
turned fits as well as another height. As an independent check, the texture of the road surface between the
lines is matched in both images. Where that texture is too weak, the checks that need lines alone take its
place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.texture_alignment import TextureFit, align_texture
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm
from ..lanes.extra_lines import inner_line_height
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import HeightOverLane, lane_in_road
from ..rejection import GateReading, Rejection, fitted
from ..reservations import ReservationKind
from ..road.cell_grid import CELL_WIDTH_M
from .cue_fusion import combine
from .estimate import Estimate, StagePoses
from .frame_evidence import Evidence, FrameObservations, Hypothesis
from .gates import evaluate_gates
from .horizon import horizon_offset
from .lane_heights import heights_over_surface, surely_no_kerb
from .nuisances import (
    crown_covariance,
    kerb_covariance,
    paint_angle_covariance,
    rig_terms,
    road_shape_terms,
    seen_slope_covariance,
    slope_ahead_unknown,
    unseen_slope_covariance,
)
from .profile import profile_from_texture
from .row_offset import vertical_offset
from .stripe_border import measure_borders

# Beyond its lines, the road continues as a shoulder or another lane. The surface the lines are compared with
# is one cell wider on either side, so that the lines lie inside of it and not at its border.
_MARGIN_M = CELL_WIDTH_M
# Where a line is a kerb, the surface beyond it is not the road, and most of the texture may lie there. So the
# texture between the lines is aligned alone as well. That surface begins this far inside of either line: a
# kerb's face of 15 cm with a margin (`core.evidence.stripe_border`), and half a stripe.
_INSET_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class JudgedEstimate:
    """An estimate, with the evidence for it and the readings of the gates.

    Attributes:
        estimate: The estimate, with what the checks so far leave unknown.
        poses: Pose by every stage that ran.
        evidence: Results of the stages so far.
        readings: Readings of the gates so far.
        rejection: Refusal by a gate; None where every gate was passed.
    """

    estimate: Estimate
    poses: StagePoses
    evidence: Evidence
    readings: tuple[GateReading, ...]
    rejection: Rejection | None = None

    def judged(self) -> JudgedEstimate:
        """Return the same after the gates that can be read now."""
        readings, rejection = evaluate_gates(self.evidence, already=self.readings)
        return replace(self, readings=readings, rejection=rejection)


def cross_check_texture(
    lines: JudgedEstimate,
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
) -> JudgedEstimate:
    """Check whether the lines lie in the road surface; where its texture is too weak, check the lines alone.

    Where the alignment between the lines is too weak, the alignment by which the lines were found is used.

    Args:
        lines: An estimate from lines.
        hypothesis: Which lines were found, and how.
        pattern: These lines.
        frame: Images and stripe points.
        rig: Intrinsics and baseline.

    Returns:
        Lines and texture combined; or a refusal; or the estimate with a reservation where the texture is not
        asked or is too weak.
    """
    estimate, evidence, config = lines.estimate, lines.evidence, lines.evidence.config
    if not config.texture.check:
        off = estimate.with_reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "texture.check is 0")
        lines = replace(lines, estimate=off)
        return _cross_check_lines_only(lines, hypothesis, pattern, frame, rig)
    _, left_m, right_m = lane_in_road(pattern.boundaries, rig, estimate.pose)
    limits_m = (float(right_m) - _MARGIN_M, float(left_m) + _MARGIN_M)
    line_pose, yaw = estimate.pose, estimate.lane_yaw_rad
    fit = fitted(align_texture(frame.images, rig, line_pose, yaw, limits_m=limits_m))
    if hypothesis.locating_texture is not None and (fit is None or fit.sufficiency < 1.0):
        fit = hypothesis.locating_texture
    # The unevenness of the road counts for the lines even where the texture is too weak to check them.
    if fit is not None:
        paint = paint_angle_covariance(pattern, rig, line_pose, fit.unevenness)
        shape = road_shape_terms(pattern, rig, line_pose, fit.unevenness)
        estimate = estimate.with_terms(*shape, UncertaintyTerm("paint_angle", paint))
    lacking = ""
    if fit is None or not fit.enough_texture or not fit.comparable:
        lacking = "too uneven" if fit is not None and fit.enough_texture else "too little texture"
        sufficiency = 0.0 if fit is None else fit.sufficiency
    else:
        within_m = (float(right_m) + _INSET_M, float(left_m) - _INSET_M)
        between = fitted(align_texture(frame.images, rig, line_pose, yaw, limits_m=within_m))
        lane_heights = _heights_over_lane(pattern, rig, line_pose, between)
        sufficiency = surely_no_kerb(lane_heights) if lane_heights else 0.0
        if between is not None and between.enough_texture:  # a weaker one may be aligned by chance
            evidence = replace(evidence, lane_heights=lane_heights)
        if sufficiency < 1.0:
            lacking = "too little texture between the lines"
    if fit is None or lacking:
        if config.texture.required:
            evidence = replace(evidence, texture_sufficiency=sufficiency)
        estimate = estimate.with_reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, lacking)
        lines = replace(lines, estimate=estimate, evidence=evidence)
        return _cross_check_lines_only(lines, hypothesis, pattern, frame, rig)
    evidence = replace(
        evidence,
        texture=fit,
        surface_heights=heights_over_surface(pattern, rig, line_pose, fit),
        vertical=fitted(vertical_offset(frame.images, rig, fit.extrinsics, yaw, limits_m=limits_m))
        or fitted(horizon_offset(frame.images, rig, fit.extrinsics)),
    )
    poses = replace(lines.poses, textured=fit.extrinsics)
    checked = replace(lines, estimate=estimate, poses=poses, evidence=evidence).judged()
    if checked.rejection is not None:
        return checked
    combined = combine(estimate, fit)
    profiles = (evidence.profile, profile_from_texture(fit))
    combined = combined.with_terms(
        *rig_terms(rig, combined.pose),
        UncertaintyTerm("slope_seen", seen_slope_covariance(*profiles)),
        UncertaintyTerm("slope_unseen", unseen_slope_covariance(*profiles)),
    )
    if slope_ahead_unknown(*profiles):
        combined = combined.with_reservation(ReservationKind.SLOPE_AHEAD_UNKNOWN)
    return replace(checked, estimate=combined, poses=replace(poses, combined=combined.pose))


def _cross_check_lines_only(
    lines: JudgedEstimate,
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
) -> JudgedEstimate:
    """Check an estimate that rests on the lines alone: borders and edges of stripes, other lines, horizon."""
    evidence = lines.evidence
    estimate = lines.estimate.with_terms(UncertaintyTerm("crown", crown_covariance(evidence.refined)))
    if evidence.refined is not None and evidence.profile is not None:
        if slope_ahead_unknown(evidence.profile):  # also where it is bent
            estimate = estimate.with_reservation(ReservationKind.SLOPE_AHEAD_UNKNOWN)
        borders = measure_borders(frame.images, pattern, evidence.refined, rig)
        evidence = replace(evidence, borders=borders)
        certain = {border.line for border in borders if not border.doubtful}
        doubtful = [line for line in range(2) if line not in certain]
        estimate = estimate.with_terms(
            UncertaintyTerm("slope_unseen", unseen_slope_covariance(evidence.profile)),
            UncertaintyTerm("kerb", kerb_covariance(pattern, rig, estimate.pose, doubtful)),
        )
        if doubtful:
            estimate = estimate.with_reservation(ReservationKind.KERB_NOT_EXCLUDED)
    std = np.sqrt(np.diag(estimate.covariance))
    evidence = replace(evidence, stripes_fitted=evidence.refined is not None, std=std)
    if hypothesis.other_lines is not None:
        plane = plane_from_pose(estimate.pose, rig)
        between = inner_line_height(
            pattern, plane, hypothesis.other_lines, frame.points, rig, evidence.config
        )
        evidence = replace(evidence, inner_line_height=between)
    evidence = replace(evidence, vertical=fitted(horizon_offset(frame.images, rig, estimate.pose)))
    return replace(lines, estimate=estimate, evidence=evidence).judged()


def _heights_over_lane(
    pattern: LanePattern, rig: StereoRig, line_pose: Extrinsics, between: TextureFit | None
) -> tuple[HeightOverLane, ...]:
    """Return the heights of both boundaries over the surface between them; () where it is not seen."""
    if between is None or not between.common_texture:
        return ()
    return heights_over_surface(pattern.boundaries, rig, line_pose, between)
