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

"""Charts as SVG, to stand inside a page: they take its colours, fonts and width.

Colours are classes of the page's style (``frame``, ``mount``, ``moved``, ...): light and dark are one file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Units of the view box; the page scales it to its width. On a phone that is half of it, so the style has
# letters of PHONE_LETTERS there, for which the margins have room.
WIDTH, HEIGHT = 720, 256
PHONE_LETTERS = 26  # units; 13 px on a phone of 390 px, where a chart is 362 px wide
_LEFT, _RIGHT, _TOP, _BOTTOM = 104, 36, 16, 78
_TICK_BELOW, _LABEL_ABOVE_EDGE = 34, 9
_RUG = 7  # height of the marks of refused frames
MOST_POINTS = 1500  # more dots than pixels make a file heavy and show nothing more
_FEW = 200  # so few dots are drawn larger
_ROOM = 0.08  # of the range, above and below the values
_MOST_TICKS = 6
_MOST_TIMES = 6  # so many of them do not touch on a phone
_MOST_COUNTS = 12  # the same of counts, which are shorter


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A level over a stretch of time.

    Attributes:
        start: Where it begins on the axis.
        end: Where it ends.
        value: Its height.
        spread: Half the height of the band around it.
    """

    start: float
    end: float
    value: float
    spread: float


def ticks(low: float, high: float, most: int = _MOST_TICKS, least_step: float = 0.0) -> list[float]:
    """Return at most ``most`` round numbers within a range, at least ``least_step`` apart."""
    span = high - low
    if not span > 0:
        return [low]
    power = 10.0 ** math.floor(math.log10(span / most))
    steps = (m * power for m in (1, 2, 5, 10, 20))
    step = max(next(step for step in steps if span / step <= most - 1), least_step)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def tick_text(value: float, step: float) -> str:
    """Return a tick with as many digits as its step has."""
    digits = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0 else 2
    return f"{value + 0.0:.{digits}f}"


def time_series(
    times: Array,
    values: Array,
    refused: Array,
    levels: Sequence[Level],
    moves: Sequence[float],
    labels: tuple[str, str],
    marked: Sequence[bool] = (),
    least_step: float = 0.0,
    joined: bool = False,
) -> str:
    """Draw values over time as dots, with levels, moves and the frames that were refused.

    Args:
        times: (N,) of the dots, on the axis.
        values: (N,).
        refused: (M,) times of refused frames, marked at the bottom.
        levels: Levels with their bands.
        moves: Times that are marked across the chart.
        labels: Of the vertical axis, for screen readers, and of the horizontal one.
        marked: Whether each dot stands out; empty: none does.
        least_step: Least distance of two numbers below the horizontal axis.
        joined: Whether a line joins the dots.
    """
    every = max(1, -(-len(times) // MOST_POINTS))
    ends = [end for level in levels for end in (level.start, level.end)]
    x_range = _range([*times[[0, -1]], *(refused[[0, -1]] if len(refused) else ()), *ends], 0.02)
    # A single wild frame must not flatten all others: dots beyond are put on the edge.
    low, high = (
        (float(v) for v in np.quantile(values, [0.005, 0.995]))
        if len(values) > 20
        else (float(values.min()), float(values.max()))
    )
    bounds = [v for level in levels for v in (level.value - level.spread, level.value + level.spread)]
    y_range = _range([low, high, *bounds], _ROOM)
    x, y = _scale(x_range, (_LEFT, WIDTH - _RIGHT)), _scale(y_range, (HEIGHT - _BOTTOM, _TOP))
    parts = [_axes(x_range, y_range, labels[1], least_step)]
    for level in levels:
        top, height = (
            y(level.value + level.spread),
            y(level.value - level.spread) - y(level.value + level.spread),
        )
        wide = max(x(level.end) - x(level.start), 2.0)
        parts.append(_tag("rect", "band", x=x(level.start), y=top, width=wide, height=max(height, 1.0)))
    shown = np.clip(values[::every], *y_range)
    if joined:
        way = "L".join(f"{x(a):.1f} {y(b):.1f}" for a, b in zip(times[::every], shown, strict=True))
        parts.append(f'<path class="way" d="M{way}"/>')
    dots = "".join(f"M{x(a):.1f} {y(b):.1f}h0" for a, b in zip(times[::every], shown, strict=True))
    size = "frame few" if len(times) <= _FEW else "frame"
    parts.append(f'<path class="{size}" d="{dots}"/>')
    for level in levels:
        parts.append(
            _line(
                "mount", x(level.start), y(level.value), max(x(level.end), x(level.start) + 2), y(level.value)
            )
        )
    if any(marked):
        stand_out = [index for index, mark in enumerate(marked) if mark]
        inside = np.clip(values[stand_out], *y_range)
        dots = "".join(f"M{x(a):.1f} {y(b):.1f}h0" for a, b in zip(times[stand_out], inside, strict=True))
        parts.append(f'<path class="changed" d="{dots}"/>')
    parts += [_line("moved", x(at), _TOP, x(at), HEIGHT - _BOTTOM) for at in moves]
    few = refused[:: max(1, -(-len(refused) // MOST_POINTS))]
    rug = "".join(f"M{x(at):.1f} {HEIGHT - _BOTTOM}v-{_RUG}" for at in few)
    parts.append(f'<path class="refused" d="{rug}"/>' if rug else "")
    return _svg(parts, labels[0])


def histogram(values: Array, label: str, x_label: str, reach: float = 4.0, n_bins: int = 16) -> str:
    """Draw how values in standard deviations are distributed, beside the normal distribution.

    Args:
        values: (N,), in standard deviations; what is beyond ``reach`` is counted in the last bin.
        label: For screen readers.
        x_label: Under the axis.
        reach: Greatest value of the axis.
        n_bins: Number of bars.
    """
    edges = np.linspace(-reach, reach, n_bins + 1)
    counts, _ = np.histogram(np.clip(values, -reach, reach), edges)
    share = counts / max(len(values), 1)
    grid = np.linspace(-reach, reach, 81)
    normal = np.exp(-(grid**2) / 2) / math.sqrt(2 * math.pi) * (2 * reach / n_bins)
    y_range = (0.0, 1.1 * float(max(share.max(), normal.max())))
    x, y = _scale((-reach, reach), (_LEFT, WIDTH - _RIGHT)), _scale(y_range, (HEIGHT - _BOTTOM, _TOP))
    parts = [_axes((-reach, reach), y_range, x_label)]
    for left, right, height in zip(edges, edges[1:], share, strict=False):
        if height:
            parts.append(
                _tag(
                    "rect",
                    "bar",
                    x=x(left) + 1,
                    y=y(height),
                    width=x(right) - x(left) - 2,
                    height=y(0) - y(height),
                )
            )
    curve = "L".join(f"{x(a):.1f} {y(b):.1f}" for a, b in zip(grid, normal, strict=True))
    parts.append(f'<path class="mount" d="M{curve}"/>')
    return _svg(parts, label)


def _range(values: Sequence[float], room: float) -> tuple[float, float]:
    low, high = float(min(values)), float(max(values))
    span = (high - low) or max(abs(high), 1.0) * 1e-3
    return low - room * span, high + room * span


class _scale:  # noqa: N801 - used like a function
    """Linear map from one range to another."""

    def __init__(self, source: tuple[float, float], target: tuple[float, float]) -> None:
        self._factor = (target[1] - target[0]) / (source[1] - source[0])
        self._offset = target[0] - source[0] * self._factor

    def __call__(self, value: float) -> float:
        return float(value) * self._factor + self._offset


def _axes(
    x_range: tuple[float, float], y_range: tuple[float, float], x_label: str, least_step: float = 0.0
) -> str:
    x, y = _scale(x_range, (_LEFT, WIDTH - _RIGHT)), _scale(y_range, (HEIGHT - _BOTTOM, _TOP))
    parts = []
    most = _MOST_COUNTS if least_step >= 1.0 else _MOST_TIMES
    for axis, scale in ((ticks(*y_range), y), (ticks(*x_range, most, least_step), x)):
        step = axis[1] - axis[0] if len(axis) > 1 else abs(axis[0]) or 1.0
        for value in axis:
            text = tick_text(value, step)
            if scale is y:
                parts.append(_line("grid", _LEFT, y(value), WIDTH - _RIGHT, y(value)))
                parts.append(f'<text class="end" x="{_LEFT - 6}" y="{y(value):.1f}" dy=".35em">{text}</text>')
            else:
                below = HEIGHT - _BOTTOM + _TICK_BELOW
                parts.append(f'<text class="middle" x="{x(value):.1f}" y="{below}">{text}</text>')
    parts.append(_line("axis", _LEFT, HEIGHT - _BOTTOM, WIDTH - _RIGHT, HEIGHT - _BOTTOM))
    parts.append(f'<text class="end" x="{WIDTH - _RIGHT}" y="{HEIGHT - _LABEL_ABOVE_EDGE}">{x_label}</text>')
    return "".join(parts)


def _line(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    return _tag("line", kind, x1=x1, y1=y1, x2=x2, y2=y2)


def _tag(name: str, kind: str, **numbers: float) -> str:
    attributes = " ".join(f'{key}="{value:.1f}"' for key, value in numbers.items())
    return f'<{name} class="{kind}" {attributes}/>'


def _svg(parts: Sequence[str], label: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">' + "".join(parts) + "</svg>"
