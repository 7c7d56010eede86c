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

"""The texts of a picture: the verdict, the numbers, and the measured value of each gate.

People with any kind of colour vision can distinguish the colours; the verdict is also given as a word.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from ..core.geometry.pose import POSE_COMPONENTS
from ..core.results import CalibrationResult
from ..core.types import Image
from .canvas import GREEN, VERMILION, WHITE, Colour, dark_strip, to_ascii

LINE_CHARACTERS = 95  # of a line of text across the picture

_GATE_COLUMNS = 3
_WHOLE = 100.0  # from here on three digits are a whole number
_UNITS = {"standard deviations": "std"}  # what is too long for a column
_GAP = 4 * " "  # between two components of a pose


@dataclass(frozen=True, slots=True)
class StripContent:
    """Text of a strip across a picture.

    Attributes:
        title: A few words.
        colour: Colour of the bar beside the text.
        lines: Text below the title. Long lines are wrapped.
    """

    title: str
    colour: Colour
    lines: tuple[str, ...] = ()


def verdict_of(result: CalibrationResult) -> StripContent:
    """Return the verdict on a result: accepted or refused, with its numbers or the reason."""
    if not result.accepted:
        return StripContent(f"REFUSED: {result.reason}", VERMILION, (result.message,))
    frames = f" from {result.n_frames} frames" if result.n_frames > 1 else ""
    return StripContent(f"CALIBRATED{frames}", GREEN, numbers(result))


def numbers(result: CalibrationResult) -> tuple[str, ...]:
    """Return the lines of text with the numbers of an accepted result, and with its notes.

    Those of the mount are called so: the standard deviations of a frame are of the moment alone.
    """
    pose, std = result.extrinsics, result.std
    if pose is None or std is None:
        return (result.message,)
    line = _GAP.join(f"{each.label} {each.describe(pose, std, fine=False)}" for each in POSE_COMPONENTS)
    line = line if result.mount is None else f"mount: {line}"
    return (line, "; ".join(result.notes)) if result.notes else (line,)


def verdict_strip(verdict: StripContent, width: int, height: int = 0) -> Image:
    """Return a strip with the verdict in words, (H, width, 3) uint8.

    Args:
        verdict: Text of the strip.
        width: Width [px].
        height: Least height [px].
    """
    step = dark_strip(width, 1).line_height
    lines = [part for line in verdict.lines for part in textwrap.wrap(to_ascii(line), LINE_CHARACTERS)]
    strip = dark_strip(width, max((len(lines) + 1.9) * step, height))
    strip.pixels[:, : round(0.4 * step)] = verdict.colour
    strip.text(to_ascii(verdict.title), 0.9 * step, 1.15 * step, size=1.3)
    for number, line in enumerate(lines):
        strip.text(line, 0.9 * step, (2.3 + number) * step)
    return strip.pixels


def gate_strip(result: CalibrationResult, width: int) -> Image:
    """Return the strip with the value of each gate beside its limit; a gate that refuses stands out."""
    step = 0.8 * dark_strip(width, 1).line_height
    n_rows = -(-len(result.gates) // _GATE_COLUMNS)
    strip = dark_strip(width, (n_rows + 0.8) * step)
    for number, gate in enumerate(result.gates):
        column, row = divmod(number, n_rows)
        unit = _UNITS.get(gate.unit, gate.unit)
        value = f"{_short(gate.value)} {unit}".rstrip()
        text = f"{gate.label}: {value} ({gate.bound} {_short(gate.threshold)})"
        x = (column + 0.03) * width / _GATE_COLUMNS
        mark, colour = ("+", GREEN) if gate.passed else ("x", VERMILION)
        x += strip.text(mark, x, (row + 1) * step, colour, size=0.8) + 0.3 * step
        strip.text(to_ascii(text), x, (row + 1) * step, WHITE if gate.passed else VERMILION, size=0.65)
    return strip.pixels


def _short(value: float) -> str:
    """Return a value with three digits, without an exponent for large values."""
    return f"{value:.0f}" if abs(value) >= _WHOLE else f"{value:.3g}"
