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

"""The drawing of docs/conventions.md: frames and signs, of the camera over the road and in the vehicle.

It is computed from the rotation that all results use, so that it cannot show another sign.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stereo_selfcal.core.geometry.pose import BODY_FROM_OPTICAL, road_from_camera_rotation
from stereo_selfcal.core.types import Array

# Angles of the drawing, much larger than those of any car, to be seen.
_PITCH, _ROLL, _YAW = math.radians(14), math.radians(14), math.radians(18)
_INK, _ROAD, _CAMERA, _ANGLE = "#333333", "#0072b2", "#d55e00", "#009e73"  # Okabe and Ito
_OPTICAL = "#8f3f71"  # their purple, darker: text in it can be read on white
_ROW_PX = 330  # height of the first row of panels
_SECOND_PX = 420
_RIGHT, _UP = (0, -1, 0), (1, 0, 0)  # of a view from above: ahead is up


def frames_svg() -> bytes:
    """Draw the frames and the signs: over the road, and below in the vehicle."""
    side = _Panel("from the right side", "pitch > 0: nose down", right=(1, 0, 0), up=(0, 0, 1), left=20)
    behind = _Panel("from behind", "roll > 0: right side down", right=(0, -1, 0), up=(0, 0, 1), left=350)
    above = _Panel("from above", "lane_yaw > 0: points left of the lane", right=_RIGHT, up=_UP, left=680)
    side.pose(road_from_camera_rotation(_PITCH, 0.0), height=118, axes="xz", turned="x", name="pitch")
    behind.pose(road_from_camera_rotation(0.0, _ROLL), height=118, axes="yz", turned="y", name="roll")
    above.lane(road_from_camera_rotation(0.0, 0.0, _YAW))
    panels = [side, behind, above]

    second = {"top": _ROW_PX, "sign_row": _SECOND_PX - 18}
    vehicle = _Panel(
        "in the vehicle, from above", "yaw > 0: points left of the travel", _RIGHT, _UP, left=20, **second
    )
    vehicle.vehicle(road_from_camera_rotation(0.0, 0.0, _YAW))
    frames = _Panel(
        "the camera from above", "camera_frame names one of the two", _RIGHT, _UP, left=350, **second
    )
    frames.camera_frames()
    travel = _Panel(
        "in the vehicle, from the right",
        "pitch > 0: nose down against the travel",
        (1, 0, 0),
        (0, 0, 1),
        left=680,
        **second,
    )
    travel.travel(road_from_camera_rotation(_PITCH, 0.0), height=118.0)
    panels += [vehicle, frames, travel]
    body = "\n".join(line for panel in panels for line in panel.parts)
    height = _ROW_PX + _SECOND_PX
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1010 {height}"
 font-family="sans-serif" font-size="14">
<title>Frames and signs of stereo_selfcal</title>
<defs>{"".join(_arrow_head(colour) for colour in (_INK, _ROAD, _CAMERA, _ANGLE, _OPTICAL))}</defs>
<rect width="1010" height="{height}" rx="6" fill="#ffffff"/>
<line x1="20" y1="{_ROW_PX}" x2="990" y2="{_ROW_PX}" stroke="#cccccc" stroke-width="1"/>
{body}
</svg>
""".encode()


class _Panel:
    """One view of the drawing: an orthographic projection of road coordinates."""

    def __init__(
        self,
        title: str,
        sign: str,
        right: tuple[int, ...],
        up: tuple[int, ...],
        left: float,
        top: float = 0.0,
        sign_row: float = 312.0,
    ) -> None:
        self._axes = np.array([right, [-value for value in up]], dtype=float)  # rows of an SVG run down
        self._left, self._top = left, top
        self._origin = np.array([left + 120.0, top + 255.0])
        self.parts = [
            _text((left + 155, top + 30), f"<tspan font-weight='bold'>{title}</tspan>", _INK, "middle"),
            _text((left + 155, top + sign_row), _escaped(sign), _ANGLE, "middle"),
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

    def vehicle(self, rotation: Array) -> None:
        """Draw a car from above, its frame, and where a camera sits that does not look along the travel."""
        self._origin = np.array([self._left + 135.0, self._top + 290.0])
        x_m, y_m, half_width = 130.0, 30.0, 88.0
        (left, front), (right, rear) = self._at([220, half_width, 0]), self._at([-60, -half_width, 0])
        self.parts.append(
            f'<rect x="{left:.1f}" y="{front:.1f}" width="{right - left:.1f}" height="{rear - front:.1f}" '
            f'rx="26" fill="#f4f4f4" stroke="{_INK}"/>'
        )
        eye, forward = np.array([x_m, y_m, 0.0]), np.array([1.0, 0.0, 0.0])
        aside, behind = -half_width - 10.0, -34.0
        for a, b in (
            ([x_m, y_m, 0], [x_m, aside, 0]),
            ([0, 0, 0], [0, aside, 0]),
            ([x_m, y_m, 0], [behind, y_m, 0]),
            ([0, 0, 0], [behind, 0, 0]),
        ):
            self.parts.append(_line(self._at(a), self._at(b), "#999999", width=1.0))
        self._distance([0, aside, 0], [x_m, aside, 0], "mount.x_m", (7.0, 5.0))
        self._distance([behind, 0, 0], [behind, y_m, 0], "mount.y_m", (19.0, 5.0))
        self.parts.append(_line(self._at(eye), self._at(eye + 104 * forward), _ROAD, dash=True, arrow=True))
        end = self._at(eye + 106 * forward)
        self.parts.append(_text(end + np.array([10, 2]), "direction of travel", _ROAD, "start"))
        self._frame(np.zeros(3), np.eye(3), "xy", 58, _ROAD)
        self.parts.append(_text(self._at([-84, 0, 0]), "base_footprint, on the road", _ROAD, "middle"))
        self._camera(eye, rotation, "yx")
        self._frame(eye, rotation, "x", 88, _CAMERA)
        self._angle(eye, forward, rotation @ forward, 62, "")
        self.parts.append(_text(self._at(eye + 52 * forward) + np.array([8, 0]), "yaw", _ANGLE, "start"))

    def camera_frames(self) -> None:
        """Draw the two frames of a camera: that of its body, and the optical frame of the left camera."""
        self._origin = np.array([self._left + 165.0, self._top + 220.0])
        half = 100.0
        left, right = np.array([0.0, half, 0.0]), np.array([0.0, -half, 0.0])
        self.parts.append(_line(self._at(left), self._at(right), "#f0d0b0", width=14))
        for eye in (left, right):
            corner = np.array([11.0, 17.0, 0.0])
            (x1, y1), (x2, y2) = self._at(eye + corner), self._at(eye - corner)
            self.parts.append(
                f'<rect x="{x1:.1f}" y="{y1:.1f}" width="{x2 - x1:.1f}" height="{y2 - y1:.1f}" '
                f'fill="#f0d0b0" stroke="{_CAMERA}"/>'
            )
        self._frame(np.zeros(3), np.eye(3), "x", 88, _CAMERA)
        self._frame(np.zeros(3), np.eye(3), "y", 46, _CAMERA, aside=(0, -9))
        self._frame(left, BODY_FROM_OPTICAL, "z", 88, _OPTICAL)
        self._frame(left, BODY_FROM_OPTICAL, "x", 40, _OPTICAL, aside=(0, 20))
        x, y = self._at(left)  # its y axis points away from the viewer
        self.parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8" fill="#ffffff" stroke="{_OPTICAL}" stroke-width="2"/>'
        )
        for turn in (1, -1):
            ends = (np.array([x, y]) + sign * np.array([5.6, 5.6 * turn]) for sign in (1, -1))
            self.parts.append(_line(*ends, _OPTICAL, width=2))
        self.parts.append(_text((x - 14, y + 32), "y, down", _OPTICAL, "middle"))
        row = self._top + 290.0
        for column, colour, lines in (
            (x + 4, _OPTICAL, ("left camera,", "optical frame")),
            (self._at([0, 0, 0])[0] + 14, _CAMERA, ("stereo_camera,", "body")),
            (self._at(right)[0] - 4, _INK, ("right", "camera")),
        ):
            for number, line in enumerate(lines):
                self.parts.append(_text((column, row + 18 * number), line, colour, "middle"))

    def travel(self, rotation: Array, height: float) -> None:
        """Draw the vehicle's frame and the camera from the side, and its pitch against the travel."""
        self._origin = np.array([self._left + 50.0, self._top + 275.0])
        x_m, (_, ground) = 90.0, self._origin
        self.parts.append(
            f'<line x1="{self._left + 10}" y1="{ground}" x2="{self._left + 300}" y2="{ground}" '
            f'stroke="#999999" stroke-width="5"/>'
        )
        eye, forward = np.array([x_m, 0.0, height]), np.array([1.0, 0.0, 0.0])
        foot = self._at([x_m, 0, 0])
        self.parts.append(_line(foot, self._at(eye), _INK, dash=True))
        self.parts.append(_text((foot + self._at(eye)) / 2 + np.array([8, 5]), "height", _INK, "start"))
        self._frame(np.zeros(3), np.eye(3), "xz", 62, _ROAD, aside=(11, -3))
        self.parts.append(_text((self._left + 10, ground + 60), "base_footprint", _ROAD, "start"))
        for end in (self._at([0, 0, 0]), foot):
            self.parts.append(_line(end, end + np.array([0, 30]), "#999999", width=1.0))
        self._distance([0, 0, -24], [x_m, 0, -24], "mount.x_m", (52.0, 5.0))
        self.parts.append(_line(self._at(eye), self._at(eye + 165 * forward), _ROAD, dash=True, arrow=True))
        end = self._at(eye + 165 * forward) - np.array([0, 10])
        self.parts.append(_text(end, "direction of travel", _ROAD, "end"))
        self._camera(eye, rotation, "xz")
        self._frame(eye, rotation, "x", 88, _CAMERA)
        self._angle(eye, forward, rotation @ forward, 120, "pitch")

    def _distance(
        self, a: Sequence[float], b: Sequence[float], name: str, aside: tuple[float, float]
    ) -> None:
        """Draw a distance between two points as a line with a head at both ends, and its name beside it."""
        start, end = self._at(a), self._at(b)
        middle = (start + end) / 2
        for tip in (start, end):
            self.parts.append(_line(middle, tip, _INK, arrow=True))
        self.parts.append(_text(middle + np.array(aside), name, _INK, "start"))

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
