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

"""The scenes of the committed bags, and how to make one's own.

A :class:`NamedScene` is a short drive over one road with one fixed pose of the rig. Its numbers
are chosen once and for all: the committed bags are remade from them byte for byte.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from stereo_selfcal.core.errors import ConfigError

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import Extrinsics
from .renderer import Frame, render
from .world import LaneLine, Photometry, Road, Scene, Verge, two_lines

# Rig of the paper, Table I: 640 x 480, 516.6 px, 148.1 mm; principal point in the middle.
PAPER_RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)

# Expected outcome of a scene: this word, or the word of a RejectReason.
CALIBRATED = "calibrated"
LINES_NOT_STRAIGHT = "lines_not_straight"
NO_LINES_FOUND = "no_lines_found"

# Like the clock of a simulation: far from zero, which means "no time" in ROS, and small enough
# that a stamp as a float is exact to well below a nanosecond.
FIRST_STAMP_S = 100.0
FRAME_RATE_HZ = 10.0
SPEED_MPS = 13.9  # 50 km/h

# Two cameras of one make: the right one a little brighter, both lenses dark in the corners.
LEFT_PHOTOMETRY = Photometry(vignetting=0.15)
RIGHT_PHOTOMETRY = Photometry(gain=1.03, offset=1.0, vignetting=0.12)

# Poses of the accuracy tests: plausible mountings behind a windscreen.
RANDOM_HEIGHT_M = (1.1, 1.7)
RANDOM_PITCH_RAD = (math.radians(1.0), math.radians(6.0))
RANDOM_ROLL_MAX_RAD = math.radians(2.0)
RANDOM_YAW_MAX_RAD = math.radians(1.5)
RANDOM_OFFSET_MAX_M = 0.4
RANDOM_TEXTURE_SEEDS = 2**16  # enough different roads


class Bump(NamedTuple):
    """The mount is knocked and stays where it is.

    Attributes:
        at_s: When, from the first frame on [s].
        extrinsics: Pose of the rig from then on.
    """

    at_s: float
    extrinsics: Extrinsics


class RenderedPair(NamedTuple):
    """One stereo frame.

    Attributes:
        stamp_s: Time stamp [s].
        left: Left image, (H, W) uint8.
        right: Right image, (H, W) uint8.
    """

    stamp_s: float
    left: Frame
    right: Frame


@dataclass(frozen=True, slots=True)
class NamedScene:
    """A short drive with its truth.

    Attributes:
        name: Name of the scene and of its bag.
        description: One sentence for people.
        scene: The world, as the first frame sees it.
        expected: "calibrated" or the word of the reject reason a calibration should give.
        n_frames: Number of frames.
        noise_fraction: Standard deviation of the noise of both cameras, as a fraction of 255.
        seed: Seed of the noise.
        rate_hz: Frames per second.
        speed_mps: Speed along the road [m/s].
        bump: When the mount is knocked, None if it is not.

    Raises:
        ConfigError: There is no frame, or time would stand still.
    """

    name: str
    description: str
    scene: Scene
    expected: str = CALIBRATED
    n_frames: int = 1
    noise_fraction: float = 0.01
    seed: int = 0
    rate_hz: float = FRAME_RATE_HZ
    speed_mps: float = SPEED_MPS
    bump: Bump | None = None

    def __post_init__(self) -> None:
        if self.n_frames < 1:
            raise ConfigError(f"n_frames is {self.n_frames}, at least one frame is needed")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or more")
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ConfigError(f"rate_hz is {self.rate_hz}, it must be finite and greater than zero")
        # One place for the noise: the scene's cameras follow.
        object.__setattr__(self, "scene", self.scene.with_noise(self.noise_fraction))

    def scene_at(self, index: int) -> Scene:
        """Return the world as frame ``index`` sees it."""
        elapsed_s = index / self.rate_hz
        scene = replace(self.scene, travelled_m=self.scene.travelled_m + self.speed_mps * elapsed_s)
        if self.bump is not None and elapsed_s >= self.bump.at_s:
            scene = replace(scene, extrinsics=self.bump.extrinsics)
        return scene

    def frame(self, index: int) -> RenderedPair:
        """Render one frame; its noise depends on ``seed`` and ``index`` alone."""
        rng = np.random.default_rng([self.seed, index])
        return RenderedPair(FIRST_STAMP_S + index / self.rate_hz, *render(self.scene_at(index), rng))

    def frames(self) -> Iterator[RenderedPair]:
        """Yield the frames in the order of time; each is rendered when the caller takes it."""
        for index in range(self.n_frames):
            yield self.frame(index)

    def truth(self) -> dict[str, Any]:
        """Return what a calibration should find, and how the frames were made, as plain values."""
        scene, road = self.scene, self.scene.road
        truth: dict[str, Any] = {
            "name": self.name,
            "description": self.description,
            "expected": self.expected,
            **scene.extrinsics.as_dict(),
            "lane_yaw_rad": scene.lane_yaw_rad,
            "lateral_offset_m": scene.lateral_offset_m,
            "line_offsets_m": [line.offset_m for line in road.lines],
            "curvature_per_m": road.curvature_per_m,
            "noise_fraction": self.noise_fraction,
            "texture_amplitude": road.texture_amplitude,
            "n_frames": self.n_frames,
            "rate_hz": self.rate_hz,
            "speed_mps": self.speed_mps,
            "seed": self.seed,
            "rig": scene.rig.to_mapping(),
        }
        if self.bump is not None:
            truth["bump"] = {"stamp_s": FIRST_STAMP_S + self.bump.at_s, **self.bump.extrinsics.as_dict()}
        return truth


def _pose(height_m: float, pitch_deg: float, roll_deg: float) -> Extrinsics:
    return Extrinsics(height_m, math.radians(pitch_deg), math.radians(roll_deg))


def _bag_scene(pose: Extrinsics, yaw_deg: float, lateral_offset_m: float, road: Road) -> Scene:
    return Scene(
        PAPER_RIG,
        pose,
        math.radians(yaw_deg),
        lateral_offset_m,
        road=road,
        left=LEFT_PHOTOMETRY,
        right=RIGHT_PHOTOMETRY,
    )


# A country road: solid edge line on the right, a warning line (4 m paint, 2 m gap) in the middle,
# asphalt a little beyond the edge line and across the lane of the oncoming traffic.
_COUNTRY_ROAD = Road(
    lines=(LaneLine(-1.75), LaneLine(1.75, dash_m=4.0, gap_m=2.0)),
    texture_seed=1,
    verge=Verge(left_m=5.5, right_m=-2.4),
)

NAMED_SCENES: tuple[NamedScene, ...] = (
    NamedScene(
        "straight_road",
        "A straight country road at 50 km/h, mild noise (1 %): calibrates",
        _bag_scene(_pose(1.40, 3.0, 0.8), 0.5, 0.15, _COUNTRY_ROAD),
        n_frames=10,
        seed=1,
    ),
    NamedScene(
        "noisy_10",
        "A straight lane between solid lines, noise of 10 %: calibrates",
        _bag_scene(_pose(1.25, 2.2, -1.1), -0.4, -0.10, Road(texture_seed=2)),
        n_frames=2,
        noise_fraction=0.10,
        seed=2,
    ),
    NamedScene(
        "noisy_20",
        "A straight lane between solid lines, noise of 20 %: calibrates",
        _bag_scene(_pose(1.55, 4.2, 1.5), 0.3, 0.20, Road(texture_seed=3)),
        n_frames=2,
        noise_fraction=0.20,
        seed=3,
    ),
    NamedScene(
        "curve",
        "A left bend with a radius of 150 m: refused, the lines are not straight",
        _bag_scene(_pose(1.35, 3.5, -0.6), 0.2, 0.05, Road(curvature_per_m=1 / 150, texture_seed=4)),
        expected=LINES_NOT_STRAIGHT,
        n_frames=3,
        seed=4,
    ),
    NamedScene(
        "no_lines",
        "Asphalt without paint: refused, there are no lines",
        _bag_scene(_pose(1.45, 2.8, 0.4), 0.0, 0.0, Road(lines=(), texture_amplitude=6.0, texture_seed=5)),
        expected=NO_LINES_FOUND,
        n_frames=3,
        seed=5,
    ),
)


def named_scene(name: str) -> NamedScene:
    """Return the scene of a committed bag.

    Raises:
        ConfigError: There is no scene of that name.
    """
    for scene in NAMED_SCENES:
        if scene.name == name:
            return scene
    known = ", ".join(scene.name for scene in NAMED_SCENES)
    raise ConfigError(f"there is no scene {name!r}: the scenes are {known}")


def custom_scene(
    *,
    height_m: float = 1.4,
    pitch_rad: float = math.radians(3.0),
    roll_rad: float = 0.0,
    lane_yaw_rad: float = 0.0,
    lateral_offset_m: float = 0.0,
    noise_fraction: float = 0.01,
    n_frames: int = 10,
    curvature_per_m: float = 0.0,
    no_lines: bool = False,
    seed: int = 0,
    rig: StereoRig = PAPER_RIG,
    name: str = "custom",
    rate_hz: float = FRAME_RATE_HZ,
    bump_at_s: float | None = None,
    bump_height_m: float = 0.0,
    bump_pitch_rad: float = 0.0,
    bump_roll_rad: float = 0.0,
) -> NamedScene:
    """Return a drive along one lane between two solid lines.

    Args:
        height_m: Height of the rig over the road [m].
        pitch_rad: Pitch [rad], > 0: nose down.
        roll_rad: Roll [rad], > 0: right side down.
        lane_yaw_rad: Heading of the rig against the lane [rad], > 0: it points left.
        lateral_offset_m: Position of the rig beside the middle of the lane, left positive [m].
        noise_fraction: Standard deviation of the noise, as a fraction of 255.
        n_frames: Number of frames.
        curvature_per_m: Curvature of the road [1/m], > 0 bends left.
        no_lines: Whether to leave out the paint.
        seed: Seed of noise and texture.
        rig: The rectified pair.
        name: Name of the scene.
        rate_hz: Frames per second.
        bump_at_s: When the mount is knocked, from the first frame on [s]; None: it is not.
        bump_height_m: Change of the height by the knock [m].
        bump_pitch_rad: Change of the pitch by the knock [rad].
        bump_roll_rad: Change of the roll by the knock [rad].

    Raises:
        ConfigError: A value is outside of what can be rendered.
    """
    lines = () if no_lines else two_lines()
    road = Road(lines=lines, curvature_per_m=curvature_per_m, texture_seed=seed)
    pose = Extrinsics(height_m, pitch_rad, roll_rad)
    # Any bend counts as one: how slight a bend may pass is for the calibrator to say.
    expected = NO_LINES_FOUND if no_lines else LINES_NOT_STRAIGHT if curvature_per_m != 0 else CALIBRATED
    surface = "asphalt without paint" if no_lines else "a lane between two solid lines"
    bump, knocked = None, ""
    if bump_at_s is not None:
        bump = Bump(
            bump_at_s,
            Extrinsics(height_m + bump_height_m, pitch_rad + bump_pitch_rad, roll_rad + bump_roll_rad),
        )
        knocked = f"; knocked after {bump_at_s:g} s to {bump.extrinsics.describe()}"
    elif bump_height_m or bump_pitch_rad or bump_roll_rad:
        raise ConfigError("there is a bump, but not when: give bump_at_s")
    return NamedScene(
        name,
        f"Made to order: {surface}, {pose.describe()}{knocked}",
        Scene(
            rig,
            pose,
            lane_yaw_rad,
            lateral_offset_m,
            road=road,
            left=LEFT_PHOTOMETRY,
            right=RIGHT_PHOTOMETRY,
        ),
        expected=expected,
        n_frames=n_frames,
        noise_fraction=noise_fraction,
        seed=seed,
        rate_hz=rate_hz,
        bump=bump,
    )


def random_scene(
    rng: np.random.Generator,
    noise_fraction: float = 0.0,
    rig: StereoRig = PAPER_RIG,
    texture_amplitude: float = 3.0,
) -> Scene:
    """Draw a scene for accuracy tests: two solid lines, a plausible pose.

    Args:
        rng: Source of the pose and of the texture; six draws, whatever the other arguments are.
        noise_fraction: Standard deviation of the noise of both cameras, as a fraction of 255.
        rig: The rectified pair.
        texture_amplitude: Standard deviation of the road's texture at a short distance [grey levels].

    Returns:
        A scene with height 1.1 ... 1.7 m, pitch 1 ... 6 deg, roll within 2 deg, yaw within
        1.5 deg and the rig within 0.4 m of the middle of the lane.
    """
    pose = Extrinsics(
        float(rng.uniform(*RANDOM_HEIGHT_M)),
        float(rng.uniform(*RANDOM_PITCH_RAD)),
        float(rng.uniform(-RANDOM_ROLL_MAX_RAD, RANDOM_ROLL_MAX_RAD)),
    )
    lane_yaw_rad = float(rng.uniform(-RANDOM_YAW_MAX_RAD, RANDOM_YAW_MAX_RAD))
    lateral_offset_m = float(rng.uniform(-RANDOM_OFFSET_MAX_M, RANDOM_OFFSET_MAX_M))
    texture_seed = int(rng.integers(RANDOM_TEXTURE_SEEDS))
    road = Road(texture_amplitude=texture_amplitude, texture_seed=texture_seed)
    return Scene(rig, pose, lane_yaw_rad, lateral_offset_m, road=road).with_noise(noise_fraction)
