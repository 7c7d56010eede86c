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

"""Why a frame was refused, as far as its images themselves show it: the cause in place of the consequence.

Lines that are not found, not matched or contradict each other have many causes. Two of them are seen in the
images. Both cameras see the same scene with the same lens, so where one image differs grossly from the other,
it is that camera: its exposure, its focus, its cover. And where images show the lines of a road when they are
turned by 180 degrees, they are upside down. Only frames that were refused are diagnosed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..evidence.frame_evidence import FrameObservations
from ..evidence.synchronisation import Lateness, lateness_of_rows, measure_lateness
from ..geometry.homography import SIDES
from ..lanes.closed_form import solve_plane
from ..lanes.detector import detect_by_hough
from ..lanes.frame_checks import FIND_LINES, exchanged_by_disparity
from ..lanes.hypotheses import LaneHypotheses, find_hypotheses
from ..lanes.lane_pair import ImageLine, LanePattern
from ..lanes.stripe_points import find_stripe_points
from ..rejection import Bound, NotFitted, Rejection, RejectReason
from ..types import Array, Image
from .attempt import Attempt
from .both_images import BothImages, Relation, same_picture

# Refusals that say that the lines of both images do not fit each other, or that there are none.
_OF_LINES = (
    RejectReason.NO_LINES_FOUND,
    RejectReason.ROAD_NOT_SEEN,
    RejectReason.LINES_NOT_MATCHED,
    RejectReason.LINES_INCONSISTENT,
    RejectReason.LINES_NOT_CONVERGING,
    RejectReason.LINE_NOT_PAINTED,
    RejectReason.STAGES_DISAGREE,
    RejectReason.FITNESS_TOO_LOW,
    RejectReason.IMAGES_NOT_RECTIFIED,
    RejectReason.TEXTURE_DISAGREES,
    RejectReason.ESTIMATE_UNCERTAIN,
)
_OF_MISSING_LINES = (
    RejectReason.NO_LINES_FOUND,
    RejectReason.ROAD_NOT_SEEN,
    RejectReason.LINES_NOT_MATCHED,
    RejectReason.LINES_NOT_CONVERGING,
)

# Exposures that are set together differ by a quarter (`core.lanes.matching`); a third is no such difference.
_LEAST_BRIGHTNESS = 1 / 3
# A lens that is covered or fogged leaves less than a fifth of the contrast.
_LEAST_CONTRAST = 1 / 5
# Share of white pixels of an image, and of its paint, beyond that of the other image. A gain that clips paint
# moves its edges; rims and noise leave a few of a hundred pixels white.
_MOST_WHITE, _MOST_WHITE_PAINT = 0.25, 0.25
# An overexposed image is brighter as a whole. Where it is not, each camera has found other lines.
_LEAST_BRIGHTER = 1.1
_WHITE_GREY = 250  # noise makes clipping visible a few grey levels below 255
# Steepness of the edges of an image, over that of the other one. A blur of 2 px halves it; of 211 recorded
# and rendered pairs, the least was 0.70.
_LEAST_STEEPNESS = 0.6
_NEAR_PX, _FAR_PX = 1, 16  # an edge rises over a pixel or two; over 16 px, all of its contrast is there
_EDGE_PERCENTILE = 99.8  # of the differences of grey values: those of the edges of two stripes
_MOST_EDGES = 1.25  # contrast of the edges of an image over that of the other one, by different gains
_LEAST_EDGE_GREY = 8.0  # an image without edges has no steepness
_LEAST_MEAN_GREY = 6.0  # where the brighter image is darker, it is night, and no camera is at fault


@dataclass(frozen=True, slots=True)
class _Look:
    """What tells the image of one camera from that of the other.

    Attributes:
        mean: Mean grey value.
        contrast: Standard deviation of the grey values.
        white: Share of white pixels in the lower half.
        paint: Share of white pixels on the lines; 0 without lines.
        edges: Contrast of its edges [grey levels].
        steepness: Rise of its edges over a pixel, as a part of their contrast.
    """

    mean: float
    contrast: float
    white: float
    paint: float
    edges: float
    steepness: float


def diagnose(
    rejection: Rejection,
    found: LaneHypotheses,
    pattern: LanePattern | None,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> Rejection:
    """Return the cause of a refusal where the images show it, else the refusal itself.

    Args:
        rejection: The refusal.
        found: The lines of the frame.
        pattern: The pair of lines that was refused, None where there is none.
        frame: Images and stripe points.
        rig: Intrinsics and baseline.
        config: Settings.
    """
    if rejection.reason not in _OF_LINES:
        return rejection
    of_cameras = _lines_of_cameras(found, pattern)
    looks = [_look(image, lines) for image, lines in zip(frame.images, of_cameras, strict=True)]
    for check in (_dark, _flat, _white, _blurred):
        for camera, side in enumerate(SIDES):
            cause = check(side, looks[camera], looks[1 - camera])
            if cause is not None:
                return cause
    view = BothImages.of(frame.images)
    cause = same_picture(frame.images, rig, config) or _one_changed(view, frame, rig, config)
    if cause is not None:
        return cause
    if rejection.reason in _OF_MISSING_LINES:
        cause = _exchanged_or_upside_down(view, found, frame, rig, config)
    return cause or rejection


def lateness_of_refused(
    rejection: Rejection, attempt: Attempt | None, frame: FrameObservations, rig: StereoRig
) -> Lateness | None:
    """Return the way of the car between the images of a refused frame; None where nothing tells it.

    The road tells it, and where it does not, the rows of points all over the images: they need no road.

    Args:
        rejection: The refusal.
        attempt: The attempt that was refused, None without one.
        frame: Images, and what is known of them without a hypothesis.
        rig: Intrinsics and baseline.
    """
    late = None if attempt is None else attempt.lateness
    if rejection.reason not in _OF_LINES:
        return late
    if late is None and attempt is not None:
        pose = attempt.poses.by_lines or attempt.poses.textured
        late = None if pose is None else measure_lateness(frame.images, rig, pose, None)
    if late is not None and late.surely:
        return late
    # Lenses that are not known move rows as well.
    rectified = rejection.reason is not RejectReason.IMAGES_NOT_RECTIFIED
    by_rows = lateness_of_rows(frame.turn.landmarks, rig) if rectified else None
    return late if by_rows is None else by_rows


def not_synchronised(rejection: Rejection, late: Lateness | None) -> Rejection:
    """Return that the images are not of one moment, where that is sure, else the refusal itself.

    Args:
        rejection: The refusal.
        late: The way of the car between both images.
    """
    if late is None or not late.surely or rejection.reason not in _OF_LINES:
        return rejection
    return late.refusal()


def _exchanged_or_upside_down(
    view: BothImages,
    found: LaneHypotheses,
    frame: FrameObservations,
    rig: StereoRig,
    config: CalibratorConfig,
) -> Rejection | None:
    """Return the refusal of images that are exchanged, or both upside down."""
    if view.exchanged:
        return exchanged_by_disparity(view.disparity_px(rig))
    # Where a line of both images is one of a road as they are, nothing hangs upside down; nor where what is
    # below is nearer than what is above.
    if any(found.matches) or view.nearer_below:
        return None
    return _both_upside_down(frame, rig, config)


def _lines_of_cameras(found: LaneHypotheses, pattern: LanePattern | None) -> list[list[ImageLine]]:
    """Return the lines of the left and of the right camera: those of the pattern, or the clearest ones."""
    if pattern is not None:
        return [list(pattern.left), list(pattern.right)]
    return [
        [max(side, key=lambda each: each.votes).line for side in camera if side]
        for camera in found.candidates
    ]


def _look(image: Image, lines: list[ImageLine]) -> _Look:
    smooth = cv2.blur(image, (1, 3))  # along the columns: less noise, the same edges
    near, far = (
        _percentile(cv2.absdiff(smooth[:, reach:], smooth[:, :-reach]), _EDGE_PERCENTILE)
        for reach in (_NEAR_PX, _FAR_PX)
    )
    mean, std = (float(each[0, 0]) for each in cv2.meanStdDev(image))
    on_paint = np.concatenate([_paint_of(image, line) for line in lines]) if lines else np.zeros(1)
    return _Look(
        mean=mean,
        contrast=std,
        white=float(np.mean(image[image.shape[0] // 2 :] >= _WHITE_GREY)),
        paint=float(np.mean(on_paint >= _WHITE_GREY)),
        edges=far,
        steepness=near / max(far, _LEAST_EDGE_GREY),
    )


def _percentile(image: npt.NDArray[Any], percent: float) -> float:
    """Return a percentile of the grey values of an image (uint8), interpolated linearly."""
    # By counting: sorting half a million values takes ten times as long.
    below = np.cumsum(cv2.calcHist([image], [0], None, [256], [0.0, 256.0]), dtype=np.float64)
    position = (image.size - 1) * percent / 100.0
    first = int(position)
    lower, upper = (int(np.searchsorted(below, each, side="right")) for each in (first, first + 1))
    return lower + (upper - lower) * (position - first)


def _paint_of(image: Image, line: ImageLine) -> Array:
    """Return the grey values in the middle of a stripe, in the rows where it was seen."""
    rows = np.clip(np.rint(line.rows), 0, image.shape[0] - 1).astype(np.intp)
    columns = np.clip(np.rint(line.columns + line.width_px / 2.0), 0, image.shape[1] - 1).astype(np.intp)
    return image[rows, columns].astype(np.float64)


def _dark(side: str, own: _Look, other: _Look) -> Rejection | None:
    limit = _LEAST_BRIGHTNESS * other.mean
    if own.mean >= limit or other.mean < _LEAST_MEAN_GREY:
        return None
    return Rejection(
        RejectReason.IMAGE_EXPOSURE,
        f"the {side} image is darker than the other one: its mean grey value is {{value}}, a third of the "
        "other's is {limit}",
        own.mean,
        Bound.LEAST,
        limit,
        "",
        f"uncover the {side} camera, or set both cameras to one exposure",
    )


def _flat(side: str, own: _Look, other: _Look) -> Rejection | None:
    limit = _LEAST_CONTRAST * other.contrast
    if own.contrast >= limit or other.contrast < _LEAST_EDGE_GREY:
        return None
    return Rejection(
        RejectReason.IMAGE_EXPOSURE,
        f"the {side} image shows almost nothing: its grey values have a standard deviation of {{value}}, a "
        "fifth of the other's is {limit}",
        own.contrast,
        Bound.LEAST,
        limit,
        "",
        f"uncover and clean the {side} camera, and check its exposure and its driver",
    )


def _white(side: str, own: _Look, other: _Look) -> Rejection | None:
    if own.mean < _LEAST_BRIGHTER * other.mean:
        return None
    for what, value, least, most in (
        ("image", own.white, other.white, _MOST_WHITE),
        ("image's paint of the lane lines", own.paint, other.paint, _MOST_WHITE_PAINT),
    ):
        if value > least + most:
            return Rejection(
                RejectReason.IMAGE_EXPOSURE,
                f"the {side} camera is overexposed: of the {side} {what}, {{value}} is white, of the other "
                f"one's {100 * least:.2g} %",
                100 * value,
                Bound.MOST,
                100 * (least + most),
                "%",
                "set both cameras to one exposure that does not clip paint",
            )
    return None


def _blurred(side: str, own: _Look, other: _Look) -> Rejection | None:
    # A blur raises the contrast of no edge. Where it is higher, this camera sees what the other one does not.
    if own.edges < _LEAST_EDGE_GREY or own.edges > _MOST_EDGES * other.edges:
        return None
    limit = _LEAST_STEEPNESS * other.steepness
    if own.steepness >= limit:
        return None
    return Rejection(
        RejectReason.IMAGE_BLURRED,
        f"the {side} image is more blurred than the other one: its edges rise from pixel to pixel by "
        "{value} of their contrast, 0.6 of the other's is {limit}",
        own.steepness,
        Bound.LEAST,
        limit,
        "",
        f"focus and clean the lens of the {side} camera, or shorten its exposure",
    )


def _may_be_a_road(pattern: LanePattern, rig: StereoRig, config: CalibratorConfig) -> bool:
    """Whether the plane through two lines is that of a road in the search space."""
    closed = solve_plane(pattern, rig)
    if isinstance(closed, NotFitted):
        return False
    lower, upper = config.search.bounds()
    pose = closed.extrinsics.as_array()
    return bool(np.all((np.array(lower) < pose) & (pose < np.array(upper))))


def _both_upside_down(frame: FrameObservations, rig: StereoRig, config: CalibratorConfig) -> Rejection | None:
    """Return the refusal of images that show the lines of a road when both are turned by 180 degrees."""
    # Most refused frames show no lines that way either: one image is enough to see that.
    images = Relation.TURNED.applied_to(frame.images[0]), Relation.TURNED.applied_to(frame.images[1])
    left = find_stripe_points(images[0], config.extraction)
    if not all(detect_by_hough(left, images[0])):
        return None
    points = left, find_stripe_points(images[1], config.extraction)
    # A principal point at the border of the image stays there.
    rig = replace(rig, cx=max(rig.width - 1 - rig.cx, 0.0), cy=max(rig.height - 1 - rig.cy, 0.0))
    both = "turn both images by 180 deg"
    for first, remedy in (
        (1, f"{both} and exchange left and right (or flip both back, if flipped)"),
        (0, both),
    ):
        order = [first, 1 - first]
        found = find_hypotheses(
            (points[order[0]], points[order[1]]), (images[order[0]], images[order[1]]), rig, config
        )
        if isinstance(found.patterns, list):
            is_road = _may_be_a_road(found.patterns[0], rig, config)
            return _upside_down("both images are", remedy) if is_road else None
        if found.patterns.rejection.reason is not RejectReason.CAMERAS_SWAPPED:
            return None
    return None


def _one_changed(
    view: BothImages, frame: FrameObservations, rig: StereoRig, config: CalibratorConfig
) -> Rejection | None:
    """Return the refusal of images of which one is mirrored, flipped or turned against the other one."""
    if view.relation is Relation.AS_IT_IS:
        return None
    side = None
    for camera, name in enumerate(SIDES):
        images = tuple(
            view.relation.applied_to(image) if index == camera else image
            for index, image in enumerate(frame.images)
        )
        points = tuple(
            find_stripe_points(image, config.extraction) if index == camera else frame.points[index]
            for index, image in enumerate(images)
        )
        found = find_hypotheses((points[0], points[1]), (images[0], images[1]), rig, config)
        if isinstance(found.patterns, list) and _may_be_a_road(found.patterns[0], rig, config):
            side = name
            break
    if view.relation is not Relation.TURNED:
        return view.mirrored(side)
    which = "one image is" if side is None else f"the {side} image is"
    return _upside_down(which, f"turn {'it' if side is None else f'the {side} image'} by 180 deg")


def _upside_down(which: str, remedy: str) -> Rejection:
    return Rejection(
        RejectReason.IMAGES_UPSIDE_DOWN,
        f"{which} upside down: as they are, {{value}} of {{limit}} lane lines are found, turned both",
        0,
        Bound.LEAST,
        2,
        "",
        f"{remedy}, with a CameraInfo of these images; or, where nothing hangs upside down, {FIND_LINES}",
    )
