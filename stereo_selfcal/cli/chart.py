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

"""Small line charts drawn with OpenCV: panels with logarithmic axes, ticks and directly labelled curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Colour = tuple[int, int, int]
ChartImage = npt.NDArray[np.uint8]

# BGR, from Okabe and Ito ("Color Universal Design", 2008): told apart with any kind of colour vision.
BLUE: Colour = (178, 114, 0)
VERMILION: Colour = (0, 94, 213)
GREEN: Colour = (115, 158, 0)
CURVE_COLOURS = (BLUE, VERMILION, GREEN)

BLACK: Colour = (30, 30, 30)
GRID: Colour = (225, 225, 225)
WHITE = 255

PANEL_PX = (470, 330)  # width, height
MARGINS_PX = (86, 96, 44, 58)  # left (tick labels), right (names of the curves), top (title), bottom
HEADER_PX = 56  # above all panels
FONT = cv2.FONT_HERSHEY_SIMPLEX
TEXT_SCALE = 0.48
TITLE_SCALE = 0.56
LABEL_SPACING_PX = 17.0  # between the names of two curves
_SPREAD_ROUNDS = 20
_LETTER_HEIGHT_PX = 6  # half the height of a capital at TEXT_SCALE

# Ticks of a logarithmic axis: these digits times powers of ten; all of them if few fall into the range.
_DIGITS = (1, 2, 5)
_MAX_TICKS = 7
_SHIFT = 4  # OpenCV takes coordinates in 1/16 px


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a panel.

    Attributes:
        label: Its name, written at its right end.
        y: Values, as many as the panel has x, positive.
    """

    label: str
    y: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """One diagram.

    Attributes:
        title: Drawn quantity, with its unit.
        x_label: Quantity of the abscissa, with its unit.
        x: Abscissae, positive, rising.
        curves: At most as many as there are colours.
        point: (x, y) to be marked with a ring, None for no mark.
    """

    title: str
    x_label: str
    x: tuple[float, ...]
    curves: tuple[Curve, ...]
    point: tuple[float, float] | None = None


def draw_charts(header: str, rows: Sequence[Sequence[Panel]]) -> ChartImage:
    """Draw panels in rows below a header.

    Args:
        header: One line of text.
        rows: Panels of every row.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    width, height = PANEL_PX
    shape = (HEADER_PX + height * len(rows), width * max(len(row) for row in rows), 3)
    picture = np.full(shape, WHITE, np.uint8)
    _write(picture, header, (MARGINS_PX[0], HEADER_PX * 2 // 3), TITLE_SCALE)
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            _draw(picture, panel, (j * width, HEADER_PX + i * height))
    return picture


def _draw(picture: ChartImage, panel: Panel, corner: tuple[int, int]) -> None:
    """Draw one panel with its upper left corner at ``corner`` [px]."""
    left, right = corner[0] + MARGINS_PX[0], corner[0] + PANEL_PX[0] - MARGINS_PX[1]
    top, bottom = corner[1] + MARGINS_PX[2], corner[1] + PANEL_PX[1] - MARGINS_PX[3]
    values = [y for curve in panel.curves for y in curve.y]
    x_range = (panel.x[0], panel.x[-1])
    y_range = (min(values) / 1.15, max(values) * 1.15)  # the curves keep off the frame

    def column(x: float) -> float:
        return left + _fraction(x, x_range) * (right - left)

    def row(y: float) -> float:
        return bottom - _fraction(y, y_range) * (bottom - top)

    for x in log_ticks(*x_range):
        _line(picture, [(column(x), top), (column(x), bottom)], GRID)
        _write(picture, f"{x:g}", (column(x), bottom + 20), align=0.5)
    for y in log_ticks(*y_range):
        _line(picture, [(left, row(y)), (right, row(y))], GRID)
        _write(picture, f"{y:g}", (left - 8, row(y) + _LETTER_HEIGHT_PX - 1), align=1.0)
    _line(picture, [(left, top), (left, bottom), (right, bottom)], BLACK)
    _write(picture, panel.title, (left, top - 14), TITLE_SCALE)
    _write(picture, panel.x_label, ((left + right) / 2, bottom + 43), align=0.5)
    ends = spread([row(curve.y[-1]) for curve in panel.curves], LABEL_SPACING_PX)
    for curve, colour, end in zip(panel.curves, CURVE_COLOURS, ends, strict=False):
        points = [(column(x), row(y)) for x, y in zip(panel.x, curve.y, strict=True)]
        _line(picture, points, colour, thickness=2)
        _write(picture, curve.label, (right + 8, end + _LETTER_HEIGHT_PX - 1), colour=colour)
    if panel.point is not None:
        x, y = column(panel.point[0]), row(panel.point[1])
        _line(picture, [(x, y), (x, bottom)], BLACK)
        centre = (round(x * (1 << _SHIFT)), round(y * (1 << _SHIFT)))
        cv2.circle(picture, centre, 5 << _SHIFT, (WHITE, WHITE, WHITE), -1, cv2.LINE_AA, _SHIFT)
        cv2.circle(picture, centre, 5 << _SHIFT, BLACK, 2, cv2.LINE_AA, _SHIFT)


def log_ticks(low: float, high: float) -> list[float]:
    """Return round numbers within a range: 1, 2, 5 times powers of ten; powers alone if those are many."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    # Decimal numbers are read, not computed: 10.0 ** -2 * 5 is no round number.
    ticks = [float(f"{digit}e{exponent}") for exponent in exponents for digit in _DIGITS]
    inside = [tick for tick in ticks if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]
    if len(inside) <= _MAX_TICKS:
        return inside
    return [tick for tick in inside if f"{tick:e}".startswith("1.")]


def spread(positions: Sequence[float], spacing: float) -> list[float]:
    """Move positions apart until neighbours are at least ``spacing`` apart; order and middle stay."""
    order = sorted(range(len(positions)), key=lambda i: positions[i])
    moved = [positions[i] for i in order]
    # Distances too small are made up for half on either side; a few rounds settle a handful of labels.
    for _ in range(_SPREAD_ROUNDS):
        for i in range(1, len(moved)):
            lack = max(spacing - (moved[i] - moved[i - 1]), 0.0) / 2
            moved[i - 1] -= lack
            moved[i] += lack
    placed = dict(zip(order, moved, strict=True))
    return [placed[i] for i in range(len(positions))]


def _fraction(value: float, bounds: tuple[float, float]) -> float:
    low, high = bounds
    return math.log(value / low) / math.log(high / low)


def _line(
    picture: ChartImage, points: Sequence[tuple[float, float]], colour: Colour, thickness: int = 1
) -> None:
    fixed = np.round(np.array(points) * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(picture, [fixed.reshape(-1, 1, 2)], False, colour, thickness, cv2.LINE_AA, _SHIFT)


def _write(
    picture: ChartImage,
    text: str,
    position: tuple[float, float],
    scale: float = TEXT_SCALE,
    colour: Colour = BLACK,
    align: float = 0.0,
) -> None:
    """Write with the base line at ``position``; ``align``: 0 begins there, 0.5 is centred, 1 ends there."""
    (width, _), _ = cv2.getTextSize(text, FONT, scale, 1)
    origin = (round(position[0] - align * width), round(position[1]))
    cv2.putText(picture, text, origin, FONT, scale, colour, 1, cv2.LINE_AA)
