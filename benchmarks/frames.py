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

"""The held-out frames all tables share, and what one calibration of each gives."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
import numpy.typing as npt

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig, calibrate
from stereo_selfcal.core.geometry.homography import apply_homography, image_from_road, road_from_image
from stereo_selfcal.core.geometry.pose import POSE_COMPONENTS
from stereo_selfcal.synth.renderer import Frame, Picture, render_camera
from stereo_selfcal.synth.scenes import random_scene
from stereo_selfcal.synth.world import Scene

Array = npt.NDArray[np.float64]

# Poses nobody looked at while the estimator was written: development used the seeds from 0 on.
FIRST_POSE_SEED = 10_000
NOISE_SEED = 20_000

# Grey levels of the asphalt's texture: none as in the paper's pictures, and what the scenes have.
SURFACES = {"bare": 0.0, "textured": 3.0}

# In the order a calibration runs through them; "final" is what the user gets.
STAGES = ("genetic", "closed_form", "refined", "final")

FULL_SCALE = 255
MARGIN_PX = 8  # more than the reach of the widest blur measured, 4 x 1.2 px
FINE = 4  # samples of a lens per pixel, along either axis: the means of 16 of them are a pixel
# From metres and radians to millimetres and degrees.
READABLE = np.array([component.small_unit.per_si for component in POSE_COMPONENTS])
UNITS = tuple(f"{component.label} {component.small_unit.symbol}" for component in POSE_COMPONENTS)


@dataclass(frozen=True)
class Measured:
    """One calibration of one frame.

    Attributes:
        scene: The truth.
        accepted: Whether it was.
        stages: Pose of every stage that ran, "final" among them when accepted.
        std: Reported standard deviations (height, pitch, roll), None when refused.
        noise_std: Those by the noise of the pixels alone, None when refused.
    """

    scene: Scene
    accepted: bool
    stages: dict[str, Extrinsics]
    std: Array | None
    noise_std: Array | None = None

    def error(self, stage: str) -> Array:
        """Return estimate minus truth of a stage [m, rad, rad]."""
        return pose_error(self.stages[stage], self.scene)


def pose_error(estimate: Extrinsics, scene: Scene) -> Array:
    """Return estimate minus truth [m, rad, rad]."""
    error: Array = estimate.as_array() - scene.extrinsics.as_array()
    return error


def pose_of_plane(plane: Array, rig: StereoRig) -> tuple[float, float, float]:
    """Return height [m], pitch, roll [rad] of the rig from its disparity plane ``d = p0 + p1 y + p2 z`` [px].

    (1, y, z) is the ray in the left camera's body frame; the plane is parallel to the road's normal.
    """
    length = float(np.linalg.norm(plane))
    pitch, roll = math.asin(plane[0] / length), math.atan2(-plane[1], -plane[2])
    height_left = rig.fx * rig.baseline_m / length
    return height_left - math.cos(pitch) * math.sin(roll) * rig.baseline_m / 2, pitch, roll


def add_noise(picture: Picture, noise_fraction: float, rng: np.random.Generator) -> Frame:
    """Return a noise-free picture as a camera delivers it: Gaussian noise, clipped, in whole grey levels."""
    noisy = picture
    if noise_fraction > 0:
        noise = rng.standard_normal(picture.shape, dtype=np.float32)
        noisy = picture + noise * np.float32(FULL_SCALE * noise_fraction)
    frame: Frame = np.rint(np.clip(noisy, 0, FULL_SCALE)).astype(np.uint8)
    return frame


def noise_free(scene: Scene) -> tuple[Picture, Picture]:
    """Render both cameras without noise and before quantisation."""
    return render_camera(scene, "left"), render_camera(scene, "right")


def finely_rendered(scene: Scene) -> tuple[Picture, Picture]:
    """Render both cameras without noise, the lens sampled at a quarter of a pixel.

    The renderer samples its lens at whole pixels: a Gaussian of 0.5 px becomes a kernel of variance 0.21
    instead of 0.25 px^2 and of another shape, which matters where noise hides nothing. And it repeats the
    border of the image beyond it, where a lens sees the road go on: so more is rendered and cut off.
    """
    rig = scene.rig
    fine_rig = StereoRig(
        (rig.width + 2 * MARGIN_PX) * FINE,
        (rig.height + 2 * MARGIN_PX) * FINE,
        rig.fx * FINE,
        rig.fy * FINE,
        (rig.cx + MARGIN_PX + 0.5) * FINE - 0.5,
        (rig.cy + MARGIN_PX + 0.5) * FINE - 0.5,
        rig.baseline_m,
    )
    cameras = [
        replace(camera, psf_sigma_px=camera.psf_sigma_px * FINE) for camera in (scene.left, scene.right)
    ]
    left, right = noise_free(replace(scene, rig=fine_rig, left=cameras[0], right=cameras[1]))
    return _binned(left), _binned(right)


def _binned(picture: Picture) -> Picture:
    """Return the means of FINE x FINE pixels, without the margin."""
    height, width = picture.shape
    pixels = picture.reshape(height // FINE, FINE, width // FINE, FINE).mean(axis=(1, 3), dtype=np.float32)
    return np.ascontiguousarray(pixels[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX])


def draw(
    pictures: tuple[Picture, Picture], noise_fraction: float, rng: np.random.Generator
) -> tuple[Frame, Frame]:
    """Return both pictures with noise; the left one draws first."""
    return add_noise(pictures[0], noise_fraction, rng), add_noise(pictures[1], noise_fraction, rng)


@lru_cache(maxsize=128)
def held_out(surface: str, pose: int) -> tuple[Scene, tuple[Picture, Picture]]:
    """Return a held-out scene and its noise-free pictures."""
    scene = random_scene(np.random.default_rng(FIRST_POSE_SEED + pose), texture_amplitude=SURFACES[surface])
    return scene, noise_free(scene)


def held_out_frame(surface: str, noise: float, pose: int) -> tuple[Scene, Frame, Frame]:
    """Return a held-out scene and its frame; the noise depends on pose and noise level alone."""
    scene, pictures = held_out(surface, pose)
    rng = np.random.default_rng([NOISE_SEED, pose, round(noise * 1000)])
    return scene, *draw(pictures, noise, rng)


@cache
def measured(surface: str, noise: float, pose: int) -> Measured:
    """Calibrate a held-out frame; every table of one run reads the same result."""
    scene, left, right = held_out_frame(surface, noise, pose)
    return judge(calibrate(left, right, scene.rig), scene)


def judge(result: CalibrationResult, scene: Scene) -> Measured:
    """Keep of a result what the tables need."""
    stages = dict(result.stages)
    if result.extrinsics is not None:
        stages["final"] = result.extrinsics
    std = None if result.covariance is None else np.sqrt(np.diag(result.covariance))
    return Measured(scene, result.accepted, stages, std, noise_std(result))


def noise_std(result: CalibrationResult) -> Array | None:
    """Return the standard deviations [m, rad, rad] by the noise of the pixels alone; None when refused.

    A rendered road is a plane, its lines are parallel and its cameras are as their rig says: its errors are
    those of the noise, and the other terms of the uncertainty are not in them.
    """
    for term in result.uncertainty:
        if term.name == "noise":
            std: Array = np.sqrt(np.diag(term.covariance))
            return std
    return None


def stages_of(results: list[Measured]) -> list[str]:
    """Return the stages any of the results has: the known ones in their order, then others."""
    present = {name for result in results for name in result.stages}
    return [name for name in STAGES if name in present] + sorted(present - set(STAGES))


def stage_errors(results: list[Measured], stage: str) -> Array:
    """Return the errors of a stage over the accepted frames, shape (n, 3) [m, rad, rad]."""
    rows = [result.error(stage) for result in results if result.accepted and stage in result.stages]
    return np.array(rows).reshape(-1, 3)


def rms(values: npt.ArrayLike) -> Array:
    """Return the root mean square over the first axis; NaN of nothing."""
    array = np.asarray(values, np.float64)
    if not len(array):
        return np.full(array.shape[1:], np.nan)
    root: Array = np.sqrt(np.mean(array * array, axis=0))
    return root


def location_error(scene: Scene, estimate: Extrinsics, distance_m: float) -> float:
    """Return the relative error of the location of a road point straight ahead, by the estimate."""
    truth = np.array([distance_m, 0.0])
    pixel = apply_homography(image_from_road(scene.rig, scene.extrinsics, "left"), truth)
    located = apply_homography(road_from_image(scene.rig, estimate, "left"), pixel)
    return float(np.linalg.norm(located - truth)) / distance_m
