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

"""``limits``: how well height, pitch and roll can be known at all with a rig, before anything is mounted."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..core.analysis.cramer_rao import DEFAULT_CONTRAST, limits, location_std
from ..core.camera.rig import StereoRig
from ..core.geometry.pose import POSE_COMPONENTS, POSE_NAMES, Extrinsics
from ..core.types import Array
from ..files.atomic_file import write_atomically
from ..files.rig_file import read_rig_file
from ..synth.scenes import PAPER_RIG
from ..synth.world import LANE_WIDTH_M, LINE_WIDTH_M, MAX_TILT_RAD, PSF_SIGMA_PX
from .chart import ChartImage, Curve, Panel, draw_charts
from .console import EXIT_OK, OTHER_STATUSES, Parser, UsageError, run
from .outputs import File, check_outputs
from .replay_options import positive_int

_DESCRIPTION = """\
Print how well height, pitch and roll can be known at all: the Cramer-Rao bound of a stereo frame with the
two solid lines of a lane, the rig in its middle, and where a road point straight ahead is placed with them.
"""
_EPILOG = f"""\
exit status: 0 printed; 2 bad usage, unreadable input, or the cameras see too little of the lines;
{OTHER_STATUSES}
The bound counts pixel noise alone; lane yaw, positions, widths and grey levels of the lines are unknown.
A road that is not flat, or a rig calibrated wrongly, comes on top, in every frame alike.
"""

# Distances at which a location error is quoted, and the distance of the chart.
LOCATION_DISTANCES_M = (10.0, 20.0, 30.0, 50.0)
CHART_DISTANCE_M = 30.0
# The chart: baselines from a small stereo camera to the width of a windscreen, and the noise for which the
# accuracy was measured.
CHART_BASELINES_M = (0.1, 1.0)
CHART_NOISES = (0.01, 0.20)
CHART_NOISE_CURVES = (0.01, 0.05, 0.20)
CHART_BASELINE_FACTORS = (1.0, 2.0, 4.0)
CHART_POINTS = 19  # of a curve; smooth to the eye

_GREY_LEVELS = 255.0
_DEFAULT_HEIGHT_M = 1.4
_DEFAULT_PITCH_DEG = 3.0  # that of synth
_DEFAULT_NOISE = 0.01  # that of synth


@dataclass(frozen=True, slots=True)
class Setup:
    """Rig, pose, lines and images that the bound is computed for.

    Attributes:
        rig: The rectified pair.
        height_m: Height over the road [m].
        pitch_rad: Pitch [rad].
        lane_width_m: Distance of the middles of both lines [m].
        line_width_m: Width of a line [m].
        noise_fraction: Standard deviation of the pixel noise as a fraction of 255.
        contrast: Paint minus road surface [grey levels].
        psf_px: Standard deviation of the blur of the lens [px].
        frames: Frames that are fused; their noise is independent.
    """

    rig: StereoRig
    height_m: float
    pitch_rad: float
    lane_width_m: float
    line_width_m: float
    noise_fraction: float
    contrast: float
    psf_px: float
    frames: int

    @property
    def extrinsics(self) -> Extrinsics:
        """The pose, without roll."""
        return Extrinsics(self.height_m, self.pitch_rad, 0.0)

    def covariance(self) -> Array:
        """Return the bound of (height_m, pitch_rad, roll_rad), shape (3, 3)."""
        bound = limits(
            self.rig,
            self.extrinsics,
            line_positions_m=(self.lane_width_m / 2, -self.lane_width_m / 2),
            line_width_m=self.line_width_m,
            contrast=self.contrast,
            noise_grey=self.noise_fraction * _GREY_LEVELS,
            psf_sigma_px=self.psf_px,
        )
        return bound / self.frames

    def location_std_m(self, covariance: Array, distance_m: float) -> float:
        """Return how far off a point straight ahead is placed [m]."""
        return location_std(covariance, self.rig, self.extrinsics, distance_m)

    def describe(self) -> str:
        """Return the setup in one line."""
        rig = self.rig
        return (
            f"{rig.width} x {rig.height} px, f {rig.fx:g} px, baseline {rig.baseline_m * 1e3:g} mm, "
            f"height {self.height_m:g} m, pitch {math.degrees(self.pitch_rad):g} deg"
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status that its help explains."""
    return run("limits", _limits, argv)


def _limits(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    if arguments.plot is not None:
        rig = [] if arguments.rig is None else [File("--rig", arguments.rig)]
        check_outputs([File("--plot", arguments.plot)], rig)
        if arguments.plot.suffix.lower() != ".png":
            raise UsageError(f"--plot {arguments.plot}: charts are written as PNG; end the name in .png")
    if arguments.line_width_m >= arguments.lane_width_m:
        raise UsageError(
            f"--line-width-m {arguments.line_width_m:g} is not less than --lane-width-m "
            f"{arguments.lane_width_m:g}: the lines would overlap"
        )
    setup = Setup(
        rig=PAPER_RIG if arguments.rig is None else read_rig_file(arguments.rig),
        height_m=arguments.height_m,
        pitch_rad=math.radians(arguments.pitch_deg),
        lane_width_m=arguments.lane_width_m,
        line_width_m=arguments.line_width_m,
        noise_fraction=arguments.noise,
        contrast=arguments.contrast,
        psf_px=arguments.psf_px,
        frames=arguments.frames,
    )
    covariance = setup.covariance()
    # The file first: a reader of stdout that goes away must not cost it.
    if arguments.plot is not None:
        _, content = cv2.imencode(".png", draw_limits(setup), [cv2.IMWRITE_PNG_COMPRESSION, 9])
        write_atomically(arguments.plot, content.tobytes())
    report = as_json if arguments.json else as_table
    sys.stdout.write(report(setup, covariance))
    return EXIT_OK


def as_table(setup: Setup, covariance: Array) -> str:
    """Return the table for people."""
    frames = "1 frame" if setup.frames == 1 else f"{setup.frames} frames"
    lines = [
        f"rig      {setup.describe()}",
        f"lines    2 solid, {setup.line_width_m:g} m wide, {setup.lane_width_m:g} m apart, contrast "
        f"{setup.contrast:g} grey levels",
        f"images   noise {setup.noise_fraction * 100:g} % of 255, blur {setup.psf_px:g} px, {frames}",
        "",
        f"{'':<20}{'standard deviation':>18}{'of distance':>14}",
        "-" * 52,
    ]
    for component, std in zip(POSE_COMPONENTS, np.sqrt(np.diag(covariance)), strict=True):
        unit = component.small_unit
        lines.append(f"{component.label:<21}{_digits(std * unit.per_si):>13} {unit.symbol}")
    for distance_m in LOCATION_DISTANCES_M:
        std_m = setup.location_std_m(covariance, distance_m)
        label = f"location at {distance_m:g} m"
        lines.append(f"{label:<21}{_digits(std_m * 1e3):>13} mm{_digits(std_m / distance_m * 100):>13} %")
    return "\n".join(lines) + "\n"


def as_json(setup: Setup, covariance: Array) -> str:
    """Return one JSON object in one line: SI units, radians, floats with all their digits."""
    content: dict[str, Any] = {
        "std": dict(zip(POSE_NAMES, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        "covariance": covariance.tolist(),
        "location": [
            {"distance_m": distance_m, "std_m": setup.location_std_m(covariance, distance_m)}
            for distance_m in LOCATION_DISTANCES_M
        ],
        "frames": setup.frames,
        "height_m": setup.height_m,
        "pitch_rad": setup.pitch_rad,
        "lane_width_m": setup.lane_width_m,
        "line_width_m": setup.line_width_m,
        "noise_fraction": setup.noise_fraction,
        "contrast": setup.contrast,
        "psf_px": setup.psf_px,
        "rig": setup.rig.to_mapping(),
    }
    return json.dumps(content, allow_nan=False) + "\n"


def draw_limits(setup: Setup) -> ChartImage:
    """Draw the components of the pose and the location error over the baseline (above) and the noise (below).

    Returns:
        (H, W, 3) uint8 BGR.
    """
    own_m = setup.rig.baseline_m
    baselines_m = np.geomspace(
        min(CHART_BASELINES_M[0], own_m), max(CHART_BASELINES_M[1], own_m), CHART_POINTS
    )
    noises = np.geomspace(
        min(CHART_NOISES[0], setup.noise_fraction), max(CHART_NOISES[1], setup.noise_fraction), CHART_POINTS
    )

    def shown(baseline_m: float) -> Array:
        """Return the drawn values, one per title, for the noise of the options."""
        rig = replace(setup.rig, baseline_m=baseline_m)
        changed = replace(setup, rig=rig)
        covariance = changed.covariance()
        stds = np.sqrt(np.diag(covariance)) * [component.small_unit.per_si for component in POSE_COMPONENTS]
        location_m = changed.location_std_m(covariance, CHART_DISTANCE_M)
        return np.array([*stds, location_m * 1e3])

    def per_noise(noise: float) -> float:
        return noise / setup.noise_fraction  # the bound is proportional to the noise

    over_baseline = np.array([shown(float(b)) for b in baselines_m])
    own = shown(own_m)
    titles = [f"{component.label} [{component.small_unit.symbol}]" for component in POSE_COMPONENTS]
    titles.append(f"location at {CHART_DISTANCE_M:g} m [mm]")
    upper = [
        _panel(
            title,
            "baseline [m]",
            baselines_m,
            {f"{n * 100:g} % noise": over_baseline[:, i] * per_noise(n) for n in CHART_NOISE_CURVES},
            (own_m, float(own[i])),
        )
        for i, title in enumerate(titles)
    ]
    by_baseline = {f"{own_m * f:.3g} m": shown(own_m * f) for f in CHART_BASELINE_FACTORS}
    lower = [
        _panel(
            title,
            "noise [% of 255]",
            noises * 100,
            {name: value[i] * per_noise(1.0) * noises for name, value in by_baseline.items()},
            (setup.noise_fraction * 100, float(own[i])),
        )
        for i, title in enumerate(titles)
    ]
    frames = "one frame" if setup.frames == 1 else f"{setup.frames} frames"
    return draw_charts(
        f"Smallest standard deviations from {frames}: {setup.describe()} (ring)", [upper, lower]
    )


def _panel(title: str, x_label: str, x: Array, curves: dict[str, Array], point: tuple[float, float]) -> Panel:
    drawn = tuple(Curve(label, tuple(y.tolist())) for label, y in curves.items())
    return Panel(title, x_label, tuple(x.tolist()), drawn, point)


def _digits(value: float) -> str:
    """Return three significant digits, without an exponent for all that is plausible."""
    decimals = max(2 - math.floor(math.log10(value)), 0) if value > 0 else 0
    return f"{value:.{decimals}f}"


def _between(low: float, high: float, *, open_low: bool = True) -> Callable[[str], float]:
    """Return a parser of numbers in a range, for argparse."""

    def parse(text: str) -> float:
        value = float(text)
        if not (low < value <= high or (value == low and not open_low)) or math.isinf(value):
            above = "above" if open_low else "at least"
            below = "" if math.isinf(high) else f" and at most {high:g}"
            raise argparse.ArgumentTypeError(f"{text} is not a finite number {above} {low:g}{below}")
        return value

    parse.__name__ = "number"  # argparse names it when float() refuses
    return parse


def _parser() -> Parser:
    parser = Parser(
        prog="limits",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    positive = _between(0.0, math.inf)
    tilt_deg = math.degrees(MAX_TILT_RAD)
    numbers = (
        ("--lane-width-m", LANE_WIDTH_M, positive, "distance of the middles of both lines [m]"),
        ("--line-width-m", LINE_WIDTH_M, positive, "width of a line [m]"),
        ("--height-m", _DEFAULT_HEIGHT_M, positive, "height of the middle of the baseline over the road [m]"),
        ("--pitch-deg", _DEFAULT_PITCH_DEG, _between(-tilt_deg, tilt_deg), "pitch [deg], > 0: nose down"),
        ("--noise", _DEFAULT_NOISE, _between(0.0, 1.0), "standard deviation of the noise, a fraction of 255"),
        (
            "--contrast",
            DEFAULT_CONTRAST,
            _between(0.0, _GREY_LEVELS),
            "paint minus road surface [grey levels]",
        ),
        ("--psf-px", PSF_SIGMA_PX, _between(0.0, math.inf, open_low=False), "blur of the lens, sigma [px]"),
    )
    add("--rig", metavar="FILE", type=Path, help="rig file, YAML or JSON (default: the paper's rig)")
    for option, default, kind, text in numbers:
        add(option, metavar="X", type=kind, default=default, help=f"{text} (default: {default:g})")
    add("--frames", metavar="N", type=positive_int, default=1, help="frames that are fused (default: 1)")
    add("--json", action="store_true", help="print one JSON object (SI units, radians) instead of the table")
    add("--plot", metavar="FILE", type=Path, help="draw it over baseline and noise (PNG)")
    return parser
