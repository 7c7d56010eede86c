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

"""Reasons to refuse a frame before there is an estimate: its images, its lines, their matches.

The conditions that an estimate has to meet are in `core.evidence.gates`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..geometry.homography import SIDES
from ..rejection import Bound, Rejection, RejectReason
from .lane_pair import ImageLine
from .matching import Candidate, MatchedLines

# The widest filter of the extraction spans 33 px; in smaller images it finds nothing.
_MIN_IMAGE_PX = 64
_GREY_BITS = 8

FIND_LINES = "drive on a straight road with painted lines on both sides of the camera, lens clean"


def check_images(left: Any, right: Any, rig: StereoRig) -> Rejection | None:
    """Refuse anything but two 8-bit grey images of the rig's size."""
    for side, image in (("left", left), ("right", right)):
        refusal = _check_array(side, image)
        if refusal is not None:
            return refusal
    if left.shape != right.shape:
        return Rejection(
            RejectReason.IMAGE_SIZES_DIFFER,
            f"the left image is {_size(left.shape)}, the right image is {_size(right.shape)}: "
            "they differ by {value}",
            float(np.abs(np.subtract(left.shape, right.shape)).max()),
            Bound.MOST,
            0,
            "px",
            "set both cameras to one size",
        )
    if left.shape != (rig.height, rig.width):
        return Rejection(
            RejectReason.RIG_SIZE_MISMATCH,
            f"the images are {_size(left.shape)}, the rig is {rig.width} x {rig.height}: "
            "they differ by {value}",
            float(np.abs(np.subtract(left.shape, (rig.height, rig.width))).max()),
            Bound.MOST,
            0,
            "px",
            "use the rig (CameraInfo) of these images",
        )
    if min(left.shape) < _MIN_IMAGE_PX:
        return Rejection(
            RejectReason.IMAGE_EMPTY,
            "the shorter side of the images has {value}",
            min(left.shape),
            Bound.LEAST,
            _MIN_IMAGE_PX,
            "px",
            "use larger images",
        )
    return None


def _check_array(side: str, image: Any) -> Rejection | None:
    """Refuse an image that is no 2-D uint8 array with a grey value for each pixel."""
    if image is None or (isinstance(image, np.ndarray) and image.size == 0):
        return Rejection(
            RejectReason.IMAGE_EMPTY,
            f"the {side} image is empty: it has {{value}}",
            0,
            Bound.LEAST,
            1,
            "px",
            "check the camera driver",
        )
    if isinstance(image, np.ma.MaskedArray):
        return Rejection(
            RejectReason.IMAGE_TYPE,
            f"the {side} image is a masked array: {{value}} of {{limit}} grey values are known",
            int(np.ma.count(image)),
            Bound.LEAST,
            image.size,
            "",
            "give a plain array, with a grey value for each pixel",
        )
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        array = isinstance(image, np.ndarray)
        found = f"{image.dtype} of shape {image.shape}" if array else type(image)
        flat = array and image.ndim == 2
        return Rejection(
            RejectReason.IMAGE_TYPE,
            f"the {side} image is {found}, not 2-D uint8: it has {{value}} "
            + ("bits per grey value" if flat else "dimensions"),
            _bits(image.dtype) if flat else np.ndim(image) if array else 0,
            Bound.EXACTLY,
            _GREY_BITS if flat else 2,
            "",
            "convert it to 8-bit grey first",
        )
    return None


def check_lines_found(
    candidates: list[tuple[list[Candidate], list[Candidate]]], config: CalibratorConfig
) -> Rejection | None:
    """Refuse a frame in which an image shows no line on one side."""
    least = config.extraction.min_line_rows
    longest = [
        [max((candidate.line.length_px for candidate in lines), default=0.0) for lines in sides]
        for sides in candidates
    ]
    if max(max(sides) for sides in longest) < least:
        found = "no lane line was found in either image"
        return _no_line(found, max(max(sides) for sides in longest), least)
    for camera, sides in enumerate(longest):
        for side, length in enumerate(sides):
            if length < least:
                found = f"no {SIDES[side]} lane line was found in the {SIDES[camera]} image"
                if all(each[1 - side] >= least for each in longest):
                    found = f"only a {SIDES[1 - side]} lane line was found, and {found}"
                return _no_line(found, length, least)
    return None


def _no_line(found: str, longest: float, least: int) -> Rejection:
    return Rejection(
        RejectReason.NO_LINES_FOUND,
        f"{found}: the longest candidate is {{value}} long",
        round(longest),
        Bound.LEAST,
        least,
        "px",
        FIND_LINES,
    )


def line_not_in_both(n_matched: tuple[int, int], n_exchanged: tuple[int, int]) -> Rejection:
    """Refuse lines of which at most one side is in both images.

    Args:
        n_matched: How many left and how many right lane lines were found in both images.
        n_exchanged: The same with the left and the right image exchanged.
    """
    n_sides, n_other = (sum(n > 0 for n in each) for each in (n_matched, n_exchanged))
    if n_sides == 1:
        side = SIDES[0] if n_matched[0] else SIDES[1]
        what = f"only a {side} lane line was found in both images, {{value}} of {{limit}}"
    else:
        what = "no line of the left image was found in the right one: {value} of {limit} lane lines"
    if n_other <= n_sides:
        return Rejection(RejectReason.NO_LINES_FOUND, what, n_sides, Bound.LEAST, 2, "", FIND_LINES)
    exchanged = f"with left and right exchanged, {n_other} of 2 are in both"
    return Rejection(
        RejectReason.LINES_NOT_MATCHED,
        f"{what}; {exchanged}",
        n_sides,
        Bound.LEAST,
        2,
        "",
        f"check that left and right are not swapped and the images are rectified, and {FIND_LINES}",
    )


def lines_not_matched(roll_max_rad: float) -> Rejection:
    """Refuse lines on both sides, seen by both cameras, of which no two can bound one lane.

    Args:
        roll_max_rad: Greatest roll that is searched [rad].
    """
    what = (
        "{value} of {limit} lane lines were found: no two lines that are in both images can bound one "
        f"lane on a road whose roll is at most {math.degrees(roll_max_rad):.4g} deg (search.roll_max_rad)"
    )
    remedy = f"{FIND_LINES}; if both images show these lines well, check that they are rectified"
    return Rejection(RejectReason.LINES_NOT_MATCHED, what, 0, Bound.LEAST, 2, "", remedy)


def no_pair_on_road(n_left: int, n_right: int) -> Rejection:
    """Refuse lines of which no two lie on the road surface and are parallel.

    Args:
        n_left: Number of lines on the road to the left.
        n_right: Number of lines on the road to the right.
    """
    n_sides = (n_left > 0) + (n_right > 0)
    if n_sides == 2:
        what = (
            "no two of the lines on the road surface are parallel: {value} of {limit} lane lines were found"
        )
        n_sides = 0
    elif n_sides == 1:
        side = SIDES[0] if n_left else SIDES[1]
        what = f"only a {side} lane line was found on the road surface, {{value}} of {{limit}}"
    else:
        what = "no lane line was found on the road surface: {value} of {limit}"
    return Rejection(RejectReason.NO_LINES_FOUND, what, n_sides, Bound.LEAST, 2, "", FIND_LINES)


def cameras_swapped(pairs: list[MatchedLines]) -> Rejection:
    """Refuse images whose lines match only when the left and the right image are exchanged.

    Args:
        pairs: Pairs of lane boundaries of the exchanged images, best first.
    """
    best = pairs[0]
    disparities = [a.column_at(np.array(a.v_mid)) - b.column_at(np.array(a.v_mid)) for a, b in _pairs(best)]
    return _exchanged("lane lines", -float(np.mean(disparities)))


def exchanged_by_disparity(disparity_px: float) -> Rejection:
    """Refuse images whose near part has a negative disparity.

    Args:
        disparity_px: Mean disparity of the lower part of the images [px].
    """
    return _exchanged("lower part of the images", disparity_px)


def _exchanged(what: str, disparity_px: float) -> Rejection:
    return Rejection(
        RejectReason.CAMERAS_SWAPPED,
        f"the left and the right image are exchanged: the disparity of the {what} is {{value}}",
        disparity_px,
        Bound.LEAST,
        0.0,
        "px",
        "exchange the topics, or the order of the cameras in their calibration; where P[3] of a CameraInfo "
        "is positive, its sign is wrong instead",
    )


def _pairs(lines: MatchedLines) -> list[tuple[ImageLine, ImageLine]]:
    return list(zip(lines.left, lines.right, strict=True))


def lines_too_short(config: CalibratorConfig) -> Rejection:
    """Refuse lines that are seen in too few rows below the vanishing point."""
    return Rejection(
        RejectReason.NO_LINES_FOUND,
        "a lane line is seen in too few rows below the horizon: {value}",
        0,
        Bound.LEAST,
        config.extraction.min_line_rows,
        "px",
        FIND_LINES,
    )


def check_converging(matched: MatchedLines) -> Rejection | None:
    """Refuse lines whose vanishing point lies above the image."""
    row = float(matched.vanishing_point[1])
    if row >= 0.0:
        return None
    return Rejection(
        RejectReason.LINES_NOT_CONVERGING,
        "the lane lines meet above the image: the row of their vanishing point, counted from the top of the "
        "image, is {value}",
        row,
        Bound.LEAST,
        0.0,
        "px",
        "the horizon must be in view: pitch the camera up, or " + FIND_LINES,
    )


def no_frames() -> Rejection:
    """Refuse an estimate without any frame."""
    return Rejection(RejectReason.NO_FRAMES, "frames", 0, Bound.LEAST, 1, "", "add a stereo frame first")


def _bits(dtype: np.dtype[Any]) -> int:
    """Return how many bits of a type can hold a grey value: 1 of bool, and all but the sign of int8."""
    if dtype == np.bool_:
        return 1
    return 8 * dtype.itemsize - (dtype == np.int8)


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"
