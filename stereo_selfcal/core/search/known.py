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

"""The known camera: what an accepted cold frame tells of the frames after it, which are followed from it.

A calibration tells how the right camera is turned, where the road is but for the motion of the car, how
uneven it is, and where its lines are. So a frame soon afterwards needs no search: its road surface is aligned
from the expected pose on; or, where that is not seen, the stripes of its lines are fitted again. What only a
cold frame can tell is taken over from it: the turn of the right camera, kerbs, what crowns and slopes leave.
A frame that does not confirm the known camera is looked at as if nothing were known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..camera.rig import StereoRig
from ..config import CORRECT_ALL, CORRECT_NOTHING, CalibratorConfig
from ..estimators.landmarks import Landmarks
from ..estimators.line_covariance import Bends
from ..estimators.stripe_fit import StripeFit
from ..estimators.stripe_following import follow_stripes
from ..estimators.texture_fit import MIN_SIGMAS, TextureFit
from ..estimators.texture_following import follow_texture
from ..evidence.camera_turn import CameraTurn, find_landmarks, turned_back
from ..evidence.camera_yaw import YawTold, wrong_yaw_rad, yaw_posterior
from ..evidence.estimate import Estimate, StagePoses
from ..evidence.frame_evidence import Evidence, FoundBy, Hypothesis, clipped_share
from ..evidence.gates import evaluate_gates
from ..evidence.measurements import read_lane_radius, read_vertical_radius
from ..evidence.profile import measure_profile
from ..evidence.rig_unknowns import RigStd, response_of_surface, rig_terms
from ..evidence.road_surface import SurfaceCells
from ..evidence.synchronisation import Lateness, measure_lateness, synchronisation_covariance
from ..geometry.alignment import Alignment
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms
from ..lanes.lane_pair import LanePattern
from ..rejection import NotFitted
from ..road.priors import RIDE_MEMORY_S, RIDE_STD
from ..types import Array, Image
from .attempt import Attempt, Verdict
from .known_lines import HALF_DOUBLE_LINE_M, MOST_SIGMAS
from .road_lines import first_road_row

# Landmarks are looked for so often. In recorded drives, steps of this length tell the direction of travel as
# well as steps of 0.1 s do.
LANDMARKS_EVERY_S = 0.3
_ROUNDING_S = 1e-3  # of stamps
# Grey values about the stripes scatter by no more than so many times as much as in the cold frame: with more,
# there is something else beside them.
_MOST_NOISE = 2.0
TURN_BEFORE = "turn_before"  # the term by the turn that was taken over
_LEAST_OF_COLD = 0.5  # of the road that the cold frame has seen: most of it is seen again


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A frame that was looked at.

    Attributes:
        stamp_s: Time stamp [s].
        pose: Pose over the road.
        stripes: The fit of its stripes; None where its surface is followed.
        pattern: Their lines.
    """

    stamp_s: float
    pose: Extrinsics
    stripes: StripeFit | None
    pattern: LanePattern | None


class KnownCamera:
    """An accepted cold frame, by which the frames after it are followed, one after the other.

    Args:
        rig: The rig all frames come from.
        config: Settings.
        alignment: How the right camera is turned, by the cold frame.
        cold: The attempt whose result is that of the cold frame.
        estimate: Its estimate.
        stamp_s: Its time stamp [s].
        ahead: How much farther ahead the right camera sat in it, over the baseline.
        corrects: Whether images are freed of the turn of the right camera.
    """

    def __init__(
        self,
        rig: StereoRig,
        config: CalibratorConfig,
        alignment: Alignment,
        cold: Attempt,
        estimate: Estimate,
        stamp_s: float,
        ahead: float,
        corrects: bool,
    ) -> None:
        self._rig, self._config, self._alignment = rig, config, alignment
        self._cold, self._estimate, self._stamp_s = cold, estimate, stamp_s
        self._texture = cold.hypothesis.texture
        stripes, pattern = (None, None) if self._texture is not None else (cold.stripes, cold.pattern)
        self._last = _Seen(stamp_s, estimate.pose, stripes, pattern)
        self._landmarks_s = self._before_s = stamp_s
        self._ahead = ahead
        self._corrects = corrects and config.alignment.correct != CORRECT_NOTHING

    @classmethod
    def after(
        cls,
        cold: Attempt | None,
        alignment: Alignment | None,
        stamp_s: float,
        rig: StereoRig,
        config: CalibratorConfig,
        ahead: float = 0.0,
        *,
        corrects: bool = True,
    ) -> KnownCamera | None:
        """Return what a cold frame tells; None where it was refused, or shows nothing that can be followed.

        Lines that were compared with the surface between them are not followed without it.

        Args:
            cold: The attempt whose result is that of the frame; None without one.
            alignment: How the right camera is turned, by the frame.
            stamp_s: Its time stamp [s].
            rig: The rig all frames come from.
            config: Settings.
            ahead: How much farther ahead the right camera sits in it, over the baseline.
            corrects: Whether images are to be freed of that turn: where those of the cold frame were not, its
                noise would be an error of all frames that follow.
        """
        if cold is None or alignment is None or not cold.accepted or cold.estimate is None:
            return None
        lines = cold.stripes is not None and cold.pattern is not None and cold.poses.textured is None
        if cold.hypothesis.texture is None and not lines:
            return None
        return cls(rig, config, alignment, cold, cold.estimate, stamp_s, ahead, corrects)

    @property
    def stamp_s(self) -> float:
        """Time stamp of the cold frame [s]."""
        return self._stamp_s

    def follow(self, images: tuple[Image, Image], stamp_s: float, apart_s: float) -> Attempt | None:
        """Return the attempt at the next frame; None where it does not confirm the known camera.

        Args:
            images: Left and right image, (H, W) uint8.
            stamp_s: Time stamp of the frame [s].
            apart_s: Stamp of the right image minus that of the left one [s].
        """
        expected = self._expected(stamp_s)
        if self._texture is not None:
            attempt = self._by_surface(images, expected, self._texture, apart_s)
            stripes = None
        else:
            attempt, stripes = self._by_stripes(images, expected, apart_s)
        if (
            attempt is None
            or attempt.estimate is None
            or not self._is_confirmed_by(attempt.estimate, stamp_s)
        ):
            return None
        self._before_s = self._last.stamp_s
        self._last = _Seen(stamp_s, attempt.estimate.pose, stripes, attempt.pattern)
        return attempt

    def landmarks(self, images: tuple[Image, Image], stamp_s: float) -> Landmarks | None:
        """Return the landmarks of a frame; None where others of it were looked for shortly before.

        Args:
            images: Left and right image, (H, W) uint8.
            stamp_s: Time stamp of the frame [s].
        """
        # The next frame would come too late.
        next_s = stamp_s + max(stamp_s - self._before_s, 0.0)
        if next_s - self._landmarks_s <= LANDMARKS_EVERY_S + _ROUNDING_S:
            return None
        self._landmarks_s = stamp_s
        return find_landmarks(images, self._rig, self._ahead)

    def _expected(self, stamp_s: float) -> Extrinsics:
        """Return the pose that is most probable: the last one, which fades into that of the cold frame."""
        expected = self._estimate.pose.as_array()
        lasts = math.exp(-abs(stamp_s - self._last.stamp_s) / RIDE_MEMORY_S)
        return Extrinsics.from_array(expected + lasts * (self._last.pose.as_array() - expected))

    def _is_confirmed_by(self, estimate: Estimate, stamp_s: float) -> bool:
        """Whether an estimate differs from that of the cold frame by no more than motion explains."""
        # Of a stationary motion whose correlation falls by 1 / e in its memory.
        moved = 2.0 - 2.0 * math.exp(-abs(stamp_s - self._stamp_s) / RIDE_MEMORY_S)
        variance = np.diag(self._estimate.covariance + estimate.covariance) + moved * np.square(RIDE_STD)
        difference = estimate.pose.as_array() - self._estimate.pose.as_array()
        return bool(np.all(np.abs(difference) <= MOST_SIGMAS * np.sqrt(variance)))

    def _by_surface(
        self, images: tuple[Image, Image], expected: Extrinsics, before: TextureFit, apart_s: float
    ) -> Attempt | None:
        """Align the road surface again."""
        texture = follow_texture(images, self._rig, expected, before, self._homography)
        if isinstance(texture, NotFitted):
            return None
        if not _shows_the_same(texture, before):
            return None
        pose, rig = texture.extrinsics, self._rig
        of_rig = rig_terms(response_of_surface(rig, pose, self._rig_std))
        terms = (*texture.terms, *(self._of_cold_rows(term) for term in of_rig))
        late = measure_lateness(images, rig, pose, None, self._homography)
        estimate = self._estimate_of(pose, terms, None, late, apart_s)
        evidence = Evidence(
            self._config,
            texture=texture,
            std=np.sqrt(np.diag(estimate.covariance)),
            yaw=self._yaw_left,
            wrong_yaw_rad=wrong_yaw_rad(rig, pose),
            lateness=late,
            most_way_m=math.inf if late is None else late.limit_m(pose, rig),
        )
        hypothesis = Hypothesis(FoundBy.KNOWN, None, texture=texture)
        return self._attempt(hypothesis, evidence, estimate, StagePoses(textured=pose))

    def _by_stripes(
        self, images: tuple[Image, Image], expected: Extrinsics, apart_s: float
    ) -> tuple[Attempt | None, StripeFit | None]:
        """Fit the stripes again."""
        if self._homography is not None:
            images, _ = turned_back(images, self._rig, self._turn, self._yaw_corrected_rad, self._first_row)
        before, pattern = self._last.stripes, self._last.pattern
        assert before is not None and pattern is not None  # as there is no surface
        found = follow_stripes(images, self._rig, expected, before, pattern)
        if isinstance(found, NotFitted):
            return None, None
        fit = found.fit
        if not (self._same_stripes(fit) and self._is_straight(found.bends)):
            return None, None
        pose = fit.extrinsics
        late = measure_lateness(images, self._rig, pose, fit.lane_yaw_rad)
        terms = (*self._terms_of_lines, UncertaintyTerm("noise", fit.covariance))
        estimate = self._estimate_of(pose, terms, fit, late, apart_s)
        evidence = Evidence(
            self._config,
            refined=fit,
            wide_profile=measure_profile(fit.residuals, self._rig, pose, wide=True),
            clipped=clipped_share(images),
            lateness=late,
            most_way_m=math.inf if late is None else late.limit_m(pose, self._rig),
            std=np.sqrt(np.diag(estimate.covariance)),
        )
        hypothesis = Hypothesis(FoundBy.KNOWN, found.pattern)
        attempt = self._attempt(hypothesis, evidence, estimate, StagePoses(refined=pose))
        return attempt, fit

    def _same_stripes(self, fit: StripeFit) -> bool:
        """Whether stripes are as wide, as far apart and as clear as those of the cold frame."""
        cold = self._cold.stripes
        assert cold is not None
        apart_m = np.diff(fit.positions_m[:2]) - np.diff(cold.positions_m[:2])
        wider_m = fit.widths_m[:2] - cold.widths_m[:2]
        same = float(np.abs([*apart_m, *wider_m]).max()) <= HALF_DOUBLE_LINE_M
        return same and fit.noise_grey <= _MOST_NOISE * cold.noise_grey

    def _is_straight(self, bends: Bends) -> bool:
        """Whether lane and road are as straight as those of a cold frame have to be."""
        evidence = Evidence(self._config, bends=bends)
        readings = read_lane_radius(evidence), read_vertical_radius(evidence)
        return all(reading is None or reading.passed for reading in readings)

    def _estimate_of(
        self,
        pose: Extrinsics,
        terms: tuple[UncertaintyTerm, ...],
        fit: StripeFit | None,
        late: Lateness | None,
        apart_s: float,
    ) -> Estimate:
        """Return an estimate with the terms of it that the motion of the car makes."""
        across = synchronisation_covariance(late, apart_s, pose, self._rig)
        all_terms = merge_terms((*terms, UncertaintyTerm("synchronisation", across)))
        yaw_rad = None if fit is None else fit.lane_yaw_rad
        return Estimate(pose, all_terms, yaw_rad, self._estimate.reservations)

    def _attempt(
        self, hypothesis: Hypothesis, evidence: Evidence, estimate: Estimate, poses: StagePoses
    ) -> Attempt | None:
        """Return the attempt; None where a gate refuses it."""
        readings, refusal = evaluate_gates(evidence)
        if refusal:
            return None
        return Attempt(
            hypothesis,
            Verdict.ACCEPTED,
            poses=poses,
            readings=readings,
            estimate=estimate,
            surface=SurfaceCells.of(evidence.texture),
            stripes=evidence.refined,
            lateness=evidence.lateness,
        )

    @cached_property
    def _turn(self) -> CameraTurn:
        return CameraTurn.known(self._alignment, self._rig)

    @cached_property
    def _homography(self) -> Array | None:
        """Homography (3, 3) of the right camera by its turn; None where nothing is corrected."""
        nothing = not self._turn.seen and self._yaw_corrected_rad == 0.0
        if nothing or not self._corrects:
            return None
        return self._turn.homography(self._rig, self._yaw_corrected_rad)

    @cached_property
    def _yaw_told(self) -> YawTold:
        """The yaw of the right camera, by the cold frame."""
        alignment = self._alignment
        told = (YawTold(alignment.yaw_rad, float(alignment.std[2])),) if alignment.known()[2] else ()
        return yaw_posterior(told, None, self._rig, calibrated=True)

    @cached_property
    def _yaw_corrected_rad(self) -> float:
        """The yaw of which the images are freed [rad]."""
        return self._yaw_told.yaw_rad if self._config.alignment.correct == CORRECT_ALL else 0.0

    @cached_property
    def _yaw_left(self) -> YawTold:
        """The yaw that is left in the images."""
        told = self._yaw_told
        return replace(told, yaw_rad=told.yaw_rad - self._yaw_corrected_rad)

    @cached_property
    def _rig_std(self) -> RigStd:
        turn = replace(self._turn, corrected=self._turn.seen and self._corrects)
        return turn.rig_std(self._yaw_left.rms_rad)

    def _of_cold_rows(self, term: UncertaintyTerm) -> UncertaintyTerm:
        """Return a term of the rig; what measured rows leave of the turn has a name of its own."""
        measured = term.name == "row_offset" and self._turn.seen
        return replace(term, name=TURN_BEFORE) if measured else term

    @cached_property
    def _first_row(self) -> int:
        """Row above which no road is."""
        return first_road_row(self._estimate.pose, self._rig)

    @cached_property
    def _terms_of_lines(self) -> tuple[UncertaintyTerm, ...]:
        """The terms of the cold frame but for the noise of its stripes.

        What the measured rows of the cold frame leave of the turn is noise of that frame, and one error of
        all that are followed from it.
        """
        stripes = self._cold.stripes
        assert stripes is not None
        terms = []
        for term in self._estimate.terms:
            if term.name == "noise":
                terms.append(UncertaintyTerm(TURN_BEFORE, _positive(term.covariance - stripes.covariance)))
            elif term.name != "synchronisation":
                terms.append(term)
        return tuple(terms)


def _shows_the_same(texture: TextureFit, before: TextureFit) -> bool:
    """Whether the road is seen as in the cold frame: in all, and under the car.

    Fewer samples find significant texture in fewer cells, so that half of what there was is enough.
    """
    shares = (
        (texture.quality.cell_share, before.quality.cell_share),
        (texture.quality.strip_share, before.quality.strip_share),
    )
    return texture.quality.sigmas >= MIN_SIGMAS and all(now >= _LEAST_OF_COLD * cold for now, cold in shares)


def _positive(matrix: Array) -> Array:
    """Return a symmetric matrix without its negative eigenvalues, which are errors of rounding."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    positive: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return positive
