"""The calibrator: every stage on one frame, and the fusion of frames. Live and replay use it alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .camera.rig import StereoRig
from .config import CalibratorConfig
from .drive.fusion import fuse_frames
from .estimators.fitness import PatternFitness
from .estimators.line_covariance import measure_bends, propagate
from .estimators.stripe_fit import refine
from .estimators.texture_alignment import TextureFit, align_texture
from .evidence.cross_checks import FrameObservations, cross_check_texture
from .evidence.cue_fusion import same_road, surely_right
from .evidence.frame_evidence import Evidence
from .evidence.gates import evaluate_gates
from .evidence.lane_heights import lies_on, surely_same
from .evidence.nuisances import (
    rectification_covariance,
    seen_slope_covariance,
    stage_disagreement_covariance,
    unseen_slope_covariance,
)
from .evidence.profile import measure_profile, profile_of_asphalt
from .evidence.row_offset import vertical_offset
from .geometry.homography import SIDES
from .geometry.pose import Extrinsics
from .lanes import frame_checks
from .lanes.closed_form import compare_stages, solve_plane
from .lanes.extra_lines import find_extra_lines
from .lanes.hypotheses import (
    LaneHypotheses,
    Points,
    Refused,
    cross,
    find_hypotheses,
    lines_below_plane,
    unused_lines,
)
from .lanes.lane_pair import LanePattern
from .lanes.line_geometry import BelowPlane
from .lanes.matching import Match
from .lanes.stripe_points import find_stripe_points
from .numerics.genetic import GeneticResult, maximise_each
from .rejection import RejectReason
from .results import CalibrationResult, announce, rejected
from .search.texture_guided_lines import find_road, line_on_road, lines_on_road
from .types import Image

# A frame that is refused is looked at again, with chains and with the next best pairs of lines; each costs a
# search, a refinement and an alignment, so there is an end to it.
_MOST_SECOND_LOOKS = 4
# Where one of two lines is none of the road, or not the same in both cameras, other pairs get their turn: as
# many as that took in most worlds.
_OTHER_LINES_MAY_DO = (
    RejectReason.LINES_NOT_MATCHED,
    RejectReason.LINE_BELOW_ROAD,
    RejectReason.LINES_NOT_COPLANAR,
    RejectReason.LINE_NOT_PAINTED,
)
_MOST_OTHER_PAIRS = 2
# A lane of 2.5 m has this on both sides of a camera in it, with a quarter of a metre to spare.
_BENEATH_M = (-1.0, 1.0)
_CLIPPED_STEP = 4  # every fourth pixel of every fourth row is enough for two digits


class Calibrator:
    """Stateful calibrator of one rig: add frames, read the fused estimate.

    Attributes:
        rig: The rig all frames come from.
        config: Settings.
    """

    def __init__(self, rig: StereoRig, config: CalibratorConfig | None = None) -> None:
        self.rig = rig
        self.config = config or CalibratorConfig()
        self._accepted: list[CalibrationResult] = []
        self._last: CalibrationResult | None = None

    def add(self, left: Image, right: Image, stamp_s: float = 0.0) -> CalibrationResult:
        """Calibrate one frame and remember it when it is accepted.

        The result depends on this frame alone, whatever was added before: the random numbers
        start anew from the seed.

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.
            stamp_s: Time stamp of the frame [s].
        """
        result = self.calibrate_frame(left, right, stamp_s)
        self.remember(result)
        return result

    def remember(self, result: CalibrationResult) -> None:
        """Take the result of a frame of this rig into the estimate, wherever it was calibrated.

        Args:
            result: What :meth:`calibrate_frame` returned, of this calibrator or of one like it.
        """
        if result.accepted:
            # Images' worth of points is not needed any more: memory must not grow with a bag.
            self._accepted.append(result.slim())
        self._last = result

    @property
    def estimate(self) -> CalibrationResult:
        """The accepted frames so far, fused; the last rejection when none was accepted."""
        if not self._accepted:
            if self._last is not None:
                return self._last
            return rejected(frame_checks.no_frames())
        return fuse_frames(self._accepted, self.rig)

    def calibrate_frame(self, left: Image, right: Image, stamp_s: float = 0.0) -> CalibrationResult:
        """Calibrate one frame and remember nothing; arguments and result as of :meth:`add`.

        Every stage runs, and again with other lines where the first ones are refused.
        """
        images = (left, right)
        refusal = frame_checks.check_images(left, right, self.rig)
        if refusal:
            return rejected(refusal, stamp_s)
        points = self._find_points(images)
        first = find_hypotheses(points, images, self.rig, self.config)
        if isinstance(first.patterns, Refused):
            result = rejected(first.patterns.rejection, stamp_s, pattern=first.patterns.pattern)
        else:
            depths = lines_below_plane(first.patterns, self.rig)
            further = find_extra_lines(first.patterns[0], first.matches, points, self.rig, self.config)
            seen = FrameObservations(images, points, first.matches)
            result = self._solve(first.patterns[0].joined(further), seen, stamp_s, depths[0])
            if further and not result.accepted:
                result = self._solve(first.patterns[0], seen, stamp_s, depths[0])
            if result.reason in _OTHER_LINES_MAY_DO:
                others = [
                    i
                    for i, depth in enumerate(depths)
                    if i and not depth.surely_below and not cross(first.patterns[0], first.patterns[i])
                ]
                for i in others[:_MOST_OTHER_PAIRS]:
                    if result.reason in _OTHER_LINES_MAY_DO:
                        result = self._solve(first.patterns[i], seen, stamp_s, depths[i])
        if not result.accepted and self.config.texture.check:
            result = self._look_again(result, first, points, images, stamp_s)
        return replace(result, unused_lines=unused_lines(first, result.pattern))

    def _look_again(
        self,
        refused: CalibrationResult,
        first: LaneHypotheses,
        points: Points,
        images: tuple[Image, Image],
        stamp_s: float,
    ) -> CalibrationResult:
        """Try other lines; what is found this way counts only with the asphalt as a witness."""
        chained = find_hypotheses(points, images, self.rig, self.config, chained=True)
        tried: list[Extrinsics] = [] if refused.pattern is None else list(refused.stages.values())[:1]
        road = refused.stages.get("textured")
        left = _MOST_SECOND_LOOKS
        looks = (chained, first)
        free = [p for each in looks if not isinstance(each.patterns, Refused) for p in each.patterns]
        for pattern in free:
            closed = solve_plane(pattern, self.rig)
            if closed is None or not left:
                continue
            if any(same_road(closed.extrinsics, other) for other in tried):
                continue
            tried.append(closed.extrinsics)
            if road is not None and not lies_on(pattern, self.rig, closed.extrinsics, road):
                continue
            left -= 1
            result = self._solve(pattern, FrameObservations(images), stamp_s)
            if result.accepted and "textured" in result.stages:
                return result
            road = road or result.stages.get("textured")
        matches = [match for each in looks for side in each.matches for match in side]
        shown = find_road(images, road, matches, self.rig, self.config)
        if shown is None or (road is not None and not same_road(road, shown.extrinsics)):
            return refused
        candidates = [each.candidates[0] for each in looks]
        for pattern in lines_on_road(shown.extrinsics, candidates, points, images, self.rig, self.config):
            result = self._solve(pattern, FrameObservations(images, shown=shown), stamp_s)
            if result.accepted and "textured" in result.stages:
                return result
        return self._from_asphalt(refused, shown, matches, FrameObservations(images, points), stamp_s)

    def _from_asphalt(
        self,
        refused: CalibrationResult,
        shown: TextureFit,
        matches: list[Match],
        seen: FrameObservations,
        stamp_s: float,
    ) -> CalibrationResult:
        """Return the pose over the asphalt where a line both cameras see lies in it; else what was refused.

        Where lines that lie in it have shown that the road goes on with another slope, that stands: the
        asphalt tells less of what is farther ahead.
        """
        profile = profile_of_asphalt(shown)
        covariance = shown.covariance + rectification_covariance(self.rig, shown.extrinsics)
        covariance += seen_slope_covariance(profile) + unseen_slope_covariance(profile)
        if self._bent_road(refused, shown) or seen.points is None or not surely_right(covariance):
            return refused
        line = line_on_road(shown.extrinsics, matches, seen.points, seen.images, self.rig, self.config)
        if line is None:
            return refused
        _, yaw = line
        # What is beyond a kerb is no road, and may have decided the plane.
        beneath = align_texture(seen.images, self.rig, shown.extrinsics, yaw, limits_m=_BENEATH_M)
        if beneath is None or not surely_same(shown.extrinsics, beneath, self.rig):
            return refused
        vertical = vertical_offset(seen.images, self.rig, shown.extrinsics, yaw)
        if vertical is None:  # rows that cannot be compared may be those of a turned camera
            return refused
        gates, refusal = evaluate_gates(Evidence(self.config, texture=shown, vertical=vertical))
        if refusal:
            return rejected(refusal, stamp_s, gates=gates, stages={"textured": shown.extrinsics})
        result = CalibrationResult(
            message="",
            extrinsics=shown.extrinsics,
            covariance=covariance,
            lane_yaw_rad=yaw,
            stamp_s=stamp_s,
            n_frames=1,
            stages={"textured": shown.extrinsics},
            gates=gates,
            notes=("from the asphalt, confirmed by one line only",),
        )
        return replace(result, message=announce(result))

    def _bent_road(self, refused: CalibrationResult, shown: TextureFit) -> bool:
        """Whether lines that lie in the asphalt were refused as those of a road with another slope ahead."""
        return (
            refused.reason is RejectReason.ROAD_NOT_FLAT
            and refused.pattern is not None
            and lies_on(refused.pattern, self.rig, list(refused.stages.values())[-1], shown.extrinsics)
        )

    def extract(self, left: Image, right: Image) -> LanePattern | Refused:
        """Extract the calibration pattern of one frame (paper section 2.2).

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.

        Returns:
            The two lane boundaries in both images, sampled; or why there are none.
        """
        refusal = frame_checks.check_images(left, right, self.rig)
        if refusal:
            return Refused(refusal)
        images = (left, right)
        found = find_hypotheses(self._find_points(images), images, self.rig, self.config).patterns
        return found if isinstance(found, Refused) else found[0]

    def _find_points(self, images: tuple[Image, Image]) -> Points:
        left, right = (find_stripe_points(image, self.config.extraction) for image in images)
        return left, right

    def _solve(
        self,
        pattern: LanePattern,
        seen: FrameObservations,
        stamp_s: float,
        below: BelowPlane | None = None,
    ) -> CalibrationResult:
        """Find the extrinsics for a pattern, judge them, and refine them on the images."""
        images = seen.images
        fitness = PatternFitness(pattern, self.rig, self.config.fitness)
        genetic = self._search(fitness)
        extrinsics = Extrinsics.from_array(genetic.best)
        misfit_px = float(np.sqrt(np.max(fitness.errors(genetic.best[None]))))
        evidence = Evidence(self.config, extrinsics, genetic.fitness, misfit_px, below)
        known: dict[str, Any] = {
            "pattern": pattern,
            "genetic": genetic,
            "stages": {"genetic": extrinsics},
            "stamp_s": stamp_s,
        }
        gates, refusal = evaluate_gates(evidence)
        if refusal:
            return rejected(refusal, gates=gates, **known)
        fit = propagate(pattern, self.rig, extrinsics, self.config.fitness)
        bends = measure_bends(pattern, self.rig, extrinsics.height_m)
        evidence = replace(evidence, bends=bends, lines=fit)
        gates, refusal = evaluate_gates(evidence, already=gates)
        if refusal or fit is None:
            # The gate `determined` has made sure that there is a refusal where there is no fit.
            return rejected(refusal, gates=gates, **known)  # type: ignore[arg-type]
        notes = compare_stages(pattern, self.rig, extrinsics, fit.covariance, known["stages"])
        refined = refine(images, pattern, self.rig, extrinsics)
        if refined is None:
            notes = (*notes, "not refined: too few rows show both edges of a stripe")
        else:
            known["stages"]["refined"] = refined.extrinsics
            evidence = replace(
                evidence,
                profile=measure_profile(refined.residuals, self.rig, refined.extrinsics),
                wide_profile=measure_profile(refined.residuals, self.rig, refined.extrinsics, wide=True),
            )
        evidence = replace(evidence, refined=refined, clipped=_clipped(images))
        gates, refusal = evaluate_gates(evidence, already=gates)
        if refusal:
            return rejected(refusal, gates=gates, **known)
        best = fit if refined is None else refined
        of_road = seen_slope_covariance(evidence.profile)
        of_road += stage_disagreement_covariance(extrinsics, fit.covariance, refined)
        result = CalibrationResult(
            message="",
            extrinsics=evidence.of_lines,
            covariance=best.covariance + of_road,
            lane_yaw_rad=best.lane_yaw_rad,
            lane_curvature_per_m=bends.lateral_per_m,
            n_frames=1,
            gates=gates,
            notes=notes,
            **known,
        )
        result = cross_check_texture(result, evidence, seen, self.rig, self.config)
        return replace(result, message=announce(result)) if result.accepted else result

    def _search(self, fitness: PatternFitness) -> GeneticResult:
        """Run the genetic algorithm over the whole search box, once for each camera's parallelism."""
        box = self.config.search
        runs = maximise_each(
            fitness.seen_by_each,
            lower=(box.height_min_m, -box.pitch_max_rad, -box.roll_max_rad),
            upper=(box.height_max_m, box.pitch_max_rad, box.roll_max_rad),
            config=self.config.genetic,
            rng=np.random.default_rng(self.config.seed),
            n_runs=len(SIDES),
        )
        best = max(runs, key=lambda run: run.fitness)
        return replace(best, evaluations=sum(run.evaluations for run in runs))


def calibrate(
    left: Image, right: Image, rig: StereoRig, seed: int = 0, config: CalibratorConfig | None = None
) -> CalibrationResult:
    """Calibrate one stereo frame.

    Args:
        left: (H, W) uint8 rectified image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        seed: Seed of the random numbers; same input and seed, same result.
        config: Settings; its seed is replaced by ``seed``.
    """
    return Calibrator(rig, replace(config or CalibratorConfig(), seed=seed)).add(left, right)


def _clipped(images: tuple[Image, Image]) -> float:
    """Return the greatest part of black and white pixels in the lower half of an image."""
    lower = (image[image.shape[0] // 2 :: _CLIPPED_STEP, ::_CLIPPED_STEP] for image in images)
    return max(float(np.mean((part == 0) | (part == np.iinfo(np.uint8).max))) for part in lower)
