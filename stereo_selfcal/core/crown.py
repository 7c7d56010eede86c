"""Crowns between the lines of an estimate: what they do to that of the own lane.

Roads fall from a crown to both sides. It lies between two lanes, so that a plane through lines of different
lanes is none of the road: it passes below the crown, and is tilted against either lane.
"""

from __future__ import annotations

import numpy as np

from .extrinsics import Array
from .further import FALL_STD
from .refinement import RefinedFit

# Two lanes side by side are at least this wide each: less is found at road works only.
_NARROWEST_LANE_M = 2.5
# Between the middles of the lines of one lane there is at most this: the widest of motorways, 3.75 m, and the
# widest line, 0.30 m. Lines farther apart are not of one lane alone, whatever the other part is.
_WIDEST_LANE_M = 4.05


def covariance_by_crown(refined: RefinedFit | None) -> Array:
    """Return the covariance (3, 3) that crowns give an estimate from lines, as one of the own lane.

    A line that was measured between the boundaries shows how the own lane lies; where there is none and the
    boundaries are farther apart than the lines of one lane, the slope changes between them, as it does from
    lane to lane; of n lanes at most.
    Lines nearer to each other than any lane is wide (one of them is an arrow) show a part of the own one.

    Args:
        refined: Positions of the stripes, and heights of those beside the boundaries.

    Returns:
        Zeros where the stripes are those of one lane, in one plane.
    """
    covariance = np.zeros((3, 3))
    if refined is None:
        return covariance
    places, heights = refined.positions_m, refined.heights_m
    if np.any(places > 0.0) and np.any(places < 0.0):
        left = int(np.argmin(np.where(places > 0.0, places, np.inf)))
        right = int(np.argmax(np.where(places < 0.0, places, -np.inf)))
    else:  # one is an arrow before the camera
        left, right = int(np.argmax(places[:2])), int(np.argmin(places[:2]))
    width_m = places[left] - places[right]
    # Height of the own lane over the plane below the camera, and how it rises to the left: what lies higher
    # makes the camera lower; what rises to the left, its roll less.
    rise = (heights[left] - heights[right]) / width_m
    higher_m = heights[right] - rise * places[right]
    shown = np.array([higher_m, 0.0, rise])
    covariance += np.outer(shown, shown)
    lanes = max(2, int(width_m / _NARROWEST_LANE_M)) if width_m > _WIDEST_LANE_M else 1
    near, far = sorted((places[left], places[right]), key=abs)
    if lanes > 1:
        # The plane goes through both borders, the lane of the camera through the nearer one.
        hidden, border_m = (lanes - 1) / lanes, near
    else:
        # The border of the lane is the farther one: the arrow lies before the camera.
        hidden, border_m = max(0.0, 1.0 - float(np.ptp(places)) / _NARROWEST_LANE_M), far
    by_slope = FALL_STD * hidden * np.array([-border_m, 0.0, 1.0])
    return covariance + np.outer(by_slope, by_slope)
