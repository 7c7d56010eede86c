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

"""The part of a road that the pose describes: points of the own lane, over which the plane is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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

_OPEN = 1e-12  # eigenvalues of normal equations below this part of the greatest one are rounding
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

    def plane_and_parts(
        self, strips: tuple[int, int], others_m: tuple[float, ...] = OTHER_HALF_WIDTHS_M
    ) -> tuple[Array, Array]:
        """Return the matrices that give planes of parts of the road from the heights of all points.

        Args:
            strips: First and last strip of the road; points beyond them do not count.
            others_m: Half widths of other parts than the own lane [m].

        Returns:
            That of the plane of the own lane (3, T), which is the mean of those of ``STRETCHES_M``; and those
            of these stretches and of the nearest one, (K, 3, T), over the width of the lane and over the
            others.
        """
        parts = self._planes(strips, (HALF_LANE_WIDTH_M, *others_m))
        return parts[: len(STRETCHES_M)].mean(axis=0), parts

    def _planes(self, strips: tuple[int, int], half_widths_m: tuple[float, ...]) -> Array:
        """Return the matrices (K, 3, T) that give the plane of each stretch, one half width after the other.

        A narrow road may leave no more than a side of the lane: then that counts, as wide as it is.
        """
        on_road = (self.strip >= strips[0]) & (self.strip <= strips[1])
        ahead, columns = self.xy[:, 0], self.design.T
        stretches_m = np.array([*STRETCHES_M, NEAREST_STRETCH_M])[:, :, None]
        of_stretch = on_road & (ahead >= stretches_m[:, 0]) & (ahead <= stretches_m[:, 1])
        inside = []
        for half_m in half_widths_m:
            within = np.abs(self.aside_m) <= half_m
            if len(np.unique(self.aside_m[within & on_road])) < _LEAST_COLUMNS:
                within = on_road
            inside.append(of_stretch & within)
        counted = np.concatenate(inside)[:, None] * columns
        # Points in one column, or none at all, leave numbers of a plane open: those become small.
        inverse = np.linalg.pinv(counted @ self.design, rcond=_OPEN, hermitian=True)
        return np.asarray(inverse @ counted, np.float64)
