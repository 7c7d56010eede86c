"""The result for RViz: a patch of the road, the lane lines on it, and the camera over it."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ..core.camera.rig import StereoRig
from ..core.geometry.homography import apply_homography, road_from_image
from ..core.geometry.pose import POSE_COMPONENTS, Extrinsics
from ..core.lanes.lane_pair import LanePattern
from ..core.types import Array
from ..pictures.canvas import DARK, SKY_BLUE, VERMILION, WHITE, Colour
from ..pictures.road_grid import GRID_FAR_M, GRID_HALF_WIDTH_M
from .messages import quaternion_message, time_message

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


def markers_message(
    extrinsics: Extrinsics, lanes: tuple[Array, ...], road_frame: str, stamp_ns: int
) -> MarkerArray:
    """Return the markers of a result; those of the next result replace them.

    Args:
        extrinsics: The calibration.
        lanes: Lane lines on the road, each (N, 2) [m]; those of an earlier result are deleted.
        road_frame: Name of the road frame.
        stamp_ns: Stamp of the (last) frame [ns].
    """
    road = Marker(ns="road", type=Marker.CUBE, color=_colour(DARK, _ROAD_OPACITY))
    road.scale.x, road.scale.y, road.scale.z = GRID_FAR_M, 2 * GRID_HALF_WIDTH_M, _ROAD_THICKNESS_M
    road.pose.position.x, road.pose.position.z = (
        GRID_FAR_M / 2,
        -_ROAD_THICKNESS_M / 2,
    )  # its top is the road surface

    arrow = Marker(ns="camera", type=Marker.ARROW, color=_colour(SKY_BLUE))
    arrow.scale.x, arrow.scale.y, arrow.scale.z = _ARROW_M
    arrow.pose.position.z = float(extrinsics.height_m)
    arrow.pose.orientation = quaternion_message(extrinsics)

    text = Marker(ns="camera", id=1, type=Marker.TEXT_VIEW_FACING, color=_colour(WHITE))
    text.scale.z = _TEXT_M
    text.pose.position.z = float(extrinsics.height_m) + _TEXT_ABOVE_M
    text.text = _written(extrinsics)

    markers = [road, arrow, text, *(_lane(lanes, number) for number in range(_N_LINES))]
    for marker in markers:
        marker.header.stamp = time_message(stamp_ns)
        marker.header.frame_id = road_frame
    return MarkerArray(markers=markers)


def _written(extrinsics: Extrinsics) -> str:
    """Return the pose as it is written over the camera, with one decimal less than elsewhere."""
    texts = [
        f"{each.label} {each.unit.number(each.of(extrinsics), each.sign, more=-1)} {each.unit.symbol}"
        for each in POSE_COMPONENTS
    ]
    return ", ".join(texts).removeprefix("height ")  # the text stands at the height that it names


def no_markers_message() -> MarkerArray:
    """Return the message that deletes all markers."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def _lane(lanes: tuple[Array, ...], number: int) -> Marker:
    """Return the marker of one lane line, or the one that deletes it."""
    marker = Marker(ns="lane_lines", id=number, type=Marker.LINE_STRIP, color=_colour(VERMILION))
    marker.scale.x = _LINE_WIDTH_M
    points = lanes[number] if number < len(lanes) else ()
    if len(points) < 2:
        marker.action = Marker.DELETE
        return marker
    marker.points = [Point(x=float(x), y=float(y), z=_LINE_HEIGHT_M) for x, y in points]
    return marker


def _colour(colour: Colour, opacity: float = 1.0) -> ColorRGBA:
    blue, green, red = (value / 255 for value in colour)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)
