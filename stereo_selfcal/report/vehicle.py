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

"""What the page shows of the direction of travel: the yaw over time, and the camera in the car from above."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.drive.travel import ahead_only, angles_against
from ..core.geometry.travel import MOUNT_YAW_STD_RAD, Travel
from ..core.results import CalibrationResult
from ..offline import Replay
from ..pictures.travel_direction import shown_travel
from .charts import WIDTH, Array, Level, time_series
from .figures import time_axis
from .pictures import digits

_NO_TIMES: Array = np.zeros(0)
# The sketch, in the same units as the charts. The car drives to the right, so its left side is up.
_SKETCH_HEIGHT = 240
_MIDDLE = _SKETCH_HEIGHT / 2.0
_REAR_AXLE, _CAMERA, _TRAVEL_END = 120.0, 290.0, 690.0
_AXIS, _HEADING, _ARC = 72.0, 210.0, 180.0
_BASELINE = 34.0  # half of it
_EXAGGERATIONS = (50, 20, 10, 5, 2)
_MOST_DRAWN_RAD = math.radians(25.0)


def yaw_chart(replay: Replay) -> list[dict[str, str]]:
    """Return the yaw of each step against the direction of travel over time; none where it is not known.

    A step that tells it less well than any mount is known is left out. In bends the camera, which is ahead
    of the rear axle, moves sideways; that much, by the length that the drive shows, is taken off.

    Args:
        replay: The recording's outcome.
    """
    travel, pose = shown_travel(replay.estimate), replay.estimate.extrinsics
    steps = [
        step
        for step in ahead_only(replay.travel_steps)
        if math.sqrt(float(step.noise()[0])) < MOUNT_YAW_STD_RAD
    ]
    if travel is None or pose is None or not steps:
        return []
    time, time_label = time_axis(replay.rows)
    against, _ = angles_against(np.array([step.direction for step in steps]), pose.roll_rad)
    sideways = travel.lever_m * np.array([step.curvature_per_m for step in steps])
    times = np.array([time(step.middle_s) for step in steps])
    levels = []
    for segment in replay.drive.segments:
        told = shown_travel(segment.estimate)
        if told is not None:
            yaw_deg, std_deg = math.degrees(told.yaw_rad), math.degrees(float(told.std[0]))
            levels.append(Level(time(segment.start_s), time(segment.end_s), yaw_deg, std_deg))
    moves = [time(change.at_s) for change in replay.drive.changes]
    labels = "Yaw of the camera against the direction of travel over time", time_label
    svg = time_series(times, np.degrees(against + sideways), _NO_TIMES, levels, moves, labels)
    return [{"title": "Yaw [deg], against the direction of travel", "svg": svg}]


def vehicle_section(estimate: CalibrationResult) -> dict[str, Any] | None:
    """Return what the section of the vehicle says; None while the yaw is not known.

    Args:
        estimate: Estimate of the mount.
    """
    travel = shown_travel(estimate)
    if travel is None or not estimate.accepted:
        return None
    yaw_deg, std_deg = math.degrees(travel.yaw_rad), digits(math.degrees(float(travel.std[0])))
    side = "left" if travel.yaw_rad >= 0.0 else "right"
    sketch = _Sketch(travel)
    return {
        "sentence": f"The camera points {abs(yaw_deg):.2f}° (standard deviation {std_deg}°) to the {side} "
        "of the direction of travel.",
        "svg": sketch.svg(),
        "drawn": sketch.remark,
    }


@dataclass(frozen=True, slots=True)
class _Sketch:
    """The car from above, with its frame, the camera, and the yaw exaggerated.

    Attributes:
        travel: The direction of travel, which tells the yaw.
    """

    travel: Travel

    @property
    def factor(self) -> int:
        """How many times as large the yaw is drawn as it is, so that it can be seen."""
        reach_rad = abs(self.travel.yaw_rad) + float(self.travel.std[0])
        return next((n for n in _EXAGGERATIONS if n * reach_rad <= _MOST_DRAWN_RAD), 1)

    @property
    def drawn_rad(self) -> float:
        """The yaw as it is drawn [rad]."""
        yaw_rad = self.factor * self.travel.yaw_rad
        return min(max(yaw_rad, -_MOST_DRAWN_RAD), _MOST_DRAWN_RAD)

    @property
    def remark(self) -> str:
        """A sentence that says how the yaw is drawn; "" where it is as large as it is."""
        if self.factor > 1:
            return f"The yaw is drawn {self.factor} times as large as it is."
        return "The yaw is drawn smaller than it is." if self.drawn_rad != self.travel.yaw_rad else ""

    def svg(self) -> str:
        """Return the drawing as SVG, in the page's colours."""
        yaw, std = self.drawn_rad, self.factor * float(self.travel.std[0])
        to_left = self.travel.yaw_rad >= 0.0
        heading, left = _towards(yaw), _towards(yaw + math.pi / 2.0)
        above, below = -10.0, 22.0
        end = _from_camera(_HEADING * heading)
        text = f"yaw {math.degrees(self.travel.yaw_rad):+.2f}°"
        beside, aside = (above, below) if to_left else (below, above)
        parts = [
            '<rect class="car" x="60" y="52" width="330" height="136" rx="34"/>',
            '<path class="car" d="M262 66L304 80V160L262 174M104 74L88 88V152L104 166"/>',
            _wedge(yaw - std, yaw + std),
            _arrow("of-vehicle dashed", (_REAR_AXLE, _MIDDLE), (_TRAVEL_END, _MIDDLE)),
            _arrow("of-vehicle", (_REAR_AXLE, _MIDDLE), (_REAR_AXLE + _AXIS, _MIDDLE)),
            _arrow("of-vehicle", (_REAR_AXLE, _MIDDLE), (_REAR_AXLE, _MIDDLE - _AXIS)),
            _text("of-vehicle middle", _REAR_AXLE + _AXIS, _MIDDLE + below, "x"),
            _text("of-vehicle middle", _REAR_AXLE + 16.0, _MIDDLE - _AXIS + 16.0, "y"),
            _text("of-vehicle end", _TRAVEL_END + 16.0, _MIDDLE + aside, "direction of travel"),
            _line("of-camera rig", _from_camera(-_BASELINE * left), _from_camera(_BASELINE * left)),
            _arrow("of-camera", _from_camera(np.zeros(2)), end),
            _text("of-camera", end[0] + 6.0, end[1] + beside, text),
            _arc(yaw),
        ]
        label = f"The camera in the car from above: it points to the {'left' if to_left else 'right'}"
        return (
            f'<svg viewBox="0 0 {WIDTH} {_SKETCH_HEIGHT}" role="img" aria-label="{label}">'
            + "".join(parts)
            + "</svg>"
        )


def _towards(angle_rad: float) -> Array:
    """Return the direction (2,) in the sketch that is turned to the left of ahead; rows run down."""
    return np.array([math.cos(angle_rad), -math.sin(angle_rad)])


def _from_camera(offset: Array) -> tuple[float, float]:
    return _CAMERA + float(offset[0]), _MIDDLE + float(offset[1])


def _wedge(first_rad: float, last_rad: float) -> str:
    """Return the band of a standard deviation around the heading."""
    corners = (_from_camera(_HEADING * _towards(angle)) for angle in np.linspace(first_rad, last_rad, 9))
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in corners)
    return f'<path class="band" d="M{_CAMERA:.1f} {_MIDDLE:.1f}L{path}Z"/>'


def _arc(angle_rad: float) -> str:
    """Return the angle from the direction of travel to the heading."""
    points = (_from_camera(_ARC * _towards(part * angle_rad)) for part in np.linspace(0.0, 1.0, 9))
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path class="angle" d="M{path}"/>'


def _line(kind: str, start: tuple[float, float], end: tuple[float, float]) -> str:
    (x1, y1), (x2, y2) = start, end
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _arrow(kind: str, start: tuple[float, float], end: tuple[float, float]) -> str:
    """Return a line with a head of two strokes."""
    along = np.array(end) - np.array(start)
    back = -9.0 * along / np.hypot(*along)
    sides = (np.array(end) + back @ np.array([[0.87, turn], [-turn, 0.87]]) for turn in (0.5, -0.5))
    (x1, y1), (x2, y2) = sides
    tip = f"M{x1:.1f} {y1:.1f}L{end[0]:.1f} {end[1]:.1f}L{x2:.1f} {y2:.1f}"
    return f'{_line(kind, start, end)}<path class="{kind.split(maxsplit=1)[0]}" d="{tip}"/>'


def _text(kind: str, x: float, y: float, text: str) -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{text}</text>'
