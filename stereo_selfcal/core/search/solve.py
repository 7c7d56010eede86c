"""All stages for one hypothesis: from its lines, or from the road surface alone, to an attempt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.fitness import PatternFitness
from ..estimators.line_covariance import LineFit, measure_bends, propagate
from ..estimators.stripe_fit import StripeFit, refine
from ..estimators.texture_alignment import TextureFit, align_texture
from ..evidence.cross_checks import JudgedEstimate, cross_check_texture
from ..evidence.cue_fusion import too_uncertain
from ..evidence.estimate import Estimate, StagePoses
from ..evidence.frame_evidence import Evidence, FrameObservations, Hypothesis
from ..evidence.gates import evaluate_gates
from ..evidence.lane_heights import surely_same
from ..evidence.nuisances import (
    rig_terms,
    seen_slope_covariance,
    stage_disagreement_covariance,
    unseen_slope_covariance,
)
from ..evidence.profile import measure_profile, profile_from_texture
from ..evidence.row_offset import vertical_offset
from ..geometry.homography import SIDES
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms
from ..lanes.closed_form import contradictions, solve_plane
from ..lanes.lane_pair import LanePattern
from ..numerics.genetic import GeneticResult, maximise_each
from ..rejection import GateReading, NotFitted, Rejection, fitted
from ..reservations import Reservation, ReservationKind
from ..tolerances import KERB_SIGMAS
from .attempt import Attempt, Verdict
from .texture_guided_lines import line_on_road

# Part of the road surface that surely belongs to the own lane, left and right of the camera [m]: a lane of
# 2.5 m extends a quarter of a metre farther.
_OWN_LANE_M = (-1.0, 1.0)


def solve(
    hypothesis: Hypothesis, frame: FrameObservations, rig: StereoRig, config: CalibratorConfig
) -> Attempt:
    """Estimate the pose under a hypothesis, and evaluate the gates after each stage.

    Args:
        hypothesis: Which lines were found, and how.
        frame: Images and stripe points.
        rig: Intrinsics and baseline.
        config: Settings.

    Raises:
        ValueError: The hypothesis has neither a pair of lines nor the texture of the road surface.
    """
    if hypothesis.pattern is not None:
        return _solve_lines(hypothesis, hypothesis.pattern, frame, rig, config)
    if hypothesis.locating_texture is None:
        raise ValueError("a hypothesis needs a pair of lines or the texture of the road surface")
    return _solve_surface(hypothesis, hypothesis.locating_texture, frame, rig, config)


def _solve_lines(
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> Attempt:
    """Search for the pose, refine it on the images, and cross-check it."""
    fitness = PatternFitness(pattern, rig, config.fitness)
    genetic = _search(fitness, config)
    pose = Extrinsics.from_array(genetic.best)
    misfit_px = float(np.sqrt(np.max(fitness.errors(genetic.best[None]))))
    poses = StagePoses(genetic=pose)
    evidence = Evidence(config, pose, genetic.fitness, misfit_px, hypothesis.below)
    readings, refusal = evaluate_gates(evidence)
    if refusal:
        return _refused(hypothesis, refusal, readings, poses, genetic)
    fit = propagate(pattern, rig, pose, config.fitness)
    bends = measure_bends(pattern, rig, pose.height_m)
    evidence = replace(evidence, bends=bends, lines=fitted(fit))
    readings, refusal = evaluate_gates(evidence, already=readings)
    if refusal:
        return _refused(hypothesis, refusal, readings, poses, genetic)
    assert not isinstance(fit, NotFitted)  # the gate "determined" refuses where there is no fit
    closed = solve_plane(pattern, rig)
    if isinstance(closed, NotFitted):
        reservations: tuple[Reservation, ...] = (Reservation(ReservationKind.NO_CLOSED_FORM, closed.reason),)
    else:
        poses = replace(poses, closed_form=closed.extrinsics)
        reservations = contradictions(closed, pose, fit.covariance)
    stripe_fit = refine(frame.images, pattern, rig, pose)
    refined = fitted(stripe_fit)
    if isinstance(stripe_fit, NotFitted):
        reservations = (*reservations, Reservation(ReservationKind.NOT_REFINED, stripe_fit.reason))
    else:
        poses = replace(poses, refined=stripe_fit.extrinsics)
        evidence = replace(
            evidence,
            profile=measure_profile(stripe_fit.residuals, rig, stripe_fit.extrinsics),
            wide_profile=measure_profile(stripe_fit.residuals, rig, stripe_fit.extrinsics, wide=True),
        )
    evidence = replace(evidence, refined=refined, clipped=frame.clipped)
    readings, refusal = evaluate_gates(evidence, already=readings)
    if refusal:
        return _refused(hypothesis, refusal, readings, poses, genetic)
    estimate = _estimate(pose, fit, refined, evidence, reservations)
    lines = JudgedEstimate(estimate, poses, evidence, readings)
    checked = cross_check_texture(lines, hypothesis, pattern, frame, rig)
    if checked.rejection is not None:
        return _refused(hypothesis, checked.rejection, checked.readings, checked.poses, genetic)
    confirmed = checked.poses.textured is not None or not hypothesis.needs_texture
    return Attempt(
        hypothesis,
        Verdict.ACCEPTED if confirmed else Verdict.UNCONFIRMED,
        ""
        if confirmed
        else f"lines that were not the first choice need the texture; {_unchecked(checked.estimate)}",
        poses=checked.poses,
        readings=checked.readings,
        estimate=checked.estimate,
        lane_curvature_per_m=bends.lateral_per_m,
        genetic=genetic,
    )


def _unchecked(estimate: Estimate) -> str:
    """Return why an estimate was not checked against the texture."""
    kind = ReservationKind.NOT_CHECKED_BY_TEXTURE
    return next(each.sentence for each in estimate.reservations if each.kind is kind)


def _estimate(
    genetic: Extrinsics,
    line_fit: LineFit,
    refined: StripeFit | None,
    evidence: Evidence,
    reservations: tuple[Reservation, ...],
) -> Estimate:
    """Return the estimate from lines, by the fit of the stripes' grey values where there is one."""
    terms = line_fit.terms if refined is None else (UncertaintyTerm("noise", refined.covariance),)
    more = (
        UncertaintyTerm("slope_seen", seen_slope_covariance(evidence.profile)),
        UncertaintyTerm(
            "stage_disagreement", stage_disagreement_covariance(genetic, line_fit.covariance, refined)
        ),
    )
    return Estimate(
        genetic if refined is None else refined.extrinsics,
        merge_terms((*terms, *more)),
        line_fit.lane_yaw_rad if refined is None else refined.lane_yaw_rad,
        reservations,
    )


def _solve_surface(
    hypothesis: Hypothesis,
    texture: TextureFit,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> Attempt:
    """Take the pose over the road surface, where a line that both cameras see lies in it."""
    poses = StagePoses(textured=texture.extrinsics)

    def not_fitted(message: str) -> Attempt:
        return Attempt(hypothesis, Verdict.NOT_FITTED, message, poses=poses)

    profile = profile_from_texture(texture)
    terms = merge_terms(
        (
            *texture.terms,
            *rig_terms(rig, texture.extrinsics),
            UncertaintyTerm("slope_seen", seen_slope_covariance(profile)),
            UncertaintyTerm("slope_unseen", unseen_slope_covariance(profile)),
        )
    )
    estimate = Estimate(texture.extrinsics, terms, 0.0, (Reservation(ReservationKind.ONE_LINE_ONLY),))
    uncertain = too_uncertain(estimate.covariance)
    if uncertain is not None:
        return not_fitted(f"the road surface alone leaves {uncertain.reason}")
    found = line_on_road(
        texture.extrinsics, list(hypothesis.single_lines), frame.points, frame.images, rig, config
    )
    if found is None:
        return not_fitted("0 lines that both cameras see lie in the road surface, at least 1 needed")
    _, yaw = found
    doubt = _doubt_of_surface(texture.extrinsics, yaw, frame, rig)
    if doubt:
        return not_fitted(doubt)
    vertical = vertical_offset(frame.images, rig, texture.extrinsics, yaw)
    if isinstance(vertical, NotFitted):  # the rows may be those of a camera that has turned
        return not_fitted(f"the rows of both images are not compared; {vertical.reason}")
    readings, refusal = evaluate_gates(Evidence(config, texture=texture, vertical=vertical))
    if refusal:
        return _refused(hypothesis, refusal, readings, poses)
    return Attempt(
        hypothesis,
        Verdict.ACCEPTED,
        poses=poses,
        readings=readings,
        estimate=replace(estimate, lane_yaw_rad=yaw),
    )


def _doubt_of_surface(pose: Extrinsics, yaw: float, frame: FrameObservations, rig: StereoRig) -> str:
    """Return why the plane of the road surface may be that of a pavement; "" where that is excluded.

    A pavement beside the lane is not the road, and its texture may have determined the plane. So the surface
    of the own lane is aligned alone, as a check.
    """
    own_lane = align_texture(frame.images, rig, pose, yaw, limits_m=_OWN_LANE_M)
    if isinstance(own_lane, NotFitted):
        return f"the road surface of the own lane alone is not aligned; {own_lane.reason}"
    if not surely_same(pose, own_lane, rig):
        return (
            "the road surface of the own lane does not exclude a kerb beside it, "
            f"at least {KERB_SIGMAS:g} standard deviations needed"
        )
    return ""


def _refused(
    hypothesis: Hypothesis,
    rejection: Rejection,
    readings: tuple[GateReading, ...],
    poses: StagePoses,
    genetic: GeneticResult | None = None,
) -> Attempt:
    return Attempt(
        hypothesis, Verdict.REFUSED, rejection.message, rejection, poses, readings, genetic=genetic
    )


def _search(fitness: PatternFitness, config: CalibratorConfig) -> GeneticResult:
    """Run the genetic algorithm over the whole search box, once with the parallelism term of each camera."""
    lower, upper = config.search.bounds()
    runs = maximise_each(
        fitness.fitness_in_each_camera,
        lower=lower,
        upper=upper,
        config=config.genetic,
        rng=np.random.default_rng(config.seed),
        n_runs=len(SIDES),
    )
    best = max(runs, key=lambda run: run.fitness)
    return replace(best, evaluations=sum(run.evaluations for run in runs))
