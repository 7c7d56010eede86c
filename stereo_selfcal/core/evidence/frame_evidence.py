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

"""What is known of a frame: its observations, a hypothesis about its lines, and the results of the stages."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from ..camera.rig import StereoRig
from ..config import CORRECT_NOTHING, CalibratorConfig
from ..estimators.coarse_road import CoarseRoad, find_coarse_road
from ..estimators.lane_sweep import LaneSweep
from ..estimators.line_covariance import Bends, LineFit
from ..estimators.stripe_fit import StripeFit
from ..estimators.texture_fit import TextureFit
from ..geometry.homography import horizon_row
from ..geometry.pose import Extrinsics
from ..lanes.hypotheses import Points
from ..lanes.lane_pair import LanePattern
from ..lanes.line_geometry import BelowPlane, HeightOverLane
from ..lanes.matching import Matches
from ..lanes.stripe_points import find_stripe_points, row_thinning
from ..rejection import Bound, NotFitted, fitted
from ..road.priors import ROWS_TELL_YAW_PART
from ..types import Array, Image
from .camera_turn import CameraTurn, measure_turn, turned_back
from .camera_yaw import YawTold, yaw_posterior
from .far_disparity import FarDisparity, far_disparity, first_far_row
from .profile import Profile
from .rig_unknowns import CALIBRATED, RigStd
from .road_surface import RoadSurface, find_road_surface
from .stripe_border import StripeBorder
from .synchronisation import Lateness

_HORIZON_MARGIN_PX = 8  # above the horizon of the road: reach of the edges' directions and continuity
_CLIPPED_STEP = 4  # every fourth pixel of every fourth row is enough for two digits


_ROWS_NOT_COMPARED = CameraTurn.unknown(NotFitted("alignment.correct", 0, Bound.LEAST, 1))


@dataclass(frozen=True, slots=True, eq=False)
class FrameObservations:
    """Observations of a frame that need no hypothesis.

    Attributes:
        images: Left and right image, (H, W) uint8.
        points: Stripe points of both images.
        clipped: Greatest part of black and white pixels in the lower half of an image.
        surface: The road surface; None where ``texture.check`` is 0.
        far: Disparity of what is farthest away; None where the surface does not tell where that is.
        turn: Pitch and roll of the right camera, of which the images are free.
        rig_std: Standard deviations of what remains unknown of the rig.
        yaw_told: The yaw of the right camera, by rows and lines.
        yaw_corrected_rad: The yaw of which the images are free [rad].
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
    """

    images: tuple[Image, Image]
    points: Points
    clipped: float
    surface: RoadSurface | None = None
    far: FarDisparity | None = None
    turn: CameraTurn = _ROWS_NOT_COMPARED
    rig_std: RigStd = CALIBRATED
    yaw_told: tuple[YawTold, ...] = ()
    yaw_corrected_rad: float = 0.0
    stamp_difference_s: float = 0.0

    @classmethod
    def from_images(
        cls,
        images: tuple[Image, Image],
        rig: StereoRig,
        config: CalibratorConfig,
        turn: CameraTurn | None = None,
        yaw_rad: float = 0.0,
        stamp_difference_s: float = 0.0,
    ) -> FrameObservations:
        """Return the observations of a frame.

        Args:
            images: Left and right image, (H, W) uint8.
            rig: Intrinsics and baseline.
            config: Settings.
            turn: Pitch and roll of the right camera where they are known; None to measure them.
            yaw_rad: The yaw of the right camera that is to be corrected [rad].
            stamp_difference_s: Stamp of the right image minus that of the left one [s].
        """
        surface, coarse = None, None
        if config.texture.check or config.alignment.correct != CORRECT_NOTHING:
            found, disparities = find_coarse_road(images, rig, config.search, config.seed)
            coarse = fitted(found)
            pose = None if coarse is None else coarse.extrinsics
            turn = turn or measure_turn(images, rig, disparities, pose)
            if config.alignment.correct != CORRECT_NOTHING:
                first_row = 0
                if coarse is not None and coarse.clear and row_thinning(rig.height) > 1:
                    # Above the farthest things of a clear road, a turn matters to nothing. In large images,
                    # it takes time.
                    first_row = first_far_row(rig, coarse.extrinsics)
                images, turn = turned_back(images, rig, turn, yaw_rad, first_row)
            surface = find_road_surface(images, rig, found) if config.texture.check else None
        turn = turn or _ROWS_NOT_COMPARED
        first_row = _first_row(surface, rig)
        left, right = (find_stripe_points(image, config.extraction, first_row) for image in images)
        seen = None if surface is None else surface.seen
        road = seen or coarse
        far = None if road is None else fitted(far_disparity(images, rig, road.extrinsics))
        clipped = clipped_share(images)
        told = None
        if turn.points is not None:
            by_rows_rad, std_rad = turn.points.yaw
            told = YawTold(by_rows_rad - yaw_rad, std_rad, ROWS_TELL_YAW_PART)
        frame = cls(
            images,
            (left, right),
            clipped,
            surface,
            far,
            turn,
            yaw_corrected_rad=yaw_rad,
            stamp_difference_s=stamp_difference_s,
        )
        return frame.with_yaw(told, rig)

    def with_yaw(self, told: YawTold | None, rig: StereoRig) -> FrameObservations:
        """Return the observations with something more that tells the yaw of the right camera.

        Args:
            told: The yaw; None where nothing more tells it.
            rig: Intrinsics and baseline.
        """
        all_told = self.yaw_told if told is None else (*self.yaw_told, told)
        left = replace(self, yaw_told=all_told)
        return replace(left, rig_std=self.turn.rig_std(left.yaw_left(rig).rms_rad))

    def yaw_left(self, rig: StereoRig, *, calibrated: bool = True) -> YawTold:
        """Return the yaw of the right camera that is left in the images, by all that tells it.

        Args:
            rig: Intrinsics and baseline.
            calibrated: Whether the prior is that of calibrated pairs; else all angles are equally probable.
        """
        corrected = self.yaw_corrected_rad
        return yaw_posterior(self.yaw_told, self.far, rig, calibrated=calibrated, corrected_rad=corrected)


def _first_row(surface: RoadSurface | None, rig: StereoRig) -> int:
    """Return the first row that may show the road: that of its horizon, where the surface is seen."""
    if surface is None or surface.located is None:
        return 0
    highest = horizon_row(rig, surface.located.extrinsics, [0.0, rig.width - 1.0]).min()
    return int(np.clip(highest - _HORIZON_MARGIN_PX, 0, rig.height // 2))


def clipped_share(images: tuple[Image, Image]) -> float:
    """Return the greatest part of black and white pixels in the lower half of an image, 0 ... 1."""
    lower = (image[image.shape[0] // 2 :: _CLIPPED_STEP, ::_CLIPPED_STEP] for image in images)
    return max(float(np.mean((part == 0) | (part == np.iinfo(np.uint8).max))) for part in lower)


class FoundBy(Enum):
    """How the lines of a hypothesis were found; ``str()`` is a stable snake_case word."""

    ROAD = "road"
    SURFACE = "surface"
    HOUGH = "hough"
    KNOWN = "known"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """An assumption about a frame: which two lines bound the lane, if any, and how they were found.

    Attributes:
        found_by: ``road``: the lines were looked for on the road that its surface shows; ``surface``: that
            road without a pair of lines; ``hough``: points of the whole image have voted for the lines;
            ``known``: they were followed from the frame before.
        pattern: The lines; None for ``surface``.
        other_lines: Lines that both cameras see, those of the pattern included.
        below: How deep another line lies below the plane of the pattern; None where it was not measured.
        texture: The alignment of the road surface on which the lines were looked for; None where they were
            looked for in the whole image.
        yaw_told: The yaw of the right camera by the clearest two of these lines; None without two.
    """

    found_by: FoundBy
    pattern: LanePattern | None
    other_lines: Matches = field(default_factory=lambda: ([], []))
    below: BelowPlane | None = None
    texture: TextureFit | None = None
    yaw_told: YawTold | None = None

    def slim(self) -> Hypothesis:
        """Return the hypothesis without points and lines, which take as much memory as an image."""
        return Hypothesis(self.found_by, None)


@dataclass(frozen=True, slots=True, eq=False)
class Contradictor:
    """A pose over the road surface that excludes lines whose pose differs too much.

    Attributes:
        extrinsics: The pose.
        covariance: (3, 3) of its difference from the pose by the lines.
    """

    extrinsics: Extrinsics
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Results of the stages so far; None where a stage has not run, or has given up.

    Attributes:
        config: Settings.
        genetic: Pose of the greatest fitness, by the genetic algorithm, or from the closed form where lines
            were followed; None where the pose is estimated from the surface alone.
        fitness: Its fitness.
        misfit_px: Misfit of the lines under it.
        below: How deep another line that both cameras see lies below the plane of the pattern.
        bends: Curvatures of the lines.
        lines: Fit of a flat road to the lines.
        refined: Fit of the stripes' grey values.
        profile: Heights of the road along the stripes, over the plane of that fit.
        wide_profile: The same, with edges that are too far off to be measured well. Where it shows another
            slope ahead, there is one, at least of that size.
        clipped: Greatest part of clipped pixels in the lower half of an image.
        texture_sufficiency: Texture of the road surface over what a check of the lines needs; None where such
            a check is not required.
        texture: The alignment of the road surface, where it can check the lines.
        surface_heights: Heights of all lines over that surface.
        lane_heights: Heights of the two boundaries over the surface between them alone.
        rows: Pitch and roll of the right camera by the rows of both images; None where they were corrected.
        borders: Grey values between the boundaries and the lane; empty where the texture checks the lines.
        stripes_fitted: Whether the stripes' grey values could be fitted; None where the texture checks the
            lines.
        inner_line_height: Height of a line between the boundaries over their plane.
        std: (3,) standard deviations of the estimate [m, rad, rad].
        contradictors: What else shows the road, and excludes lines that differ too much from it.
        kerb_heights: Heights of the plane of the surface over that of the own lane alone, at its two sides:
            they have to exclude a kerb.
        own_strip: The alignment of the strip under the car alone.
        coarse: Plane of the dense disparities, for an estimate that rests on the lines alone.
        sweeps: Planes under which the faintest texture and the tracks between the lines agree, for such an
            estimate.
        lateness: The way of the car between both images; None where the road does not tell it.
        most_way_m: The way that makes a height wrong [m].
        yaw: Yaw of the right camera that is left in the images.
        wrong_yaw_rad: The yaw that makes a pose over the road surface wrong.
    """

    config: CalibratorConfig
    genetic: Extrinsics | None = None
    fitness: float = 0.0
    misfit_px: float = 0.0
    below: BelowPlane | None = None
    bends: Bends | None = None
    lines: LineFit | None = None
    refined: StripeFit | None = None
    profile: Profile | None = None
    wide_profile: Profile | None = None
    clipped: float | None = None
    texture_sufficiency: float | None = None
    texture: TextureFit | None = None
    surface_heights: tuple[HeightOverLane, ...] = ()
    lane_heights: tuple[HeightOverLane, ...] = ()
    rows: CameraTurn | None = None
    borders: tuple[StripeBorder, ...] = ()
    stripes_fitted: bool | None = None
    inner_line_height: HeightOverLane | None = None
    std: Array | None = None
    contradictors: tuple[Contradictor, ...] = ()
    kerb_heights: tuple[HeightOverLane, ...] = ()
    own_strip: TextureFit | None = None
    coarse: CoarseRoad | None = None
    sweeps: tuple[LaneSweep, ...] = ()
    lateness: Lateness | None = None
    most_way_m: float = math.inf
    yaw: YawTold | None = None
    wrong_yaw_rad: float = math.inf

    @property
    def line_pose(self) -> Extrinsics | None:
        """The best pose from lines so far."""
        return self.genetic if self.refined is None else self.refined.extrinsics
