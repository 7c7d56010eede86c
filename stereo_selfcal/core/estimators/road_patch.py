"""A small bird's-eye view of the road ahead, by which another frame can tell how far the car has driven.

Corners of road surface are seldom found again from a metre farther on: near and far asphalt looks different.
Its patches are, seen from above. A patch takes 12 kB; the image is not needed any more.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..geometry.homography import image_from_road
from ..geometry.pose import Extrinsics
from ..numerics.linear import solve_linear
from ..rejection import NotFitted
from ..types import Image

CELL_M = 0.05
_LENGTH_M, _HALF_WIDTH_M = 10.0, 1.2  # the lane between its lines, as far as asphalt is seen with texture
_MARGIN = 0.02  # of the height of the image, that the nearest cells stay away from its border


@dataclass(frozen=True, slots=True, eq=False)
class RoadPatch:
    """Grey values of the road ahead.

    Attributes:
        grey: (L, W) grey values, uint8: the first row is the nearest one, the first column the leftmost one.
        near_m: How far ahead of the rig the first row is [m].
    """

    grey: Image
    near_m: float


def road_patch(image: Image, rig: StereoRig, pose: Extrinsics) -> RoadPatch | None:
    """Return the bird's-eye view of the road ahead, as the left camera sees it.

    Args:
        image: Left image, (H, W) uint8.
        rig: Intrinsics and baseline.
        pose: Pose over the road; good to a tenth of a degree.

    Returns:
        The view; None where the lower border of the image shows no road.
    """
    pixel_from_road = image_from_road(rig, pose, "left")
    below = np.array([rig.cx, (1.0 - _MARGIN) * rig.height, 1.0])
    ray = solve_linear(pixel_from_road, below, "numbers of the place that the lower border shows")
    if isinstance(ray, NotFitted) or not ray[2] > 0.0:
        return None
    near_m = float(ray[0] / ray[2])
    size = round(2.0 * _HALF_WIDTH_M / CELL_M), round(_LENGTH_M / CELL_M)
    road_from_cell = np.array([[0.0, CELL_M, near_m], [-CELL_M, 0.0, _HALF_WIDTH_M], [0.0, 0.0, 1.0]])
    seen = cv2.warpPerspective(
        image, pixel_from_road @ road_from_cell, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    return RoadPatch(np.asarray(seen, np.uint8), near_m)
