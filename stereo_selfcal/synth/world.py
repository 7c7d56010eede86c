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

"""Parts of a synthetic scene: paint, road, sky, cameras and the true pose.

Road coordinates: ``s`` runs along the road's reference line, ``d`` to the left of it [m]. The
lane frame (x along the reference line, y left, z up) touches that line beside the rig;
``p_lane = R_z(lane_yaw) R_y(pitch) R_x(roll) p_camera + [0, lateral_offset, height]``, REP-103.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

from stereo_selfcal.core.errors import ConfigError

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import Extrinsics

Side = Literal["left", "right"]

# Grey levels of a sunny two-lane road; their difference is the contrast of 123 the defaults aim at.
ASPHALT_GREY = 90.0
PAINT_GREY = 213.0
SKY_GREY = 160.0

LINE_WIDTH_M = 0.12  # usual width of a painted lane line outside motorways
LANE_WIDTH_M = 3.5  # usual lane: the lines are 1.75 m to either side

# A small lens in focus: enough blur that an edge is no staircase, as in any real picture.
PSF_SIGMA_PX = 0.5

# Beyond this tilt the picture shows no road ahead; it is also the widest search of the estimator.
MAX_TILT_RAD = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class LaneLine:
    """One painted stripe, solid or dashed.

    Attributes:
        offset_m: Distance of the stripe's middle from the reference line, left positive [m].
        width_m: Width of the stripe [m].
        dash_m: Length of a dash [m]; None for a solid line.
        gap_m: Length of the gap between two dashes [m]; None for a solid line.
        phase_m: Where along the road a dash begins [m].
        grey: Grey level of the paint.

    Raises:
        ConfigError: The stripe has no place, it or its dashes have no length, or only one of
            dash and gap is given.
    """

    offset_m: float
    width_m: float = LINE_WIDTH_M
    dash_m: float | None = None
    gap_m: float | None = None
    phase_m: float = 0.0
    grey: float = PAINT_GREY

    def __post_init__(self) -> None:
        _require(math.isfinite(self.offset_m), "line.offset_m", self.offset_m, "finite")
        _require(self.width_m > 0, "line.width_m", self.width_m, "greater than zero")
        if (self.dash_m is None) != (self.gap_m is None):
            raise ConfigError("line.dash_m and line.gap_m belong together: give both or none")
        if self.dash_m is not None and self.gap_m is not None:
            _require(self.dash_m > 0, "line.dash_m", self.dash_m, "greater than zero")
            _require(self.gap_m > 0, "line.gap_m", self.gap_m, "greater than zero")

    @property
    def right_edge_m(self) -> float:
        """Lateral position of the right edge [m]."""
        return self.offset_m - self.width_m / 2

    @property
    def left_edge_m(self) -> float:
        """Lateral position of the left edge [m]."""
        return self.offset_m + self.width_m / 2


@dataclass(frozen=True, slots=True)
class Verge:
    """Unbounded ground beside the road surface, such as grass or earth.

    Attributes:
        left_m: Lateral position where it begins on the left [m].
        right_m: Lateral position where it begins on the right [m], negative.
        grey: Mean grey level.
        texture_amplitude: Standard deviation of its texture seen from near [grey levels].
    """

    left_m: float
    right_m: float
    grey: float = 105.0
    texture_amplitude: float = 12.0

    def __post_init__(self) -> None:
        _require(self.right_m < self.left_m, "verge.right_m", self.right_m, f"below left_m = {self.left_m}")


def two_lines(lane_width_m: float = LANE_WIDTH_M) -> tuple[LaneLine, ...]:
    """Return the solid lines of one lane, right one first."""
    return LaneLine(-lane_width_m / 2), LaneLine(lane_width_m / 2)


@dataclass(frozen=True, slots=True)
class Road:
    """A flat road of constant curvature.

    Attributes:
        lines: Painted stripes; they may not overlap.
        curvature_per_m: Curvature of the reference line [1/m], > 0 bends left. The lines are
            arcs concentric with it.
        asphalt_grey: Mean grey level of the road surface.
        texture_amplitude: Standard deviation of the road's texture at a short distance [grey levels].
        texture_seed: Seed of the texture: same seed, same road.
        verge: Ground beside the road surface; None where the road surface has no border.

    Raises:
        ConfigError: Stripes overlap or lie on the verge, the bend is tighter than a line is far from
            the reference line, or a texture value is negative.
    """

    lines: tuple[LaneLine, ...] = field(default_factory=two_lines)
    curvature_per_m: float = 0.0
    asphalt_grey: float = ASPHALT_GREY
    texture_amplitude: float = 3.0
    texture_seed: int = 0
    verge: Verge | None = None

    def __post_init__(self) -> None:
        bend = self.curvature_per_m
        _require(math.isfinite(bend), "road.curvature_per_m", bend, "finite")
        _require(self.texture_seed >= 0, "road.texture_seed", self.texture_seed, "0 or more")
        _require(self.texture_amplitude >= 0, "road.texture_amplitude", self.texture_amplitude, "0 or more")
        ordered = sorted(self.lines, key=lambda line: line.offset_m)
        for right, left in pairwise(ordered):
            if right.left_edge_m > left.right_edge_m:
                raise ConfigError(f"lines at {right.offset_m} m and {left.offset_m} m overlap")
        for line in ordered:
            # A line tighter than its own distance to the centre of the arc does not exist.
            _require(
                bend * line.offset_m < 1,
                "road.curvature_per_m",
                bend,
                f"such that a line at {line.offset_m} m has a radius",
            )
            if self.verge is not None:
                _require(
                    self.verge.right_m <= line.right_edge_m and line.left_edge_m <= self.verge.left_m,
                    "line.offset_m",
                    line.offset_m,
                    f"on the asphalt, {self.verge.right_m} ... {self.verge.left_m} m",
                )


@dataclass(frozen=True, slots=True)
class Photometry:
    """How one camera turns light into grey levels.

    Attributes:
        gain: Factor on the grey levels of the world.
        offset: Added grey levels (black level).
        vignetting: Loss of light in the image corner farthest from the principal point (0 ... 1);
            it grows with the square of the radius.
        psf_sigma_px: Standard deviation of the Gaussian blur of the lens [px].
        noise_fraction: Standard deviation of the Gaussian noise, as a fraction of 255.
    """

    gain: float = 1.0
    offset: float = 0.0
    vignetting: float = 0.0
    psf_sigma_px: float = PSF_SIGMA_PX
    noise_fraction: float = 0.0

    def __post_init__(self) -> None:
        _require(self.gain > 0, "photometry.gain", self.gain, "greater than zero")
        _require(0 <= self.vignetting <= 1, "photometry.vignetting", self.vignetting, "in 0 ... 1")
        _require(self.psf_sigma_px >= 0, "photometry.psf_sigma_px", self.psf_sigma_px, "0 or more")
        noise = self.noise_fraction
        _require(0 <= noise <= 1, "photometry.noise_fraction", noise, "in 0 ... 1")


@dataclass(frozen=True, slots=True)
class Scene:
    """One stereo frame to be rendered, with the truth of its pose.

    Attributes:
        rig: The rectified pair.
        extrinsics: Height, pitch and roll of the rig over the road.
        lane_yaw_rad: Heading of the rig against the reference line [rad], > 0: it points left.
        lateral_offset_m: Position of the rig beside the reference line, left positive [m].
        travelled_m: Position of the rig along the reference line [m].
        road: Paint and road surface.
        sky_grey: Grey level of the sky at the horizon.
        sky_gradient: Change of the sky's grey level per unit of slope above the horizon.
        left: Photometry of the left camera.
        right: Photometry of the right camera.

    Raises:
        ConfigError: A number is not finite, the rig is not above the road, or it is tilted so far
            that it sees none.
    """

    rig: StereoRig
    extrinsics: Extrinsics
    lane_yaw_rad: float = 0.0
    lateral_offset_m: float = 0.0
    travelled_m: float = 0.0
    road: Road = field(default_factory=Road)
    sky_grey: float = SKY_GREY
    sky_gradient: float = 40.0
    left: Photometry = field(default_factory=Photometry)
    right: Photometry = field(default_factory=Photometry)

    def __post_init__(self) -> None:
        pose = self.extrinsics
        for name in ("lane_yaw_rad", "lateral_offset_m", "travelled_m"):
            _require(math.isfinite(getattr(self, name)), f"scene.{name}", getattr(self, name), "finite")
        # At half the baseline the lower camera of a rig rolled by 90 degrees would touch the road.
        lowest_m = self.rig.baseline_m / 2
        _require(
            math.isfinite(pose.height_m) and pose.height_m > lowest_m,
            "scene.height_m",
            pose.height_m,
            f"finite and above half the baseline, {lowest_m:.4g} m",
        )
        for name, angle_rad in (("pitch_rad", pose.pitch_rad), ("roll_rad", pose.roll_rad)):
            _require(abs(angle_rad) <= MAX_TILT_RAD, f"scene.{name}", angle_rad, f"within {MAX_TILT_RAD:.4g}")

    def photometry(self, side: Side) -> Photometry:
        """Return the photometry of one camera."""
        return self.left if side == "left" else self.right

    def with_noise(self, noise_fraction: float) -> Scene:
        """Return the scene with another noise in both cameras (standard deviation over 255)."""
        return replace(
            self,
            left=replace(self.left, noise_fraction=noise_fraction),
            right=replace(self.right, noise_fraction=noise_fraction),
        )


def _require(condition: bool, name: str, value: float, must_be: str) -> None:
    """Raise a ConfigError that names the value unless ``condition`` holds (NaN never does)."""
    if not condition:
        raise ConfigError(f"{name} is {value}, it must be {must_be}")
