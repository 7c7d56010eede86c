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
from ..estimators.lane_profile import profile_lane
from ..estimators.lane_sweep import LaneSweep, lane_samples, sweep_lane
from ..estimators.sampling import ImageBlurs
from ..estimators.texture_alignment import align_texture
from ..estimators.texture_fit import TextureFit
from ..geometry.plane import PlaneCamera, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm
from ..lanes.extra_lines import inner_line_height
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import HeightOverLane, lane_in_road
from ..rejection import GateReading, NotFitted, Rejection, fitted
from ..reservations import ReservationKind
from ..road.cell_grid import CELL_WIDTH_M
from ..road.priors import KERB_DOUBT_STD_M
from ..tolerances import EXCLUDED_SIGMAS, MAX_LINE_HEIGHT_M, WRONG
from .camera_turn import CameraTurn
from .cue_fusion import combine, difference_covariance
from .estimate import Estimate, StagePoses
from .frame_evidence import Contradictor, Evidence, FrameObservations, Hypothesis
from .gates import evaluate_gates, undetermined
from .horizon import horizon_offset
from .lane_heights import heights_over_strip, heights_over_surface, surely_no_kerb
from .nuisances import (
    crown_covariance,
    kerb_covariance,
    road_shape_terms,
    unseen_slope_covariance,
)
from .rig_unknowns import RigResponse, response_of_surface, rig_terms
from .row_offset import vertical_offset
from .stripe_border import measure_borders

# Beyond its lines, the road continues as a shoulder or another lane. The surface the lines are compared with
# is one cell wider on either side, so that the lines lie inside of it and not at its border.
_MARGIN_M = CELL_WIDTH_M
# Where a line is a kerb, the surface beyond it is not the road, and most of the texture may lie there. So the
# texture between the lines is aligned alone as well. That surface begins this far inside of either line: a
# kerb's face of 15 cm with a margin (`core.evidence.stripe_border`), and half a stripe.
_INSET_M = 0.3
_INSUFFICIENT = 0.99  # of a check that lacks a part


@dataclass(frozen=True, slots=True, eq=False)
class JudgedEstimate:
    """An estimate, with the evidence for it and the readings of the gates.

    Attributes:
        estimate: The estimate, with what the checks so far leave unknown.
        poses: Pose by every stage that ran.
        evidence: Results of the stages so far.
        readings: Readings of the gates so far.
        line_response: What the unknowns of the rig do to the estimate.
        rejection: Refusal by a gate; None where every gate was passed.
    """

    estimate: Estimate
    poses: StagePoses
    evidence: Evidence
    readings: tuple[GateReading, ...]
    line_response: RigResponse
    rejection: Rejection | None = None

    def judged(self) -> JudgedEstimate:
        """Return the same after the gates that can be read now."""
        readings, rejection = evaluate_gates(self.evidence, already=self.readings)
        return replace(self, readings=readings, rejection=rejection)


def cross_check_surface(
    lines: JudgedEstimate,
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
) -> JudgedEstimate:
    """Check whether the lines lie in the road surface; where its texture is too weak, check the lines alone.

    Args:
        lines: An estimate from lines.
        hypothesis: Which lines were found, and how; with the alignment of the surface they were found on.
        pattern: These lines.
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.

    Returns:
        Lines and texture combined; or a refusal; or the estimate with a reservation where the texture is not
        asked or is too weak.
    """
    estimate, evidence, config = lines.estimate, lines.evidence, lines.evidence.config
    if not config.texture.check:
        off = estimate.with_reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "texture.check is 0")
        return _cross_check_lines_only(replace(lines, estimate=off), hypothesis, pattern, frame, rig)
    lane_heights: tuple[HeightOverLane, ...] = ()
    fit, sufficiency = hypothesis.texture, 1.0
    if fit is None:
        fit, lane_heights, sufficiency = _align_between(lines, pattern, frame, rig)
    # The unevenness of the road counts for the lines even where the texture is too weak to check them.
    if fit is not None:
        estimate = estimate.with_terms(*road_shape_terms(pattern, rig, estimate.pose, fit.unevenness))
        evidence = replace(evidence, lane_heights=lane_heights)
    common = fit is not None and fit.common_texture
    # Whatever shows the road well enough may contradict, also where it is too weak for an estimate.
    evidence = replace(
        evidence,
        texture=fit if common else None,
        contradictors=tuple(
            _contradictor(estimate, each, lines, frame, rig)
            for each in (fit if common else None, None if frame.surface is None else frame.surface.seen)
            if each is not None
        ),
    )
    lines = replace(lines, estimate=estimate, evidence=evidence)
    if fit is not None and common and sufficiency >= 1.0:
        return _cross_check_on_surface(lines, pattern, fit, frame, rig, hypothesis.texture)
    if config.texture.required:
        evidence = replace(evidence, texture_sufficiency=sufficiency)
    lacking = "too little texture between the lines"
    estimate = estimate.with_reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, lacking)
    lines = replace(lines, estimate=estimate, evidence=evidence)
    return _cross_check_lines_only(lines, hypothesis, pattern, frame, rig)


def _contradictor(
    estimate: Estimate, fit: TextureFit, lines: JudgedEstimate, frame: FrameObservations, rig: StereoRig
) -> Contradictor:
    """Return the pose over a surface, with the uncertainty of its difference from that of the lines."""
    of_surface = response_of_surface(rig, fit.extrinsics, frame.rig_std)
    return Contradictor(fit.extrinsics, difference_covariance(estimate, fit, lines.line_response, of_surface))


def _align_between(
    lines: JudgedEstimate, pattern: LanePattern, frame: FrameObservations, rig: StereoRig
) -> tuple[TextureFit | None, tuple[HeightOverLane, ...], float]:
    """Align the texture beside and between lines that were found without it.

    Returns:
        The alignment, None without one; the heights of the lines over the surface between them; and the
        texture over what a check of the lines needs, 1 or more where it is sufficient.
    """
    pose, yaw = lines.estimate.pose, lines.estimate.lane_yaw_rad or 0.0
    bare = None if frame.surface is None else frame.surface.bare_at(pose)
    if bare is not None:
        return bare, (), min(bare.sufficiency, _INSUFFICIENT)
    _, left_m, right_m = lane_in_road(pattern.boundaries, rig, pose)
    wide_m = (float(right_m) - _MARGIN_M, float(left_m) + _MARGIN_M)
    within_m = (float(right_m) + _INSET_M, float(left_m) - _INSET_M)
    blurs = ImageBlurs(frame.images)
    wide, between = (
        fitted(align_texture(frame.images, rig, pose, yaw, limits_m=limits_m, blurs=blurs))
        for limits_m in (wide_m, within_m)
    )
    heights = _heights_over_lane(pattern, rig, pose, between)
    fit = wide if wide is not None and wide.common_texture else between
    sufficiency = 0.0
    if fit is not None:
        no_kerb = surely_no_kerb(heights) if heights else _INSUFFICIENT
        sufficiency = min(fit.sufficiency, no_kerb)
    # A weaker texture between the lines may be aligned by chance.
    sure = between is not None and between.enough_texture
    return fit or wide, heights if sure else (), sufficiency


def _cross_check_on_surface(
    lines: JudgedEstimate,
    pattern: LanePattern,
    fit: TextureFit,
    frame: FrameObservations,
    rig: StereoRig,
    searched: TextureFit | None,
) -> JudgedEstimate:
    """Check whether lines and road surface agree, and combine them.

    Args:
        lines: The estimate from lines.
        pattern: The lines.
        fit: The alignment of the road surface.
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.
        searched: The alignment on which the lines were looked for; None where they were found without one.
    """
    evidence, pose, yaw = lines.evidence, lines.estimate.pose, lines.estimate.lane_yaw_rad
    evidence = replace(
        evidence,
        surface_heights=heights_over_surface(pattern, rig, pose, fit),
        rows=remaining_turn(frame, rig, fit.extrinsics, yaw),
    )
    if searched is not None:
        evidence = with_strip(evidence, searched, frame, rig)
        excluded = bool(evidence.kerb_heights) and surely_no_kerb(evidence.kerb_heights) >= 1.0
        if not excluded and evidence.refined is not None:
            # The road under the car leaves room for a kerb. So the lines have to look like paint.
            borders = measure_borders(frame.images, pattern, evidence.refined, rig)
            evidence = replace(evidence, kerb_heights=(), borders=borders)
    poses = replace(lines.poses, textured=fit.extrinsics)
    checked = replace(lines, poses=poses, evidence=evidence).judged()
    if checked.rejection is not None:
        return checked
    of_surface = response_of_surface(rig, fit.extrinsics, frame.rig_std)
    combined = combine(lines.estimate, fit, lines.line_response, of_surface)
    if isinstance(combined, NotFitted):
        return replace(checked, rejection=undetermined(combined))
    evidence = replace(evidence, std=np.sqrt(np.diag(combined.covariance)))
    poses = replace(poses, combined=combined.pose)
    return replace(checked, estimate=combined, poses=poses, evidence=evidence).judged()


def remaining_turn(
    frame: FrameObservations, rig: StereoRig, pose: Extrinsics, yaw_rad: float | None
) -> CameraTurn | None:
    """Return pitch and roll of the right camera by the rows of the road, else of the horizon.

    Args:
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.
        pose: Pose over the road.
        yaw_rad: Yaw of the camera against the lane, None without a line.

    Returns:
        The turn; None where rows were compared before the pose was known, or cannot be.
    """
    if frame.turn.corrected:
        return None
    on_road = fitted(vertical_offset(frame.images, rig, pose, yaw_rad or 0.0))
    offset = on_road or fitted(horizon_offset(frame.images, rig, pose))
    return None if offset is None else CameraTurn.of_offset(offset, rig)


def with_strip(evidence: Evidence, texture: TextureFit, frame: FrameObservations, rig: StereoRig) -> Evidence:
    """Return evidence with that of the strip under the car alone, which was aligned apart.

    Args:
        evidence: Results of the stages so far.
        texture: Alignment of the whole road surface.
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.
    """
    strip = None if frame.surface is None else fitted(frame.surface.strip)
    if strip is None:
        return evidence
    heights = heights_over_strip(texture.extrinsics, strip, rig)
    return replace(evidence, own_strip=strip, kerb_heights=heights)


def _cross_check_lines_only(
    lines: JudgedEstimate,
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
) -> JudgedEstimate:
    """Check an estimate that rests on the lines alone: borders and edges of stripes, other lines, horizon."""
    evidence = lines.evidence
    estimate = lines.estimate.with_terms(
        UncertaintyTerm("crown", crown_covariance(evidence.refined)), *rig_terms(lines.line_response)
    )
    if evidence.config.texture.check:
        evidence = replace(evidence, sweeps=_sweep_between(estimate, pattern, frame, rig))
    if evidence.refined is not None and evidence.profile is not None:
        if not evidence.profile.sees_ahead:  # also where it is bent
            estimate = estimate.with_reservation(ReservationKind.SLOPE_AHEAD_UNKNOWN)
        borders = measure_borders(frame.images, pattern, evidence.refined, rig)
        evidence = replace(evidence, borders=borders)
        certain = {border.line for border in borders if not border.doubtful}
        doubtful = [line for line in range(2) if line not in certain]
        # What lies between the lines may exclude all kerbs but those too low for a wrong result.
        low = any(
            sweep.confirming_sigmas(estimate.pose, WRONG) >= EXCLUDED_SIGMAS for sweep in evidence.sweeps
        )
        kerb_std_m = MAX_LINE_HEIGHT_M if low else KERB_DOUBT_STD_M
        estimate = estimate.with_terms(
            UncertaintyTerm("slope_unseen", unseen_slope_covariance(evidence.profile)),
            UncertaintyTerm("kerb", kerb_covariance(pattern, rig, estimate.pose, doubtful, kerb_std_m)),
        )
        if doubtful:
            estimate = estimate.with_reservation(ReservationKind.KERB_NOT_EXCLUDED)
    fitted_to_grey = evidence.config.refinement.stripes
    evidence = replace(
        evidence,
        stripes_fitted=evidence.refined is not None if fitted_to_grey else None,
        std=np.sqrt(np.diag(estimate.covariance)),
        coarse=None if frame.surface is None else frame.surface.clear_plane,
    )
    plane = plane_from_pose(estimate.pose, rig)
    between = inner_line_height(pattern, plane, hypothesis.other_lines, frame.points, rig, evidence.config)
    evidence = replace(
        evidence,
        inner_line_height=between,
        rows=remaining_turn(frame, rig, estimate.pose, estimate.lane_yaw_rad),
    )
    return replace(lines, estimate=estimate, evidence=evidence).judged()


def _sweep_between(
    estimate: Estimate, pattern: LanePattern, frame: FrameObservations, rig: StereoRig
) -> tuple[LaneSweep, ...]:
    """Return under which planes the faintest texture and the tracks between the lines agree."""
    yaw, left_m, right_m = lane_in_road(pattern.boundaries, rig, estimate.pose)
    within_m = (float(right_m) + _INSET_M, float(left_m) - _INSET_M)
    plane = plane_from_pose(estimate.pose, rig, PlaneCamera.LEFT)
    samples = lane_samples(rig, plane, float(yaw), within_m)
    sweeps = (
        fitted(of_lane(frame.images, rig, estimate.pose, float(yaw), within_m, samples))
        for of_lane in (sweep_lane, profile_lane)
    )
    return tuple(sweep for sweep in sweeps if sweep is not None)


def _heights_over_lane(
    pattern: LanePattern, rig: StereoRig, line_pose: Extrinsics, between: TextureFit | None
) -> tuple[HeightOverLane, ...]:
    """Return the heights of both boundaries over the surface between them; () where it is not seen."""
    if between is None or not between.common_texture:
        return ()
    return heights_over_surface(pattern.boundaries, rig, line_pose, between)
