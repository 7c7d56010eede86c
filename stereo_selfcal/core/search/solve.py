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

"""All stages for one hypothesis: from its lines, or from the road surface alone, to an attempt."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.fitness import PatternFitness
from ..estimators.fittest_nearby import fittest_nearby
from ..estimators.line_covariance import LineFit, measure_bends, propagate
from ..estimators.stripe_fit import StripeFit, refine
from ..estimators.texture_fit import TextureFit
from ..evidence.camera_turn import CameraTurn
from ..evidence.camera_yaw import YawTold, wrong_yaw_rad, yaw_of_lines
from ..evidence.cross_checks import JudgedEstimate, cross_check_surface, with_strip
from ..evidence.estimate import Estimate, StagePoses
from ..evidence.frame_evidence import Evidence, FoundBy, FrameObservations, Hypothesis
from ..evidence.gates import evaluate_gates, undetermined
from ..evidence.nuisances import (
    paint_angle_covariance,
    seen_slope_covariance,
    stage_disagreement_covariance,
)
from ..evidence.profile import measure_profile
from ..evidence.rig_unknowns import changes_of_lines, response_of_lines, response_of_surface, rig_terms
from ..evidence.road_surface import SurfaceCells
from ..evidence.row_offset import vertical_offset
from ..evidence.synchronisation import Lateness, measure_lateness, synchronisation_covariance
from ..geometry.homography import SIDES
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms
from ..lanes.closed_form import contradictions, solve_plane
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import lane_in_road
from ..numerics.genetic import GeneticResult, maximise_each
from ..numerics.linear import is_covariance, rank_of
from ..rejection import Bound, GateReading, NotFitted, Rejection, fitted
from ..reservations import Reservation, ReservationKind
from ..road.priors import STRIPES_PARALLEL_PART
from .attempt import Attempt, Verdict, coarse_pose
from .lines_on_road import lane_line, yaw_of_line

_SWITCHED_OFF = NotFitted("refinement.stripes", 0, Bound.LEAST, 1)


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
        return _sound(_solve_lines(hypothesis, hypothesis.pattern, frame, rig, config))
    texture = hypothesis.texture
    if texture is None:
        raise ValueError("a hypothesis needs a pair of lines or the texture of the road surface")
    attempt = _sound(_solve_surface(hypothesis, texture, frame, rig, config))
    line = lane_line(hypothesis.other_lines, texture.extrinsics, rig)
    return replace(attempt, surface=SurfaceCells.of(texture), lane_line=line)


def _sound(attempt: Attempt) -> Attempt:
    """Return the attempt; refused where its estimate is not finite, or has no positive definite covariance.

    Whatever its stages did: a result can be published, written and fused.
    """
    if attempt.estimate is None:
        return attempt
    values = np.array([*attempt.estimate.pose.as_array(), attempt.estimate.lane_yaw_rad or 0.0])
    n_finite, covariance = int(np.count_nonzero(np.isfinite(values))), attempt.estimate.covariance
    if n_finite < len(values):
        why = NotFitted("numbers of the pose that are finite", n_finite, Bound.LEAST, len(values))
    elif not is_covariance(covariance):
        rank = min(rank_of(covariance), len(covariance) - 1)
        why = NotFitted("numbers of the pose that are determined", rank, Bound.LEAST, len(covariance))
    else:
        return attempt
    return _refused(attempt.hypothesis, undetermined(why), attempt.readings, attempt.poses, attempt.genetic)


def _solve_lines(
    hypothesis: Hypothesis,
    pattern: LanePattern,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> Attempt:
    """Find the pose of the greatest fitness, refine it on the images, and cross-check it."""
    fitness = PatternFitness(pattern, rig, config.fitness)
    pose, greatest, genetic, poses = _fittest(hypothesis, pattern, fitness, frame, rig, config)
    misfit_px = float(np.sqrt(np.max(fitness.errors(pose.as_array()[None]))))
    evidence = Evidence(config, pose, greatest, misfit_px, hypothesis.below)
    readings, refusal = evaluate_gates(evidence)
    if refusal:
        return _refused(hypothesis, refusal, readings, poses, genetic)
    fit = propagate(
        pattern, rig, pose, config.fitness, changes_of_lines(pattern.boundaries, rig, frame.rig_std)
    )
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
    stripe_fit: StripeFit | NotFitted = _SWITCHED_OFF
    if config.refinement.stripes:
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
    best = pose if refined is None else refined.extrinsics
    late = measure_lateness(frame.images, rig, best, fit.lane_yaw_rad)
    evidence = replace(
        evidence,
        refined=refined,
        clipped=frame.clipped,
        lateness=late,
        most_way_m=math.inf if late is None else late.limit_m(best, rig),
    )
    readings, refusal = evaluate_gates(evidence, already=readings)
    if refusal:
        return replace(_refused(hypothesis, refusal, readings, poses, genetic), lateness=late)
    estimate = _estimate(pose, fit, refined, evidence, reservations).with_terms(
        UncertaintyTerm("paint_angle", paint_angle_covariance(pattern, rig, pose))
    )
    told = hypothesis.yaw_told or _yaw_of_pattern(pattern, rig, estimate.pose, fitted=refined is not None)
    frame = frame.with_yaw(told, rig)
    if hypothesis.texture is not None:
        wrong_rad = wrong_yaw_rad(rig, hypothesis.texture.extrinsics)
        evidence = replace(evidence, yaw=frame.yaw_left(rig), wrong_yaw_rad=wrong_rad)
    lines = JudgedEstimate(
        estimate, poses, evidence, readings, response_of_lines(fit, pattern, rig, frame.rig_std)
    )
    checked = cross_check_surface(lines, hypothesis, pattern, frame, rig)
    surface = SurfaceCells.of(checked.evidence.texture)
    if checked.rejection is not None:
        refused = _refused(hypothesis, checked.rejection, checked.readings, checked.poses, genetic)
        return replace(refused, surface=surface, lateness=late)
    return Attempt(
        hypothesis,
        Verdict.ACCEPTED,
        poses=checked.poses,
        readings=checked.readings,
        estimate=_with_lateness(checked.estimate, late, frame, rig),
        lane_curvature_per_m=bends.lateral_per_m,
        genetic=genetic,
        surface=surface,
        yaw_told=frame.yaw_told,
        lateness=late,
        stripes=refined,
        rows=checked.evidence.rows,
    )


def _yaw_of_pattern(
    pattern: LanePattern, rig: StereoRig, pose: Extrinsics, *, fitted: bool
) -> YawTold | None:
    """Return the yaw of the right camera that two lines tell; more surely where their stripes were fitted."""
    _, left_m, right_m = lane_in_road(pattern.boundaries, rig, pose)
    told = yaw_of_lines(pattern.left, pattern.right, abs(float(left_m - right_m)), rig)
    return replace(told, certainty=STRIPES_PARALLEL_PART) if told is not None and fitted else told


def _estimate(
    fittest: Extrinsics,
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
            "stage_disagreement", stage_disagreement_covariance(fittest, line_fit.covariance, refined)
        ),
    )
    return Estimate(
        fittest if refined is None else refined.extrinsics,
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
    """Take the pose over the road surface, without a pair of lines; a line on it tells the yaw."""
    poses = replace(coarse_pose(frame), textured=texture.extrinsics)
    yaw = yaw_of_line(hypothesis.other_lines, texture.extrinsics, rig)
    seen = Reservation(ReservationKind.NO_LINE_CONFIRMS if yaw is None else ReservationKind.ONE_LINE_ONLY)
    frame = frame.with_yaw(hypothesis.yaw_told, rig)
    of_rig = response_of_surface(rig, texture.extrinsics, frame.rig_std)
    terms = merge_terms((*texture.terms, *rig_terms(of_rig)))
    late = measure_lateness(frame.images, rig, texture.extrinsics, yaw)
    estimate = _with_lateness(Estimate(texture.extrinsics, terms, yaw, (seen,)), late, frame, rig)
    evidence = Evidence(
        config,
        texture=texture,
        std=np.sqrt(np.diag(estimate.covariance)),
        yaw=frame.yaw_left(rig),
        wrong_yaw_rad=wrong_yaw_rad(rig, texture.extrinsics),
        lateness=late,
        most_way_m=math.inf if late is None else late.limit_m(texture.extrinsics, rig),
    )
    evidence = with_strip(evidence, texture, frame, rig)
    readings, refusal = evaluate_gates(evidence)
    if refusal:
        return replace(_refused(hypothesis, refusal, readings, poses), lateness=late)
    accepted = Attempt(
        hypothesis,
        Verdict.ACCEPTED,
        poses=poses,
        readings=readings,
        estimate=estimate,
        yaw_told=frame.yaw_told,
        lateness=late,
    )
    if frame.turn.corrected:
        return accepted
    vertical = vertical_offset(frame.images, rig, texture.extrinsics, yaw or 0.0)
    if isinstance(vertical, NotFitted):  # the rows may be those of a camera that has turned
        message = f"the rows of both images are not compared; {vertical.reason}"
        given_up = Attempt(hypothesis, Verdict.NOT_FITTED, message, poses=poses, readings=readings)
        return replace(given_up, lateness=late)
    evidence = replace(evidence, rows=CameraTurn.of_offset(vertical, rig))
    readings, refusal = evaluate_gates(evidence, already=readings)
    if refusal:
        return replace(_refused(hypothesis, refusal, readings, poses), lateness=late)
    return replace(accepted, readings=readings, rows=evidence.rows)


def _with_lateness(
    estimate: Estimate, late: Lateness | None, frame: FrameObservations, rig: StereoRig
) -> Estimate:
    """Return an estimate with the term by the way of the car between both images."""
    covariance = synchronisation_covariance(late, frame.stamp_difference_s, estimate.pose, rig)
    return estimate.with_terms(UncertaintyTerm("synchronisation", covariance))


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


def _fittest(
    hypothesis: Hypothesis,
    pattern: LanePattern,
    fitness: PatternFitness,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> tuple[Extrinsics, float, GeneticResult | None, StagePoses]:
    """Return the pose of the greatest fitness, its fitness, the report of a search, and the poses so far."""
    poses = coarse_pose(frame)
    nearby = fittest_nearby(pattern, fitness, rig) if hypothesis.found_by is FoundBy.KNOWN else None
    if nearby is not None:
        pose, greatest = nearby
        return pose, greatest, None, replace(poses, nearby=pose)
    genetic = _search(fitness, config)
    pose = Extrinsics.from_array(genetic.best)
    return pose, genetic.fitness, genetic, replace(poses, genetic=pose)


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
