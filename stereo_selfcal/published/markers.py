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

"""The result in three dimensions: a patch of the road, its lane lines, the camera, the axes of the vehicle.

All is placed in the parent frame of :class:`.CameraInVehicle`: the vehicle's frame where the yaw is known,
else the road's frame. What is known in the road's frame (the road, its lanes, the camera) is carried there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import apply_homography, road_from_image
from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, Extrinsics, road_from_camera_rotation
from ..core.geometry.vehicle import CameraInVehicle, RigidTransform
from ..core.lanes.lane_pair import LanePattern
from ..core.types import Array
from ..pictures.canvas import BLUE, DARK, SKY_BLUE, VERMILION, WHITE, Colour
from ..pictures.road_grid import GRID_FAR_M, GRID_HALF_WIDTH_M

_ROAD_THICKNESS_M = 0.01
_ROAD_OPACITY = 0.5
_LINE_WIDTH_M = 0.12  # of painted lane lines (RMS and VwV-StVO: 0.12 and 0.15 m)
_LINE_HEIGHT_M = 0.02  # over the road, so that the road does not hide it
_LINE_FAR_M = 2 * GRID_FAR_M  # beyond it, a pixel spans many metres
_LINE_POINTS = 16
_ARROW_M = (1.0, 0.08, 0.16)  # length, width, height
_TEXT_M = 0.25
_TEXT_ABOVE_M = 0.4
_N_LINES = 2
# Axes of the vehicle as RViz draws those of a frame: x red, y green, z blue, 1 m long.
_AXIS_M = 1.0
_AXIS_COLOURS: tuple[Colour, Colour, Colour] = ((0, 0, 255), (0, 255, 0), (255, 0, 0))
_AXIS_SHAFT_M, _AXIS_HEAD_M = 0.05, 0.1
# The direction of travel lies on the road, from where it hides neither the axes nor the camera.
_TRAVEL_START_M, _TRAVEL_END_M = 2.0, 8.0
_TRAVEL_SHAFT_M, _TRAVEL_HEAD_M = 0.08, 0.24


class ShapeKind(IntEnum):
    """Types of visualization_msgs/Marker that are used."""

    ARROW = 0
    CUBE = 1
    LINE_STRIP = 4
    TEXT_VIEW_FACING = 9


@dataclass(frozen=True, slots=True, eq=False)
class MarkerShape:
    """One visualization_msgs/Marker.

    Attributes:
        namespace: Its namespace.
        kind: Its type.
        number: Its number within the namespace.
        scale_m: What its type understands by x, y and z of the scale [m].
        colour: Its colour.
        opacity: From 0 to 1.
        pose: Where it is in the parent frame.
        points_m: Its points (N, 3) in the parent frame [m], of a line or an arrow between two points.
        text: Its text.
        shown: Whether it is there; else the marker of this name is deleted.
    """

    namespace: str
    kind: ShapeKind
    number: int = 0
    scale_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    colour: Colour = WHITE
    opacity: float = 1.0
    pose: RigidTransform | None = None
    points_m: tuple[tuple[float, float, float], ...] = ()
    text: str = ""
    shown: bool = True


def lanes_on_road(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> tuple[Array, ...]:
    """Return the lane lines of the left camera on the road, each (N, 2): x ahead, y to the left [m].

    Args:
        pattern: Lines of an accepted frame.
        rig: The rig it comes from.
        extrinsics: Its pose over the road.
    """
    matrix, lanes = road_from_image(rig, extrinsics, "left"), []
    for line in pattern.left:
        rows = np.linspace(line.rows.max(), line.rows.min(), _LINE_POINTS)
        points = apply_homography(matrix, np.column_stack([line.column_at(rows), rows]))
        seen = np.isfinite(points).all(axis=1) & (points[:, 0] > 0) & (points[:, 0] < _LINE_FAR_M)
        lanes.append(points[seen])
    return tuple(lanes)


def result_markers(
    extrinsics: Extrinsics, lanes: tuple[Array, ...], camera: CameraInVehicle | None = None
) -> tuple[MarkerShape, ...]:
    """Return the markers of a result; those of the next result replace them, or are deleted by it.

    Args:
        extrinsics: The calibration.
        lanes: Lane lines on the road, each (N, 2) [m]; those of an earlier result are deleted.
        camera: The camera in the vehicle; None: the parent frame is that of the road. While its yaw is not
            known there are no axes of the vehicle and no direction of travel.
    """
    yaw_known = camera is not None and camera.yaw_known
    on_road = RigidTransform(np.eye(3), np.zeros(3)) if camera is None else camera.parent_from_road
    road_from_body = RigidTransform(
        road_from_camera_rotation(extrinsics.pitch_rad, extrinsics.roll_rad),
        np.array([0.0, 0.0, extrinsics.height_m]),
    )
    middle_m = np.array([GRID_FAR_M / 2, 0.0, -_ROAD_THICKNESS_M / 2])  # its top is the road surface
    road = MarkerShape(
        "road",
        ShapeKind.CUBE,
        scale_m=(GRID_FAR_M, 2 * GRID_HALF_WIDTH_M, _ROAD_THICKNESS_M),
        colour=DARK,
        opacity=_ROAD_OPACITY,
        pose=on_road.after(RigidTransform(np.eye(3), middle_m)),
    )
    arrow = MarkerShape(
        "camera", ShapeKind.ARROW, scale_m=_ARROW_M, colour=SKY_BLUE, pose=on_road.after(road_from_body)
    )
    written = _written(extrinsics)
    if yaw_known:
        written += f", yaw {DEGREES.number(on_road.roll_pitch_yaw()[2], '+', more=-1)} {DEGREES.symbol}"
    above_m = on_road.apply([0.0, 0.0, extrinsics.height_m + _TEXT_ABOVE_M])
    text = MarkerShape(
        "camera",
        ShapeKind.TEXT_VIEW_FACING,
        number=1,
        scale_m=(0.0, 0.0, _TEXT_M),
        pose=RigidTransform(np.eye(3), above_m),
        text=written,
    )
    lane_lines = (_lane(lanes, number, on_road) for number in range(_N_LINES))
    return (road, arrow, text, *lane_lines, *_vehicle(on_road, yaw_known))


def _vehicle(on_road: RigidTransform, yaw_known: bool) -> list[MarkerShape]:
    """Return the axes of the vehicle's frame and the direction of travel, or the markers that delete them."""
    origin, axes = np.zeros(3), np.eye(3)
    arrows = [
        _arrow("vehicle", number, (origin, _AXIS_M * axis), colour, (_AXIS_SHAFT_M, _AXIS_HEAD_M))
        for number, (axis, colour) in enumerate(zip(axes, _AXIS_COLOURS, strict=True))
    ]
    under_camera = on_road.translation_m + _LINE_HEIGHT_M * axes[2]
    start, end = (under_camera + ahead_m * axes[0] for ahead_m in (_TRAVEL_START_M, _TRAVEL_END_M))
    arrows.append(_arrow("travel", 0, (start, end), BLUE, (_TRAVEL_SHAFT_M, _TRAVEL_HEAD_M)))
    return arrows if yaw_known else [replace(arrow, shown=False) for arrow in arrows]


def _arrow(
    name: str, number: int, ends: tuple[Array, Array], colour: Colour, diameters_m: tuple[float, float]
) -> MarkerShape:
    """Return an arrow between two points (3,) [m]; the diameters are those of its shaft and its head."""
    scale_m = (*diameters_m, 0.0)
    return MarkerShape(
        name, ShapeKind.ARROW, number, scale_m, colour, points_m=tuple(_point(end) for end in ends)
    )


def _point(place_m: Array) -> tuple[float, float, float]:
    x, y, z = map(float, place_m)
    return x, y, z


def _written(extrinsics: Extrinsics) -> str:
    """Return the pose as it is written over the camera, with one decimal less than elsewhere."""
    texts = [
        f"{each.label} {each.unit.number(each.of(extrinsics), each.sign, more=-1)} {each.unit.symbol}"
        for each in POSE_COMPONENTS
    ]
    return ", ".join(texts).removeprefix("height ")  # the text stands at the height that it names


def _lane(lanes: tuple[Array, ...], number: int, on_road: RigidTransform) -> MarkerShape:
    """Return the marker of one lane line, or the one that deletes it."""
    line = MarkerShape("lane_lines", ShapeKind.LINE_STRIP, number, (_LINE_WIDTH_M, 0.0, 0.0), VERMILION)
    points = lanes[number] if number < len(lanes) else ()
    if len(points) < 2:
        return replace(line, shown=False)
    points_m = np.column_stack([points, np.full(len(points), _LINE_HEIGHT_M)])
    return replace(line, points_m=tuple(_point(point_m) for point_m in on_road.apply(points_m)))
