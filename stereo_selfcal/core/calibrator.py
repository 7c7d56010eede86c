"""The calibrator: every stage on one frame, and the fusion of frames. Live and replay use it alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from . import checks
from .closed_form import compare_stages, solve_plane
from .combination import (
    MAX_LINE_HEIGHT_M,
    combine,
    covariance_by_paint,
    covariance_by_rectification,
    covariance_by_road,
    heights_over_asphalt,
    lies_on,
    same_road,
    surely_right,
)
from .config import CalibratorConfig
from .corridor import CELL_WIDTH_M
from .extraction import Image, find_stripe_points
from .extrinsics import Extrinsics
from .fitness import PatternFitness
from .further import further_lines
from .fusion import fuse, shared
from .gates import Evidence, judge
from .genetic import GeneticResult, maximise_each
from .geometry import SIDES
from .guided import find_road, line_on_road, lines_on_road
from .pattern import LanePattern
from .patterns import Look, Points, Refused, buried_m, look, unused_lines
from .rectification import vertical_offset
from .refinement import refine
from .results import CalibrationResult, Rejection, RejectReason, describe, rejected
from .rig import StereoRig
from .road import lane_in_road
from .texture import TextureFit, align_texture
from .uncertainty import measure_bends, propagate

# A frame that is refused is looked at again, with chains and with the next best pairs of lines; each costs a
# search, a refinement and an alignment, so there is an end to it.
_MOST_SECOND_LOOKS = 4
# The road goes on beyond its lines by a shoulder or another lane: a cell more on either side has the lines
# inside of the surface they are compared with, not on its rim.
_BESIDE_M = CELL_WIDTH_M
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
        result = self._calibrate(left, right, stamp_s)
        if result.accepted:
            # Images' worth of points is not needed any more: memory must not grow with a bag.
            self._accepted.append(replace(result, pattern=None, unused_lines=(), genetic=None))
        self._last = result
        return result

    @property
    def estimate(self) -> CalibrationResult:
        """The accepted frames so far, fused; the last rejection when none was accepted."""
        if not self._accepted:
            if self._last is not None:
                return self._last
            return rejected(Rejection(RejectReason.NO_FRAMES, "frames", 0, 1, "", "add a stereo frame first"))
        if len(self._accepted) == 1:
            return self._accepted[0]
        poses = np.array([r.extrinsics.as_array() for r in self._accepted if r.extrinsics is not None])
        covariances = np.array([r.covariance for r in self._accepted])
        mean, covariance, used = fuse(poses, covariances)
        frames = [r for r, use in zip(self._accepted, used, strict=True) if use]
        yaws = [r.lane_yaw_rad for r in frames if r.lane_yaw_rad is not None]
        bends = [r.lane_curvature_per_m for r in frames if r.lane_curvature_per_m is not None]
        pose, covariance = Extrinsics.from_array(mean), covariance + shared(covariances[used])
        if any("textured" in r.stages for r in frames):
            # What the calibration of the cameras has left is the same in all frames.
            covariance = covariance + covariance_by_rectification(self.rig, pose)
        fused = CalibrationResult(
            message="",
            extrinsics=pose,
            covariance=covariance,
            lane_yaw_rad=float(np.mean(yaws)),
            lane_curvature_per_m=float(np.mean(bends)) if bends else None,
            stages={
                name: Extrinsics.from_array(np.mean([r.stages[name].as_array() for r in frames], axis=0))
                for name in frames[0].stages
                if all(name in r.stages for r in frames)
            },
            stamp_s=self._accepted[-1].stamp_s,
            n_frames=len(frames),
        )
        return replace(fused, message=_announce(fused, len(self._accepted) - len(frames)))

    def _calibrate(self, left: Image, right: Image, stamp_s: float) -> CalibrationResult:
        """Run every stage on one frame; again with other lines where the first ones are refused."""
        images = (left, right)
        refusal = checks.check_images(left, right, self.rig)
        if refusal:
            return rejected(refusal, stamp_s)
        points = self._find_points(images)
        first = look(points, images, self.rig, self.config)
        if isinstance(first.patterns, Refused):
            result = rejected(first.patterns.rejection, stamp_s, pattern=first.patterns.pattern)
        else:
            depths = buried_m(first.patterns, self.rig)
            further = further_lines(first.patterns[0], first.matches, points, self.rig, self.config)
            result = self._solve(first.patterns[0].joined(further), images, stamp_s, depths[0])
            if further and not result.accepted:
                result = self._solve(first.patterns[0], images, stamp_s, depths[0])
            others = [i for i, depth in enumerate(depths) if depth <= MAX_LINE_HEIGHT_M]
            if result.reason is RejectReason.LINE_BELOW_ROAD and others:
                result = self._solve(first.patterns[others[0]], images, stamp_s, depths[others[0]])
        if not result.accepted and self.config.texture.check:
            result = self._look_again(result, first, points, images, stamp_s)
        return replace(result, unused_lines=unused_lines(first, result.pattern))

    def _look_again(
        self,
        refused: CalibrationResult,
        first: Look,
        points: Points,
        images: tuple[Image, Image],
        stamp_s: float,
    ) -> CalibrationResult:
        """Try other lines; what is found this way counts only with the asphalt as a witness."""
        chained = look(points, images, self.rig, self.config, chained=True)
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
            result = self._solve(pattern, images, stamp_s)
            if result.accepted and "textured" in result.stages:
                return result
            road = road or result.stages.get("textured")
        matches = [match for each in looks for side in each.matches for match in side]
        shown = find_road(images, road, matches, self.rig, self.config)
        if shown is None or (road is not None and not same_road(road, shown.extrinsics)):
            return refused
        candidates = [each.candidates[0] for each in looks]
        for pattern in lines_on_road(shown.extrinsics, candidates, points, images, self.rig, self.config):
            result = self._solve(pattern, images, stamp_s, shown=shown)
            if result.accepted and "textured" in result.stages:
                return result
        seen = line_on_road(shown.extrinsics, matches, points, images, self.rig, self.config)
        covariance = shown.covariance + covariance_by_rectification(self.rig, shown.extrinsics)
        vertical = None
        if seen is not None and surely_right(covariance):
            vertical = vertical_offset(images, self.rig, shown.extrinsics, seen[1])
        if seen is None or vertical is None:  # rows that cannot be compared may be those of a turned camera
            return refused
        gates, refusal = judge(Evidence(self.config, texture=shown, vertical=vertical))
        if refusal:
            return rejected(refusal, stamp_s, gates=gates, stages={"textured": shown.extrinsics})
        result = CalibrationResult(
            message="",
            extrinsics=shown.extrinsics,
            covariance=covariance,
            lane_yaw_rad=seen[1],
            stamp_s=stamp_s,
            n_frames=1,
            stages={"textured": shown.extrinsics},
            gates=gates,
            notes=("from the asphalt, confirmed by one line only",),
        )
        return replace(result, message=_announce(result))

    def extract(self, left: Image, right: Image) -> LanePattern | Refused:
        """Extract the calibration pattern of one frame (paper section 2.2).

        Args:
            left: (H, W) uint8 rectified image of the left camera.
            right: The same of the right camera.

        Returns:
            The two lane boundaries in both images, sampled; or why there are none.
        """
        refusal = checks.check_images(left, right, self.rig)
        if refusal:
            return Refused(refusal)
        images = (left, right)
        found = look(self._find_points(images), images, self.rig, self.config).patterns
        return found if isinstance(found, Refused) else found[0]

    def _find_points(self, images: tuple[Image, Image]) -> Points:
        left, right = (find_stripe_points(image, self.config.extraction) for image in images)
        return left, right

    def _solve(
        self,
        pattern: LanePattern,
        images: tuple[Image, Image],
        stamp_s: float,
        buried: float | None = None,
        shown: TextureFit | None = None,
    ) -> CalibrationResult:
        """Find the extrinsics for a pattern, judge them, and refine them on the images."""
        fitness = PatternFitness(pattern, self.rig, self.config.fitness)
        genetic = self._search(fitness)
        extrinsics = Extrinsics.from_array(genetic.best)
        misfit_px = float(np.sqrt(np.max(fitness.errors(genetic.best[None]))))
        evidence = Evidence(self.config, extrinsics, genetic.fitness, misfit_px, buried)
        known: dict[str, Any] = {
            "pattern": pattern,
            "genetic": genetic,
            "stages": {"genetic": extrinsics},
            "stamp_s": stamp_s,
        }
        gates, refusal = judge(evidence)
        if refusal:
            return rejected(refusal, gates=gates, **known)
        fit = propagate(pattern, self.rig, extrinsics, self.config.fitness)
        bends = measure_bends(pattern, self.rig, extrinsics.height_m)
        evidence = replace(evidence, bends=bends, lines=fit)
        gates, refusal = judge(evidence, but=gates)
        if refusal or fit is None:
            # The gate "determined" has made sure that there is a refusal where there is no fit.
            return rejected(refusal, gates=gates, **known)  # type: ignore[arg-type]
        notes = compare_stages(pattern, self.rig, extrinsics, fit.covariance, known["stages"])
        refined = refine(images, pattern, self.rig, extrinsics)
        if refined is None:
            notes = (*notes, "not refined: too few rows show both edges of a stripe")
        else:
            known["stages"]["refined"] = refined.extrinsics
        evidence = replace(evidence, refined=refined, clipped=_clipped(images))
        gates, refusal = judge(evidence, but=gates)
        if refusal:
            return rejected(refusal, gates=gates, **known)
        best = fit if refined is None else refined
        result = CalibrationResult(
            message="",
            extrinsics=evidence.of_lines,
            covariance=best.covariance,
            lane_yaw_rad=best.lane_yaw_rad,
            lane_curvature_per_m=bends.lateral_per_m,
            n_frames=1,
            gates=gates,
            notes=notes,
            **known,
        )
        if self.config.texture.check:
            result = self._ask_asphalt(result, evidence, images, shown)
        return replace(result, message=_announce(result)) if result.accepted else result

    def _ask_asphalt(
        self,
        result: CalibrationResult,
        evidence: Evidence,
        images: tuple[Image, Image],
        shown: TextureFit | None,
    ) -> CalibrationResult:
        """Compare an estimate from lines with the plane of the asphalt between them, and combine both.

        Where there it is no witness, the asphalt that has shown where the lines are still is one.
        """
        if result.pattern is None or result.extrinsics is None or result.covariance is None:
            raise ValueError("only an accepted result can be compared with the road")
        _, left_m, right_m = lane_in_road(result.pattern.boundaries, self.rig, result.extrinsics)
        limits_m = (float(right_m) - _BESIDE_M, float(left_m) + _BESIDE_M)
        yaw = result.lane_yaw_rad or 0.0
        fit = align_texture(images, self.rig, result.extrinsics, yaw, limits_m=limits_m)
        if shown is not None and (fit is None or fit.sufficiency < 1.0):
            fit = shown
        if fit is None or not fit.enough_texture or not fit.even_enough:
            lacking = "too uneven" if fit is not None and fit.enough_texture else "too little texture"
            # Lines whose stripes could not be fitted, on asphalt that cannot be asked, are a guess.
            if self.config.texture.required or "refined" not in result.stages:
                evidence = replace(evidence, witness=0.0 if fit is None else fit.sufficiency)
                gates, refusal = judge(evidence, but=result.gates)
                known = {"pattern": result.pattern, "genetic": result.genetic, "stages": result.stages}
                return rejected(refusal, result.stamp_s, gates=gates, **known)  # type: ignore[arg-type]
            return replace(result, notes=(*result.notes, f"not checked against the asphalt: {lacking}"))
        evidence = replace(
            evidence,
            texture=fit,
            heights_m=heights_over_asphalt(result.pattern, self.rig, result.extrinsics, fit),
            vertical=vertical_offset(images, self.rig, fit.extrinsics, yaw, limits_m=limits_m),
        )
        gates, refusal = judge(evidence, but=result.gates)
        stages = {**result.stages, "textured": fit.extrinsics}
        if refusal:
            known = {"pattern": result.pattern, "genetic": result.genetic}
            return rejected(refusal, result.stamp_s, gates=gates, stages=stages, **known)
        known_road = (result.pattern, self.rig, result.extrinsics, fit.shape)
        by_road = covariance_by_road(*known_road) + covariance_by_paint(*known_road)
        extrinsics, covariance = combine(result.extrinsics, result.covariance + by_road, fit)
        stages["combined"] = extrinsics
        covariance = covariance + covariance_by_rectification(self.rig, extrinsics)
        return replace(result, stages=stages, extrinsics=extrinsics, covariance=covariance, gates=gates)

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


def _announce(result: CalibrationResult, n_outliers: int = 0) -> str:
    """Return the sentence of an accepted result."""
    if result.extrinsics is None or result.std is None:
        raise ValueError("only an accepted result can be announced")
    frames = "1 frame" if result.n_frames == 1 else f"{result.n_frames} frames"
    aside = f" ({n_outliers} more set aside as outliers)" if n_outliers else ""
    notes = "".join(f"; {note}" for note in result.notes)
    return f"calibrated from {frames}{aside}: {describe(result.extrinsics, result.std)}{notes}"
