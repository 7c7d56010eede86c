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

"""The Cramér-Rao bound of height, pitch and roll from one stereo frame: the best possible accuracy.

A solid stripe has the image ``road + (paint - road) * share``, with independent Gaussian noise of equal
strength in every pixel. The information matrix of its parameters is
``sum over pixels (dI / dp) (dI / dp)^T / noise^2`` (Kay, Fundamentals of Statistical Signal Processing, vol.
I, section 3.9). Its inverse is the smallest covariance of an unbiased estimator. The parameters are height,
pitch and roll. The nuisances are the lane's yaw, the position and width of every line, and one grey level
each for the paint and the road surface. Only pixels of the stripes and their edges count; texture, verge and
sky do not.

A line on the road is straight in the image, so the share of a pixel on one side of an edge has a closed form
(:func:`edge_response`). The pixel is a box and the lens an optional Gaussian, without further approximation.
The slant matters. From a height of 1.4 m, the edge of a line at 1.75 m moves 1.25 columns per row and spreads
over 2.25 columns of a row. This costs 30 % of the accuracy of an upright edge. A stripe is the difference of
its two edges, so a distant stripe that is thinner than a pixel is as faint as in a real image.
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

# Rows nearer than this to the vanishing point of the lines are left out. 4 rows below it, 180 m ahead of the
# paper's rig, a line 12 cm wide is a third of a pixel wide. Between margins of 0.5 and 8 rows, the bound of
# height and roll changes by 0.03 %, that of pitch by 1 %.
HORIZON_MARGIN_PX = 4.0

# Contrast of paint on the road, and noise of 5 % of 255. The published chart uses these values.
DEFAULT_CONTRAST = 123.0
DEFAULT_NOISE_GREY = 0.05 * 255

# Least slant of an edge [columns per row]; a more upright edge is treated as this slanted. This adds 1e-5
# px^2 to the variance of the response, which is at least 1/12 px^2. It keeps the difference quotients exact
# to 1e-9.
MIN_SLANT = 0.01
# Least blur of the lens, for the same reason; it adds 1e-8 px^2 to the variance of the response.
MIN_PSF_SIGMA_PX = 1e-4
# The density of a Gaussian is below 1e-6 of its peak farther away than this, in standard deviations.
REACH_SIGMA = 5.5

# Step of the central differences of edge columns [m or rad]. It moves the lines by at most 1e-3 px. The
# relative error is about 1e-6, by the second order and by rounding alike.
STEP = 1e-6

_erf = np.frompyfunc(math.erf, 1, 1)  # numpy has no error function

# Most condition number of the normalised information matrix; beyond it, double precision has no valid digit.
MAX_CONDITION = 1e14

_UNDETERMINED = (
    "height, pitch and roll cannot be determined: the cameras see too little of the lines; "
    "check the rig, the pose and the positions of the lines"
)

N_POSE = 3  # height, pitch, roll come first among the parameters


@dataclass(frozen=True, slots=True)
class StripeScene:
    """The stripes in view, their contrast, and the noise and blur of the cameras.

    Attributes:
        lane_yaw_rad: Yaw of the rig against the lines [rad], > 0: the rig points left of them.
        line_positions_m: Lateral position of the middle of each line [m], left positive, from the rig.
        line_width_m: Width of the lines [m].
        contrast: Grey level of the paint minus that of the road surface.
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
        # Lines must not overlap. One line alone leaves height, pitch and roll undetermined.
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
        contrast: Grey level of the paint minus that of the road surface.
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
    # The units are metres, radians and grey levels, so the matrix is normalised to a unit diagonal first.
    scale = 1 / np.sqrt(strengths)
    normal = information * np.outer(scale, scale)
    if not np.linalg.cond(normal) < MAX_CONDITION:
        raise ConfigError(_UNDETERMINED)
    covariance = (np.linalg.inv(normal) * np.outer(scale, scale))[:N_POSE, :N_POSE]
    symmetric: Array = (covariance + covariance.T) / 2
    return symmetric


def location_std(covariance: Array, rig: StereoRig, extrinsics: Extrinsics, distance_m: float) -> float:
    """Return the location error of a road point straight ahead that the extrinsics alone cause.

    The point keeps its pixel in the left camera. Its location is where the ray of that pixel meets the road,
    which depends on the extrinsics.

    Args:
        covariance: (3, 3) covariance of (height_m, pitch_rad, roll_rad).
        rig: The rectified pair.
        extrinsics: Pose of the rig over the road.
        distance_m: Distance of the point ahead of the rig [m].

    Returns:
        Root mean square distance between the true and the computed location [m]: the root of the trace of the
        (2, 2) covariance of the location.
    """
    pixel = apply_homography(image_from_road(rig, extrinsics, "left"), (distance_m, 0.0))

    def locate(pose: Array) -> Array:
        return apply_homography(road_from_image(rig, Extrinsics.from_array(pose), "left"), pixel)

    jac_location_pose = central_difference(point_by_point(locate), extrinsics.as_array(), STEP).T
    return math.sqrt(float(np.trace(jac_location_pose @ covariance @ jac_location_pose.T)))


def fisher_information(rig: StereoRig, extrinsics: Extrinsics, scene: StripeScene) -> Array:
    """Return the information about pose and nuisances in one stereo frame.

    Returns:
        (6 + 2 n, 6 + 2 n) matrix for n lines: height [m], pitch, roll, lane yaw [rad], n positions [m], n
        widths [m], grey levels of the paint and the road surface.
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
    """Return the exact response of a pixel to a slanted edge.

    Along a row, the step response of a square pixel to an edge that moves ``slant`` columns per row is
    the distribution of the sum of a uniform variable of width 1 (across the pixel), one of width
    ``|slant|`` (down it) and a Gaussian of standard deviation ``psf * sqrt(1 + slant^2)`` (the lens, cut
    along the row). Its variance is ``(1 + slant^2) (1 / 12 + psf^2)``.

    Args:
        distance_px: Columns from the edge to the middle of the pixel, in the pixel's row [px].
        slant: Columns per row.
        psf_sigma_px: Standard deviation of the blur of the lens [px].

    Returns:
        The share of the pixel to the right of the edge (0 ... 1), and its derivative by the distance (the
        density, [1/px]); both have the shape of ``distance_px``.
    """
    m = max(abs(slant), MIN_SLANT)
    psf = max(psf_sigma_px, MIN_PSF_SIGMA_PX)
    s = psf * math.sqrt(1 + m * m)
    # The distribution's first two integrals at the corners of the trapezium, which is the sum of two uniform
    # variables.
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
        edges: (2, 2) image lines of its left and right edge, as :func:`_edges` returns them.
        motion: (n, 2, 2) derivatives of these lines by the n parameters.

    Returns:
        (n + 2, N) derivatives of N pixels by the n parameters and the grey levels of the paint and the road.
    """
    n = len(motion)
    vanishing_row = rig.cy - (edges[0, 0] - edges[1, 0]) / (edges[0, 1] - edges[1, 1])
    first_row = max(math.ceil(vanishing_row + HORIZON_MARGIN_PX), 0)
    rows = np.arange(first_row, rig.height) - rig.cy
    left, right = edges[:, :1] + edges[:, 1:] * rows
    slant = float(np.abs(edges[:, 1]).max())
    # The reach of an edge's response, and one pixel of road surface without paint.
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
