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
from stereo_selfcal.cli import limits as limits_command
from stereo_selfcal.core.estimators.fitness import PatternFitness
from stereo_selfcal.core.geometry.pose import road_from_camera_rotation
from stereo_selfcal.core.lanes.stripe_points import find_stripe_points
from stereo_selfcal.core.types import Array, Image
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

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "figures"

_WIDTH_PX = 960
_JPEG_QUALITY = 85

# Angles of the drawing, much larger than those of any car, to be seen.
_PITCH, _ROLL, _YAW = math.radians(14), math.radians(14), math.radians(18)
_INK, _ROAD, _CAMERA, _ANGLE = "#333333", "#0072b2", "#d55e00", "#009e73"  # Okabe and Ito

_GAP_PX = 6


def frames_svg() -> bytes:
    """Draw the frames and the signs: from the side, from behind, from above."""
    side = _Panel("from the right side", "pitch > 0: nose down", right=(1, 0, 0), up=(0, 0, 1), left=20)
    behind = _Panel("from behind", "roll > 0: right side down", right=(0, -1, 0), up=(0, 0, 1), left=350)
    above = _Panel(
        "from above", "lane_yaw > 0: points left of the lane", right=(0, -1, 0), up=(1, 0, 0), left=680
    )
    side.pose(road_from_camera_rotation(_PITCH, 0.0), height=118, axes="xz", turned="x", name="pitch")
    behind.pose(road_from_camera_rotation(0.0, _ROLL), height=118, axes="yz", turned="y", name="roll")
    above.lane(road_from_camera_rotation(0.0, 0.0, _YAW))
    body = "\n".join(line for panel in (side, behind, above) for line in panel.parts)
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1010 330"
 font-family="sans-serif" font-size="14">
<title>Frames and signs of stereo_selfcal</title>
<defs>{"".join(_arrow_head(colour) for colour in (_INK, _ROAD, _CAMERA, _ANGLE))}</defs>
<rect width="1010" height="330" rx="6" fill="#ffffff"/>
{body}
</svg>
""".encode()


class _Panel:
    """One view of the drawing: an orthographic projection of road coordinates."""

    def __init__(
        self, title: str, sign: str, right: tuple[int, ...], up: tuple[int, ...], left: float
    ) -> None:
        self._axes = np.array([right, [-value for value in up]], dtype=float)  # rows of an SVG run down
        self._left = left
        self._origin = np.array([left + 120.0, 255.0])
        self.parts = [
            _text((left + 155, 30), f"<tspan font-weight='bold'>{title}</tspan>", _INK, "middle"),
            _text((left + 155, 312), _escaped(sign), _ANGLE, "middle"),
        ]

    def pose(self, rotation: Array, height: float, axes: str, turned: str, name: str) -> None:
        """Draw road frame, camera frame at a height, and the angle between one pair of axes."""
        if axes[0] == "y":  # left is to the left here: room for it
            self._origin[0] += 90
        eye = np.array([0.0, 0.0, height])
        ends = self._at([0, 0, 0]), self._at(eye)
        ground = self._origin[1]
        self.parts.append(
            f'<line x1="{self._left + 10}" y1="{ground}" x2="{self._left + 300}" y2="{ground}" '
            f'stroke="#999999" stroke-width="5"/>'
        )
        self.parts.append(_line(*ends, _INK, dash=True))
        middle = (ends[0] + ends[1]) / 2
        self.parts.append(_text((middle[0] - 8, middle[1] + 5), "height", _INK, "end"))
        self._frame(np.zeros(3), np.eye(3), axes, 70, _ROAD, aside=(11, -3))
        level = np.eye(3)["xyz".index(turned)]
        self.parts.append(_line(self._at(eye), self._at(eye + 130 * level), "#999999", dash=True))
        self._camera(eye, rotation, axes)
        self._frame(eye, rotation, axes, 88, _CAMERA)
        self._angle(eye, level, rotation @ level, 120, name)

    def lane(self, rotation: Array) -> None:
        """Draw a lane from above, and a camera that does not look along it."""
        self._origin = np.array([self._left + 155.0, 225.0])
        for offset in (-120, 120):
            self.parts.append(
                _line(self._at([-40, offset, 0]), self._at([185, offset, 0]), "#999999", width=6)
            )
        forward = np.array([1.0, 0.0, 0.0])
        self.parts.append(_line(self._at([0, 0, 0]), self._at([150, 0, 0]), "#999999", dash=True))
        self.parts.append(_text(self._at([160, 0, 0]), "along the lane", _INK, "middle"))
        self._camera(np.zeros(3), rotation, "yx")
        self._frame(np.zeros(3), rotation, "xy", 95, _CAMERA)
        self._angle(np.zeros(3), forward, rotation @ forward, 125, "lane_yaw")

    def _at(self, point: Sequence[float] | Array) -> Array:
        place: Array = self._origin + self._axes @ np.asarray(point, dtype=float)
        return place

    def _frame(
        self,
        origin: Array,
        rotation: Array,
        axes: str,
        length: float,
        colour: str,
        aside: tuple[int, int] = (0, 5),
    ) -> None:
        for name in axes:
            direction = rotation[:, "xyz".index(name)]
            end = self._at(origin + length * direction)
            self.parts.append(_line(self._at(origin), end, colour, arrow=True, width=2.5))
            shift = (-aside[0], aside[1]) if name == "y" else aside
            label = self._at(origin + (length + (14 if aside[0] == 0 else 0)) * direction)
            self.parts.append(_text(label + shift, name, colour, "middle"))

    def _camera(self, origin: Array, rotation: Array, axes: str) -> None:
        """Draw the body of the rig: a box along the first of the axes shown."""
        half = {"x": 16.0, "y": 42.0, "z": 11.0}
        first, second = (rotation[:, "xyz".index(name)] * half[name] for name in axes)
        corners = [self._at(origin + a * first + b * second) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(f'<polygon points="{path}" fill="#f0d0b0" stroke="{_CAMERA}"/>')

    def _angle(self, origin: Array, start: Array, end: Array, radius: float, name: str) -> None:
        """Draw the angle from one direction to another as an arc with an arrow."""
        steps = np.linspace(0.0, 1.0, 13)
        directions = [(1 - t) * start + t * end for t in steps]
        points = [self._at(origin + radius * d / np.linalg.norm(d)) for d in directions]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.parts.append(
            f'<polyline points="{path}" fill="none" stroke="{_ANGLE}" stroke-width="2.5" '
            f'marker-end="url(#head{_ANGLE[1:]})"/>'
        )
        middle = directions[6] / np.linalg.norm(directions[6])
        outwards = self._at(origin + (radius + 12) * middle)
        anchor = "start" if outwards[0] > points[6][0] + 4 else "end"
        self.parts.append(_text((outwards[0], outwards[1] + 5), name, _ANGLE, anchor))


def _line(
    a: Array, b: Array, colour: str, dash: bool = False, arrow: bool = False, width: float = 1.5
) -> str:
    more = ' stroke-dasharray="5 4"' if dash else ""
    more += f' marker-end="url(#head{colour[1:]})"' if arrow else ""
    return (
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" '
        f'stroke="{colour}" stroke-width="{width}"{more}/>'
    )


def _text(place: Sequence[float] | Array, text: str, colour: str, anchor: str) -> str:
    return f'<text x="{place[0]:.1f}" y="{place[1]:.1f}" fill="{colour}" text-anchor="{anchor}">{text}</text>'


def _arrow_head(colour: str) -> str:
    return (
        f'<marker id="head{colour[1:]}" viewBox="0 0 10 10" refX="8" refY="5" '
        f'markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0 L10 5 L0 10 z" fill="{colour}"/></marker>'
    )


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace(">", "&gt;").replace("<", "&lt;")


def overview() -> bytes:
    """Show what `make demo` writes: a calibrated frame."""
    scene = named_scene("straight_road")
    frame = scene.frame(0)
    rig = scene.scene.rig
    return _jpeg(draw_overview(frame.left, frame.right, rig, Calibrator(rig).add(frame.left, frame.right)))


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
