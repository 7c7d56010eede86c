"""The best any estimator can do: the Cramér-Rao bound of height, pitch and roll from one stereo frame.

A solid stripe on asphalt is an image ``asphalt + (paint - asphalt) * share`` with independent
Gaussian noise of equal strength in every pixel. The information matrix of its parameters is
``sum over pixels (dI / dp) (dI / dp)^T / noise^2`` (Kay, Fundamentals of Statistical Signal
Processing, vol. I, section 3.9); the inverse is the smallest covariance of an unbiased estimator.
Parameters are height, pitch, roll and, as nuisances, the lane's yaw, position and width of every line
and one grey level each for paint and asphalt. Only pixels of the stripes and their edges count: no
texture, no verge, no sky.

A line on the road is straight in the image, so the share of a pixel that lies on one side of an edge has
a closed form: the pixel is a box, the lens an optional Gaussian, and no other edge profile stands in for
them (:func:`edge_response`). The slant counts: the edge of a line at 1.75 m seen from 1.4 m moves 1.25
columns per row and is felt by 2.25 columns of a row, which costs 30 % of accuracy against an upright
edge. A stripe is the difference of its two edges, so one thinner than a pixel, far away, is as faint as
it is in a picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from ..camera.rig import StereoRig
from ..errors import ConfigError
from ..geometry.homography import SIDES, Side, apply_homography, image_from_road, road_from_image
from ..geometry.pose import Extrinsics
from ..numerics.derivatives import central_difference, linearise, point_by_point
from ..types import Array

# Rows nearer than this to where a line meets the horizon are left out. 4 rows below it, 180 m ahead of the
# paper's rig, a line 12 cm wide is a third of a pixel wide; between margins of 0.5 and 8 rows the bound of
# height and roll changes by 0.03 %, that of pitch by 1 %.
HORIZON_MARGIN_PX = 4.0

# Paint on asphalt, and noise of 5 % of 255: the chart is for these.
DEFAULT_CONTRAST = 123.0
DEFAULT_NOISE_GREY = 0.05 * 255

# An edge more upright than this (columns per row) is taken as this slanted: it adds 1e-5 px^2 to the variance
# of the response, 1/12 px^2 and more, and keeps the quotients of differences exact to 1e-9.
MIN_SLANT = 0.01
# The same for the lens: a blur that adds 1e-8 px^2 to the variance of the response.
MIN_PSF_SIGMA_PX = 1e-4
# The density of a Gaussian is below 1e-6 of its peak farther away than this, in standard deviations.
REACH_SIGMA = 5.5

# Steps of the central differences of edge columns [m or rad]: straight lines move by 1e-3 px and less, so the
# differences are exact to about 1e-6 relative, for second order and rounding alike.
STEP = 1e-6

_erf = np.frompyfunc(math.erf, 1, 1)  # numpy has none

# Condition of the normalised information matrix beyond which double precision has no digit left.
MAX_CONDITION = 1e14

_UNDETERMINED = (
    "height, pitch and roll cannot be determined: the cameras see too little of the lines; "
    "check the rig, the pose and the positions of the lines"
)

N_POSE = 3  # height, pitch, roll come first among the parameters


@dataclass(frozen=True, slots=True)
class StripeScene:
    """The stripes in view and how the cameras see them.

    Attributes:
        lane_yaw_rad: Yaw of the rig against the lines [rad], > 0: it points left of them.
        line_positions_m: Lateral position of the middle of each line [m], left positive, from the rig.
        line_width_m: Width of the lines [m].
        contrast: Paint minus asphalt [grey levels].
        noise_grey: Standard deviation of the pixel noise [grey levels].
        psf_sigma_px: Standard deviation of the Gaussian blur of the lens [px].

    Raises:
        ConfigError: A value is not finite or outside its range, or fewer than two lines are given.
    """

    lane_yaw_rad: float = 0.0
    line_positions_m: tuple[float, ...] = (1.75, -1.75)
    line_width_m: float = 0.12
    contrast: float = DEFAULT_CONTRAST
    noise_grey: float = DEFAULT_NOISE_GREY
    psf_sigma_px: float = 0.0

    def __post_init__(self) -> None:
        for name in ("lane_yaw_rad", "line_width_m", "contrast", "noise_grey", "psf_sigma_px"):
            _require(math.isfinite(getattr(self, name)), name, getattr(self, name), "finite")
        for name in ("line_width_m", "contrast", "noise_grey"):
            _require(getattr(self, name) > 0, name, getattr(self, name), "greater than zero")
        _require(self.psf_sigma_px >= 0, "psf_sigma_px", self.psf_sigma_px, "0 or more")
        # Lines are told apart by their edges; one line alone leaves height, pitch and roll undetermined.
        ordered = sorted(self.line_positions_m)
        apart = len(ordered) >= 2 and all(b - a > self.line_width_m for a, b in pairwise(ordered))
        if not (apart and all(math.isfinite(y) for y in ordered)):
            raise ConfigError(
                f"line_positions_m is {tuple(self.line_positions_m)}, it must be two or more positions "
                f"farther apart than the lines are wide ({self.line_width_m} m)"
            )


def limits(
    rig: StereoRig,
    extrinsics: Extrinsics,
    *,
    lane_yaw_rad: float = 0.0,
    line_positions_m: Sequence[float] = (1.75, -1.75),
    line_width_m: float = 0.12,
    contrast: float = DEFAULT_CONTRAST,
    noise_grey: float = DEFAULT_NOISE_GREY,
    psf_sigma_px: float = 0.0,
) -> Array:
    """Return the Cramér-Rao bound of (height, pitch, roll) from one stereo frame of solid lines.

    Args:
        rig: The rectified pair.
        extrinsics: Pose of the rig over the road.
        lane_yaw_rad: Yaw of the rig against the lines [rad].
        line_positions_m: Lateral position of the middle of each line [m], left positive, from the rig.
        line_width_m: Width of the lines [m].
        contrast: Paint minus asphalt [grey levels].
        noise_grey: Standard deviation of the pixel noise [grey levels].
        psf_sigma_px: Standard deviation of the Gaussian blur of the lens [px].

    Returns:
        (3, 3) covariance of (height_m, pitch_rad, roll_rad).

    Raises:
        ConfigError: A value is outside its range, or the cameras see too little of the lines to
            determine the pose.
    """
    positions = tuple(float(y) for y in line_positions_m)
    scene = StripeScene(lane_yaw_rad, positions, line_width_m, contrast, noise_grey, psf_sigma_px)
    turns = (
        ("pitch_rad", extrinsics.pitch_rad),
        ("roll_rad", extrinsics.roll_rad),
        ("lane_yaw_rad", lane_yaw_rad),
    )
    for name, angle_rad in turns:
        _require(abs(angle_rad) < math.pi / 2, name, angle_rad, "within a right angle")
    lowest_m = rig.baseline_m / 2 * abs(math.sin(extrinsics.roll_rad))
    _require(extrinsics.height_m > lowest_m, "height_m", extrinsics.height_m, f"above {lowest_m:.4g} m")
    information = fisher_information(rig, extrinsics, scene)
    strengths = np.diag(information)
    if not (np.isfinite(information).all() and (strengths > 0).all()):
        raise ConfigError(_UNDETERMINED)
    # Metres, radians and grey levels: inverted with a unit diagonal.
    scale = 1 / np.sqrt(strengths)
    normal = information * np.outer(scale, scale)
    if not np.linalg.cond(normal) < MAX_CONDITION:
        raise ConfigError(_UNDETERMINED)
    covariance = (np.linalg.inv(normal) * np.outer(scale, scale))[:N_POSE, :N_POSE]
    symmetric: Array = (covariance + covariance.T) / 2
    return symmetric


def location_std(covariance: Array, rig: StereoRig, extrinsics: Extrinsics, distance_m: float) -> float:
    """Return how far off a road point straight ahead is placed because of the extrinsics alone.

    The point keeps its pixel of the left camera; where that pixel meets the road follows the extrinsics.

    Args:
        covariance: (3, 3) covariance of (height_m, pitch_rad, roll_rad).
        rig: The rectified pair.
        extrinsics: Pose of the rig over the road.
        distance_m: Distance of the point ahead of the rig [m].

    Returns:
        Root mean square distance between where the point is and where it is placed [m]:
        the root of the trace of its (2, 2) covariance.
    """
    pixel = apply_homography(image_from_road(rig, extrinsics, "left"), (distance_m, 0.0))

    def place(pose: Array) -> Array:
        return apply_homography(road_from_image(rig, Extrinsics.from_array(pose), "left"), pixel)

    jac_place_pose = central_difference(point_by_point(place), extrinsics.as_array(), STEP).T
    return math.sqrt(float(np.trace(jac_place_pose @ covariance @ jac_place_pose.T)))


def fisher_information(rig: StereoRig, extrinsics: Extrinsics, scene: StripeScene) -> Array:
    """Return the information about pose and nuisances in one stereo frame.

    Returns:
        (6 + 2 n, 6 + 2 n) matrix for n lines: height [m], pitch, roll, lane yaw [rad], n positions [m], n
        widths [m], grey levels of paint and asphalt.
    """
    lines = np.array([*scene.line_positions_m, *[scene.line_width_m] * len(scene.line_positions_m)])
    parameters = np.array([*extrinsics.as_array(), scene.lane_yaw_rad, *lines])
    n = parameters.size
    total = np.zeros((n + 2, n + 2))
    for side in SIDES:
        edges_of = point_by_point(partial(_edges, rig, side))
        edges, motion = linearise(edges_of, parameters, STEP)
        for line in range(len(scene.line_positions_m)):
            derivative = _stripe_derivative(rig, scene, edges[line], motion[:, line])
            total += derivative @ derivative.T
    return total / scene.noise_grey**2


def edge_response(distance_px: Array, slant: float, psf_sigma_px: float) -> tuple[Array, Array]:
    """Return how a pixel responds to a slanted edge, exactly.

    Along a row, the step response of a square pixel to an edge that moves ``slant`` columns per row is
    the distribution of the sum of a uniform variable of width 1 (across the pixel), one of width
    ``|slant|`` (down it) and a Gaussian of standard deviation ``psf * sqrt(1 + slant^2)`` (the lens, cut
    along the row). Its variance is ``(1 + slant^2) (1 / 12 + psf^2)``.

    Args:
        distance_px: Columns from the edge to the middle of the pixel, in the pixel's row [px].
        slant: Columns per row.
        psf_sigma_px: Standard deviation of the blur of the lens [px].

    Returns:
        The share of the pixel that lies to the right of the edge (0 ... 1), and its derivative by the
        distance (the density, [1/px]); both of the shape of ``distance_px``.
    """
    m = max(abs(slant), MIN_SLANT)
    psf = max(psf_sigma_px, MIN_PSF_SIGMA_PX)
    s = psf * math.sqrt(1 + m * m)
    # Corners of the trapezium that two uniform variables add up to; cdf and its first two integrals there.
    offsets = np.array([(1 + m) / 2, (1 - m) / 2, -(1 - m) / 2, -(1 + m) / 2])
    x = distance_px[..., None] + offsets
    z = np.clip(x / s, -REACH_SIGMA * 2, REACH_SIGMA * 2)
    cdf = 0.5 + 0.5 * _erf(z / math.sqrt(2)).astype(np.float64)
    normal = np.exp(-z * z / 2) / math.sqrt(2 * math.pi)
    first = x * cdf + s * normal
    second = (x * x + s * s) / 2 * cdf + x * s / 2 * normal
    signs = np.array([1.0, -1.0, -1.0, 1.0])
    return second @ signs / m, first @ signs / m


def _edges(rig: StereoRig, side: Side, parameters: Array) -> Array:
    """Return the image lines ``u = a + b (v - rig.cy)`` of all stripe edges, shape (n, 2, 2).

    The axes are (line, edge, (a [px], b [columns per row])); the first edge is the left one.
    """
    pose, yaw_rad, lines = (
        Extrinsics.from_array(parameters[:N_POSE]),
        parameters[N_POSE],
        parameters[N_POSE + 1 :],
    )
    positions_m, widths_m = np.split(lines, 2)
    lateral_m = np.stack([positions_m + widths_m / 2, positions_m - widths_m / 2], axis=1)
    # p_lane = R_z(yaw) p_road, so y_lane = sin(yaw) x + cos(yaw) y. In homogeneous coordinates a line maps
    # by the inverse transpose of what maps points.
    across = np.broadcast_to([math.sin(yaw_rad), math.cos(yaw_rad)], (*lateral_m.shape, 2))
    in_image = np.concatenate([across, -lateral_m[..., None]], axis=-1) @ road_from_image(rig, pose, side)
    slope = -in_image[..., 1] / in_image[..., 0]
    return np.stack([-in_image[..., 2] / in_image[..., 0] + slope * rig.cy, slope], axis=-1)


def _stripe_derivative(rig: StereoRig, scene: StripeScene, edges: Array, motion: Array) -> Array:
    """Return the derivative of the grey levels of one stripe and its edges in one image.

    Args:
        rig: The rectified pair.
        scene: How the camera sees the stripe.
        edges: (2, 2) image lines of its left and right edge, as :func:`_edges` gives them.
        motion: (n, 2, 2) their derivatives by the n parameters.

    Returns:
        (n + 2, N) derivatives of N pixels by the n parameters, the grey levels of paint and of asphalt.
    """
    n = len(motion)
    vanishing_row = rig.cy - (edges[0, 0] - edges[1, 0]) / (edges[0, 1] - edges[1, 1])
    first_row = max(math.ceil(vanishing_row + HORIZON_MARGIN_PX), 0)
    rows = np.arange(first_row, rig.height) - rig.cy
    left, right = edges[:, :1] + edges[:, 1:] * rows
    slant = float(np.abs(edges[:, 1]).max())
    # As far as an edge is felt, and a pixel of bare asphalt.
    reach_px = (1 + slant) / 2 + REACH_SIGMA * scene.psf_sigma_px * math.hypot(1, slant) + 1
    begin = np.maximum(np.ceil(left - reach_px), 0)
    end = np.minimum(np.floor(right + reach_px), rig.width - 1)
    widest = int(np.max(end - begin, initial=-1)) + 1
    if widest < 1:
        return np.zeros((n + 2, 0))
    columns = begin[:, None] + np.arange(widest)
    row, column = np.nonzero(columns <= end[:, None])
    u, v = columns[row, column], rows[row]
    derivative = np.zeros((n + 2, u.size))
    for edge, sign in ((0, 1.0), (1, -1.0)):
        at, slope = edges[edge]
        share, density = edge_response(u - at - slope * v, float(slope), scene.psf_sigma_px)
        moved = motion[:, edge]
        # An edge also turns; within the height of one pixel that changes the bound by less than 3e-4.
        derivative[:n] -= sign * scene.contrast * density * (moved[:, :1] + moved[:, 1:] * v)
        derivative[n] += sign * share
    derivative[n + 1] = 1 - derivative[n]
    return derivative


def _require(condition: bool, name: str, value: float, must_be: str) -> None:
    """Raise a ConfigError that names the value unless ``condition`` holds (NaN never does)."""
    if not condition:
        raise ConfigError(f"{name} is {value}, it must be {must_be}")
