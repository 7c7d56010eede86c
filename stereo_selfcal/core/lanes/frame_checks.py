"""Reasons to refuse a frame before there is an estimate: images, lines, matches.

More: `core.evidence.gates`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..rejection import Rejection, RejectReason
from .lane_pair import ImageLine
from .matching import Candidate, MatchedLines

# The widest filter of the extraction spans 33 px; nothing can be found in less.
_MIN_IMAGE_PX = 64

_FIND_LINES = "drive on a straight road with painted lines on both sides of the camera, lens clean"


def check_images(left: Any, right: Any, rig: StereoRig) -> Rejection | None:
    """Refuse what is no pair of grey images of the rig's size."""
    for side, image in (("left", left), ("right", right)):
        if image is None or (isinstance(image, np.ndarray) and image.size == 0):
            return Rejection(
                RejectReason.IMAGE_EMPTY, f"pixels of the {side} image", 0, 1, "px", "check the camera driver"
            )
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
            array = isinstance(image, np.ndarray)
            found = f"{image.dtype} of shape {image.shape}" if array else type(image)
            flat = array and image.ndim == 2
            return Rejection(
                RejectReason.IMAGE_TYPE,
                f"the {side} image is {found}, not 2-D uint8; its {'bits a pixel' if flat else 'dimensions'}",
                8 * image.itemsize if flat else np.ndim(image) if array else 0,
                8 if flat else 2,
                "",
                "convert it to 8-bit grey first",
            )
    if left.shape != right.shape:
        return Rejection(
            RejectReason.IMAGE_SIZES_DIFFER,
            f"left image is {_size(left.shape)}, right image is {_size(right.shape)}; difference",
            float(np.abs(np.subtract(left.shape, right.shape)).max()),
            0,
            "px",
            "set both cameras to one size",
        )
    if left.shape != (rig.height, rig.width):
        return Rejection(
            RejectReason.RIG_SIZE_MISMATCH,
            f"images are {_size(left.shape)}, the rig is {rig.width} x {rig.height}; difference",
            float(np.abs(np.subtract(left.shape, (rig.height, rig.width))).max()),
            0,
            "px",
            "use the rig (CameraInfo) of these images",
        )
    if min(left.shape) < _MIN_IMAGE_PX:
        return Rejection(
            RejectReason.IMAGE_EMPTY,
            "shorter side of the images",
            min(left.shape),
            _MIN_IMAGE_PX,
            "px",
            "use larger images",
        )
    return None


def check_lines_found(
    candidates: list[tuple[list[Candidate], list[Candidate]]], config: CalibratorConfig
) -> Rejection | None:
    """Refuse a frame in which a camera sees no line on one side."""
    for camera, sides in zip(("left", "right"), candidates, strict=True):
        for side, lines in zip(("left", "right"), sides, strict=True):
            longest = max((candidate.line.n_rows for candidate in lines), default=0)
            if longest < config.extraction.min_line_rows:
                return Rejection(
                    RejectReason.NO_LINES_FOUND,
                    f"no two lines found: rows of the longest {side} lane boundary in the {camera} image",
                    longest,
                    config.extraction.min_line_rows,
                    "px",
                    _FIND_LINES,
                )
    return None


def lines_not_matched(n_matched: tuple[int, int]) -> Rejection:
    """Refuse lines that the two cameras do not see alike."""
    if all(n_matched):
        what = (
            "no two of the lines both cameras see can bound one lane on a road rolled by less than search.*"
        )
    else:
        what = "lane boundaries that both cameras see, of the two sides"
    return Rejection(
        RejectReason.LINES_NOT_MATCHED,
        what,
        sum(n > 0 for n in n_matched) if not all(n_matched) else 0,
        2,
        "",
        f"check that left and right are not swapped and the images are rectified, and {_FIND_LINES}",
    )


def cameras_swapped(pairs: list[MatchedLines]) -> Rejection:
    """Refuse images whose lines match with the cameras exchanged, and only then.

    Args:
        pairs: Pairs of lane boundaries of the exchanged images, best first.
    """
    best = pairs[0]
    disparities = [a.column_at(np.array(a.v_mid)) - b.column_at(np.array(a.v_mid)) for a, b in _both(best)]
    return Rejection(
        RejectReason.CAMERAS_SWAPPED,
        "the left and the right image are exchanged: disparity of the lane lines",
        -float(np.mean(disparities)),
        0.0,
        "px",
        "exchange the topics, or the order of the cameras in their calibration",
    )


def _both(lines: MatchedLines) -> list[tuple[ImageLine, ImageLine]]:
    return list(zip(lines.left, lines.right, strict=True))


def lines_too_short(config: CalibratorConfig) -> Rejection:
    """Refuse lines of which too little lies below the vanishing point."""
    return Rejection(
        RejectReason.NO_LINES_FOUND,
        "no two lines found: one of them is seen below the horizon in too few rows",
        0,
        config.extraction.min_line_rows,
        "px",
        _FIND_LINES,
    )


def check_converging(matched: MatchedLines) -> Rejection | None:
    """Refuse lines that do not meet below the top of the image."""
    row = float(matched.vanishing_point[1])
    if row >= 0.0:
        return None
    return Rejection(
        RejectReason.LINES_NOT_CONVERGING,
        "row where the lane lines meet, counted from the top of the image",
        row,
        0.0,
        "px",
        "the horizon must be in view: pitch the camera up, or " + _FIND_LINES,
    )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"
