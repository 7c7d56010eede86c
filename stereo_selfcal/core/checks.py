"""Every reason to refuse a frame: what is measured, against which limit, and what helps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .combination import MAX_DIFFERENCE, MAX_LINE_HEIGHT_M
from .config import CalibratorConfig
from .extrinsics import Array, Extrinsics
from .matching import Candidate, MatchedLines
from .results import Rejection, RejectReason
from .rig import StereoRig
from .texture import TextureFit
from .uncertainty import LineFit

# The widest filter of the extraction spans 33 px; nothing can be found in less.
_MIN_IMAGE_PX = 64

# An estimate this close to a side of the search box, as a fraction of its length, has been
# stopped by it: the genetic algorithm ends with its whole population within 1e-7.
_EDGE_FRACTION = 1e-3

# A curvature counts when it is this many standard deviations from straight: one false alarm
# in 15 000 frames for normal errors.
_CURVATURE_SIGMAS = 4.0

# The pixels of a line weigh as the slope of the road 8 m ahead does: with this radius, it differs by 0.25 deg
# there, which is what stripes and asphalt have to agree within.
_MIN_VERTICAL_RADIUS_M = 1800.0

# Lines of one rectified pair over any flat road agree within their standard deviations, which
# real roads exceed up to five times (edges are not straight to a hundredth of a pixel). A right camera
# turned by 0.02 rad about its axis gives 37, a vertical offset of a quarter of a pixel 21.
_MAX_MISFIT_SIGMAS = 10.0

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


def check_inside(extrinsics: Extrinsics, config: CalibratorConfig) -> Rejection | None:
    """Refuse an estimate that the border of the search space has stopped."""
    search = config.search
    checks = (
        ("height", extrinsics.height_m, search.height_min_m, search.height_max_m, "m"),
        ("pitch", extrinsics.pitch_rad, -search.pitch_max_rad, search.pitch_max_rad, "deg"),
        ("roll", extrinsics.roll_rad, -search.roll_max_rad, search.roll_max_rad, "deg"),
    )
    for name, value, low, high, unit in checks:
        nearest = low if value - low < high - value else high
        if abs(value - nearest) <= _EDGE_FRACTION * (high - low):
            scale = 1.0 if unit == "m" else math.degrees(1.0)
            return Rejection(
                RejectReason.SEARCH_SPACE_EDGE,
                f"best {name} is at the edge of the search space",
                value * scale,
                nearest * scale,
                unit,
                f"widen search.* if the camera is mounted like that, else {_FIND_LINES}",
            )
    return None


def check_fitness(fitness: float, misfit_px: float, config: CalibratorConfig) -> Rejection | None:
    """Refuse lines that fit no pose of the rig over a plane."""
    limit_px = config.fitness.max_misfit_px
    threshold = 1.0 / (limit_px**2 + config.fitness.k)
    if fitness >= threshold:
        return None
    return Rejection(
        RejectReason.FITNESS_TOO_LOW,
        f"best fitness (the lines miss every road plane by {misfit_px:.2f} px, limit {limit_px:g} px)",
        fitness,
        threshold,
        "",
        f"the lines may not be parallel or not lie in one plane: {_FIND_LINES}",
    )


def check_straight(curvature_per_m: float, std_per_m: float, config: CalibratorConfig) -> Rejection | None:
    """Refuse lane lines that bend."""
    limit = 1.0 / config.extraction.min_radius_m
    if abs(curvature_per_m) <= max(limit, _CURVATURE_SIGMAS * std_per_m):
        return None
    return Rejection(
        RejectReason.LINES_NOT_STRAIGHT,
        f"the lane lines bend to the {'left' if curvature_per_m > 0 else 'right'}, radius",
        1.0 / abs(curvature_per_m),
        config.extraction.min_radius_m,
        "m",
        "calibrate on a straight road",
    )


def check_flat(curvature_per_m: float, std_per_m: float) -> Rejection | None:
    """Refuse a road that rises or falls more and more: a crest, a dip."""
    if abs(curvature_per_m) <= max(1.0 / _MIN_VERTICAL_RADIUS_M, _CURVATURE_SIGMAS * std_per_m):
        return None
    return Rejection(
        RejectReason.ROAD_NOT_FLAT,
        f"the road goes over a {'dip' if curvature_per_m > 0 else 'crest'}, radius",
        1.0 / abs(curvature_per_m),
        _MIN_VERTICAL_RADIUS_M,
        "m",
        "calibrate where the slope does not change",
    )


def check_consistent(fit: LineFit | None) -> Rejection | None:
    """Refuse four lines that no road explains: the cameras contradict each other."""
    if fit is None or fit.misfit_sigmas <= _MAX_MISFIT_SIGMAS:
        return None
    return Rejection(
        RejectReason.LINES_INCONSISTENT,
        "the lines of the two cameras contradict each other whatever the road, by",
        fit.misfit_sigmas,
        _MAX_MISFIT_SIGMAS,
        "standard deviations",
        "check that the images are rectified: a row of one must be the same row of the other",
    )


def check_texture(lines: Extrinsics, texture: TextureFit, heights_m: Array) -> Rejection | None:
    """Refuse lines that do not lie in the plane of the asphalt between them: a kerb, another lane's.

    Args:
        lines: Estimate from the lines.
        texture: The asphalt.
        heights_m: (L,) heights of the lines over it, where they were seen [m].
    """
    difference = np.abs(lines.as_array() - texture.extrinsics.as_array())
    names = ("height", "pitch", "roll", "height of a line over the asphalt")
    values = np.array([*difference, np.abs(heights_m).max()])
    limits = np.array([*MAX_DIFFERENCE, MAX_LINE_HEIGHT_M])
    worst = int(np.argmax(values / limits))
    if values[worst] <= limits[worst]:
        return None
    in_metres = worst in (0, 3)
    scale = 1e3 if in_metres else math.degrees(1.0)
    return Rejection(
        RejectReason.TEXTURE_DISAGREES,
        f"the lines and the asphalt between them differ in {names[worst]}",
        float(values[worst]) * scale,
        float(limits[worst]) * scale,
        "mm" if in_metres else "deg",
        "one of them may be a kerb, or slope otherwise: drive on, in the middle of a flat lane",
    )


def check_determined(fit: LineFit | None) -> Rejection | None:
    """Refuse lines that leave one of the six parameters undetermined (they coincide, say)."""
    if fit is not None:
        return None
    return Rejection(
        RejectReason.LINES_NOT_MATCHED,
        "the lines leave part of the pose undetermined; independent lines",
        1,
        2,
        "",
        _FIND_LINES,
    )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"
