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

"""The drawing of docs/alignment.md: where the content of a right camera moves that is turned."""

from __future__ import annotations

import math

import numpy as np

from stereo_selfcal.core.geometry.alignment import optical_rotation
from stereo_selfcal.core.types import Array

_INK, _ARROW, _FRAME = "#333333", "#d55e00", "#0072b2"  # Okabe and Ito
_ANGLE = math.radians(6)  # much larger than that of any car, to be seen
_PX = 165.0  # for one unit of x or y, the tangent of the angle to the optical axis
_HALF = (0.8, 0.48)  # of the image, in these units
_COLUMNS, _ROWS = 7, 5
_PANEL, _TOP = 320, 128

# Angle, what it is, and what follows.
_PANELS = (
    ("pitch", "pitch > 0: nose down", "rows lie too high"),
    ("roll", "roll > 0: right side down", "higher at the right, lower at the left"),
    ("yaw", "yaw > 0: too far left", "disparities too small: depths too large"),
)


def alignment_svg() -> bytes:
    """Draw where points of the right image move, by the rotation that all results use."""
    body = "\n".join(_panel(index, *panel) for index, panel in enumerate(_PANELS))
    width = _PANEL * len(_PANELS)
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} 250"
 font-family="sans-serif" font-size="14">
<title>What a turned right camera shows, against where the rig has it</title>
<defs><marker id="head" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="5" markerHeight="5" orient="auto">\
<path d="M0 0 L10 5 L0 10 z" fill="{_ARROW}"/></marker></defs>
<rect width="{width}" height="250" rx="6" fill="#ffffff"/>
{body}
</svg>
""".encode()


def _panel(index: int, name: str, title: str, caption: str) -> str:
    middle = np.array([_PANEL * (index + 0.5), _TOP])
    half = np.array(_HALF) * _PX
    left, top = middle - half
    parts = [
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{2 * half[0]:.1f}" height="{2 * half[1]:.1f}" '
        f'fill="none" stroke="{_FRAME}" stroke-width="2"/>',
        _text(middle[0], 30, f"<tspan font-weight='bold'>{title.replace('>', '&gt;')}</tspan>"),
        _text(middle[0], 236, caption),
    ]
    angles = {"pitch_rad": 0.0, "roll_rad": 0.0, "yaw_rad": 0.0, f"{name}_rad": _ANGLE}
    x, y = (np.linspace(-0.82, 0.82, n) * size for n, size in zip((_COLUMNS, _ROWS), _HALF, strict=True))
    before = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    for a, b in zip(before, _moved(before, angles), strict=True):
        start, end = middle + a * _PX, middle + b * _PX
        parts.append(f'<circle cx="{start[0]:.1f}" cy="{start[1]:.1f}" r="2" fill="{_INK}"/>')
        if np.hypot(*(end - start)) > 1.0:
            parts.append(
                f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" '
                f'stroke="{_ARROW}" stroke-width="1.8" marker-end="url(#head)"/>'
            )
    return "\n".join(parts)


def _moved(points: Array, angles: dict[str, float]) -> Array:
    """Return where far points (N, 2) of a straight camera lie in a turned one; x right, y down."""
    rays = np.column_stack([points, np.ones(len(points))])
    turned = rays @ optical_rotation(**angles)  # each ray by the inverse rotation
    moved: Array = turned[:, :2] / turned[:, 2:]
    return moved


def _text(x: float, y: float, text: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{_INK}" text-anchor="middle">{text}</text>'
