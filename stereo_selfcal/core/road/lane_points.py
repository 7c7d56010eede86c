"""The part of a road that the pose describes: points of the own lane, over which the plane is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.linear import solve_each
from ..types import Array, Indices
from .priors import HALF_LANE_WIDTH_M

# The pose describes the own lane. A plane over an uneven road depends on the part that counts, and there is
# no one right part. It may begin behind the bonnet or at the first row of a camera behind the windscreen
# (KITTI's lidar planes: 5.5 to 20 m): the pose is the mean of both. It may be that of the tracks of the
# wheels, of the lane with its shoulders, or of both lanes of a road: how their planes differ from that of the
# lane, as far as it is seen or follows from the road's usual shape, is an uncertainty.
STRETCHES_M = ((3.0, 15.0), (5.0, 20.0))
NEAREST_STRETCH_M = (3.0, 10.0)  # on which the car stands, and most pixels lie
OTHER_HALF_WIDTHS_M = (1.0, 2.5, 4.0)

_LEAST_COLUMNS = 2  # of the points of a lane: with one, its roll is open


@dataclass(frozen=True, slots=True, eq=False)
class LanePoints:
    """Points of the own lane at equal distances, over which the plane is fitted.

    Attributes:
        xy: (T, 2) positions relative to the point under the camera [m].
        aside_m: (T,) distances from the camera's path along the lane, to the left [m].
        design: (T, 3) derivative of the heights there by the parameters of the plane.
        strip: (T,) strip along the road in which each point lies, as of the cells.
        middle: Strip of the middle of the lane.
    """

    xy: Array
    aside_m: Array
    design: Array
    strip: Indices
    middle: int

    def planes(self, strips: tuple[int, int], half_width_m: float) -> Array:
        """Return the matrices (3, 3, T) that give the plane of each stretch from the heights of all points.

        They are those of ``STRETCHES_M``, and then that of the nearest one.

        Args:
            strips: First and last strip of the road; points beyond them do not count.
            half_width_m: How far from the camera's path points count. A narrow road may leave no more than a
                side of the lane: then that counts, as wide as it is.
        """
        on_road = (self.strip >= strips[0]) & (self.strip <= strips[1])
        within = on_road & (np.abs(self.aside_m) <= half_width_m)
        if len(np.unique(self.aside_m[within])) < _LEAST_COLUMNS:
            within = on_road
        ahead, columns = self.xy[:, 0], self.design.T
        stretches_m = np.array([*STRETCHES_M, NEAREST_STRETCH_M])[:, :, None]
        inside = within & (ahead >= stretches_m[:, 0]) & (ahead <= stretches_m[:, 1])
        counted = inside[:, None] * columns
        return solve_each(counted @ self.design, counted)

    def plane_of_lane(self, strips: tuple[int, int]) -> Array:
        """Return the matrix (3, T) that gives the plane of the own lane from the heights of the points.

        Args:
            strips: First and last strip of the road.
        """
        plane: Array = self.planes(strips, HALF_LANE_WIDTH_M)[: len(STRETCHES_M)].mean(axis=0)
        return plane
