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

"""The figures of docs/: ``python -m benchmarks.figures [FOLDER]``. Same versions, same bytes.

Without a folder, the output that the pages show is made anew as well (:mod:`benchmarks.outputs`).

Pictures are of rendered roads; the drawing of the frames is computed from the rotation all results use, so
that it cannot show another sign.
"""

from __future__ import annotations

import contextlib
import io
import math
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from stereo_selfcal import Calibrator, CalibratorConfig, Extrinsics
from stereo_selfcal.bags import StereoBag
from stereo_selfcal.cli import limits as limits_command
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.types import Image
from stereo_selfcal.pictures.birds_eye import draw_birds_eye
from stereo_selfcal.pictures.camera_view import draw_camera_view
from stereo_selfcal.pictures.canvas import DARK, VERMILION, WHITE, Canvas
from stereo_selfcal.pictures.overview import draw_debug_image, draw_overview
from stereo_selfcal.pictures.verdict import StripContent, verdict_of, verdict_strip
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import named_scene
from stereo_selfcal.synth.worlds import RIGS, named_world, render_world

from . import outputs
from .alignment_drawing import alignment_svg
from .data_flow import data_flow_svg
from .frames_drawing import frames_svg

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "figures"

_WIDTH_PX = 960
_JPEG_QUALITY = 85

_GAP_PX = 6


def overview() -> bytes:
    """Show what `make demo` writes: the last frame of its drive, with the calibration of the mount."""
    with StereoBag(FOLDER.parents[1] / "bags" / "drive") as bag:
        rig = bag.read_rig()
        calibrator = Calibrator(rig)
        for frame in bag.frames():
            result = calibrator.add(frame.left, frame.right, frame.stamp_s)
    mount = calibrator.estimate
    of_mount = replace(
        result, extrinsics=mount.extrinsics, covariance=mount.covariance, uncertainty=(), travel=mount.travel
    )
    return _jpeg(draw_overview(frame.left, frame.right, rig, of_mount))


def debug_image() -> bytes:
    """Show what the node publishes of a frame that was refused, in a bend."""
    scene = named_scene("curve")
    frame = scene.frame(0)
    rig = scene.scene.rig
    result = Calibrator(rig).add(frame.left, frame.right)
    points = find_stripe_points(frame.left, CalibratorConfig().extraction)
    stripes = np.column_stack([points.columns, points.rows])
    return _jpeg(draw_debug_image(frame.left, rig, result, verdict_of(result), stripes))


def limits() -> bytes:
    """Show what `limits --noise 0.05 --plot` draws."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        path = Path(folder) / "limits.png"
        limits_command.main(["--noise", "0.05", "--plot", str(path)])
        return path.read_bytes()


def extraction() -> bytes:
    """Show the marked edges, and the lines, their points and where they meet."""
    scene = named_scene("straight_road")
    frame = scene.frame(0)
    rig = scene.scene.rig
    result = Calibrator(rig).add(frame.left, frame.right)
    stripes = find_stripe_points(frame.left, CalibratorConfig().extraction)
    marked = draw_camera_view(frame.left, rig, None, 1.5, np.column_stack([stripes.columns, stripes.rows]))
    # Without the pose: lines and points alone.
    found = replace(result, extrinsics=None, stages={})
    return _jpeg(_beside([marked, draw_camera_view(frame.left, rig, found, 1.5)]))


def misfit() -> bytes:
    """Show one frame from above under the right pose, and under three that are off."""
    scene = named_scene("straight_road").scene
    scene = replace(scene, rig=RIGS["kitti"][0]).with_noise(0.01)
    images = render(scene, np.random.default_rng(0))
    truth = scene.extrinsics
    panels = []
    for title, pose in (
        ("as it is", truth),
        ("roll 3 deg off", replace(truth, roll_rad=truth.roll_rad + math.radians(3))),
        ("pitch 0.5 deg off", replace(truth, pitch_rad=truth.pitch_rad + math.radians(0.5))),
        ("height 0.15 m off", replace(truth, height_m=truth.height_m + 0.15)),
    ):
        bar = verdict_strip(StripContent(title, WHITE if pose == truth else VERMILION), _WIDTH_PX)
        panels += [bar, draw_birds_eye(*images, scene.rig, pose, _WIDTH_PX)[_WIDTH_PX // 30 :]]
    return _jpeg(np.vstack(panels))


def kerb() -> bytes:
    """Show a refused frame: a kerb painted like a line."""
    world = named_world("kerb_for_line")
    rig = world.scene.rig
    left, right = render_world(world, np.random.default_rng(0))
    result = Calibrator(rig).add(left, right)
    return _jpeg(draw_overview(left, right, rig, result))


def fitness() -> bytes:
    """Show the fitness over pitch and roll, at the best height: a valley."""
    scene = named_scene("straight_road")
    frame = scene.frame(0)
    calibrator = Calibrator(scene.scene.rig)
    result = calibrator.add(frame.left, frame.right)
    assert result.pattern is not None
    best = result.stages["genetic"]
    measure = PatternFitness(result.pattern, scene.scene.rig, calibrator.config.fitness)
    panels = [_landscape(measure, best, *size_deg) for size_deg in ((3.0, 3.0), (0.05, 0.5))]
    return _png(_beside(panels))


def _landscape(measure: PatternFitness, best: Extrinsics, pitch_deg: float, roll_deg: float) -> Image:
    """Draw log10 of the misfit around an estimate, pitch to the right, roll up; dark is good."""
    title = f"pitch +-{pitch_deg:g} deg, roll +-{roll_deg:g} deg"
    pitch_rad, roll_rad = math.radians(pitch_deg), math.radians(roll_deg)
    size = 420
    pitch = best.pitch_rad + np.linspace(-pitch_rad, pitch_rad, size)
    roll = best.roll_rad + np.linspace(roll_rad, -roll_rad, size)
    grid = np.stack(np.meshgrid(pitch, roll), axis=-1).reshape(-1, 2)
    poses = np.column_stack([np.full(len(grid), best.height_m), grid])
    misfit_px = np.sqrt(1.0 / measure(poses)).reshape(size, size)
    low, high = 0.01, 100.0  # pixels: the K of the fitness, and a line that is nowhere near
    level = np.clip(np.log10(misfit_px / low) / np.log10(high / low), 0.0, 1.0)
    colours = np.asarray(cv2.applyColorMap((level * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS), np.uint8)
    canvas = Canvas(colours, 1.0)
    canvas.dot(np.array([size / 2, size / 2]), 9.0, DARK, 4)
    canvas.dot(np.array([size / 2, size / 2]), 9.0, WHITE, 2)
    bar = verdict_strip(StripContent(title, WHITE), size, 1)
    return np.vstack([bar, canvas.pixels])


def _beside(pictures: Sequence[Image]) -> Image:
    """Put pictures of one height beside each other."""
    height = pictures[0].shape[0]
    gap = np.full((height, _GAP_PX, 3), 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)][1:]
    return np.hstack(parts)


def _png(picture: Image) -> bytes:
    return cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()


def _jpeg(picture: Image) -> bytes:
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()


FIGURES: dict[str, Callable[[], bytes]] = {
    "alignment.svg": alignment_svg,
    "data_flow.svg": data_flow_svg,
    "frames.svg": frames_svg,
    "debug_image.jpg": debug_image,
    "extraction.jpg": extraction,
    "fitness.png": fitness,
    "kerb.jpg": kerb,
    "limits.png": limits,
    "misfit.jpg": misfit,
    "overview.jpg": overview,
}


def main(arguments: list[str]) -> int:
    """Write all figures into a folder, by default that of the docs."""
    folder = Path(arguments[0]) if arguments else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    for name, make in FIGURES.items():
        (folder / name).write_bytes(make())
        sys.stdout.write(f"{folder / name}\n")
    return 0 if arguments else outputs.main()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
