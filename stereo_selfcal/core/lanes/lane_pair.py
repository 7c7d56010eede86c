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

"""The calibration pattern: lane lines seen by both cameras, sampled row by row."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..camera.working_size import WorkingSize
from ..types import Array


@dataclass(frozen=True, slots=True, eq=False)
class ImageLine:
    """A straight line in one image: ``u(v) = u_mid + slope * (v - v_mid)``.

    It is the left edge (the positive gradient) of a painted stripe.

    Attributes:
        u_mid: Column at row ``v_mid`` [px].
        slope: du/dv.
        v_mid: Mean of the rows it was measured in [px].
        covariance: (2, 2) covariance of (u_mid, slope).
        rows: (N,) rows [px] of the measured points.
        columns: (N,) sub-pixel columns [px] of the measured points.
        weights: (N,) relative weights of the measured points in the fit.
        n_rows: Number of image rows behind the measured points.
        width_px: Median width of the stripe along the rows [px].
        contrast: Median contrast of its weaker edge [grey levels].
    """

    u_mid: float
    slope: float
    v_mid: float
    covariance: Array
    rows: Array
    columns: Array
    weights: Array
    n_rows: int
    width_px: float
    contrast: float

    @property
    def length_px(self) -> float:
        """Length of the line behind the measured points [px]: a flat line has few rows."""
        return self.n_rows * math.hypot(1.0, self.slope)

    def column_at(self, v: Array) -> Array:
        """Return the column [px] at rows ``v`` [px], the same shape."""
        return self.u_mid + self.slope * (v - self.v_mid)

    def is_same_stripe(self, other: ImageLine) -> bool:
        """Whether another line of the image is closer than the stripe's width, at its middle and its end."""
        at_mid = self.u_mid - other.u_mid - self.slope * self.v_mid + other.slope * other.v_mid
        between = self.slope - other.slope
        return all(
            abs(at_mid + between * v) < self.width_px
            for v in (float(self.rows.mean()), float(self.rows.max()))
        )

    def in_images(self, size: WorkingSize) -> ImageLine:
        """Return the line in images of which it was found in another size."""
        scale = size.scale
        units = np.array([scale, 1.0])
        return replace(
            self,
            u_mid=float(size.in_images(self.u_mid)),
            v_mid=float(size.in_images(self.v_mid)),
            covariance=self.covariance * np.outer(units, units),
            rows=size.in_images(self.rows),
            columns=size.in_images(self.columns),
            n_rows=self.n_rows * scale,
            width_px=self.width_px * scale,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ExtraLine:
    """A line beside the two boundaries of a lane, as both cameras see it.

    Attributes:
        left: The line in the left image.
        right: The same in the right image.
        height_std_m: Standard deviation of its height over the plane of the boundaries [m], as roads fall to
            their sides.
    """

    left: ImageLine
    right: ImageLine
    height_std_m: float


@dataclass(frozen=True, slots=True, eq=False)
class LanePattern:
    """The lane lines of both cameras, matched and sampled (paper section 2.2, figure 3b).

    The two boundaries of a lane, which are the paper's whole pattern, determine the plane. L - 2 extra lines
    are parallel to them.

    Attributes:
        left: Left and right lane boundary in the left camera.
        right: The same two lines seen by the right camera.
        vanishing_point: (2,) column and row where the boundaries meet [px].
        rows: (N,) sampled image rows [px].
        columns: (2, L, N) columns [px] of camera (left, right), line (boundaries first), row.
        extra_lines: The other lines, L - 2.
    """

    left: tuple[ImageLine, ImageLine]
    right: tuple[ImageLine, ImageLine]
    vanishing_point: Array
    rows: Array
    columns: Array
    extra_lines: tuple[ExtraLine, ...] = ()

    @property
    def lines(self) -> tuple[tuple[ImageLine, ...], tuple[ImageLine, ...]]:
        """All L lines in the left and in the right camera."""
        return (
            (*self.left, *(line.left for line in self.extra_lines)),
            (*self.right, *(line.right for line in self.extra_lines)),
        )

    @property
    def pairs(self) -> list[tuple[ImageLine, ImageLine]]:
        """The two boundaries, each in the left and in the right camera."""
        return list(zip(self.left, self.right, strict=True))

    @property
    def boundaries(self) -> LanePattern:
        """The pattern of the two boundaries alone."""
        return replace(self, columns=self.columns[:, :2], extra_lines=()) if self.extra_lines else self

    @property
    def height_stds_m(self) -> Array:
        """(L,) standard deviations of the lines' heights over the plane [m]; zeros for the boundaries."""
        return np.array([0.0, 0.0, *(line.height_std_m for line in self.extra_lines)])

    def in_images(self, size: WorkingSize) -> LanePattern:
        """Return the pattern in images of which it was found in another size."""
        left, right = (
            (lines[0].in_images(size), lines[1].in_images(size)) for lines in (self.left, self.right)
        )
        extra_lines = tuple(
            replace(each, left=each.left.in_images(size), right=each.right.in_images(size))
            for each in self.extra_lines
        )
        return LanePattern(
            left,
            right,
            size.in_images(self.vanishing_point),
            size.in_images(self.rows),
            size.in_images(self.columns),
            extra_lines,
        )

    def joined(self, extra_lines: tuple[ExtraLine, ...]) -> LanePattern:
        """Return the boundaries together with extra lines."""
        columns = [
            [line.column_at(self.rows) for line in (*pair, *others)]
            for pair, others in (
                (self.left, [line.left for line in extra_lines]),
                (self.right, [line.right for line in extra_lines]),
            )
        ]
        return replace(self, columns=np.array(columns), extra_lines=extra_lines)


def row_towards(vanishing_point: Array, fraction: float, rig: StereoRig) -> float:
    """Return the row [px], at least 0, at a fraction of the vanishing point's height over the bottom row."""
    bottom = rig.height - 1.0
    return max(0.0, bottom - fraction * (bottom - float(vanishing_point[1])))
